#include "calibration/photon_transfer.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "base/error.hpp"
#include "calibration/sensor_fit.hpp"

namespace atomcam {

FlatLevel flat_level(const FrameSequence& flats, const FrameSequence& darks, double exposure) {
  if (!(flats.shape() == darks.shape()))
    throw Error("flats", fmt::format("have {} rows and {} columns, the darks {} and {}", flats.shape().rows,
                                     flats.shape().columns, darks.shape().rows, darks.shape().columns));
  const StackSums dark = sum_stack(darks);
  std::vector<double> level(flats.shape().pixels()), variance(level.size());
  for (std::size_t i = 0; i < level.size(); ++i) level[i] = dark.mean(i), variance[i] = dark.variance(i);
  return flat_level(flats, level, variance, exposure);
}

FlatLevel flat_level(const FrameSequence& flats, const std::vector<double>& dark_counts,
                     const std::vector<double>& dark_variance, double exposure) {
  if (flats.frames() < 2)
    throw Error("flats",
                fmt::format("{} frame is too few for a variance, 2 or more are needed", flats.frames()));
  const std::size_t pixels = dark_counts.size();
  FlatLevel level;
  level.exposure = exposure;
  level.frames = flats.frames();
  const double n = static_cast<double>(level.frames), area = static_cast<double>(pixels);
  std::vector<double> signal(pixels, 0), frame_signal;
  int top = 0;
  std::size_t at_top = 0;
  flats.visit([&](std::size_t, const CountImage& frame) {
    double sum = 0;
    for (std::size_t i = 0; i < pixels; ++i) {
      const int count = frame.pixels()[i];
      if (count > top) top = count, at_top = 0;
      at_top += count == top;
      const double value = count - dark_counts[i];
      signal[i] += value / n;
      sum += value;
    }
    frame_signal.push_back(sum / area);
  });
  double mean = 0, spread = 0;
  for (const double value : frame_signal) mean += value / n;
  for (const double value : frame_signal) spread += (value - mean) * (value - mean) / (n - 1);
  level.signal_counts = mean;
  // Light that changes moves all pixels alike: with many pixels a frame's own level says by how much. What is
  // measured with few pixels is noise of their own and must stay.
  std::vector<double> squares(pixels, 0);
  flats.visit([&](std::size_t k, const CountImage& frame) {
    const double scale = std::fabs(mean) > 1e-9 ? frame_signal[k] / mean : 1;
    for (std::size_t i = 0; i < pixels; ++i) {
      const double rest = frame.pixels()[i] - dark_counts[i] - scale * signal[i];
      squares[i] += rest * rest;
    }
  });
  // Taking a frame's level off costs one degree of freedom per frame, the pixel's mean one per pixel.
  const double kept = area > 1 ? (n - 1) * (area - 1) / area : n - 1;
  double total = 0, dark = 0;
  for (std::size_t i = 0; i < pixels; ++i) total += squares[i] / kept, dark += dark_variance[i];
  level.variance_counts = (total - dark) / area;
  double scatter = 0;
  for (std::size_t i = 0; i < pixels; ++i) {
    const double off = squares[i] / kept - dark_variance[i] - level.variance_counts;
    scatter += off * off;
  }
  const double of_pixels = area > 1 ? std::sqrt(scatter / (area - 1) / area) : 0;
  const double of_chi_square = total / area * std::sqrt(2 / (n * area));
  level.variance_error = std::max(of_pixels, of_chi_square);
  level.light_noise = mean > 0 ? std::sqrt(std::max(0.0, spread - total / area / area)) / mean : 0;
  level.saturated = static_cast<double>(at_top) > 1 + 0.001 * n * area && top > 1000;
  return level;
}

PhotonTransfer photon_transfer(std::vector<FlatLevel> levels) {
  PhotonTransfer out;
  std::sort(levels.begin(), levels.end(),
            [](const FlatLevel& a, const FlatLevel& b) { return a.signal_counts < b.signal_counts; });
  out.levels = std::move(levels);
  double weights = 0, sum = 0;
  int used = 0;
  for (const FlatLevel& level : out.levels) {
    if (level.saturated || !(level.signal_counts > 0) || !(level.variance_error > 0)) continue;
    const double error = level.variance_error / level.signal_counts, weight = 1 / (error * error);
    weights += weight;
    sum += weight * level.variance_counts / level.signal_counts;
    out.saturation_counts = level.signal_counts;
    ++used;
  }
  if (used == 0) throw Error("flats", "no level has light and is not saturated");
  out.slope = sum / weights;
  for (const FlatLevel& level : out.levels) {
    if (level.saturated || !(level.signal_counts > 0) || !(level.variance_error > 0)) continue;
    const double off = level.variance_counts / level.signal_counts - out.slope;
    out.chi_square +=
        off * off * level.signal_counts * level.signal_counts / (level.variance_error * level.variance_error);
  }
  // Levels that scatter more than their errors say so in the slope's.
  const double more = used > 1 ? std::max(1.0, std::sqrt(out.chi_square / (used - 1))) : 1;
  out.slope_error = more / std::sqrt(weights);
  // EMVA 1288: straight line through signal over exposure with relative weights, from 5 to 95 % of
  // saturation.
  double s0 = 0, s1 = 0, s2 = 0, y0 = 0, y1 = 0;
  std::vector<const FlatLevel*> line;
  for (const FlatLevel& level : out.levels)
    if (!level.saturated && level.exposure > 0 && level.signal_counts >= 0.05 * out.saturation_counts &&
        level.signal_counts <= out.saturation_counts)
      line.push_back(&level);
  if (line.size() >= 3) {
    for (const FlatLevel* level : line) {
      const double w = 1 / (level->signal_counts * level->signal_counts), x = level->exposure;
      s0 += w, s1 += w * x, s2 += w * x * x, y0 += w * level->signal_counts,
          y1 += w * x * level->signal_counts;
    }
    const double determinant = s0 * s2 - s1 * s1;
    const double offset = (s2 * y0 - s1 * y1) / determinant, per = (s0 * y1 - s1 * y0) / determinant;
    for (const FlatLevel* level : line)
      out.linearity_error += std::fabs(level->signal_counts / (offset + per * level->exposure) - 1) /
                             static_cast<double>(line.size());
  }
  return out;
}

}  // namespace atomcam
