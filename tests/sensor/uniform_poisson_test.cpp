#include "sensor/uniform_poisson.hpp"

#include <gtest/gtest.h>

#include <boost/math/distributions/poisson.hpp>
#include <cmath>

#include "sensor/alias_table.hpp"
#include "support/instruction_sets.hpp"
#include "support/statistics.hpp"

namespace atomcam {
namespace {

using statistics::chi_square_p;
using statistics::level;
using statistics::moments;
using statistics::sigmas;

std::vector<std::int32_t> rows_of(double mean, int rows, std::size_t columns = 4096) {
  const UniformPoisson law(mean);
  const auto keys = UniformPoisson::keys(1, "test/collect");
  std::vector<std::int32_t> row(columns), all;
  for (int r = 0; r < rows; ++r) {
    law.fill(keys, 0, static_cast<std::uint32_t>(r), row);
    all.insert(all.end(), row.begin(), row.end());
  }
  return all;
}

class UniformPoissonAt : public testing::TestWithParam<double> {};

TEST_P(UniformPoissonAt, FollowsThePoissonLaw) {
  const double mean = GetParam();
  const auto draws = rows_of(mean, 300);
  const double reach = 8 * std::sqrt(mean) + 20;
  const auto first = static_cast<std::int64_t>(std::max(0.0, std::floor(mean - reach)));
  const boost::math::poisson_distribution<double> law(mean);
  std::vector<double> mass;
  for (std::int64_t k = first; static_cast<double>(k) < mean + reach; ++k)
    mass.push_back(boost::math::pdf(law, static_cast<double>(k)));
  EXPECT_GT(chi_square_p(draws, first, mass), level) << mean;
  const auto m = moments(draws);
  EXPECT_LT(sigmas(m.mean, mean, std::sqrt(mean / m.count)), 5) << mean;
  EXPECT_LT(sigmas(m.variance(), mean, std::sqrt((mean + 2 * mean * mean) / m.count)), 5) << mean;
}

TEST_P(UniformPoissonAt, GivesTheBitsOfThePlainDrawOnEveryInstructionSet) {
  const UniformPoisson law(GetParam());
  const auto keys = UniformPoisson::keys(2, "test/collect");
  for (const std::size_t columns : {1u, 2u, 15u, 64u, 255u, 257u, 1001u, 4096u}) {
    std::vector<std::int32_t> expected(columns), got(columns);
    for (std::uint32_t row = 0; row < 40; ++row) {
      law.fill_plainly(keys, 7, row, expected);
      on_every_instruction_set([&](const char* name) {
        law.fill(keys, 7, row, got);
        ASSERT_EQ(got, expected) << name;
      });
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Means, UniformPoissonAt,
                         testing::Values(1e-4, 0.0018, 0.05, 0.2, 0.7, 1.0, 3.0, 8.0, 12.0, 12.1, 40.0, 800.0,
                                         1e5, 1e6));

TEST(UniformPoisson, UndecidedSixteenBitsAreResolvedExactly) {
  // Means whose P(0) lies just beside a multiple of 2^-16 put all their weight on the undecided value.
  const double mean = -std::log(0.5 + 0.3 * 0x1p-16);
  const UniformPoisson law(mean);
  std::int64_t zeros = 0, all = 0;
  for (int piece = 0; piece < 8; ++piece) {
    const auto draws = rows_of(mean, 1000);
    zeros += std::count(draws.begin(), draws.end(), 0);
    all += static_cast<std::int64_t>(draws.size());
  }
  const double n = static_cast<double>(all);
  EXPECT_LT(sigmas(static_cast<double>(zeros), n * std::exp(-mean), std::sqrt(n / 4)), 5);
}

TEST(UniformPoisson, WithoutLightThereIsNothing) {
  // A known defect of a predecessor: -1 electrons.
  for (const double mean : {0.0, 1e-300, 1e-17})
    for (const std::int32_t n : rows_of(mean, 10)) ASSERT_EQ(n, 0) << mean;
}

TEST(AliasTable, GivesEachValueItsShareOfTheWords) {
  // All cells of a small law, by running through every word's upper bits.
  const std::vector<double> cumulative{0.125, 0.125, 0.625, 1.0};
  const AliasTable table(cumulative, -3);
  std::vector<std::uint64_t> counts(4, 0);
  for (std::uint64_t word = 0; word < std::uint64_t{1} << 32; word += 1 << 12)
    ++counts[static_cast<std::size_t>(table.draw(static_cast<std::uint32_t>(word)) + 3)];
  EXPECT_EQ(counts, (std::vector<std::uint64_t>{1 << 17, 0, 1 << 19, 3 << 17}));
  const AliasTable certain(std::vector<double>{1.0}, 5);
  EXPECT_EQ(certain.draw(0), 5);
  EXPECT_EQ(certain.draw(0xffffffffu), 5);
}

}  // namespace
}  // namespace atomcam
