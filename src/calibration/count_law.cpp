#include "calibration/count_law.hpp"

#include <fftw3.h>

#include <cmath>
#include <complex>
#include <map>
#include <numbers>
#include <numeric>

#include "base/fftw_planner.hpp"

namespace atomcam {
namespace {

/// Plans are made once per size and there until the end; executing one on other arrays is thread safe.
fftw_plan inverse_plan(int size) {
  static auto& plans = *new std::map<int, fftw_plan>;
  const std::scoped_lock lock(fftw_planner());
  const auto found = plans.find(size);
  if (found != plans.end()) return found->second;
  auto* in = fftw_alloc_complex(static_cast<std::size_t>(size) / 2 + 1);
  auto* out = fftw_alloc_real(static_cast<std::size_t>(size));
  const fftw_plan plan = fftw_plan_dft_c2r_1d(size, in, out, FFTW_ESTIMATE | FFTW_UNALIGNED);
  fftw_free(in);
  fftw_free(out);
  return plans[size] = plan;
}

}  // namespace

std::uint64_t CountHistogram::total() const {
  return std::accumulate(occurrences.begin(), occurrences.end(), std::uint64_t{0});
}

double excess_noise_factor(double em_gain, int stages) {
  if (!(em_gain > 1)) return 1;
  const double p = stages > 0 ? std::expm1(std::log(em_gain) / stages) : 0;
  return 1 + (1 - p) / (1 + p) * (1 - 1 / em_gain);
}

std::vector<double> count_probabilities(const CountLaw& law, int first, int size) {
  using Complex = std::complex<double>;
  std::vector<Complex> spectrum(static_cast<std::size_t>(size) / 2 + 1);
  const double g = std::max(1.0, law.em_gain), log_g = std::log(g);
  const double a = law.stages > 0 && g > 1 ? 0.5 * std::expm1(log_g / law.stages) : 0;
  // Mean of the flow between its ends; of the values before each stage, not after it.
  const auto serial_value = [&](Complex s, Complex u) -> Complex {
    if (a == 0) return -std::log(1.0 - s + s / g) / log_g;
    if (s == 1.0) return 1;
    return ((1 + a) * std::log((1.0 - u) / (1.0 - s)) + 2 * a * (u - s)) / ((1 + a) * log_g) +
           0.5 * (s - u) / static_cast<double>(law.stages);
  };
  for (int k = 0; k <= size / 2; ++k) {
    const double t = 2 * std::numbers::pi * k / size;
    const Complex s = std::polar(1.0, t / law.electrons_per_count);
    // The flow's invariant: ln((1 - u) / (1 - s)) (1 + a) - ln(u / s) (1 - a) = (1 + a) ln g; from the law of
    // very many stages (a = 0) on by Newton's steps.
    Complex one = s / (g - (g - 1) * s);
    if (a > 0 && k > 0)
      for (int step = 0; step < 2; ++step) {
        const Complex off =
            (1 + a) * (std::log((1.0 - one) / (1.0 - s)) - log_g) - (1 - a) * std::log(one / s);
        one -= off / (-(1 + a) / (1.0 - one) - (1 - a) / one);
      }
    const Complex shortfall = law.events_e * (1.0 - one);
    Complex log_value = law.events_spread > 1e-9
                            ? -std::log(1.0 + law.events_spread * shortfall) / law.events_spread
                            : -shortfall;
    if (law.serial_events > 0 && g > 1 + 1e-9) log_value += law.serial_events * (serial_value(s, one) - 1.0);
    const double sigma = law.read_noise_counts * t;
    log_value -= 0.5 * sigma * sigma;
    const double half = 0.5 * t;
    const double rounding = k == 0 ? 1 : std::sin(half) / half;
    // A real transform of a law that starts at `first`: exp(+i t X) taken at -t.
    spectrum[static_cast<std::size_t>(k)] =
        std::conj(std::exp(log_value) * rounding * std::polar(1.0, t * (law.bias_counts - first)));
  }
  std::vector<double> probabilities(static_cast<std::size_t>(size));
  fftw_execute_dft_c2r(inverse_plan(size), reinterpret_cast<fftw_complex*>(spectrum.data()),
                       probabilities.data());
  for (double& p : probabilities) p = std::max(0.0, p / size);
  return probabilities;
}

}  // namespace atomcam
