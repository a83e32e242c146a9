#include "optics/cell_sums.hpp"

#include <gtest/gtest.h>

#include <array>
#include <vector>

#include "base/random.hpp"

namespace atomcam {
namespace {

TEST(CellSums, AreThePlainSumsBitForBit) {
  RandomStream random(1, stream_id("test/cell sums"), 0, 0);
  for (const std::size_t terms : {1u, 77u, 162u}) {
    std::vector<double> weights(terms), samples(terms * cell_sum_lines);
    for (double& weight : weights) weight = random.uniform53() - 0.5;
    for (double& sample : samples) sample = random.uniform53() - 0.5;
    std::array<double, cell_sum_lines> sums;
    cell_sums(weights, samples.data(), sums.data());
    for (std::size_t c = 0; c < cell_sum_lines; ++c) {
      double plain = 0;
      for (std::size_t n = 0; n < terms; ++n) plain += weights[n] * samples[n * cell_sum_lines + c];
      EXPECT_EQ(sums[c], plain);
    }
  }
}

}  // namespace
}  // namespace atomcam
