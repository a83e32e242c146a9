// The loop, compiled once per instruction set by the include below.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "optics/pupil_row.cpp"  // NOLINT
#include "base/instruction_sets.hpp"
// Highway's own include order: foreach_target before highway.
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include "base/math.hpp"
#include "optics/pupil_row.hpp"

HWY_BEFORE_NAMESPACE();
namespace atomcam::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

using Tag = hn::CappedTag<double, pupil_row_step>;
using Vector = hn::Vec<Tag>;

// Products and sums are never fused: the bits must not depend on the processor.
template <std::size_t n>
Vector polynomial(const std::array<double, n>& coefficient, Vector x) {
  const Tag d;
  auto sum = hn::Set(d, coefficient[n - 1]);
  for (std::size_t i = n - 1; i-- > 0;) sum = hn::Add(hn::Mul(sum, x), hn::Set(d, coefficient[i]));
  return sum;
}

struct Wave {
  Vector sine, cosine;
};

/// Of 2 pi turns: Taylor's series after taking away the nearest quarter turn.
Wave wave(Vector turns) {
  constexpr std::array<double, 8> sine_series{
      1.0,          -1.0 / 6,        1.0 / 120,          -1.0 / 5040,
      1.0 / 362880, -1.0 / 39916800, 1.0 / 6227020800.0, -1.0 / 1307674368000.0};
  constexpr std::array<double, 9> cosine_series{1.0,
                                                -1.0 / 2,
                                                1.0 / 24,
                                                -1.0 / 720,
                                                1.0 / 40320,
                                                -1.0 / 3628800,
                                                1.0 / 479001600,
                                                -1.0 / 87178291200.0,
                                                1.0 / 20922789888000.0};
  const Tag d;
  const auto half = hn::Set(d, 0.5), zero = hn::Zero(d);
  const auto quarters = hn::Round(hn::Mul(turns, hn::Set(d, 4.0)));
  const auto rest = hn::Mul(hn::Sub(turns, hn::Mul(quarters, hn::Set(d, 0.25))), hn::Set(d, 2 * math::pi));
  const auto square = hn::Mul(rest, rest);
  const auto s = hn::Mul(rest, polynomial(sine_series, square));
  const auto c = polynomial(cosine_series, square);
  const auto halves = hn::Floor(hn::Mul(quarters, half));
  const auto odd = hn::Ne(hn::Sub(quarters, hn::Add(halves, halves)), zero);
  const auto wholes = hn::Floor(hn::Mul(halves, half));
  const auto flipped = hn::Ne(hn::Sub(halves, hn::Add(wholes, wholes)), zero);
  const auto sine = hn::IfThenElse(odd, c, s);
  const auto cosine = hn::IfThenElse(odd, hn::Neg(s), c);
  return {hn::IfThenElse(flipped, hn::Neg(sine), sine), hn::IfThenElse(flipped, hn::Neg(cosine), cosine)};
}

/// sin(pi x) / (pi x)
Vector sinc(Vector x) {
  const Tag d;
  const auto small = hn::Lt(hn::Abs(x), hn::Set(d, 1e-3));
  const auto safe = hn::IfThenElse(small, hn::Set(d, 1.0), x);
  const auto far = hn::Div(wave(hn::Mul(safe, hn::Set(d, 0.5))).sine, hn::Mul(safe, hn::Set(d, math::pi)));
  const auto near = hn::Sub(hn::Set(d, 1.0), hn::Mul(hn::Set(d, math::pi * math::pi / 6), hn::Mul(x, x)));
  return hn::IfThenElse(small, near, far);
}

void pupil_row_loop(const PupilRow& row, int first, int count, double* out) {
  const Tag d;
  const auto spacing = hn::Set(d, row.spacing);
  for (int n = 0; n < count; n += static_cast<int>(hn::Lanes(d))) {
    const auto x = hn::Mul(hn::Iota(d, static_cast<double>(first + n)), spacing);
    const auto square = hn::Mul(x, x);
    const auto left =
        hn::Sub(hn::Set(d, 1 - row.sine_square_y), hn::Mul(hn::Set(d, row.sine_square), square));
    const auto passed = hn::Sub(hn::Set(d, 1 - row.edge_loss_y), hn::Mul(hn::Set(d, row.edge_loss), square));
    auto amplitude = hn::Div(passed, hn::Sqrt(hn::Sqrt(left)));
    amplitude = hn::Mul(amplitude, sinc(polynomial(row.slope_x, x)));
    amplitude = hn::Mul(amplitude, sinc(polynomial(row.slope_y, x)));
    const Wave phase = wave(polynomial(row.turns, x));
    hn::StoreInterleaved2(hn::Mul(amplitude, phase.cosine), hn::Mul(amplitude, phase.sine), d, out + 2 * n);
  }
}

}  // namespace atomcam::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace atomcam {

HWY_EXPORT(pupil_row_loop);

void pupil_row(const PupilRow& row, int first, int count, std::complex<double>* out) {
  HWY_DYNAMIC_DISPATCH(pupil_row_loop)(row, first, count, reinterpret_cast<double*>(out));
}

}  // namespace atomcam
#endif
