#pragma once
// Sixteen pixels at a time. A sum over a plane is the sum of sixteen lanes in a fixed order, so its bits do
// not depend on the width of the machine's vectors.

#include <cstddef>
#include <cstdint>
#include <cstring>

// A function compiled for the baseline, AVX2 and AVX-512; the loader takes the one that the machine has.
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__) && !defined(ATOMCAM_SANITIZED)
#define ATOMCAM_VECTOR_CLONES __attribute__((target_clones("avx512f", "avx2", "default")))
#else
#define ATOMCAM_VECTOR_CLONES
#endif
// Comparisons and choices stand in the loop itself: in a function of their own they would be taken apart lane
// by lane before they got to know the wide machine.
#define ATOMCAM_SMALLER(a, b) ((a) < (b) ? (a) : (b))
#define ATOMCAM_LARGER(a, b) ((a) > (b) ? (a) : (b))
#define ATOMCAM_INLINE inline __attribute__((always_inline))

namespace atomcam::analysis {

constexpr std::size_t lane_count = 16;
typedef float Lanes __attribute__((vector_size(64)));
typedef std::int32_t IntLanes __attribute__((vector_size(64)));

ATOMCAM_INLINE Lanes load(const float* p) {
  Lanes v;
  std::memcpy(&v, p, sizeof v);
  return v;
}
ATOMCAM_INLINE void store(float* p, Lanes v) {
  std::memcpy(p, &v, sizeof v);
}
ATOMCAM_INLINE Lanes lanes(float x) {
  return Lanes{x, x, x, x, x, x, x, x, x, x, x, x, x, x, x, x};
}
ATOMCAM_INLINE double total(Lanes v) {
  double sum = 0;
  for (std::size_t l = 0; l < lane_count; ++l) sum += static_cast<double>(v[l]);
  return sum;
}

}  // namespace atomcam::analysis
