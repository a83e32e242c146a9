#pragma once
// The EMCCD's figures from histograms of counts (full-histogram likelihood), a qCMOS's from the maps of its
// dark frames.

#include <algorithm>
#include <cmath>
#include <vector>

#include "analysis/frame_sequence.hpp"
#include "base/image.hpp"
#include "calibration/count_law.hpp"
#include "calibration/maximise.hpp"

namespace atomcam {

struct CountFitOptions {
  bool gain = true;     // em_gain is free (else as in the start)
  bool serial = false;  // serial_events is free
};
struct CountFit {
  CountLaw law;                  // events_e and events_spread are those of the first histogram
  std::vector<double> events_e;  // of each histogram
  std::vector<double> spread;    // of each histogram
  double bias_error = 0, read_noise_error = 0, em_gain_error = 0, serial_error = 0;
  std::vector<double> events_error;
  double events_by_gain = -1;  // d ln events_e[0] / d ln em_gain: where they go if the gain is known better
  double chi_square = 0;       // over bins of at least 10 expected
  int bins = 0;
};
/// One law for all histograms but for their light; the first is of dark frames (no spread of light), the
/// others of pixels with little light, whose light may vary.
CountFit fit_counts(const std::vector<CountHistogram>& histograms, bool first_is_dark, const CountLaw& start,
                    const CountFitOptions& options = {});

/// Sums over a stack: what maps and histograms come from.
struct StackSums {
  std::size_t frames = 0;
  std::size_t even_frames = 0;  // that have one value throughout
  std::size_t lost_rows = 0;    // that have one value throughout, far from the frame's mean: never arrived
  Image<double, unit::counts> sum, sum_of_squares;
  std::vector<std::uint64_t> occurrences;  // of each 16-bit count, all pixels
  std::vector<double> frame_mean;
  double mean(std::size_t pixel) const { return sum.pixels()[pixel] / static_cast<double>(frames); }
  double variance(std::size_t pixel) const;  // unbiased, over time
  double median_mean() const;                // over the pixels
  double median_variance() const;
};
StackSums sum_stack(const FrameSequence& frames);
/// The same with each count that is farther above its pixel's mean than an electron of `counts_per_electron`
/// allows for any light (a cosmic ray holds thousands of electrons) replaced by the mean of the others. The
/// occurrences stay.
StackSums sum_stack_without_strikes(const FrameSequence& frames, double counts_per_electron);

/// How much the members of a population differ. What is measured is the square, of which chance may leave
/// less than nothing.
struct Spread {
  double square = 0, error_of_square = 0;
  double value() const { return std::sqrt(std::max(0.0, square)); }
  /// At zero, what it could be.
  double error() const;
};

/// Population figures of a qCMOS by robust statistics (medians and quantiles), so that a few odd pixels do
/// not move them.
struct QcmosDarkFit {
  double bias_counts = 0, bias_error = 0;
  double read_noise_counts = 0, read_noise_error = 0;  // rms over the pixels
  Spread read_noise_log_sigma, offset_sigma_counts, column_gumbel_counts, row_offset_sigma_counts;
};
QcmosDarkFit fit_qcmos_darks(const StackSums& darks);

}  // namespace atomcam
