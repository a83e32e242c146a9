#pragma once
// Laws of one 32-bit random word in single precision, as the per-pixel loops draw them. These scalar
// functions are the definition; the vector loops repeat them operation by operation, so the bits agree on
// every instruction set.

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>

namespace atomcam::word_laws {

/// -ln(x) of a positive normal number; relative error about 3e-7.
inline float minus_log(float x) {
  // x = 2^k (1 + f), 1 + f in [sqrt(1/2), sqrt(2)); -ln(1 + f) / f by a Chebyshev fit. Polynomials are summed
  // in pairs (Estrin's scheme): half the operations wait for another.
  const auto bits = static_cast<std::int32_t>(std::bit_cast<std::uint32_t>(x) - 0x3f3504f3u);
  const auto k = static_cast<float>(bits >> 23);
  const float f = std::bit_cast<float>((bits & 0x007fffff) + 0x3f3504f3) - 1.0f;
  const float f2 = f * f, f4 = f2 * f2;
  const float low = (0.500003751f * f - 0.999999968f) + (0.249689070f * f - 0.333346060f) * f2;
  const float high = (0.172782061f * f - 0.199133479f) + (0.0989535074f * f - 0.161262479f) * f2;
  return f * (low + high * f4) - k * 0.693147182f;
}

/// Words up to this one, and their mirror images, lie in the tails: 4 q (1 - q) = e^-5.
inline constexpr std::int32_t first_tail_word = 7247000;

/// Standard normal quantile of the word; |result| below 6.4, the tail's probability right to 1e-4.
inline float normal(std::uint32_t word) {
  // z = x P(w), x = 1 - 2 q, w = -ln(4 q (1 - q)): the form of M. Giles, "Approximating the erfinv function"
  // (2012); own Chebyshev fits in w - 2.5 below 5 and in sqrt(w) - 3.5 above. Which of them holds is asked of
  // the word, not of w: a processor then knows it before the logarithm is done.
  const auto sign = static_cast<std::int32_t>(word) >> 31;
  const auto m = static_cast<std::int32_t>(word) ^ sign;
  const float n = static_cast<float>(m) + 0.5f;  // tail probability q = n / 2^32 on the word's side
  const float x = 1.0f - n * 0x1p-31f;           // 1 - 2 q
  const float w = minus_log(n * (0x1p-30f - n * 0x1p-62f));  // of 4 q (1 - q)
  float p;
  if (m > first_tail_word) {
    const float u = w - 2.5f, u2 = u * u, u4 = u2 * u2;
    const float low = (3.48802717e-1f * u + 2.12331347f) + (-1.77308282e-3f * u - 5.9076601e-3f) * u2;
    const float high = (-6.19474573e-6f * u + 3.08741177e-4f) + (4.83978825e-7f * u - 4.88579604e-6f) * u2;
    p = (low + high * u4) + 3.19696803e-8f * (u4 * u4);
  } else {
    const float u = std::sqrt(w) - 3.5f, u2 = u * u, u4 = u2 * u2;
    const float low = (1.42462826f * u + 4.71708871f) + (-2.8659057e-3f * u + 4.65035662e-3f) * u2;
    const float high = (-1.06850313e-3f * u + 1.4590706e-3f) + (-2.52637681e-4f * u + 7.63966229e-4f) * u2;
    p = (low + high * u4) + 6.54243164e-6f * (u4 * u4);
  }
  const float z = x * p;
  return sign < 0 ? -z : z;
}

/// The upper 31 bits of the word as a number in (0, 1].
inline float fraction(std::uint32_t word) {
  return (static_cast<float>(static_cast<std::int32_t>(word >> 1)) + 0.5f) * 0x1p-31f;
}

/// Gumbel law of mean 0 and scale 1 (paper, section "Gumbel Distribution").
inline float gumbel(std::uint32_t word) {
  // -ln(-ln u) with u = 1 - q: q has all its bits where u is next to 1. What is lost in 1 - q is added back
  // to first order. The other end stops at u = 2^-24, 2.8 below zero.
  const float q = std::min(fraction(word), 0.99999994f);
  const float u = 1.0f - q;
  return minus_log((q - (1.0f - u)) + minus_log(u)) - 0.577215665f;
}

/// e^x for |x| < 80; relative error below 2e-7.
inline float exp(float x) {
  const float k = std::nearbyint(x * 1.44269504f);
  const float r = (x - k * 0.693145752f) - k * 1.42860677e-6f;
  float p = 1.0f / 5040;
  p = p * r + 1.0f / 720;
  p = p * r + 1.0f / 120;
  p = p * r + 1.0f / 24;
  p = p * r + 1.0f / 6;
  p = p * r + 0.5f;
  p = p * r + 1.0f;
  p = p * r + 1.0f;
  return p * std::bit_cast<float>((static_cast<std::int32_t>(k) + 127) << 23);
}

}  // namespace atomcam::word_laws
