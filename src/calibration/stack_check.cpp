#include "calibration/stack_check.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "base/error.hpp"

namespace atomcam {
namespace {

constexpr double clipped_share = 1e-3;  // of all values at the largest one
constexpr std::size_t near_top = 64;    // counts below the largest that it is compared with
constexpr double even_share = 0.1;      // of the frames that may have one value throughout

/// Levels below which a share of all values lies.
std::size_t quantile(const std::vector<std::uint64_t>& occurrences, double share, double all) {
  double sum = 0;
  for (std::size_t c = 0; c < occurrences.size(); ++c) {
    sum += static_cast<double>(occurrences[c]);
    if (sum > share * all) return c;
  }
  return occurrences.size() - 1;
}

void check_clipping(const StackSums& sums, std::string_view place) {
  const auto& occurrences = sums.occurrences;
  std::size_t top = occurrences.size() - 1;
  while (top > 0 && occurrences[top] == 0) --top;
  const std::size_t pixels = sums.sum.pixels().size();
  const double all = static_cast<double>(sums.frames) * static_cast<double>(pixels);
  // A defect that always reads the largest value says nothing of the others.
  double stuck = 0;
  for (std::size_t i = 0; i < pixels; ++i) stuck += sums.mean(i) == static_cast<double>(top);
  double at_top = static_cast<double>(occurrences[top]);
  if (stuck < 0.01 * static_cast<double>(pixels)) at_top -= stuck * static_cast<double>(sums.frames);
  if (at_top < clipped_share * all + 50) return;
  // What noise alone makes of the largest value is no more than what lies just below it.
  const std::size_t from = top > near_top ? top - near_top : 0;
  double below = 0;
  for (std::size_t c = from; c < top; ++c) below += static_cast<double>(occurrences[c]);
  below /= static_cast<double>(std::max<std::size_t>(1, top - from));
  const bool wide = top >= quantile(occurrences, 0.001, all) + near_top;
  if ((wide && at_top > 10 * below) || (top > 1000 && at_top > 0.99 * all))
    throw Error(place, fmt::format("{:.2g} % of the values are {}, the largest: saturated; {} % are allowed",
                                   100 * at_top / all, top, 100 * clipped_share));
}

}  // namespace

void check_stack(const StackSums& sums, std::string_view place) {
  bool constant = true;
  for (std::size_t i = 0; i < sums.sum.pixels().size() && constant; ++i) constant = sums.variance(i) == 0;
  if (constant)
    throw Error(place, fmt::format("all {} frames are the same: frames of a camera differ by their noise",
                                   sums.frames));
  // Few pixels may agree by chance.
  if (sums.sum.pixels().size() >= 64 &&
      static_cast<double>(sums.even_frames) > even_share * static_cast<double>(sums.frames))
    throw Error(place,
                fmt::format("{} of {} frames have one value throughout, at most {:.0f} % may: lost frames?",
                            sums.even_frames, sums.frames, 100 * even_share));
  check_clipping(sums, place);
}

void check_darks(const StackSums& darks, const StackSums& light) {
  constexpr double drift = 10;  // noises of a pixel
  const double dark = darks.median_mean(), lit = light.median_mean();
  const double noise = std::sqrt(darks.median_variance());
  if (dark > lit + drift * std::max(1.0, noise))
    throw Error("darks",
                fmt::format("have {:.1f} counts in the median pixel, the frames {:.1f}: frames of the closed "
                            "shutter, at the same settings, are not brighter",
                            dark, lit));
}

}  // namespace atomcam
