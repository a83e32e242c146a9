#pragma once
// Eight pixels at a time. A sum over a plane is the sum of eight lanes in a fixed order, so its bits do not
// depend on the width of the machine's vectors.

#include <cstddef>
#include <cstdint>
#include <cstring>

// A function compiled for the baseline and for AVX2; the loader takes the one that the machine has.
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__) && !defined(ATOMCAM_SANITIZED)
#define ATOMCAM_VECTOR_CLONES __attribute__((target_clones("avx2", "default")))
#else
#define ATOMCAM_VECTOR_CLONES
#endif
// Comparisons and choices stand in the loop itself: in a function of their own they would be taken apart lane
// by lane before they got to know the wide machine.
#define ATOMCAM_SMALLER(a, b) ((a) < (b) ? (a) : (b))
#define ATOMCAM_LARGER(a, b) ((a) > (b) ? (a) : (b))
#define ATOMCAM_INLINE inline __attribute__((always_inline))

namespace atomcam::analysis {

constexpr std::size_t lane_count = 8;
typedef float Lanes __attribute__((vector_size(32)));
typedef std::int32_t IntLanes __attribute__((vector_size(32)));
typedef std::uint16_t CountLanes __attribute__((vector_size(16)));

ATOMCAM_INLINE Lanes load(const float* p) {
  Lanes v;
  std::memcpy(&v, p, sizeof v);
  return v;
}
ATOMCAM_INLINE void store(float* p, Lanes v) {
  std::memcpy(p, &v, sizeof v);
}
ATOMCAM_INLINE Lanes lanes(float x) {
  return Lanes{x, x, x, x, x, x, x, x};
}
ATOMCAM_INLINE double total(Lanes v) {
  return (static_cast<double>(v[0]) + v[1]) + (static_cast<double>(v[2]) + v[3]) +
         ((static_cast<double>(v[4]) + v[5]) + (static_cast<double>(v[6]) + v[7]));
}

}  // namespace atomcam::analysis
