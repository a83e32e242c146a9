#include "analysis/stripes.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

#include "analysis/fourier.hpp"
#include "base/quantile.hpp"

namespace atomcam {
namespace {

constexpr std::size_t sampled_frames = 100;
constexpr double clearly = 8;  // standard deviations of a mean power, and so many
constexpr float tail = 4;      // deviations: single electrons and cosmic rays count as that

Image<double, unit::counts> mean_of(const FrameSequence& frames) {
  Image<double, unit::counts> mean(frames.shape());
  frames.visit([&](std::size_t, const CountImage& counts) {
    for (std::size_t i = 0; i < mean.pixels().size(); ++i)
      mean.pixels()[i] += static_cast<double>(counts.pixels()[i]) / static_cast<double>(frames.frames());
  });
  return mean;
}

/// Less the mean image, no pixel farther off than so many deviations of the frame's.
void take_noise(std::span<const std::uint16_t> counts, std::span<const double> mean, std::span<float> noise) {
  for (std::size_t i = 0; i < noise.size(); ++i)
    noise[i] = static_cast<float>(static_cast<double>(counts[i]) - mean[i]);
  std::vector<double> sizes(noise.size());
  std::transform(noise.begin(), noise.end(), sizes.begin(), [](float x) { return std::fabs(x); });
  const float limit = tail * static_cast<float>(1.4826 * median(sizes));
  for (float& one : noise) one = std::clamp(one, -limit, limit);
}

}  // namespace

std::optional<Stripes> strongest_stripes(const FrameSequence& frames) {
  const int rows = frames.shape().rows, columns = frames.shape().columns;
  if (frames.frames() < 2 || rows < 8 || columns < 8) return {};
  const Image<double, unit::counts> mean = mean_of(frames);
  analysis::ImageSpectrum spectrum(rows, columns);
  std::vector<float> power(spectrum.spectrum().size());
  const std::size_t every = (frames.frames() + sampled_frames - 1) / sampled_frames;
  double looks = 0;
  frames.visit([&](std::size_t n, const CountImage& counts) {
    if (n % every) return;
    take_noise(counts.pixels(), mean.pixels(), spectrum.image());
    spectrum.transform();
    spectrum.add_power(power);
    ++looks;
  });
  const int half = spectrum.half();
  const auto at = [&](int u, int v) {
    const auto row = static_cast<std::size_t>((u + rows) % rows);
    return static_cast<double>(power[row * static_cast<std::size_t>(half) + static_cast<std::size_t>(v)]);
  };
  // Not what is the same all along a row, nor a column's noise.
  int peak_u = 0, peak_v = 0;
  double highest = 0;
  for (int u = 0; u < rows; ++u)
    for (int v = 1; v < half; ++v)
      if (at(u, v) > highest) highest = at(peak_u = u, peak_v = v);
  const double usual = median(std::vector<double>(power.begin(), power.end()));
  if (!(highest > usual * (1 + clearly / std::sqrt(looks)))) return {};
  // Between the frequencies that fit into a frame.
  double sum = 0, along_rows = 0, along_columns = 0;
  for (int u = peak_u - 1; u <= peak_u + 1; ++u)
    for (int v = std::max(1, peak_v - 1); v <= std::min(half - 1, peak_v + 1); ++v) {
      const double beyond = std::max(0.0, at(u, v) - usual);
      sum += beyond, along_columns += beyond * u, along_rows += beyond * v;
    }
  const double turns_per_row = along_columns / sum / rows;
  return Stripes{.period_px = columns * sum / along_rows,
                 .row_phase_deg = 360 * (turns_per_row > 0.5 ? turns_per_row - 1 : turns_per_row)};
}

}  // namespace atomcam
