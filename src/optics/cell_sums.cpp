// The loop, compiled once per instruction set by the include below.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "optics/cell_sums.cpp"  // NOLINT
#include "base/instruction_sets.hpp"
// Highway's own include order: foreach_target before highway.
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include "optics/cell_sums.hpp"

HWY_BEFORE_NAMESPACE();
namespace atomcam::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

void cell_sums_loop(const double* weights, std::size_t terms, const double* samples, double* out) {
  const hn::CappedTag<double, cell_sum_lines / 4> d;
  const std::size_t lanes = hn::Lanes(d);
  for (std::size_t c = 0; c < cell_sum_lines; c += 4 * lanes) {
    auto a = hn::Zero(d), b = hn::Zero(d), e = hn::Zero(d), f = hn::Zero(d);
    const double* at = samples + c;
    for (std::size_t n = 0; n < terms; ++n, at += cell_sum_lines) {
      const auto weight = hn::Set(d, weights[n]);  // never fused: the bits must not depend on the processor
      a = hn::Add(a, hn::Mul(weight, hn::LoadU(d, at)));
      b = hn::Add(b, hn::Mul(weight, hn::LoadU(d, at + lanes)));
      e = hn::Add(e, hn::Mul(weight, hn::LoadU(d, at + 2 * lanes)));
      f = hn::Add(f, hn::Mul(weight, hn::LoadU(d, at + 3 * lanes)));
    }
    hn::StoreU(a, d, out + c);
    hn::StoreU(b, d, out + c + lanes);
    hn::StoreU(e, d, out + c + 2 * lanes);
    hn::StoreU(f, d, out + c + 3 * lanes);
  }
}

}  // namespace atomcam::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace atomcam {

HWY_EXPORT(cell_sums_loop);

void cell_sums(std::span<const double> weights, const double* samples, double* out) {
  HWY_DYNAMIC_DISPATCH(cell_sums_loop)(weights.data(), weights.size(), samples, out);
}

}  // namespace atomcam
#endif  // HWY_ONCE
