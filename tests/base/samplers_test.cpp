#include "base/samplers.hpp"

#include <gtest/gtest.h>

#include <boost/math/distributions/binomial.hpp>
#include <boost/math/distributions/gamma.hpp>
#include <boost/math/distributions/normal.hpp>
#include <boost/math/distributions/poisson.hpp>
#include <cmath>

#include "support/statistics.hpp"

namespace atomcam {
namespace {

using statistics::chi_square_p;
using statistics::kolmogorov_p;
using statistics::level;
using statistics::moments;
using statistics::sigmas;

template <class Draw>
auto many(int count, std::string_view name, Draw draw) {
  RandomStream random(1, stream_id(name), 0, 0);
  std::vector<decltype(draw(random))> values;
  for (int i = 0; i < count; ++i) values.push_back(draw(random));
  return values;
}

/// The Poisson law about its mean: first value and mass function.
std::pair<std::int64_t, std::vector<double>> poisson_mass(double mean) {
  const double reach = 8 * std::sqrt(mean) + 20;
  const auto first = static_cast<std::int64_t>(std::max(0.0, std::floor(mean - reach)));
  const boost::math::poisson_distribution<double> law(mean);
  std::vector<double> mass;
  for (std::int64_t k = first; static_cast<double>(k) < mean + reach; ++k)
    mass.push_back(boost::math::pdf(law, static_cast<double>(k)));
  return {first, mass};
}

class PoissonAt : public testing::TestWithParam<double> {};

TEST_P(PoissonAt, FollowsItsLaw) {
  // A known defect of a predecessor: above 745 its numbers stayed at 745.
  const double mean = GetParam();
  const auto draws =
      many(200000, "test/poisson", [mean](RandomStream& r) { return sample_poisson(r, mean); });
  const auto [first, mass] = poisson_mass(mean);
  EXPECT_GT(chi_square_p(draws, first, mass), level) << mean;
  const auto m = moments(draws);
  EXPECT_LT(sigmas(m.mean, mean, std::sqrt(mean / m.count)), 5) << mean;
  EXPECT_LT(sigmas(m.variance(), mean, std::sqrt((mean + 2 * mean * mean) / m.count)), 5) << mean;
}

INSTANTIATE_TEST_SUITE_P(Means, PoissonAt,
                         testing::Values(1e-3, 0.02, 0.2, 1.0, 3.7, 9.99, 10.0, 10.01, 12.5, 33.0, 100.0,
                                         745.0, 800.0, 5000.0, 1e5, 1e6));

TEST(Poisson, WithoutLightThereIsNothing) {
  // Known defects of a predecessor: -1 below 1e-16, and a hang on it.
  for (const double mean : {0.0, 1e-300, 1e-17, 1e-16, -1.0, std::nan("")})
    for (const std::int64_t n :
         many(1000, "test/nothing", [mean](RandomStream& r) { return sample_poisson(r, mean); }))
      ASSERT_EQ(n, 0) << mean;
}

TEST(Poisson, RigRejectsTheProductOfUniformsWhereItSaturates) {
  // The method that a predecessor used: multiply uniform numbers until e^-mean, which is 0 in double
  // precision.
  const auto draws = many(2000, "test/knuth", [](RandomStream& random) {
    const double limit = std::exp(-800.0);
    double product = 1;
    std::int64_t n = -1;
    while (product > limit) {
      product *= random.uniform();
      ++n;
    }
    return n;
  });
  const auto [first, mass] = poisson_mass(800);
  EXPECT_LT(chi_square_p(draws, first, mass), level);
}

TEST(Normal, FollowsItsLaw) {
  const boost::math::normal law;
  const auto draws = many(500000, "test/normal", [](RandomStream& r) { return sample_normal(r); });
  EXPECT_GT(kolmogorov_p(draws, [&](double x) { return boost::math::cdf(law, x); }), level);
}

TEST(Normal, RigRejectsASumOfFourUniforms) {
  const boost::math::normal law;
  const auto draws = many(500000, "test/four", [](RandomStream& r) {
    return (r.uniform() + r.uniform() + r.uniform() + r.uniform() - 2) * std::sqrt(3.0);
  });
  EXPECT_LT(kolmogorov_p(draws, [&](double x) { return boost::math::cdf(law, x); }), level);
}

TEST(Exponential, FollowsItsLaw) {
  const auto draws = many(300000, "test/exponential", [](RandomStream& r) { return sample_exponential(r); });
  EXPECT_GT(kolmogorov_p(draws, [](double x) { return -std::expm1(-x); }), level);
}

class GammaAt : public testing::TestWithParam<double> {};

TEST_P(GammaAt, FollowsItsLaw) {
  const double shape = GetParam();
  const auto draws = many(200000, "test/gamma", [shape](RandomStream& r) { return sample_gamma(r, shape); });
  EXPECT_GT(kolmogorov_p(draws, [shape](double x) { return boost::math::gamma_p(shape, x); }), level)
      << shape;
  const auto m = moments(draws);
  EXPECT_LT(sigmas(m.mean, shape, m.mean_error()), 5) << shape;
  EXPECT_LT(sigmas(m.variance(), shape, m.variance_error()), 5) << shape;
}

INSTANTIATE_TEST_SUITE_P(Shapes, GammaAt, testing::Values(0.05, 0.5, 0.99, 1.0, 2.0, 7.3, 64.0, 5000.0));

TEST(Binomial, FollowsItsLaw) {
  for (const double p : {1e-4, 0.01, 0.0107, 0.3, 0.5, 0.7, 0.999}) {
    for (const std::int64_t n : {1, 2, 7, 30, 1000, 100000}) {
      const auto draws =
          many(60000, "test/binomial", [n, p](RandomStream& r) { return sample_binomial(r, n, p); });
      const boost::math::binomial_distribution<double> law(static_cast<double>(n), p);
      const double mean = static_cast<double>(n) * p, reach = 8 * std::sqrt(mean * (1 - p)) + 20;
      const auto first = static_cast<std::int64_t>(std::max(0.0, std::floor(mean - reach)));
      std::vector<double> mass;
      for (std::int64_t k = first; k <= n && static_cast<double>(k) < mean + reach; ++k)
        mass.push_back(boost::math::pdf(law, static_cast<double>(k)));
      EXPECT_GT(chi_square_p(draws, first, mass), level) << n << ", " << p;
    }
  }
}

TEST(Binomial, TheTableGivesTheSameDraws) {
  for (const double p : {0.0, 0.003, 0.02, 0.5, 0.7, 0.999, 1.0}) {
    const BinomialLaw law(p);
    for (std::uint32_t n = 0; n < 2000; ++n) {
      RandomStream one(7, stream_id("test/binomial"), 1, n), other = one;
      ASSERT_EQ(law(one, n), sample_binomial(other, n, p)) << n << " " << p;
      ASSERT_EQ(one(), other()) << n << " " << p;
    }
  }
}

TEST(Binomial, EndsAreCertain) {
  RandomStream random(1, stream_id("test/ends"), 0, 0);
  for (int i = 0; i < 100; ++i) {
    EXPECT_EQ(sample_binomial(random, 0, 0.5), 0);
    EXPECT_EQ(sample_binomial(random, 9, 0), 0);
    EXPECT_EQ(sample_binomial(random, 9, 1), 9);
  }
}

TEST(Gumbel, HasZeroMeanAndFollowsItsLaw) {
  const double scale = 1.7;
  const auto draws =
      many(300000, "test/gumbel", [scale](RandomStream& r) { return sample_gumbel(r, scale); });
  EXPECT_GT(kolmogorov_p(draws,
                         [scale](double x) { return std::exp(-std::exp(-x / scale - 0.57721566490153286)); }),
            level);
  const auto m = moments(draws);
  EXPECT_LT(sigmas(m.mean, 0, m.mean_error()), 5);
}

}  // namespace
}  // namespace atomcam
