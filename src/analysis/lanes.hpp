#pragma once
// Sixteen pixels at a time. A sum over a plane is the sum of sixteen lanes in a fixed order, so its bits do
// not depend on the width of the machine's vectors.

#include <cstddef>
#include <cstdint>

// A function compiled for the baseline, AVX2 and AVX-512; the loader takes the one that the machine has.
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__) && !defined(ATOMCAM_SANITIZED)
#define ATOMCAM_VECTOR_CLONES __attribute__((target_clones("avx512f", "avx2", "default")))
#else
#define ATOMCAM_VECTOR_CLONES
#endif
#define ATOMCAM_INLINE inline __attribute__((always_inline))

namespace atomcam::analysis {

constexpr std::size_t lane_count = 16;
/// In halves: whole ones would be taken apart on machines whose vectors are shorter, comparisons lane by
/// lane.
typedef float HalfLanes __attribute__((vector_size(32)));
struct Lanes {
  HalfLanes low, high;
};

/// Anywhere in an array of floats. (A copy of all lanes would go through memory in quarters.)
typedef float HalfInMemory __attribute__((vector_size(32), aligned(4), may_alias));

ATOMCAM_INLINE Lanes load(const float* p) {
  const HalfInMemory* half = reinterpret_cast<const HalfInMemory*>(p);
  return {half[0], half[1]};
}
ATOMCAM_INLINE void store(float* p, Lanes v) {
  HalfInMemory* half = reinterpret_cast<HalfInMemory*>(p);
  half[0] = v.low;
  half[1] = v.high;
}
ATOMCAM_INLINE Lanes lanes(float x) {
  const HalfLanes half{x, x, x, x, x, x, x, x};
  return {half, half};
}
ATOMCAM_INLINE Lanes operator+(Lanes a, Lanes b) {
  return {a.low + b.low, a.high + b.high};
}
ATOMCAM_INLINE Lanes operator-(Lanes a, Lanes b) {
  return {a.low - b.low, a.high - b.high};
}
ATOMCAM_INLINE Lanes operator*(Lanes a, Lanes b) {
  return {a.low * b.low, a.high * b.high};
}
ATOMCAM_INLINE Lanes& operator+=(Lanes& a, Lanes b) {
  return a = a + b;
}
ATOMCAM_INLINE Lanes smaller(Lanes a, Lanes b) {
  return {a.low < b.low ? a.low : b.low, a.high < b.high ? a.high : b.high};
}
ATOMCAM_INLINE Lanes larger(Lanes a, Lanes b) {
  return {a.low > b.low ? a.low : b.low, a.high > b.high ? a.high : b.high};
}
/// `v` in the lanes where x is above the limit, else zero.
ATOMCAM_INLINE Lanes where_above(Lanes x, Lanes limit, Lanes v) {
  const HalfLanes zero{};
  return {x.low > limit.low ? v.low : zero, x.high > limit.high ? v.high : zero};
}
ATOMCAM_INLINE double total(Lanes v) {
  double sum = 0;
  for (int l = 0; l < 8; ++l) sum += static_cast<double>(v.low[l]);
  for (int l = 0; l < 8; ++l) sum += static_cast<double>(v.high[l]);
  return sum;
}

}  // namespace atomcam::analysis
