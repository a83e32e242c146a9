#include "optics/zernike.hpp"

#include <cmath>

namespace atomcam {
namespace {

constexpr std::array<ZernikeTerm, zernike_terms> catalogue{{
    {"piston", "piston", 1, 0, 0, 0},
    {"tilt_horizontal", "horizontal tilt", 2, 2, 1, 1},
    {"tilt_vertical", "vertical tilt", 3, 1, 1, -1},
    {"defocus", "defocus", 4, 4, 2, 0},
    {"astigmatism_oblique", "oblique astigmatism", 5, 3, 2, -2},
    {"astigmatism_vertical", "vertical astigmatism", 6, 5, 2, 2},
    {"coma_vertical", "vertical coma", 7, 7, 3, -1},
    {"coma_horizontal", "horizontal coma", 8, 8, 3, 1},
    {"trefoil_vertical", "vertical trefoil", 9, 6, 3, -3},
    {"trefoil_oblique", "oblique trefoil", 10, 9, 3, 3},
    {"spherical", "primary spherical", 11, 12, 4, 0},
    {"secondary_astigmatism_vertical", "vertical secondary astigmatism", 12, 13, 4, 2},
    {"secondary_astigmatism_oblique", "oblique secondary astigmatism", 13, 11, 4, -2},
    {"quadrafoil_vertical", "vertical quadrafoil", 14, 14, 4, 4},
    {"quadrafoil_oblique", "oblique quadrafoil", 15, 10, 4, -4},
}};

// With c_m = rho^m cos(m theta) and s_m = rho^m sin(m theta), which are polynomials in x and y, every term is
// one of them times a polynomial in q = rho^2. d c_m = m (c_(m-1) dx - s_(m-1) dy), d s_m = m (s_(m-1) dx +
// c_(m-1) dy).
struct Harmonics {
  double c[5], s[5], q;
  Harmonics(double x, double y) : c{1}, s{0}, q(x * x + y * y) {
    for (int m = 1; m < 5; ++m) {
      c[m] = c[m - 1] * x - s[m - 1] * y;
      s[m] = s[m - 1] * x + c[m - 1] * y;
    }
  }
};

/// Radial part over rho^|m|, as a + b q + d q^2.
struct Radial {
  double a, b, d;
};

const std::array<Radial, zernike_terms>& radials() {
  static const std::array<Radial, zernike_terms> all = [] {
    const double s3 = std::sqrt(3.0), s5 = std::sqrt(5.0), s6 = std::sqrt(6.0), s8 = std::sqrt(8.0),
                 s10 = std::sqrt(10.0);
    return std::array<Radial, zernike_terms>{{{1, 0, 0},
                                              {2, 0, 0},
                                              {2, 0, 0},
                                              {-s3, 2 * s3, 0},
                                              {s6, 0, 0},
                                              {s6, 0, 0},
                                              {-2 * s8, 3 * s8, 0},
                                              {-2 * s8, 3 * s8, 0},
                                              {s8, 0, 0},
                                              {s8, 0, 0},
                                              {s5, -6 * s5, 6 * s5},
                                              {-3 * s10, 4 * s10, 0},
                                              {-3 * s10, 4 * s10, 0},
                                              {s10, 0, 0},
                                              {s10, 0, 0}}};
  }();
  return all;
}

}  // namespace

std::span<const ZernikeTerm, zernike_terms> zernike_catalogue() {
  return catalogue;
}

std::array<double, zernike_terms> zernike_values(double x, double y) {
  const Harmonics h(x, y);
  const auto& radial = radials();
  std::array<double, zernike_terms> values;
  for (int i = 0; i < zernike_terms; ++i) {
    const Radial& r = radial[i];
    const int m = catalogue[i].frequency;
    values[i] = (r.a + h.q * (r.b + h.q * r.d)) * (m < 0 ? h.s[-m] : h.c[m]);
  }
  return values;
}

Slope zernike_slope(const std::array<double, zernike_terms>& coefficients, double x, double y) {
  const Harmonics h(x, y);
  const auto& radial = radials();
  Slope slope{0, 0};
  for (int i = 0; i < zernike_terms; ++i) {
    if (coefficients[i] == 0) continue;
    const Radial& r = radial[i];
    const int m = catalogue[i].frequency, k = m < 0 ? -m : m;
    const double part = r.a + h.q * (r.b + h.q * r.d), growth = 2 * (r.b + 2 * h.q * r.d);
    const double angular = m < 0 ? h.s[k] : h.c[k];
    double angular_x = 0, angular_y = 0;
    if (k > 0) {
      angular_x = k * (m < 0 ? h.s[k - 1] : h.c[k - 1]);
      angular_y = k * (m < 0 ? h.c[k - 1] : -h.s[k - 1]);
    }
    slope.x += coefficients[i] * (growth * x * angular + part * angular_x);
    slope.y += coefficients[i] * (growth * y * angular + part * angular_y);
  }
  return slope;
}

PupilPolynomial zernike_polynomial(const std::array<double, zernike_terms>& coefficients) {
  // c_m and s_m of the harmonics above.
  std::array<PupilPolynomial, 5> c{}, s{};
  c[0][0][0] = 1;
  for (std::size_t m = 1; m < 5; ++m)
    for (std::size_t p = 0; p < m; ++p) {
      const std::size_t q = m - 1 - p;
      c[m][p + 1][q] += c[m - 1][p][q];
      c[m][p][q + 1] -= s[m - 1][p][q];
      s[m][p + 1][q] += s[m - 1][p][q];
      s[m][p][q + 1] += c[m - 1][p][q];
    }
  PupilPolynomial sum{};
  for (int i = 0; i < zernike_terms; ++i) {
    if (coefficients[i] == 0) continue;
    const Radial& r = radials()[i];
    const int frequency = catalogue[i].frequency;
    const auto m = static_cast<std::size_t>(frequency < 0 ? -frequency : frequency);
    const PupilPolynomial& angular = frequency < 0 ? s[m] : c[m];
    for (std::size_t p = 0; p <= m; ++p) {
      const std::size_t q = m - p;
      const double value = coefficients[i] * angular[p][q];
      sum[p][q] += r.a * value;
      if (r.b != 0) {
        sum[p + 2][q] += r.b * value;
        sum[p][q + 2] += r.b * value;
      }
      if (r.d != 0) {
        sum[p + 4][q] += r.d * value;
        sum[p + 2][q + 2] += 2 * r.d * value;
        sum[p][q + 4] += r.d * value;
      }
    }
  }
  return sum;
}

}  // namespace atomcam
