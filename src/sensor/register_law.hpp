#pragma once

#include <array>
#include <bit>
#include <cstdint>
#include <span>
#include <vector>

#include "base/random.hpp"
#include "sensor/alias_table.hpp"

namespace atomcam {

/// The law of an electron-multiplying register: a cascade of `stages`, in each of which every electron
/// becomes two with probability p = gain^(1/stages) - 1.
///
/// The generating function of one electron's output is s -> (1 - p) s + p s^2 iterated `stages` times. Taken
/// at the roots of unity, a Fourier transform of it is the law itself, exact to about 1e-15, and its powers
/// are the laws of 2, 4, 8, ... electrons, each an alias table: n electrons are drawn as the sum over the
/// binary digits of n. Above `largest_exact` the output follows a shifted gamma law with the cascade's own
/// mean, variance and skewness. The mean over stages of the iterated functions is the law of a charge born at
/// a uniformly chosen stage.
class RegisterLaw {
 public:
  /// Gain 1 to 1.25^stages.
  RegisterLaw(double gain, int stages);

  double gain() const { return gain_; }
  double duplication_probability() const { return p_; }
  /// Mean, variance and third central moment of the output of one electron.
  const std::array<double, 3>& cumulants() const { return cumulants_; }
  double excess_noise_factor() const { return 1 + cumulants_[1] / (gain_ * gain_); }
  /// Largest number of electrons whose output is drawn from the exact law.
  std::int32_t largest_exact() const { return largest_exact_; }

  /// Words that draw() takes for this number of electrons.
  std::size_t words_for(std::int32_t electrons) const {
    if (electrons > largest_exact_) return 0;
    // A table for the common ones: the baseline instruction set cannot count bits.
    static constexpr std::uint8_t ones[16] = {0, 1, 1, 2, 1, 2, 2, 3, 1, 2, 2, 3, 2, 3, 3, 4};
    if (electrons < 256) return static_cast<std::size_t>(ones[electrons & 15] + ones[electrons >> 4]);
    return static_cast<std::size_t>(std::popcount(static_cast<std::uint32_t>(electrons)));
  }
  /// Output of `electrons` >= 0: `words` gives one word per binary digit one, `large` what the gamma law
  /// needs.
  template <class Words>
  float draw(std::int32_t electrons, Words& words, RandomStream& large) const {
    if (electrons > largest_exact_) return draw_large(electrons, large);
    std::int32_t output = electrons;
    for (std::uint32_t digits = static_cast<std::uint32_t>(electrons), power = 0; digits != 0;
         digits >>= 1, ++power)
      if (digits & 1) output += powers_[power].draw(words());
    return static_cast<float>(output);
  }
  /// Output of one charge born at a uniformly chosen stage and multiplied by those behind it.
  std::int32_t draw_serial(std::uint32_t word) const { return 1 + serial_.draw(word); }
  double serial_mean() const { return serial_mean_; }

  /// P(output = electrons + k) for electrons = 2^power, before it is rounded into a table (for tests).
  static std::vector<double> extra_law(double gain, int stages, int power);

 private:
  float draw_large(std::int32_t electrons, RandomStream& random) const;

  double gain_;
  double p_;
  std::array<double, 3> cumulants_;
  double serial_mean_;
  std::int32_t largest_exact_ = 0;
  std::vector<AliasTable> powers_;  // extra electrons of 2^i electrons
  AliasTable serial_;               // extra electrons of a serial charge
};

}  // namespace atomcam
