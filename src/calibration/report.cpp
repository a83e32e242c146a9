#include "calibration/report.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <numbers>

#include "calibration/pearson.hpp"
#include "calibration/report_chart.hpp"
#include "calibration/report_map.hpp"
#include "calibration/report_page.hpp"
#include "calibration/site_light.hpp"
#include "optics/zernike.hpp"

namespace atomcam {
namespace {

using namespace report;

constexpr double nan = std::numeric_limits<double>::quiet_NaN();

class Report {
 public:
  Report(const Calibration& calibration, const CalibrationInput& input)
      : calibration_(calibration), model_(calibration.model), input_(input) {
    light_ = sum_stack(*input.frames);
    if (input.darks) dark_ = sum_stack(*input.darks);
    if (calibration.has_sites) split_frames();
  }

  std::string body(const std::string& command) const {
    std::string out =
        fmt::format("<h1>Calibration: {}</h1>\n<p>{} frames of {} × {} pixels{}{}.</p>\n",
                    escaped(calibration_.lab.name), light_.frames, model_.shape.columns, model_.shape.rows,
                    input_.darks ? fmt::format(", {} with the shutter closed", dark_.frames) : "",
                    calibration_.has_sites ? fmt::format(", {} sites", model_.sites.size()) : "");
    for (const std::string& warning : calibration_.warnings)
      out += fmt::format("<p><b>Warning:</b> {}</p>\n", escaped(warning));
    if (calibration_.has_sites) out += atoms();
    out += sensor();
    if (calibration_.has_sites) out += optics();
    out += maps();
    out +=
        "<h2>Parameters</h2>\n<p class=\"note\">Grey: the frames show the product in the row above, not its "
        "factors; how it splits is from the notes.</p>\n" +
        parameter_table_markup(calibration_);
    out += fmt::format("<h2>Made by</h2>\n<pre>{}</pre>\n", escaped(command));
    return out;
  }

 private:
  void split_frames() {
    SiteLight split(model_);
    rest_mean_.assign(model_.shape.pixels(), 0);
    input_.frames->visit([&](std::size_t, const CountImage& frame) {
      split.split(frame);
      for (const double e : split.brightness_e()) brightness_.push_back(e);
      const auto rest = split.rest_counts();
      for (std::size_t i = 0; i < rest.size(); ++i) rest_mean_[i] += rest[i];
    });
    for (double& value : rest_mean_) value /= static_cast<double>(light_.frames);
  }

  std::string atoms() const {
    const AtomFit& fit = calibration_.atoms;
    const double v0 = fit.noise.empty_variance * fit.empty_variance_ratio,
                 slope = fit.noise.variance_per_e * fit.atom_variance_ratio;
    const double third0 = fit.noise.empty_skewness * std::pow(v0, 1.5);
    const auto component = [&](double e) {
      const double variance = v0 + slope * e;
      return Pearson(fit.empty_e + e, variance,
                     (third0 + fit.noise.third_per_e * e) / std::pow(variance, 1.5));
    };
    const double low = -6 * std::sqrt(v0), high = fit.atom_e + 6 * std::sqrt(v0 + slope * fit.atom_e);
    constexpr int bins = 110;
    const double width = (high - low) / bins;
    Line seen{.label = "frames", .colour = ink, .x = {}, .y = {}, .points = true, .error = {}};
    std::vector<double> count(bins);
    for (const double e : brightness_)
      if (const double k = (e - low) / width; k >= 0 && k < bins) count[static_cast<std::size_t>(k)] += 1;
    Line empty{.label = "empty", .colour = blue, .x = {}, .y = {}, .error = {}},
        stay{.label = "there to the end", .colour = green, .x = {}, .y = {}, .error = {}},
        lost{.label = "lost during the exposure", .colour = orange, .x = {}, .y = {}, .error = {}},
        sum{.label = "sum", .colour = grey, .x = {}, .y = {}, .width = 2.2, .error = {}};
    const auto total = static_cast<double>(brightness_.size());
    const Pearson none = component(0), whole = component(fit.atom_e);
    constexpr int steps = 48;
    const double rate = -std::log(std::max(1e-12, fit.survival));
    for (int k = 0; k < bins; ++k) {
      const double x = low + (k + 0.5) * width;
      // A peak may be narrower than a bin.
      const auto share = [&](const Pearson& law) {
        return law.below(x + 0.5 * width) - law.below(x - 0.5 * width);
      };
      double gone = 0;
      for (int j = 0; j < steps; ++j) {
        const double a = static_cast<double>(j) / steps, b = static_cast<double>(j + 1) / steps;
        gone += (std::exp(-rate * a) - std::exp(-rate * b)) * share(component(fit.atom_e * 0.5 * (a + b)));
      }
      const double parts[3] = {(1 - fit.filling) * share(none) * total,
                               fit.filling * fit.survival * share(whole) * total, fit.filling * gone * total};
      const double seen_here = count[static_cast<std::size_t>(k)];
      seen.x.push_back(x), seen.y.push_back(seen_here), seen.error.push_back(std::sqrt(seen_here));
      empty.x.push_back(x), empty.y.push_back(parts[0]);
      stay.x.push_back(x), stay.y.push_back(parts[1]);
      lost.x.push_back(x), lost.y.push_back(parts[2]);
      sum.x.push_back(x), sum.y.push_back(parts[0] + parts[1] + parts[2]);
    }
    // Below a tenth of a value a law tells nothing on a logarithmic axis.
    for (Line* line : {&empty, &stay, &lost, &sum})
      for (double& y : line->y)
        if (y < 0.1) y = nan;
    Chart chart{.title = "Light of a site in a frame, all sites and frames",
                .x_label = "photo-electrons",
                .y_label = "how often",
                .log_y = true,
                .bands = {},
                .lines = {sum, empty, stay, lost, seen},
                .width = 680,
                .height = 300};
    return fmt::format(
        "<h2>Atoms</h2>\n<p>Filling {}, survival {}, an atom gives {} photo-electrons a frame; χ² {:.0f} "
        "over {} "
        "bins.</p>\n<figure>{}</figure>\n",
        with_error(fit.filling, fit.filling_error), with_error(fit.survival, fit.survival_error),
        with_error(fit.atom_e, fit.atom_error), fit.chi_square, fit.bins, svg(chart));
  }

  std::string sensor() const {
    if (calibration_.lab.kind() == CameraKind::qcmos) return qcmos_sensor();
    const CountFit& fit = calibration_.counts;
    const CountLaw& law = fit.law;
    const std::vector<std::uint64_t> counts = input_.darks             ? dark_.occurrences
                                              : calibration_.has_sites ? darkest()
                                                                       : light_.occurrences;
    double total = 0;
    for (const std::uint64_t n : counts) total += static_cast<double>(n);
    const double k = law.em_gain / law.electrons_per_count;
    const int first = std::max(0, static_cast<int>(law.bias_counts - 8 * law.read_noise_counts)),
              last = static_cast<int>(law.bias_counts + std::max(30 * law.read_noise_counts, 8 * k));
    const int size =
        static_cast<int>(std::bit_ceil(static_cast<unsigned>(std::max(1024, 2 * (last - first)))));
    CountLaw at = law;
    at.events_spread = 0;
    if (!fit.events_e.empty()) at.events_e = fit.events_e.front();
    const std::vector<double> expected = count_probabilities(at, first, size);
    const int width = std::max(1, (last - first) / 160);
    Line seen{.label = "pixels", .colour = ink, .x = {}, .y = {}, .points = true, .error = {}},
        fitted{.label = "fit", .colour = orange, .x = {}, .y = {}, .width = 2, .error = {}};
    for (int c = first; c + width <= last; c += width) {
      double n = 0, due = 0;
      for (int j = c; j < c + width; ++j) {
        n += j < 65536 ? static_cast<double>(counts[static_cast<std::size_t>(j)]) : 0;
        due += total * expected[static_cast<std::size_t>(j - first)];
      }
      const double x = c + 0.5 * (width - 1);
      seen.x.push_back(x), seen.y.push_back(n / width), seen.error.push_back(std::sqrt(n) / width);
      fitted.x.push_back(x), fitted.y.push_back(due / width > 1e-2 ? due / width : nan);
    }
    Chart chart{.title = input_.darks             ? "Counts of the dark frames"
                         : calibration_.has_sites ? "Counts of the darkest pixels"
                                                  : "Counts of all pixels",
                .x_label = "counts",
                .y_label = "pixels per count",
                .log_y = true,
                .bands = {},
                .lines = {fitted, seen},
                .width = 680,
                .height = 300};
    const bool multiplied = law.em_gain > 1;
    return fmt::format(
        "<h2>Sensor</h2>\n<p>Bias {} counts, read noise {} counts{}; χ² {:.0f} over {} bins.{}</p>\n"
        "<figure>{}</figure>\n",
        with_error(law.bias_counts, fit.bias_error), with_error(law.read_noise_counts, fit.read_noise_error),
        multiplied ? fmt::format(", {} counts per electron by the tail alone",
                                 with_error(k, fit.em_gain_error / law.electrons_per_count))
                   : "",
        fit.chi_square, fit.bins,
        multiplied && calibration_.has_sites
            ? fmt::format(" Together with the photon transfer of the sites' light: {} counts per electron.",
                          with_error(model_.counts_per_electron, calibration_.counts_per_electron_error))
            : "",
        svg(chart));
  }

  std::string qcmos_sensor() const {
    const QcmosDarkFit& fit = calibration_.dark_maps;
    const StackSums& sums = input_.darks ? dark_ : light_;
    const double sigma = std::max(1e-6, fit.read_noise_counts);
    constexpr int bins = 100;
    Line noise{.label = "pixels", .colour = ink, .x = {}, .y = {}, .points = true, .error = {}};
    std::vector<double> count(bins);
    for (std::size_t i = 0; i < sums.sum.pixels().size(); ++i)
      if (const double k = std::sqrt(sums.variance(i)) / sigma * bins / 3; k < bins)
        count[static_cast<std::size_t>(k)] += 1;
    // Normal in the logarithm, wider by what a variance of so many frames scatters.
    const double own = fit.read_noise_log_sigma.value();
    const double spread = std::hypot(own, 1 / std::sqrt(2.0 * static_cast<double>(sums.frames - 1)));
    const double middle = std::log(sigma) - own * own;
    const double pixels = static_cast<double>(sums.sum.pixels().size());
    Line law{.label = "fit", .colour = orange, .x = {}, .y = {}, .width = 2, .error = {}};
    for (int k = 0; k < bins; ++k) {
      const double n = count[static_cast<std::size_t>(k)], width = 3 * sigma / bins, x = (k + 0.5) * width;
      noise.x.push_back(x), noise.y.push_back(n > 0 ? n : nan);
      noise.error.push_back(std::sqrt(n));
      const double z = (std::log(x) - middle) / spread;
      const double due =
          pixels * width / (x * spread) * std::exp(-0.5 * z * z) / std::sqrt(2 * std::numbers::pi);
      law.x.push_back(x), law.y.push_back(due > 0.1 ? due : nan);
    }
    Chart chart{.title = "Noise of the pixels over time",
                .x_label = "counts rms",
                .y_label = "pixels",
                .log_y = true,
                .bands = {},
                .lines = {law, noise},
                .width = 500,
                .height = 260};
    return fmt::format(
        "<h2>Sensor</h2>\n<p>Bias {} counts, read noise {} counts rms over the pixels, their offsets spread "
        "by {} "
        "counts.</p>\n<figure>{}</figure>\n",
        with_error(fit.bias_counts, fit.bias_error), with_error(fit.read_noise_counts, fit.read_noise_error),
        short_number(fit.offset_sigma_counts.value(), 3), svg(chart));
  }

  std::vector<std::uint64_t> darkest() const {
    const std::size_t pixels = light_.sum.pixels().size();
    std::vector<double> means(pixels);
    for (std::size_t i = 0; i < pixels; ++i) means[i] = light_.mean(i);
    std::vector<double> sorted = means;
    const auto cut = sorted.begin() + static_cast<std::ptrdiff_t>(pixels / 5);
    std::nth_element(sorted.begin(), cut, sorted.end());
    std::vector<std::uint64_t> occurrences(65536, 0);
    input_.frames->visit([&](std::size_t, const CountImage& frame) {
      for (std::size_t i = 0; i < pixels; ++i)
        if (means[i] <= *cut) ++occurrences[frame.pixels()[i]];
    });
    return occurrences;
  }

  /// Mean image above the level without atoms, e; and what the model expects.
  std::vector<double> mean_e() const {
    std::vector<double> image(model_.shape.pixels());
    const double level =
        model_.bias_counts + (model_.dark_e + model_.background_e) * model_.counts_per_electron;
    for (std::size_t i = 0; i < image.size(); ++i)
      image[i] = (light_.mean(i) - level) / model_.counts_per_electron;
    return image;
  }
  std::vector<double> expected_e() const {
    double mean = 0;
    for (const double e : calibration_.optics.site_e) mean += e;
    mean /= static_cast<double>(std::max<std::size_t>(1, calibration_.optics.site_e.size()));
    std::vector<double> image(model_.shape.pixels());
    for (std::size_t i = 0; i < image.size(); ++i)
      image[i] = static_cast<double>(model_.site_light.pixels()[i]) * mean;
    return image;
  }

  std::string optics() const {
    const OpticsFit& fit = calibration_.optics;
    const int radius = std::clamp(stamp_radius_px(fit.lattice) / 2, 4, 8);
    const FoldedSite seen = fold_sites(model_, mean_e(), radius),
                     due = fold_sites(model_, expected_e(), radius);
    std::vector<double> difference(seen.mean.pixels().size());
    for (std::size_t i = 0; i < difference.size(); ++i)
      difference[i] = seen.mean.pixels()[i] - due.mean.pixels()[i];
    const std::span<const double> both[] = {seen.mean.pixels(), due.mean.pixels()};
    const std::span<const double> rest[] = {difference};
    const Scale scale = scale_of(both, false);
    const Shape shape = seen.mean.shape();
    std::string out = fmt::format(
        "<h2>Optics</h2>\n<p>Mean image of {} sites, {} pixels across{}; χ² of the mean frame {:.0f} over "
        "{}.</p>\n"
        "<div class=\"row\">{}{}{}</div>\n",
        model_.sites.size(), 2 * radius + 1,
        seen.oversampling > 1 ? fmt::format(", folded to {} cells a pixel", seen.oversampling) : "",
        fit.chi_square, fit.degrees_of_freedom,
        map_figure("average site", "the frames", seen.mean.pixels(), shape, scale, Palette::sequential, "e"),
        map_figure("fitted site", "the model", due.mean.pixels(), shape, scale, Palette::sequential, "e"),
        map_figure("difference", "frames less model", difference, shape, scale_of(rest, true),
                   Palette::diverging, "e"));
    std::vector<Bar> bars;
    for (int term = 3; term < zernike_terms; ++term) {
      const Eigen::Index at = 6 + term - 3;
      const double error = at < fit.covariance.rows() ? std::sqrt(std::max(0.0, fit.covariance(at, at))) : 0;
      const auto k = static_cast<std::size_t>(term);
      bars.push_back({std::string(zernike_catalogue()[k].name), 1000 * fit.zernike_um[k], 1000 * error});
    }
    out += "<figure>" + bars_svg("Zernike terms", "nm rms", bars) +
           "<figcaption>The sign that the even terms share is chosen for a positive "
           "defocus.</figcaption></figure>\n";
    return out;
  }

  std::string maps() const {
    const Shape shape = model_.shape;
    const std::vector<double> mean = [&] {
      std::vector<double> values(shape.pixels());
      for (std::size_t i = 0; i < values.size(); ++i) values[i] = light_.mean(i);
      return values;
    }();
    const auto map = [&](const char* title, const char* caption, const std::vector<double>& values,
                         bool diverging, const char* unit) {
      const std::span<const double> one[] = {values};
      return map_figure(title, caption, values, shape, scale_of(one, diverging),
                        diverging ? Palette::diverging : Palette::sequential, unit, 270);
    };
    std::string out = "<h2>Maps</h2>\n<div class=\"row\">\n" + map("mean frame", "", mean, false, "counts");
    if (calibration_.has_sites) {
      out += map("mean of the rest", "the sites' light and the expected level taken off", rest_mean_, true,
                 "counts");
      const Lattice& lattice = calibration_.optics.lattice;
      if (calibration_.site_brightness.size() == static_cast<std::size_t>(lattice.sites())) {
        const std::span<const double> one[] = {calibration_.site_brightness};
        out += map_figure("light of the sites", "mean over the frames, relative to all sites",
                          calibration_.site_brightness, {lattice.rows, lattice.columns}, scale_of(one, false),
                          Palette::sequential, "", 200);
      }
    }
    if (input_.darks) {
      std::vector<double> level(shape.pixels()), noise(shape.pixels());
      for (std::size_t i = 0; i < level.size(); ++i)
        level[i] = dark_.mean(i), noise[i] = std::sqrt(dark_.variance(i));
      out += map("mean dark frame", "", level, false, "counts");
      out += map("noise of the dark frames", "over time", noise, false, "counts rms");
    }
    return out + "</div>\n";
  }

  const Calibration& calibration_;
  const StackModel& model_;
  const CalibrationInput& input_;
  StackSums light_, dark_;
  std::vector<double> brightness_, rest_mean_;
};

}  // namespace

std::string parameter_table_markup(const Calibration& calibration) {
  std::string out =
      "<table>\n<tr><th>parameter</th><th class=\"number\">notes</th><th class=\"number\">fit</th>"
      "<th>unit</th><th class=\"number\">pull</th></tr>\n";
  for (const CalibratedParameter& one : calibration.parameters) {
    const bool pulls = one.error > 0 && std::isfinite(one.noted);
    out += fmt::format(
        "<tr{}><td>{}</td><td class=\"number\">{}</td><td class=\"number\">{}</td><td>{}</td>"
        "<td class=\"number\">{}</td></tr>\n",
        one.from_notes ? " class=\"split\"" : "", escaped(one.key), report::short_number(one.noted, 6),
        one.error > 0 ? with_error(one.fitted, one.error) : report::short_number(one.fitted, 6),
        one.unit == "1" ? "" : escaped(one.unit), pulls ? fmt::format("{:+.1f}", one.pull()) : "");
  }
  return out + "</table>\n";
}

std::string calibration_report(const Calibration& calibration, const CalibrationInput& input,
                               const std::string& command) {
  return page("atomcam: calibration", Report(calibration, input).body(command));
}

}  // namespace atomcam
