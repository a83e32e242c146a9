// The loop, compiled once per instruction set by the include below.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "optics/core_sums.cpp"  // NOLINT
#include "base/instruction_sets.hpp"
// Highway's own include order: foreach_target before highway.
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include "optics/core_sums.hpp"

HWY_BEFORE_NAMESPACE();
namespace atomcam::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

void core_sums_loop(const double* re, const double* im, std::size_t terms, const double* cosine,
                    const double* sine, std::size_t columns, CoreSums sums) {
  const hn::CappedTag<double, core_sum_columns> d;
  for (std::size_t i = 0; i < columns; i += hn::Lanes(d)) {
    auto even_re = hn::Zero(d), even_im = hn::Zero(d), odd_re = hn::Zero(d), odd_im = hn::Zero(d);
    for (std::size_t k = 0; k < terms; ++k) {
      const auto a = hn::Set(d, re[k]), b = hn::Set(d, im[k]);
      const auto c = hn::LoadU(d, cosine + k * columns + i), s = hn::LoadU(d, sine + k * columns + i);
      even_re = hn::Add(even_re, hn::Mul(a, c));  // never fused: the bits must not depend on the processor
      even_im = hn::Add(even_im, hn::Mul(b, c));
      odd_re = hn::Add(odd_re, hn::Mul(a, s));
      odd_im = hn::Add(odd_im, hn::Mul(b, s));
    }
    hn::StoreU(even_re, d, sums.even_re + i);
    hn::StoreU(even_im, d, sums.even_im + i);
    hn::StoreU(odd_re, d, sums.odd_re + i);
    hn::StoreU(odd_im, d, sums.odd_im + i);
  }
}

}  // namespace atomcam::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace atomcam {

HWY_EXPORT(core_sums_loop);

void core_sums(std::span<const double> re, std::span<const double> im, const double* cosine,
               const double* sine, std::size_t columns, CoreSums sums) {
  HWY_DYNAMIC_DISPATCH(core_sums_loop)(re.data(), im.data(), re.size(), cosine, sine, columns, sums);
}

}  // namespace atomcam
#endif  // HWY_ONCE
