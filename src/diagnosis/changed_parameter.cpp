#include "diagnosis/changed_parameter.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "diagnosis/standard.hpp"

namespace atomcam {
namespace {

/// " um": of a parameter that is shifted rather than scaled; empty for a probability, whose coordinate has
/// none.
std::string unit_of(const std::string& name) {
  if (name == "bias") return " counts";
  if (name.starts_with("origin") || name.starts_with("spacing")) return " px";
  if (name.starts_with("angle")) return " degrees";
  return name.starts_with("zernike") ? " um" : "";
}

std::string stage_of_parameter(const std::string& name) {
  if (name == "atom_light" || name == "filling" || name == "survival") return "scene";
  const bool optics = name == "stray_light" || name.starts_with("origin") || name.starts_with("spacing") ||
                      name.starts_with("angle") || name.starts_with("zernike");
  return optics ? "optics" : "sensor";
}

std::string in_words(const Uncertain& one, double change) {
  const char* direction = change > 0 ? "higher" : "lower";
  const bool scaled = one.value(0) == 1;
  if (scaled)
    return fmt::format("{} were {:.2g} % {}", one.name, 100 * std::fabs(one.value(change) - 1), direction);
  if (unit_of(one.name).empty()) return fmt::format("{} were {}", one.name, direction);
  return fmt::format("{} were {:.2g}{} {}", one.name, std::fabs(change), unit_of(one.name), direction);
}

}  // namespace

ChangedParameter changed_parameter(const Population& plain, const std::vector<Uncertain>& open,
                                   const Eigen::VectorXd& z, const Eigen::VectorXd& units,
                                   const Eigen::MatrixXd& own) {
  constexpr int steps = 60;
  constexpr double smallest = 0.1, largest = 300;  // widths of the draws
  const Eigen::MatrixXd slopes = Standard(plain, Part::whole).slopes();
  const Correlation correlation(own);
  const Eigen::VectorXd y = compressed(z);
  const auto size = [&](const Eigen::VectorXd& v) { return correlation.squares(v)(0); };
  const Eigen::VectorXd sizes = correlation.squares(compressed_rows(own).transpose());
  std::vector<double> by_chance(sizes.begin(), sizes.end());
  const auto middle = by_chance.begin() + static_cast<std::ptrdiff_t>(by_chance.size() / 2);
  std::nth_element(by_chance.begin(), middle, by_chance.end());
  const double before = size(y), floor = *middle;
  if (!(before > floor)) return {};
  ChangedParameter best;
  for (std::size_t k = 0; k < open.size(); ++k) {
    const Eigen::VectorXd effect =
        (units.array() > 0)
            .select(slopes.col(static_cast<Eigen::Index>(k)).array() / units.array().max(1e-300), 0.0);
    for (const double sign : {-1.0, 1.0})
      for (int step = 0; step <= steps; ++step) {
        const double change =
            sign * open[k].width * smallest * std::pow(largest / smallest, static_cast<double>(step) / steps);
        const double closed = (before - size(y - compressed(effect * change))) / (before - floor);
        if (closed > best.closed)
          best = {in_words(open[k], change), stage_of_parameter(open[k].name), closed};
      }
  }
  return best;
}

}  // namespace atomcam
