#include "optics/zernike.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

namespace atomcam {
namespace {

// Gauss-Legendre in rho^2 (exact for the polynomials at hand) and even points in theta.
TEST(Zernike, IsOrthonormalOnTheDisc) {
  const double node[5] = {
      0, 1 / 3.0 * std::sqrt(5 - 2 * std::sqrt(10 / 7.0)), -1 / 3.0 * std::sqrt(5 - 2 * std::sqrt(10 / 7.0)),
      1 / 3.0 * std::sqrt(5 + 2 * std::sqrt(10 / 7.0)), -1 / 3.0 * std::sqrt(5 + 2 * std::sqrt(10 / 7.0))};
  const double weight[5] = {128 / 225.0, (322 + 13 * std::sqrt(70.0)) / 900,
                            (322 + 13 * std::sqrt(70.0)) / 900, (322 - 13 * std::sqrt(70.0)) / 900,
                            (322 - 13 * std::sqrt(70.0)) / 900};
  double product[zernike_terms][zernike_terms] = {};
  for (int i = 0; i < 5; ++i)
    for (int j = 0; j < 16; ++j) {
      const double rho = std::sqrt((node[i] + 1) / 2), theta = 2 * std::numbers::pi * j / 16;
      const auto values = zernike_values(rho * std::cos(theta), rho * std::sin(theta));
      for (int a = 0; a < zernike_terms; ++a)
        for (int b = 0; b < zernike_terms; ++b) product[a][b] += weight[i] / 2 / 16 * values[a] * values[b];
    }
  for (int a = 0; a < zernike_terms; ++a)
    for (int b = 0; b < zernike_terms; ++b)
      EXPECT_NEAR(product[a][b], a == b ? 1 : 0, 1e-13) << a << " " << b;
}

TEST(Zernike, IndicesFollowTheStandards) {
  int index = 0;
  for (const ZernikeTerm& term : zernike_catalogue()) {
    EXPECT_EQ(term.noll, index + 1);
    EXPECT_EQ(term.osa, (term.degree * (term.degree + 2) + term.frequency) / 2);
    // The term's own polynomial has its angular frequency: it changes as cos or sin of |m| theta.
    const double theta = 0.3;
    const auto at = [&](double angle) {
      return zernike_values(0.9 * std::cos(angle), 0.9 * std::sin(angle))[index];
    };
    const int m = term.frequency;
    const double expected =
        m < 0 ? std::sin(-m * theta) / std::sin(-m * 0.2) : std::cos(m * theta) / std::cos(m * 0.2);
    EXPECT_NEAR(at(theta) / at(0.2), expected, 1e-12) << term.name;
    EXPECT_GT(zernike_values(std::cos(m < 0 ? std::numbers::pi / (2 * -m) : 0),
                             std::sin(m < 0 ? std::numbers::pi / (2 * -m) : 0))[index],
              0)
        << term.name << " is positive at the edge where its angular part is";
    ++index;
  }
}

TEST(Zernike, SlopeIsTheDerivative) {
  for (int i = 0; i < zernike_terms; ++i) {
    std::array<double, zernike_terms> one{};
    one[i] = 1;
    const double x = 0.37, y = -0.58, step = 1e-5;
    const Slope slope = zernike_slope(one, x, y);
    EXPECT_NEAR(slope.x, (zernike_values(x + step, y)[i] - zernike_values(x - step, y)[i]) / (2 * step), 1e-8)
        << i;
    EXPECT_NEAR(slope.y, (zernike_values(x, y + step)[i] - zernike_values(x, y - step)[i]) / (2 * step), 1e-8)
        << i;
  }
}

}  // namespace
}  // namespace atomcam
