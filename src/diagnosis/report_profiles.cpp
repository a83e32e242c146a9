#include "diagnosis/report_profiles.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "calibration/report_chart.hpp"
#include "calibration/report_map.hpp"
#include "calibration/report_page.hpp"

namespace atomcam::report {
namespace {

Band band(const Curve& curve, const CurveBand& from, const char* label, const char* colour) {
  Band out{label, colour, curve.x, {}, {}};
  for (std::size_t i = 0; i < curve.x.size(); ++i) {
    const double low = from.mean[i] - 2 * from.deviation[i];
    // On a logarithmic axis a band that reaches 0 ends at a tenth of its middle.
    out.low.push_back(curve.log_y ? std::max(low, 0.1 * from.mean[i]) : low);
    out.high.push_back(from.mean[i] + 2 * from.deviation[i]);
  }
  return out;
}

std::string chart(const ReportProfiles& profiles, std::size_t k, const CurveBand& plain,
                  const CurveBand& fixed, double before, double after) {
  const Curve& real = profiles.real.curves[k];
  Chart chart;
  chart.title = real.title;
  chart.x_label = real.x_label;
  chart.y_label = real.y_label;
  chart.log_y = real.log_y;
  chart.bands.push_back(band(real, plain, profiles.other.c_str(), blue));
  Line line;
  line.colour = blue, line.x = real.x, line.y = plain.mean, line.dashed = true, line.width = 1;
  chart.lines.push_back(line);
  if (!profiles.fixed.empty()) {
    chart.bands.push_back(band(real, fixed, "with the effects found", orange));
    line.colour = orange, line.y = fixed.mean, line.dashed = false;
    chart.lines.push_back(line);
  }
  Line seen;
  seen.label = "frames";
  seen.x = real.x, seen.y = real.y;
  seen.points = real.x.size() <= 130;
  seen.width = 1;
  chart.lines.push_back(seen);
  return fmt::format("<figure>{}<figcaption>mean square distance from the {} {}{}</figcaption></figure>\n",
                     svg(chart), profiles.other, short_number(before, 2),
                     profiles.fixed.empty() ? "" : ", with the effects found " + short_number(after, 2));
}

/// Point by point over the stacks.
std::vector<double> mean_map(const std::vector<Profiles>& stacks, std::size_t map) {
  std::vector<double> mean(stacks.front().maps[map].values.pixels().size());
  for (std::size_t i = 0; i < mean.size(); ++i) {
    double sum = 0, n = 0;
    for (const Profiles& one : stacks)
      if (const double v = one.maps[map].values.pixels()[i]; std::isfinite(v)) sum += v, n += 1;
    mean[i] = n > 0 ? sum / n : std::numeric_limits<double>::quiet_NaN();
  }
  return mean;
}

std::string difference_map(const std::string& title, std::span<const double> real,
                           std::span<const double> model, Shape shape, Scale scale, const std::string& unit) {
  std::vector<double> rest(real.size());
  for (std::size_t i = 0; i < rest.size(); ++i) rest[i] = real[i] - model[i];
  return map_figure(title, "", rest, shape, scale, Palette::diverging, unit, 190);
}

}  // namespace

std::string curves(const ReportProfiles& profiles, std::size_t telling) {
  const std::size_t count = profiles.real.curves.size();
  std::vector<CurveBand> plain, fixed;
  std::vector<double> before, after;
  for (std::size_t k = 0; k < count; ++k) {
    plain.push_back(band_of(profiles.plain, k));
    fixed.push_back(band_of(profiles.fixed, k));
    before.push_back(distance(profiles.real.curves[k], plain.back()));
    after.push_back(distance(profiles.real.curves[k], fixed.back()));
  }
  std::vector<std::size_t> order(count);
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(),
                   [&](std::size_t a, std::size_t b) { return before[a] > before[b]; });
  std::string out = "<div class=\"row\">\n";
  for (std::size_t n = 0; n < count; ++n) {
    if (n == telling) out += "</div>\n<details><summary>All the others</summary>\n<div class=\"row\">\n";
    const std::size_t k = order[n];
    out += chart(profiles, k, plain[k], fixed[k], before[k], after[k]);
  }
  out += "</div>\n";
  if (count > telling) out += "</details>\n";
  return out;
}

std::string maps(const ReportProfiles& profiles) {
  std::string out;
  const bool has_fixed = !profiles.fixed.empty();
  for (std::size_t k = 0; k < profiles.real.maps.size(); ++k) {
    const ProfileMap& real = profiles.real.maps[k];
    const Shape shape = real.values.shape();
    // One simulated stack, not their mean: its noise is that of the real one.
    const auto plain = profiles.plain.front().maps[k].values.pixels();
    std::vector<std::span<const double>> all = {real.values.pixels(), plain};
    if (has_fixed) all.push_back(profiles.fixed.front().maps[k].values.pixels());
    const Palette palette = real.diverging ? Palette::diverging : Palette::sequential;
    const Scale scale = scale_of(all, real.diverging);
    const auto figure = [&](const std::string& title, std::span<const double> values) {
      return map_figure(title, "", values, shape, scale, palette, real.unit, 190);
    };
    out += fmt::format("<p>{}</p>\n<div class=\"row\">\n", escaped(real.title));
    out += figure("frames", real.values.pixels());
    out += figure(profiles.other, plain);
    if (has_fixed) out += figure("with the effects", all.back());
    if (real.key.ends_with("site_image")) {
      const std::vector<double> expected = mean_map(profiles.plain, k);
      std::vector<double> rest(expected.size());
      for (std::size_t i = 0; i < rest.size(); ++i) rest[i] = real.values.pixels()[i] - expected[i];
      const std::span<const double> one[] = {rest};
      const Scale about = scale_of(one, true);
      out += "</div>\n<div class=\"row\">\n";
      out += difference_map("frames less " + profiles.other, real.values.pixels(), expected, shape, about,
                            real.unit);
      if (has_fixed)
        out += difference_map("frames less fixed", real.values.pixels(), mean_map(profiles.fixed, k), shape,
                              about, real.unit);
    }
    out += "</div>\n";
  }
  return out;
}

}  // namespace atomcam::report
