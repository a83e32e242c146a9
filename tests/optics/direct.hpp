#pragma once
// The intensity of a point source by direct quadrature over the pupil in polar coordinates: slow, and
// independent of transforms and tables.

#include <cmath>
#include <complex>
#include <numbers>
#include <vector>

#include "optics/optics.hpp"

namespace atomcam::testing {

struct Node {
  double place, weight;
};

/// Gauss-Legendre nodes on [low, high] by Newton's method.
inline std::vector<Node> gauss_legendre(int n, double low, double high) {
  std::vector<Node> nodes;
  for (int i = 0; i < n; ++i) {
    double x = std::cos(std::numbers::pi * (i + 0.75) / (n + 0.5)), slope = 0;
    for (int step = 0; step < 50; ++step) {
      double p = 1, before = 0;
      for (int k = 1; k <= n; ++k) {
        const double older = before;
        before = p;
        p = ((2 * k - 1) * x * before - (k - 1) * older) / k;
      }
      slope = n * (x * p - before) / (x * x - 1);
      x -= p / slope;
    }
    nodes.push_back({(low + high) / 2 + (high - low) / 2 * x, (high - low) / ((1 - x * x) * slope * slope)});
  }
  return nodes;
}

class DirectPointSpread {
 public:
  explicit DirectPointSpread(const OpticsDescription& optics)
      : per_px_(optics.numerical_aperture / optics.wavelength_um * optics.pixel_um / optics.magnification) {
    const auto& a = optics.zernike_um;
    double energy = 0;
    for (const Node& ring : gauss_legendre(48, 0, 1))
      for (int j = 0; j < spokes; ++j) {
        // Written out from a textbook's table, term by term.
        const double r = ring.place, t = 2 * std::numbers::pi * j / spokes;
        const double w = a[1] * 2 * r * std::cos(t) + a[2] * 2 * r * std::sin(t) +
                         a[3] * std::sqrt(3.0) * (2 * r * r - 1) +
                         a[4] * std::sqrt(6.0) * r * r * std::sin(2 * t) +
                         a[5] * std::sqrt(6.0) * r * r * std::cos(2 * t) +
                         a[6] * std::sqrt(8.0) * (3 * r * r * r - 2 * r) * std::sin(t) +
                         a[7] * std::sqrt(8.0) * (3 * r * r * r - 2 * r) * std::cos(t) +
                         a[8] * std::sqrt(8.0) * r * r * r * std::sin(3 * t) +
                         a[9] * std::sqrt(8.0) * r * r * r * std::cos(3 * t) +
                         a[10] * std::sqrt(5.0) * (6 * std::pow(r, 4) - 6 * r * r + 1) +
                         a[11] * std::sqrt(10.0) * (4 * std::pow(r, 4) - 3 * r * r) * std::cos(2 * t) +
                         a[12] * std::sqrt(10.0) * (4 * std::pow(r, 4) - 3 * r * r) * std::sin(2 * t) +
                         a[13] * std::sqrt(10.0) * std::pow(r, 4) * std::cos(4 * t) +
                         a[14] * std::sqrt(10.0) * std::pow(r, 4) * std::sin(4 * t);
        const double sine = optics.numerical_aperture * r;
        const double amplitude = (optics.apodisation ? std::pow(1 - sine * sine, -0.25) : 1) *
                                 (1 - optics.pupil_edge_loss * r * r);
        const double area = ring.weight * r * 2 * std::numbers::pi / spokes;
        energy += area * amplitude * amplitude;
        rays_.push_back(
            {r * std::cos(t), r * std::sin(t),
             area * amplitude * std::polar(1.0, 2 * std::numbers::pi * w / optics.wavelength_um)});
      }
    scale_ = per_px_ * per_px_ / energy;
  }

  /// Light per square pixel at a displacement from the geometric image.
  double operator()(double dx_px, double dy_px) const {
    std::complex<double> sum = 0;
    for (const Ray& ray : rays_)
      sum +=
          ray.strength * std::polar(1.0, -2 * std::numbers::pi * per_px_ * (dx_px * ray.x + dy_px * ray.y));
    return scale_ * std::norm(sum);
  }

  /// Light in the rectangle from (x0, y0) to (x1, y1).
  double within(double x0, double y0, double x1, double y1, int nodes) const {
    double sum = 0;
    for (const Node& x : gauss_legendre(nodes, x0, x1))
      for (const Node& y : gauss_legendre(nodes, y0, y1))
        sum += x.weight * y.weight * (*this)(x.place, y.place);
    return sum;
  }

 private:
  static constexpr int spokes = 96;
  struct Ray {
    double x, y;
    std::complex<double> strength;
  };
  double per_px_, scale_ = 0;
  std::vector<Ray> rays_;
};

}  // namespace atomcam::testing
