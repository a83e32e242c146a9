#pragma once
// The law of a pixel's counts: events -> register -> read noise -> converter, by its generating function.

#include <cstdint>
#include <vector>

namespace atomcam {

/// A pixel that takes `events_e` Poisson electrons at the head of the register.
struct CountLaw {
  double bias_counts = 200;
  double read_noise_counts = 4;
  double electrons_per_count = 5;
  double em_gain = 1;   // mean; 1: no register
  double events_e = 0;  // mean
  /// Relative variance of events_e over the pixels and frames (gamma law); 0: the same for all.
  double events_spread = 0;
  double serial_events = 0;  // charges born at a uniformly chosen stage
};

/// P(counts = first + k) for k = 0 ... size - 1; size is a power of two that covers the law (what lies beyond
/// wraps around). An electron's output is geometric with the mean em_gain, the law of a register of many
/// stages of small gain (a pure birth process), whose generating function is
/// s / (g - (g - 1) s); a charge born at a uniformly chosen stage has -ln(1 - s + s / g) / ln g (its mean
/// over g^u). Read noise is normal; rounding to integers included.
std::vector<double> count_probabilities(const CountLaw& law, int first, int size);

/// How often each count occurred.
struct CountHistogram {
  int first = 0;
  std::vector<std::uint64_t> occurrences;
  std::uint64_t total() const;
};

}  // namespace atomcam
