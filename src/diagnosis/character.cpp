#include "diagnosis/character.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <string_view>

#include "diagnosis/deviations.hpp"

namespace atomcam {
namespace {

constexpr double clear = 5;       // standard deviations, of what is told
constexpr double much_more = 2;   // one against the other
constexpr double in_darks = 0.2;  // of the largest deviation: the shutter makes little difference

/// Seen in the mean of all frames.
bool is_static(const StatisticDeclaration& one) {
  return has(one, ".static_") || has(one, ".far_light.") || has(one, ".by_site.") ||
         (has(one, ".point_spread.") && one.axis == "shape");
}

/// Seen in what one frame has and another has not.
bool is_changing(const StatisticDeclaration& one) {
  return one.axis == "time" || has(one, ".lines.") || has(one, ".readout_spectrum.") ||
         has(one, ".common.") || has(one, ".image_noise.") || one.name.ends_with(".lag_1");
}

/// Seen where light falls, or in what follows it.
bool follows_light(const StatisticDeclaration& one) {
  return has(one, ".sites.") || has(one, ".point_spread.") || has(one, ".position.") || has(one, ".focus.") ||
         has(one, ".image_noise.") || has(one, ".trailing.") || has(one, ".far_light.") ||
         has(one, ".neighbours.all.");
}

std::string action_of(const std::vector<StatisticDeclaration>& battery, const Eigen::VectorXd& z) {
  const double all = z.cwiseAbs().maxCoeff();
  const double closed = largest(battery, z, [](const auto& one) { return one.darks; });
  if (closed > std::max(clear, in_darks * all)) return "additive";
  const double with_light =
      largest(battery, z, [](const auto& one) { return !one.darks && follows_light(one); });
  const double without =
      largest(battery, z, [](const auto& one) { return !one.darks && !follows_light(one); });
  if (with_light > std::max(clear, without)) return "multiplicative";
  if (without > std::max(clear, much_more * with_light)) return "additive";
  return "";
}

}  // namespace

Character character_of(const std::vector<StatisticDeclaration>& battery, const Eigen::VectorXd& z) {
  Character character;

  std::map<std::string, double> axes;
  for (std::size_t k = 0; k < battery.size(); ++k)
    if (const double size = std::fabs(z(static_cast<Eigen::Index>(k))); size > clear)
      axes[battery[k].axis] += std::log(size);
  if (!axes.empty())
    character.axis = std::max_element(axes.begin(), axes.end(), [](const auto& a, const auto& b) {
                       return a.second < b.second;
                     })->first;

  const double still = largest(battery, z, is_static), moving = largest(battery, z, is_changing);
  if (std::max(still, moving) > clear)
    character.change = still > much_more * moving   ? "static"
                       : moving > much_more * still ? "changing"
                                                    : "static and changing";
  character.action = action_of(battery, z);

  // A period is told if its own line of the spectrum stands out of all that is odd.
  double most = std::max(clear, z.cwiseAbs().maxCoeff() / much_more);
  for (std::size_t k = 0; k < battery.size(); ++k) {
    const StatisticDeclaration& one = battery[k];
    const double size = std::fabs(z(static_cast<Eigen::Index>(k)));
    if (size <= most) continue;
    const std::size_t at = one.name.rfind(".period_");
    if (at != std::string::npos)
      character.period = fmt::format("{} {}", one.name.substr(at + 8), one.place);
    else if (one.name.ends_with(".odd_frames"))
      character.period = "2 frames";
    else
      continue;
    most = size;
  }
  return character;
}

std::string in_words(const Character& character) {
  std::vector<std::string> words;
  for (const std::string* word : {&character.change, &character.action})
    if (!word->empty()) words.push_back(*word);
  if (!character.axis.empty()) words.push_back("along " + character.axis);
  if (!character.period.empty()) words.push_back("period " + character.period);
  return fmt::format("{}", fmt::join(words, ", "));
}

}  // namespace atomcam
