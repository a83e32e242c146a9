// The loops, compiled once per instruction set by the include below.
//
// The limits, per pixel, at 2.7 GHz with AVX-512 (bench/sensor_bench): random words 0.38 ns each, half of one
// for the electrons and one for the read noise (ten rounds of four operations on 16 words, two a cycle); the
// read noise's normal number 0.7 ns (some sixty operations on 16 pixels); the electrons' thresholds 0.2 ns. A
// full qCMOS frame, 22 ms, moves 6 bytes of maps and 2 of counts a pixel, 75 MB, which at 10 GB/s would be 8
// ms: arithmetic is the limit since the maps are in fixed point. An EMCCD frame, 1 ms, spends a third of it
// in the register's tables, one look-up of a cache line for each of some 50,000 pixels that hold an electron.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "sensor/row_loops.cpp"  // NOLINT
#include "base/instruction_sets.hpp"
// Highway's own include order: foreach_target before highway.
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include <algorithm>
#include <cmath>

#include "sensor/row_loops.hpp"
#include "sensor/word_laws.hpp"

HWY_BEFORE_NAMESPACE();
namespace atomcam::row_loops::HWY_NAMESPACE {

// One pixel; the vector loops below use it for what is left of a row.

inline float emccd_analog(const EmccdConversion& conversion, float output_e, std::uint32_t noise) {
  return (conversion.bias_counts + output_e * conversion.counts_per_e) +
         word_laws::normal(noise) * conversion.read_noise_counts;
}

inline float qcmos_analog(const QcmosConversion& conversion, std::size_t c, float output_e,
                          const std::uint32_t* noise, const std::uint32_t* flicker) {
  float electrons = output_e + conversion.row_noise_e;
  if (flicker != nullptr) electrons += word_laws::gumbel(flicker[c]) * conversion.flicker_noise_e;
  electrons += word_laws::normal(noise[c]) * (conversion.read_noise_ratio[c] * conversion.read_noise_e);
  return (conversion.bias_counts + conversion.offset_counts[c]) +
         electrons * (conversion.gain_ratio[c] * conversion.counts_per_e);
}

inline std::uint16_t count_of(float analog_counts, float largest) {
  return static_cast<std::uint16_t>(std::nearbyint(std::min(std::max(analog_counts, 0.0f), largest)));
}

#if HWY_TARGET == HWY_SCALAR
#define ATOMCAM_ROW_VECTORS 0
#else
#define ATOMCAM_ROW_VECTORS 1

namespace hn = hwy::HWY_NAMESPACE;
using F = hn::ScalableTag<float>;
using I = hn::RebindToSigned<F>;
using U = hn::RebindToUnsigned<F>;
using VF = hn::Vec<F>;
using VU = hn::Vec<U>;
using VI = hn::Vec<I>;

/// Horner's scheme without contraction, highest coefficient first.
template <std::size_t size>
HWY_INLINE VF polynomial(VF x, const float (&coefficients)[size]) {
  const F d;
  VF value = hn::Set(d, coefficients[0]);
  for (std::size_t i = 1; i < size; ++i) value = hn::Add(hn::Mul(value, x), hn::Set(d, coefficients[i]));
  return value;
}

// The laws of word_laws.hpp, operation by operation.

/// a x + b
HWY_INLINE VF line(float a, VF x, float b) {
  return hn::Add(hn::Mul(hn::Set(F(), a), x), hn::Set(F(), b));
}

HWY_INLINE VF minus_log(VF x) {
  const F d;
  const I i;
  const VI origin = hn::Set(i, 0x3f3504f3);
  const VI bits = hn::Sub(hn::BitCast(i, x), origin);
  const VF k = hn::ConvertTo(d, hn::ShiftRight<23>(bits));
  const VF f =
      hn::Sub(hn::BitCast(d, hn::Add(hn::And(bits, hn::Set(i, 0x007fffff)), origin)), hn::Set(d, 1.0f));
  const VF f2 = hn::Mul(f, f), f4 = hn::Mul(f2, f2);
  const VF low =
      hn::Add(line(0.500003751f, f, -0.999999968f), hn::Mul(line(0.249689070f, f, -0.333346060f), f2));
  const VF high =
      hn::Add(line(0.172782061f, f, -0.199133479f), hn::Mul(line(0.0989535074f, f, -0.161262479f), f2));
  return hn::Sub(hn::Mul(f, hn::Add(low, hn::Mul(high, f4))), hn::Mul(k, hn::Set(d, 0.693147182f)));
}

HWY_INLINE VF normal(VU word) {
  const F d;
  const I i;
  const VI sign = hn::ShiftRight<31>(hn::BitCast(i, word));
  const VI m = hn::Xor(hn::BitCast(i, word), sign);
  const VF n = hn::Add(hn::ConvertTo(d, m), hn::Set(d, 0.5f));
  const VF x = hn::Sub(hn::Set(d, 1.0f), hn::Mul(n, hn::Set(d, 0x1p-31f)));
  const VF w = minus_log(hn::Mul(n, hn::Sub(hn::Set(d, 0x1p-30f), hn::Mul(n, hn::Set(d, 0x1p-62f)))));
  const VF u = hn::Sub(w, hn::Set(d, 2.5f)), u2 = hn::Mul(u, u), u4 = hn::Mul(u2, u2);
  const VF low =
      hn::Add(line(3.48802717e-1f, u, 2.12331347f), hn::Mul(line(-1.77308282e-3f, u, -5.9076601e-3f), u2));
  const VF high = hn::Add(line(-6.19474573e-6f, u, 3.08741177e-4f),
                          hn::Mul(line(4.83978825e-7f, u, -4.88579604e-6f), u2));
  VF p = hn::Add(hn::Add(low, hn::Mul(high, u4)), hn::Mul(hn::Set(d, 3.19696803e-8f), hn::Mul(u4, u4)));
  const auto central = hn::Gt(m, hn::Set(i, word_laws::first_tail_word));
  if (HWY_UNLIKELY(!hn::AllTrue(i, central))) {
    const VF v = hn::Sub(hn::Sqrt(w), hn::Set(d, 3.5f)), v2 = hn::Mul(v, v), v4 = hn::Mul(v2, v2);
    const VF tail_low =
        hn::Add(line(1.42462826f, v, 4.71708871f), hn::Mul(line(-2.8659057e-3f, v, 4.65035662e-3f), v2));
    const VF tail_high = hn::Add(line(-1.06850313e-3f, v, 1.4590706e-3f),
                                 hn::Mul(line(-2.52637681e-4f, v, 7.63966229e-4f), v2));
    const VF tail = hn::Add(hn::Add(tail_low, hn::Mul(tail_high, v4)),
                            hn::Mul(hn::Set(d, 6.54243164e-6f), hn::Mul(v4, v4)));
    p = hn::IfThenElse(hn::RebindMask(d, central), p, tail);
  }
  return hn::Xor(hn::Mul(x, p), hn::And(hn::BitCast(d, sign), hn::Set(d, -0.0f)));
}

/// The upper 31 bits of the word as a number in (0, 1].
HWY_INLINE VF fraction(VU word) {
  const F d;
  const VF m = hn::ConvertTo(d, hn::BitCast(I(), hn::ShiftRight<1>(word)));
  return hn::Mul(hn::Add(m, hn::Set(d, 0.5f)), hn::Set(d, 0x1p-31f));
}

HWY_INLINE VF gumbel(VU word) {
  const F d;
  const VF q = hn::Min(fraction(word), hn::Set(d, 0.99999994f));
  const VF u = hn::Sub(hn::Set(d, 1.0f), q);
  const VF exponential = hn::Add(hn::Sub(q, hn::Sub(hn::Set(d, 1.0f), u)), minus_log(u));
  return hn::Sub(minus_log(exponential), hn::Set(d, 0.577215665f));
}

HWY_INLINE VF exp(VF x) {
  const F d;
  const I i;
  const VI k = hn::NearestInt(hn::Mul(x, hn::Set(d, 1.44269504f)));
  const VF kf = hn::ConvertTo(d, k);
  const VF r =
      hn::Sub(hn::Sub(x, hn::Mul(kf, hn::Set(d, 0.693145752f))), hn::Mul(kf, hn::Set(d, 1.42860677e-6f)));
  const VF p = polynomial(r, {1.0f / 5040, 1.0f / 720, 1.0f / 120, 1.0f / 24, 1.0f / 6, 0.5f, 1.0f, 1.0f});
  return hn::Mul(p, hn::BitCast(d, hn::ShiftLeft<23>(hn::Add(k, hn::Set(i, 127)))));
}

template <class Number>
HWY_INLINE VF load_fixed(const FixedRow<Number>& row, std::size_t c) {
  const F d;
  const hn::Rebind<Number, F> narrow;
  return hn::Mul(hn::ConvertTo(d, hn::PromoteTo(I(), hn::LoadU(narrow, row.numbers + c))),
                 hn::Set(d, row.scale));
}

HWY_INLINE VF emccd_analog_vector(const EmccdConversion& conversion, VF output_e,
                                  const std::uint32_t* noise) {
  const F d;
  return hn::Add(
      hn::Add(hn::Set(d, conversion.bias_counts), hn::Mul(output_e, hn::Set(d, conversion.counts_per_e))),
      hn::Mul(normal(hn::LoadU(U(), noise)), hn::Set(d, conversion.read_noise_counts)));
}

HWY_INLINE VF qcmos_analog_vector(const QcmosConversion& conversion, std::size_t c, VF output_e,
                                  const std::uint32_t* noise, const std::uint32_t* flicker) {
  const F d;
  VF electrons = hn::Add(output_e, hn::Set(d, conversion.row_noise_e));
  if (flicker != nullptr)
    electrons = hn::Add(electrons,
                        hn::Mul(gumbel(hn::LoadU(U(), flicker + c)), hn::Set(d, conversion.flicker_noise_e)));
  const VF sigma = hn::Mul(load_fixed(conversion.read_noise_ratio, c), hn::Set(d, conversion.read_noise_e));
  electrons = hn::Add(electrons, hn::Mul(normal(hn::LoadU(U(), noise + c)), sigma));
  const VF zero = hn::Add(hn::Set(d, conversion.bias_counts), load_fixed(conversion.offset_counts, c));
  const VF slope = hn::Mul(load_fixed(conversion.gain_ratio, c), hn::Set(d, conversion.counts_per_e));
  return hn::Add(zero, hn::Mul(electrons, slope));
}

HWY_INLINE void store_counts(VF analog_counts, float largest, std::uint16_t* counts) {
  const F d;
  const VF clipped = hn::Min(hn::Max(analog_counts, hn::Zero(d)), hn::Set(d, largest));
  // Added to 2^23 the number is rounded, ties to even, into the lower bits.
  const VI rounded = hn::BitCast(I(), hn::Add(clipped, hn::Set(d, 0x1p23f)));
  const hn::Rebind<std::uint16_t, F> d16;
  hn::StoreU(hn::DemoteTo(d16, hn::Sub(rounded, hn::Set(I(), 0x4b000000))), d16, counts);
}

#endif

void emccd_amplify_loop(const EmccdConversion& conversion, const float* output_e, const std::uint32_t* noise,
                        float* analog_counts, std::size_t columns) {
  std::size_t c = 0;
#if ATOMCAM_ROW_VECTORS
  const F d;
  for (; c + hn::Lanes(d) <= columns; c += hn::Lanes(d))
    hn::StoreU(emccd_analog_vector(conversion, hn::LoadU(d, output_e + c), noise + c), d, analog_counts + c);
#endif
  for (; c < columns; ++c) analog_counts[c] = emccd_analog(conversion, output_e[c], noise[c]);
}

void emccd_convert_loop(const EmccdConversion& conversion, const float* output_e, const std::uint32_t* noise,
                        std::uint16_t* counts, std::size_t columns) {
  std::size_t c = 0;
#if ATOMCAM_ROW_VECTORS
  const F d;
  for (; c + hn::Lanes(d) <= columns; c += hn::Lanes(d))
    store_counts(emccd_analog_vector(conversion, hn::LoadU(d, output_e + c), noise + c),
                 conversion.largest_count, counts + c);
#endif
  for (; c < columns; ++c)
    counts[c] = count_of(emccd_analog(conversion, output_e[c], noise[c]), conversion.largest_count);
}

void qcmos_amplify_loop(const QcmosConversion& conversion, const float* output_e, const std::uint32_t* noise,
                        const std::uint32_t* flicker, float* analog_counts, std::size_t columns) {
  std::size_t c = 0;
#if ATOMCAM_ROW_VECTORS
  const F d;
  for (; c + hn::Lanes(d) <= columns; c += hn::Lanes(d))
    hn::StoreU(qcmos_analog_vector(conversion, c, hn::LoadU(d, output_e + c), noise, flicker), d,
               analog_counts + c);
#endif
  for (; c < columns; ++c) analog_counts[c] = qcmos_analog(conversion, c, output_e[c], noise, flicker);
}

void qcmos_convert_loop(const QcmosConversion& conversion, const std::int32_t* electrons,
                        const std::uint32_t* noise, const std::uint32_t* flicker, std::uint16_t* counts,
                        std::size_t columns) {
  std::size_t c = 0;
#if ATOMCAM_ROW_VECTORS
  const F d;
  for (; c + hn::Lanes(d) <= columns; c += hn::Lanes(d)) {
    const VF output_e = hn::ConvertTo(d, hn::LoadU(I(), electrons + c));
    store_counts(qcmos_analog_vector(conversion, c, output_e, noise, flicker), conversion.largest_count,
                 counts + c);
  }
#endif
  for (; c < columns; ++c)
    counts[c] = count_of(qcmos_analog(conversion, c, static_cast<float>(electrons[c]), noise, flicker),
                         conversion.largest_count);
}

void digitise_loop(const float* analog_counts, float largest, std::uint16_t* counts, std::size_t columns) {
  std::size_t c = 0;
#if ATOMCAM_ROW_VECTORS
  const F d;
  for (; c + hn::Lanes(d) <= columns; c += hn::Lanes(d))
    store_counts(hn::LoadU(d, analog_counts + c), largest, counts + c);
#endif
  for (; c < columns; ++c) counts[c] = count_of(analog_counts[c], largest);
}

bool count_thresholds_loop(const std::uint32_t* words, const std::uint16_t* thresholds, std::size_t count,
                           std::int32_t* numbers, std::size_t columns) {
  std::size_t c = 0;
  bool undecided = false;
#if ATOMCAM_ROW_VECTORS
  // Compared as signed numbers, the only comparison every instruction set has: both sides less 2^15.
  const hn::ScalableTag<std::int16_t> d;
  const hn::Half<decltype(d)> half;
  const I wide;
  const auto flip = hn::Set(d, static_cast<std::int16_t>(-32768));
  auto equal = hn::FirstN(d, 0);
  const std::size_t lanes = hn::Lanes(d);
  for (; c + lanes <= columns; c += lanes) {
    const auto u = hn::Xor(hn::BitCast(d, hn::LoadU(U(), words + c / 2)), flip);
    auto number = hn::Zero(d);
    for (std::size_t k = 0; k < count; ++k) {
      const auto threshold = hn::Set(d, static_cast<std::int16_t>(thresholds[k] ^ 0x8000));
      number = hn::Sub(number, hn::VecFromMask(d, hn::Gt(u, threshold)));
      equal = hn::Or(equal, hn::Eq(u, threshold));
    }
    hn::StoreU(hn::PromoteTo(wide, hn::LowerHalf(half, number)), wide, numbers + c);
    hn::StoreU(hn::PromoteTo(wide, hn::UpperHalf(half, number)), wide, numbers + c + lanes / 2);
  }
  undecided = !hn::AllFalse(d, equal);
#endif
  for (; c < columns; ++c) {
    const auto u = static_cast<std::uint16_t>(words[c / 2] >> (16 * (c % 2)));
    std::int32_t number = 0;
    for (std::size_t k = 0; k < count; ++k) {
      number += u > thresholds[k] ? 1 : 0;
      undecided = undecided || u == thresholds[k];
    }
    numbers[c] = number;
  }
  return undecided;
}

std::size_t spread_electrons_loop(const std::int32_t* electrons, float well_e, float* output_e,
                                  std::int32_t* packet_columns, std::int32_t* packet_electrons,
                                  std::size_t columns) {
  std::size_t c = 0, found = 0;
  // Without a branch: the lists have room for one that does not count.
  const auto list = [&](std::size_t column) {
    packet_columns[found] = static_cast<std::int32_t>(column);
    packet_electrons[found] = electrons[column];
    found += electrons[column] > 0 ? 1 : 0;
  };
#if ATOMCAM_ROW_VECTORS
  const F d;
  const I i;
  for (; c + hn::Lanes(d) <= columns; c += hn::Lanes(d)) {
    const VI n = hn::LoadU(i, electrons + c);
    hn::StoreU(hn::Min(hn::ConvertTo(d, n), hn::Set(d, well_e)), d, output_e + c);
    if (hn::AllFalse(i, hn::Gt(n, hn::Zero(i)))) continue;
    for (std::size_t k = c; k < c + hn::Lanes(d); ++k) list(k);
  }
#endif
  for (; c < columns; ++c) {
    output_e[c] = std::min(static_cast<float>(electrons[c]), well_e);
    list(c);
  }
  return found;
}

void normal_row_loop(const std::uint32_t* words, float* values, std::size_t count) {
  std::size_t c = 0;
#if ATOMCAM_ROW_VECTORS
  const F d;
  for (; c + hn::Lanes(d) <= count; c += hn::Lanes(d))
    hn::StoreU(normal(hn::LoadU(U(), words + c)), d, values + c);
#endif
  for (; c < count; ++c) values[c] = word_laws::normal(words[c]);
}

void log_normal_row_loop(const std::uint32_t* words, float scale, float shift, float* values,
                         std::size_t count) {
  std::size_t c = 0;
#if ATOMCAM_ROW_VECTORS
  const F d;
  for (; c + hn::Lanes(d) <= count; c += hn::Lanes(d)) {
    const VF exponent =
        hn::Add(hn::Mul(hn::Set(d, scale), normal(hn::LoadU(U(), words + c))), hn::Set(d, shift));
    hn::StoreU(exp(exponent), d, values + c);
  }
#endif
  for (; c < count; ++c) values[c] = word_laws::exp(scale * word_laws::normal(words[c]) + shift);
}

void exponential_row_loop(const std::uint32_t* words, float* values, std::size_t count) {
  std::size_t c = 0;
#if ATOMCAM_ROW_VECTORS
  const F d;
  for (; c + hn::Lanes(d) <= count; c += hn::Lanes(d))
    hn::StoreU(minus_log(fraction(hn::LoadU(U(), words + c))), d, values + c);
#endif
  for (; c < count; ++c) values[c] = word_laws::minus_log(word_laws::fraction(words[c]));
}

void clip_loop(std::int32_t largest, std::int32_t* electrons, std::size_t columns) {
  std::size_t c = 0;
#if ATOMCAM_ROW_VECTORS
  const I i;
  for (; c + hn::Lanes(i) <= columns; c += hn::Lanes(i))
    hn::StoreU(hn::Min(hn::LoadU(i, electrons + c), hn::Set(i, largest)), i, electrons + c);
#endif
  for (; c < columns; ++c) electrons[c] = std::min(electrons[c], largest);
}

#undef ATOMCAM_ROW_VECTORS

}  // namespace atomcam::row_loops::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace atomcam::row_loops {

HWY_EXPORT(emccd_amplify_loop);
HWY_EXPORT(emccd_convert_loop);
HWY_EXPORT(qcmos_amplify_loop);
HWY_EXPORT(qcmos_convert_loop);
HWY_EXPORT(digitise_loop);
HWY_EXPORT(count_thresholds_loop);
HWY_EXPORT(spread_electrons_loop);
HWY_EXPORT(clip_loop);
HWY_EXPORT(normal_row_loop);
HWY_EXPORT(log_normal_row_loop);
HWY_EXPORT(exponential_row_loop);

void emccd_amplify(const EmccdConversion& conversion, std::span<const float> output_e,
                   const std::uint32_t* noise, std::span<float> analog_counts) {
  HWY_DYNAMIC_DISPATCH(emccd_amplify_loop)
  (conversion, output_e.data(), noise, analog_counts.data(), output_e.size());
}

void emccd_convert(const EmccdConversion& conversion, std::span<const float> output_e,
                   const std::uint32_t* noise, std::span<std::uint16_t> counts) {
  HWY_DYNAMIC_DISPATCH(emccd_convert_loop)
  (conversion, output_e.data(), noise, counts.data(), output_e.size());
}

void qcmos_amplify(const QcmosConversion& conversion, std::span<const float> output_e,
                   const std::uint32_t* noise, const std::uint32_t* flicker, std::span<float> analog_counts) {
  HWY_DYNAMIC_DISPATCH(qcmos_amplify_loop)
  (conversion, output_e.data(), noise, flicker, analog_counts.data(), output_e.size());
}

void qcmos_convert(const QcmosConversion& conversion, std::span<const std::int32_t> electrons,
                   const std::uint32_t* noise, const std::uint32_t* flicker,
                   std::span<std::uint16_t> counts) {
  HWY_DYNAMIC_DISPATCH(qcmos_convert_loop)
  (conversion, electrons.data(), noise, flicker, counts.data(), electrons.size());
}

void digitise(std::span<const float> analog_counts, float largest_count, std::span<std::uint16_t> counts) {
  HWY_DYNAMIC_DISPATCH(digitise_loop)(analog_counts.data(), largest_count, counts.data(), counts.size());
}

bool count_thresholds(const std::uint32_t* words, std::span<const std::uint16_t> thresholds,
                      std::span<std::int32_t> numbers) {
  return HWY_DYNAMIC_DISPATCH(count_thresholds_loop)(words, thresholds.data(), thresholds.size(),
                                                     numbers.data(), numbers.size());
}

void spread_electrons(std::span<const std::int32_t> electrons, float well_e, std::span<float> output_e,
                      Packets& packets) {
  packets.columns.resize(electrons.size() + 1);
  packets.electrons.resize(electrons.size() + 1);
  packets.count = HWY_DYNAMIC_DISPATCH(spread_electrons_loop)(electrons.data(), well_e, output_e.data(),
                                                              packets.columns.data(),
                                                              packets.electrons.data(), electrons.size());
}

void normal_row(std::span<const std::uint32_t> words, std::span<float> values) {
  HWY_DYNAMIC_DISPATCH(normal_row_loop)(words.data(), values.data(), values.size());
}

void log_normal_row(std::span<const std::uint32_t> words, float scale, float shift, std::span<float> values) {
  HWY_DYNAMIC_DISPATCH(log_normal_row_loop)(words.data(), scale, shift, values.data(), values.size());
}

void exponential_row(std::span<const std::uint32_t> words, std::span<float> values) {
  HWY_DYNAMIC_DISPATCH(exponential_row_loop)(words.data(), values.data(), values.size());
}

void clip(std::int32_t largest, std::span<std::int32_t> electrons) {
  HWY_DYNAMIC_DISPATCH(clip_loop)(largest, electrons.data(), electrons.size());
}

namespace plain {

void emccd_amplify(const EmccdConversion& conversion, std::span<const float> output_e,
                   const std::uint32_t* noise, std::span<float> analog_counts) {
  for (std::size_t c = 0; c < output_e.size(); ++c)
    analog_counts[c] = HWY_STATIC_DISPATCH(emccd_analog)(conversion, output_e[c], noise[c]);
}

void qcmos_amplify(const QcmosConversion& conversion, std::span<const float> output_e,
                   const std::uint32_t* noise, const std::uint32_t* flicker, std::span<float> analog_counts) {
  for (std::size_t c = 0; c < output_e.size(); ++c)
    analog_counts[c] = HWY_STATIC_DISPATCH(qcmos_analog)(conversion, c, output_e[c], noise, flicker);
}

void digitise(std::span<const float> analog_counts, float largest_count, std::span<std::uint16_t> counts) {
  for (std::size_t c = 0; c < counts.size(); ++c)
    counts[c] = HWY_STATIC_DISPATCH(count_of)(analog_counts[c], largest_count);
}

}  // namespace plain

}  // namespace atomcam::row_loops
#endif  // HWY_ONCE
