#include "sensor/word_laws.hpp"

#include <gtest/gtest.h>

#include <boost/math/special_functions/erf.hpp>
#include <cmath>

#include "base/random.hpp"
#include "support/statistics.hpp"

namespace atomcam {
namespace {

using statistics::chi_square_p;
using statistics::kolmogorov_p;
using statistics::level;

double normal_cdf(double z) {
  return 0.5 * std::erfc(-z / std::sqrt(2.0));
}
double gumbel_cdf(double x) {
  return std::exp(-std::exp(-x - 0.57721566490153286));
}

/// A word's place in the order of the law: 0 to 1. The words 0, 1, 2, ... 2^31 - 1 run up from -inf to the
/// middle ...
double rank(std::uint32_t word) {
  return (static_cast<double>(word) + 0.5) * 0x1p-32;
}

TEST(WordLaws, NormalIsTheQuantileOfTheWordAllTheWayOut) {
  // Every power of two of the word and all between: the tail probability is right to 1e-4, down to 2^-33.
  double worst = 0;
  for (std::uint64_t step = 0; step < 4000000; ++step) {
    const auto m = static_cast<std::uint32_t>(std::exp2(static_cast<double>(step) * 31.0 / 4000000) - 1);
    const double tail = rank(m);
    const double z = word_laws::normal(m);
    ASSERT_GE(z, 0);
    worst = std::max(worst, std::fabs(0.5 * std::erfc(z / std::sqrt(2.0)) / tail - 1));
    ASSERT_EQ(word_laws::normal(~m), -word_laws::normal(m));
  }
  EXPECT_LT(worst, 1e-4);
  EXPECT_LT(word_laws::normal(0), 6.4f);
}

TEST(WordLaws, NormalNumbersFollowTheNormalLawAndItsTails) {
  std::vector<std::uint32_t> words(1 << 20);
  std::vector<double> body;
  constexpr double edge = 3;
  std::vector<double> cells(40, 0.0);  // of |z| above the edge, width 0.05
  double total = 0;
  for (std::uint64_t frame = 0; frame < 24; ++frame) {
    fill_random(stream_key(1, stream_id("test/normal")), frame, 0, words);
    for (const std::uint32_t word : words) {
      const double z = word_laws::normal(word);
      if (frame == 0) body.push_back(z);
      const auto cell = (std::fabs(z) - edge) / 0.05;
      if (cell >= 0 && cell < 40) ++cells[static_cast<std::size_t>(cell)];
    }
    total += static_cast<double>(words.size());
  }
  EXPECT_GT(kolmogorov_p(body, normal_cdf), level);
  std::vector<double> mass;
  for (int i = 0; i < 40; ++i)
    mass.push_back(2 * (normal_cdf(-edge - 0.05 * i) - normal_cdf(-edge - 0.05 * (i + 1))));
  EXPECT_GT(chi_square_p(cells, mass, total), level);
}

TEST(WordLaws, RigRejectsNormalNumbersOfSixteenBits) {
  // Tails of 16 bits end in lumps: the rig must see them.
  std::vector<std::uint32_t> words(1 << 20);
  std::vector<double> cells(40, 0.0);
  double total = 0;
  for (std::uint64_t frame = 0; frame < 24; ++frame) {
    fill_random(stream_key(1, stream_id("test/normal")), frame, 0, words);
    for (const std::uint32_t word : words) {
      const double z = word_laws::normal((word & 0xffff0000u) | 0x8000u);
      const auto cell = (std::fabs(z) - 3) / 0.05;
      if (cell >= 0 && cell < 40) ++cells[static_cast<std::size_t>(cell)];
    }
    total += static_cast<double>(words.size());
  }
  std::vector<double> mass;
  for (int i = 0; i < 40; ++i)
    mass.push_back(2 * (normal_cdf(-3 - 0.05 * i) - normal_cdf(-3 - 0.05 * (i + 1))));
  EXPECT_LT(chi_square_p(cells, mass, total), level);
}

TEST(WordLaws, GumbelNumbersFollowTheGumbelLaw) {
  std::vector<std::uint32_t> words(1 << 20);
  fill_random(stream_key(2, stream_id("test/gumbel")), 0, 0, words);
  std::vector<double> values;
  for (const std::uint32_t word : words) values.push_back(word_laws::gumbel(word));
  const auto m = statistics::moments(values);
  EXPECT_GT(kolmogorov_p(values, gumbel_cdf), level);
  EXPECT_LT(statistics::sigmas(m.mean, 0, m.mean_error()), 5);
  // The far tail to the right, where u is next to 1: words 0 and 1.
  const double far = word_laws::gumbel(0);
  EXPECT_NEAR(-std::expm1(-std::exp(-far - 0.57721566490153286)), 0x1p-32, 1e-4 * 0x1p-32);
}

TEST(WordLaws, LogarithmKeepsItsAccuracy) {
  RandomStream random(3, stream_id("test/log"), 0, 0);
  for (int i = 0; i < 500000; ++i) {
    const auto x = static_cast<float>(std::ldexp(1 + random.uniform(), static_cast<int>(random() % 64) - 40));
    ASSERT_LE(std::fabs(word_laws::minus_log(x) + std::log(static_cast<double>(x))),
              4e-7 * std::fabs(std::log(static_cast<double>(x))))
        << x;
  }
}

}  // namespace
}  // namespace atomcam
