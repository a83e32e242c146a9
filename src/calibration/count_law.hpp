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
  int stages = 0;            // of the register; 0: very many of very small gain
};

/// F^2 of a register: 1 + (1 - p) / (1 + p) (1 - 1 / gain) with p = gain^(1 / stages) - 1 (2 - 1 / gain for
/// very many stages); 1 without multiplication.
double excess_noise_factor(double em_gain, int stages);

/// P(counts = first + k) for k = 0 ... size - 1; size is a power of two that covers the law (what lies beyond
/// wraps around). An electron's output is geometric with the mean em_gain, the law of a register of many
/// stages of small gain (a pure birth process), whose generating function is
/// s / (g - (g - 1) s); a charge born at a uniformly chosen stage has -ln(1 - s + s / g) / ln g (its mean
/// over g^u). A register of N stages doubles with p = g^(1/N) - 1 at each, which narrows the output by about
/// p: taken in to its first order by the flow ds/dn ~ s (s - 1) (1 - (2 s - 1) p / 2) whose step n = 1 is a
/// stage. Read noise is normal; rounding to integers included.
std::vector<double> count_probabilities(const CountLaw& law, int first, int size);

/// How often each count occurred.
struct CountHistogram {
  int first = 0;
  std::vector<std::uint64_t> occurrences;
  std::uint64_t total() const;
};

}  // namespace atomcam
