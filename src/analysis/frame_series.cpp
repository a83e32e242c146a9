// Levels and noise of whole frames along the stack.

#include <algorithm>
#include <cmath>

#include "analysis/series.hpp"

namespace atomcam::analysis {
namespace {

/// Fisher's z of two series over the frames of a part: the inverse hyperbolic tangent of their correlation.
double fisher_z(const std::vector<double>& a, const std::vector<double>& b, const Record& record,
                Part which) {
  const double count = static_cast<double>(record.count(which));
  double mean_a = 0, mean_b = 0, cross = 0, square_a = 0, square_b = 0;
  for (std::size_t n = 0; n < record.frames; ++n)
    if (record.holds(which, n)) mean_a += a[n] / count, mean_b += b[n] / count;
  for (std::size_t n = 0; n < record.frames; ++n)
    if (record.holds(which, n)) {
      cross += (a[n] - mean_a) * (b[n] - mean_b);
      square_a += (a[n] - mean_a) * (a[n] - mean_a);
      square_b += (b[n] - mean_b) * (b[n] - mean_b);
    }
  return count > 5 ? std::atanh(0.999 * cross / std::sqrt(square_a * square_b)) : not_a_number;
}

class FrameSeries : public Family {
 public:
  explicit FrameSeries(const Layout& layout) : layout_(layout) {}

  void summarise(Part which, const Record& record, Sheet& sheet) const override {
    sheet.family("frames");
    sheet.kind({"frame_means", "time", "dark pixels"});
    // Of the clipped level the read noise alone would give this; of the linear one, the model's dark pixel.
    put_series(sheet, "level", record.level, record, which,
               layout_.quiet_square_sum / (layout_.quiet_sum * layout_.quiet_sum));
    put_short_series(sheet, "linear_level", record.linear_level, record, which,
                     layout_.white * layout_.white / static_cast<double>(layout_.dark_pixels.size()));
    double mean = 0, noise = 0;
    const double count = static_cast<double>(record.count(which));
    for (std::size_t n = 0; n < record.frames; ++n)
      if (record.holds(which, n)) mean += record.linear_level[n] / count, noise += record.noise[n] / count;
    sheet.put("mean", count > 0 ? mean / layout_.white : not_a_number);
    sheet.kind({"frame_means", "time", "whole frame"});
    put_short_series(sheet, "noise", record.noise, record, which,
                     noise * noise / static_cast<double>(layout_.shape.pixels()));
    // The same noise in two frames: a frame that was sent twice, or a pattern that hops.
    double largest = -1, sum = 0, pairs = 0, smallest = 1;
    for (std::size_t n = 0; n < record.frames; ++n)
      if (record.holds(which, n) && std::isfinite(record.repeat[n])) {
        largest = std::max(largest, record.repeat[n]);
        smallest = std::min(smallest, record.repeat[n]);
        sum += record.repeat[n];
        ++pairs;
      }
    const double width = std::sqrt(static_cast<double>(layout_.shape.pixels()));
    sheet.kind({"lag_correlation", "time", "whole frame"});
    sheet.put_unsteady("most_alike", pairs > 2 ? std::asinh(largest * width / 4) : not_a_number);
    sheet.put("least_alike", pairs > 2 ? std::asinh(smallest * width / 4) : not_a_number);
    sheet.put("alike", pairs > 2 ? std::asinh(sum / std::sqrt(pairs) * width / 4) : not_a_number);
    // Charge brings noise of its own, a shift of the electronics does not.
    std::vector<double> own_noise(record.frames);
    for (std::size_t n = 0; n < record.frames; ++n)
      own_noise[n] = record.noise[n] - record.level[n] * record.level[n];
    sheet.kind({"frame_means", "intensity", "whole frame"});
    sheet.put("noise_against_level", fisher_z(own_noise, record.level, record, which));
    if (layout_.packed.empty()) return;
    // Background that follows the atoms' light: halo, droop of the baseline.
    std::vector<double> all(record.frames);
    for (std::size_t n = 0; n < record.frames; ++n)
      for (std::size_t s = 0; s < record.sites(); ++s) all[n] += record.bright(n, s);
    sheet.kind({"point_spread_halo", "intensity", "dark pixels"});
    sheet.put("level_against_light", fisher_z(all, record.level, record, which));
  }

 private:
  const Layout& layout_;
};

}  // namespace

std::unique_ptr<Family> make_frame_series(const Layout& layout) {
  return std::make_unique<FrameSeries>(layout);
}

}  // namespace atomcam::analysis
