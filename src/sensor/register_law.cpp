#include "sensor/register_law.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <complex>
#include <string>

#include "base/error.hpp"
#include "base/math.hpp"
#include "base/samplers.hpp"
#include "sensor/fourier.hpp"

namespace atomcam {
namespace {

/// Laws by their generating functions at the roots of unity; the law of output minus input.
struct Spectrum {
  std::vector<std::complex<double>> one;     // of one electron
  std::vector<std::complex<double>> serial;  // of a charge born at a uniformly chosen stage
};

/// More exact tables than 2^4 where the gain is low: the gamma law is only used where the register adds 500
/// electrons or more, so that its continuity and its fourth moment no longer show.
int exact_powers(double gain) {
  int powers = 5;
  while (powers < 19 && (gain - 1) * std::ldexp(1.0, powers) < 512) ++powers;
  return powers;
}

/// Power of two that holds all of the law of 2^power electrons but 1e-11: an exponential's tail for few
/// electrons, seven standard deviations for many.
std::size_t law_size(double gain, int power) {
  const double electrons = std::ldexp(1.0, power);
  const double reach = electrons * (gain - 1) + 7 * std::sqrt(electrons * gain * (gain - 1)) + 26 * gain + 64;
  return std::bit_ceil(static_cast<std::size_t>(reach));
}

Spectrum spectrum(double p, int stages, std::size_t size) {
  // Half of the roots: the laws are real. Real and imaginary parts apart, so that the loop over roots
  // vectorises.
  const std::size_t half = size / 2 + 1;
  std::vector<double> re(half), im(half), sum_re(half, 0), sum_im(half, 0);
  std::vector<std::complex<double>> root(half);
  for (std::size_t m = 0; m < half; ++m) {
    const double turns = static_cast<double>(m) / static_cast<double>(size);
    root[m] = {math::cos_turns(turns), math::sin_turns(turns)};
    re[m] = root[m].real();
    im[m] = root[m].imag();
  }
  const double q = 1 - p;
  for (int stage = 0; stage < stages; ++stage) {
    for (std::size_t m = 0; m < half; ++m) {
      const double x = re[m], y = im[m], a = q + p * x, b = p * y;
      sum_re[m] += x;
      sum_im[m] += y;
      re[m] = x * a - y * b;
      im[m] = x * b + y * a;
    }
  }
  Spectrum result{std::vector<std::complex<double>>(half), std::vector<std::complex<double>>(half)};
  for (std::size_t m = 0; m < half; ++m) {
    const std::complex<double> back = std::conj(root[m]);  // one electron less: the extra ones
    result.one[m] = std::complex<double>(re[m], im[m]) * back;
    result.serial[m] = std::complex<double>(sum_re[m] / stages, sum_im[m] / stages) * back;
  }
  return result;
}

/// The law on 0..size-1 from half of the roots of some multiple of `size`: every so many of them are enough.
std::vector<double> law_of(const std::vector<std::complex<double>>& half, std::size_t size) {
  const std::size_t stride = 2 * (half.size() - 1) / size;
  std::vector<std::complex<double>> value(size);
  for (std::size_t m = 0; m <= size / 2; ++m) value[m] = half[m * stride];
  for (std::size_t m = size / 2 + 1; m < size; ++m) value[m] = std::conj(value[size - m]);
  fourier_transform(value);
  std::vector<double> law(size);
  for (std::size_t k = 0; k < size; ++k) law[k] = std::max(value[k].real() / static_cast<double>(size), 0.0);
  return law;
}

AliasTable table_of(const std::vector<std::complex<double>>& half, std::size_t size) {
  std::vector<double> cumulative = law_of(half, size);
  double total = 0;
  for (double& p : cumulative) p = total += p;
  for (double& p : cumulative) p /= total;
  return AliasTable(cumulative, 0);
}

void square(std::vector<std::complex<double>>& spectrum_values) {
  for (std::complex<double>& z : spectrum_values) {
    const double x = z.real(), y = z.imag();
    z = {x * x - y * y, 2 * x * y};
  }
}

double duplication(double gain, int stages) {
  if (stages < 1) throw Error("register_stages", std::to_string(stages) + " is below 1");
  const double p = math::exp(math::log(gain) / stages) - 1;
  if (!(gain >= 1) || p > 0.25)
    throw Error("em_gain", std::to_string(gain) + " is outside 1 to 1.25^" + std::to_string(stages));
  return std::max(p, 0.0);
}

}  // namespace

RegisterLaw::RegisterLaw(double gain, int stages) : gain_(gain), p_(duplication(gain, stages)) {
  if (gain == 1) {
    p_ = 0;
    cumulants_ = {1, 0, 0};
    serial_mean_ = 1;
    const std::array<double, 1> certain{1.0};
    powers_.assign(19, AliasTable(certain, 0));
    serial_ = AliasTable(certain, 0);
    largest_exact_ = (1 << powers_.size()) - 1;
    return;
  }
  // Cumulants of a stage, carried through the stages: K_out(t) = K_in(K_stage(t)).
  const double q = 1 - p_, m1 = 1 + p_, m2 = p_ * q, m3 = p_ * q * (q - p_);
  cumulants_ = {1, 0, 0};
  for (int stage = 0; stage < stages; ++stage) {
    const auto [c1, c2, c3] = cumulants_;
    cumulants_ = {c1 * m1, c1 * m2 + c2 * m1 * m1, c1 * m3 + 3 * c2 * m1 * m2 + c3 * m1 * m1 * m1};
  }
  cumulants_[0] = gain;
  serial_mean_ = (gain - 1) / (stages * p_);

  const int powers = exact_powers(gain);
  Spectrum laws = spectrum(p_, stages, law_size(gain, powers - 1));
  serial_ = table_of(laws.serial, law_size(gain, 0));
  for (int power = 0; power < powers; ++power) {
    powers_.push_back(table_of(laws.one, law_size(gain, power)));
    square(laws.one);
  }
  largest_exact_ = (1 << powers_.size()) - 1;
}

float RegisterLaw::draw_large(std::int32_t electrons, RandomStream& random) const {
  // Pearson III: shift + scale * Gamma(shape); rounding to integers adds 1/12 to the variance.
  const double n = electrons, mean = n * cumulants_[0], variance = n * cumulants_[1] - 1.0 / 12;
  const double third = n * cumulants_[2];
  const double scale = third / (2 * variance), shape = variance / (scale * scale);
  const double output = std::floor(mean - shape * scale + scale * sample_gamma(random, shape) + 0.5);
  return static_cast<float>(std::max(output, n));
}

std::vector<double> RegisterLaw::extra_law(double gain, int stages, int power) {
  const std::size_t size = law_size(gain, power);
  std::vector<std::complex<double>> one = spectrum(duplication(gain, stages), stages, size).one;
  for (int i = 0; i < power; ++i) square(one);
  return law_of(one, size);
}

}  // namespace atomcam
