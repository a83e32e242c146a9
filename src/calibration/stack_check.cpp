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

void check_dark_level(const CountLaw& dark, const Notes& notes) {
  constexpr double higher = 2, wider = 10;
  if (dark.bias_counts < higher * notes.bias_counts ||
      dark.read_noise_counts < wider * std::max(1.0, notes.read_noise_counts))
    return;
  throw Error(
      "frames",
      fmt::format("even the darkest pixels are lit, {:.0f} counts with a noise of {:.0f}, where {} says "
                  "bias_adu {:g} and read_noise_adu {:g}: darks are needed",
                  dark.bias_counts, dark.read_noise_counts, notes.place, notes.bias_counts,
                  notes.read_noise_counts));
}

void check_site_light(const MeanImage& mean, const OpticsFit& fitted) {
  constexpr double errors = 8, least_deviations = 4, pixels_of_site = 20;
  const int sites = fitted.lattice.sites();
  const double mean_site_e = fitted.mean_site_e();
  // A lattice that looks for light in noise finds some: so many errors of the mean over the sites, each of
  // which spreads over some pixels.
  const double pixel_variance =
      mean.dark_variance.pixels()[0] + mean.variance_per_e * std::max(0.0, fitted.background_e);
  const double noise = std::sqrt(pixel_variance) *
                       std::max(least_deviations, errors * std::sqrt(pixels_of_site / std::max(1, sites)));
  if (!(mean_site_e > noise))
    throw Error("frames", fmt::format("no light where the notes list {} sites: {:.3f} e- a site and frame on "
                                      "average, {:.3f} is the noise",
                                      sites, mean_site_e, noise));
}

void check_site_images(const MeanImage& mean, const OpticsFit& fitted) {
  constexpr double least_px = 0.3;
  const int sites = fitted.lattice.sites();
  // An even image must be much worse than one with sites, whose many parameters also fit noise.
  double weights = 0, first = 0, second = 0;
  for (std::size_t i = 0; i < mean.electrons.pixels().size(); ++i) {
    if (mean.variance.pixels()[i] > 1e6) continue;
    const double weight =
        1 / (mean.dark_variance.pixels()[i] + mean.variance_per_e * std::max(0.0, fitted.background_e));
    const double value = mean.electrons.pixels()[i];
    weights += weight, first += weight * value, second += weight * value * value;
  }
  // In units of the errors that the image has: without darks, they come out too small.
  const double wide = std::max(1.0, fitted.chi_square / std::max(1, fitted.degrees_of_freedom));
  const double gained = (second - first * first / weights - fitted.chi_square) / wide;
  const double by_noise = static_cast<double>(fitted.site_e.size() + 18) * 4 + 100;
  if (!(gained > by_noise))
    throw Error("frames", fmt::format("no light where the notes list {} sites: with them chi square falls by "
                                      "{:.0f}, {:.0f} may be noise",
                                      sites, gained, by_noise));
  if (!(fitted.position_error_px < least_px))
    throw Error("frames",
                fmt::format("the notes list {} sites, but the light there does not have the shape of sites: "
                            "their positions come out with an error of {:.2g} pixels, {} is allowed",
                            sites, fitted.position_error_px, least_px));
}

}  // namespace atomcam
