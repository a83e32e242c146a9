#include "optics/core_sums.hpp"

#include <gtest/gtest.h>

#include <vector>

#include "base/random.hpp"

namespace atomcam {
namespace {

TEST(CoreSums, AreThePlainSumsBitForBit) {
  RandomStream random(1, stream_id("test/core sums"), 0, 0);
  const std::size_t terms = 77, columns = 3 * core_sum_columns;
  const auto numbers = [&](std::size_t count) {
    std::vector<double> values(count);
    for (double& value : values) value = random.uniform53() - 0.5;
    return values;
  };
  const auto re = numbers(terms), im = numbers(terms);
  const auto cosine = numbers(terms * columns), sine = numbers(terms * columns);
  std::vector<double> even_re(columns), even_im(columns), odd_re(columns), odd_im(columns);
  core_sums(re, im, cosine.data(), sine.data(), columns,
            {even_re.data(), even_im.data(), odd_re.data(), odd_im.data()});
  const auto plain = [&](const std::vector<double>& value, const std::vector<double>& wave,
                         std::size_t column) {
    double sum = 0;
    for (std::size_t k = 0; k < terms; ++k) sum += value[k] * wave[k * columns + column];
    return sum;
  };
  for (std::size_t i = 0; i < columns; ++i) {
    EXPECT_EQ(even_re[i], plain(re, cosine, i));
    EXPECT_EQ(even_im[i], plain(im, cosine, i));
    EXPECT_EQ(odd_re[i], plain(re, sine, i));
    EXPECT_EQ(odd_im[i], plain(im, sine, i));
  }
}

}  // namespace
}  // namespace atomcam
