#pragma once
// Laws of one 32-bit random word in single precision, as the per-pixel loops draw them. These scalar
// functions are the definition; the vector loops repeat them operation by operation, so the bits agree on
// every instruction set.

#include <bit>
#include <cmath>
#include <cstdint>

namespace atomcam::word_laws {

/// ln(1 + f) for 1 + f in [sqrt(1/2), sqrt(2)): f - f^2/2 + f^3 R(f), R a Chebyshev fit; relative error about
/// 1e-7.
inline float log_series(float f) {
  float r = 0.0904878443f;
  r = r * f - 0.140308922f;
  r = r * f + 0.147038992f;
  r = r * f - 0.166027188f;
  r = r * f + 0.199842232f;
  r = r * f - 0.250007026f;
  r = r * f + 0.333334154f;
  const float q = f * f;
  return f + (q * (r * f) - 0.5f * q);
}

/// ln(x) of a positive normal number.
inline float log(float x) {
  // x = 2^k (1 + f), 1 + f in [sqrt(1/2), sqrt(2)).
  const auto bits = static_cast<std::int32_t>(std::bit_cast<std::uint32_t>(x) - 0x3f3504f3u);
  const auto k = static_cast<float>(bits >> 23);
  const float f = std::bit_cast<float>((bits & 0x007fffff) + 0x3f3504f3) - 1.0f;
  return k * 0.693147182f + log_series(f);
}

/// The word as a sign and the probability q = (m + 1/2) / 2^32 of the tail on its side, m its 31 other bits.
struct SignedTail {
  bool negative;
  float q;
};
inline SignedTail signed_tail(std::uint32_t word) {
  const auto sign = static_cast<std::int32_t>(word) >> 31;
  const auto m = static_cast<std::int32_t>(word) ^ sign;
  return {sign < 0, (static_cast<float>(m) + 0.5f) * 0x1p-32f};
}

/// Standard normal quantile of the word; |result| below 6.4, the tail's probability right to 1e-4.
inline float normal(std::uint32_t word) {
  // z = x P(w), x = 1 - 2 q, w = -ln(4 q (1 - q)): the form of M. Giles, "Approximating the erfinv function"
  // (2012); own Chebyshev fits in w - 2.5 below 5 and in sqrt(w) - 3.5 above.
  const SignedTail tail = signed_tail(word);
  const float x = 1.0f - 2.0f * tail.q;
  const float w = -log(tail.q * (4.0f - 4.0f * tail.q));
  float p;
  if (w < 5.0f) {
    const float u = w - 2.5f;
    p = 3.19696803e-8f;
    p = p * u + 4.83978825e-7f;
    p = p * u - 4.88579604e-6f;
    p = p * u - 6.19474573e-6f;
    p = p * u + 3.08741177e-4f;
    p = p * u - 1.77308282e-3f;
    p = p * u - 5.9076601e-3f;
    p = p * u + 3.48802717e-1f;
    p = p * u + 2.12331347f;
  } else {
    const float u = std::sqrt(w) - 3.5f;
    p = 6.54243164e-6f;
    p = p * u - 2.52637681e-4f;
    p = p * u + 7.63966229e-4f;
    p = p * u - 1.06850313e-3f;
    p = p * u + 1.4590706e-3f;
    p = p * u - 2.8659057e-3f;
    p = p * u + 4.65035662e-3f;
    p = p * u + 1.42462826f;
    p = p * u + 4.71708871f;
  }
  const float z = x * p;
  return tail.negative ? -z : z;
}

/// Gumbel law of mean 0 and scale 1 (paper, section "Gumbel Distribution").
inline float gumbel(std::uint32_t word) {
  // -ln u, with u = q or 1 - q: near 1 from q itself, without cancellation.
  const SignedTail tail = signed_tail(word);
  float minus_log;
  if (!tail.negative) {
    minus_log = -log(tail.q);
  } else if (tail.q < 0.29f) {
    minus_log = -log_series(-tail.q);
  } else {
    minus_log = -log(1.0f - tail.q);
  }
  return -log(minus_log) - 0.577215665f;
}

}  // namespace atomcam::word_laws
