#include "optics/pupil.hpp"

#include <algorithm>
#include <cmath>

#include "base/math.hpp"
#include "optics/fourier.hpp"
#include "optics/sinc.hpp"
#include "optics/zernike.hpp"

namespace atomcam {
namespace {

std::array<double, zernike_terms> without_tilt(std::array<double, zernike_terms> zernike_um) {
  zernike_um[0] = zernike_um[1] = zernike_um[2] = 0;
  return zernike_um;
}

/// The part of a square of side `side` about (x, y) inside the unit disc: its share and its centre of mass.
struct Part {
  double share, x, y;
};

Part part_inside(double x, double y, double side) {
  const double r = std::sqrt(x * x + y * y), half_diagonal = 0.7072 * side;
  if (r + half_diagonal <= 1) return {1, x, y};
  if (r - half_diagonal >= 1) return {0, x, y};
  constexpr int parts = 16;
  double inside = 0, sum_x = 0, sum_y = 0;
  for (int j = 0; j < parts; ++j)
    for (int i = 0; i < parts; ++i) {
      const double u = x + side * ((i + 0.5) / parts - 0.5), v = y + side * ((j + 0.5) / parts - 0.5);
      if (u * u + v * v >= 1) continue;
      inside += 1;
      sum_x += u;
      sum_y += v;
    }
  if (inside == 0) return {0, x, y};
  return {inside / (parts * parts), sum_x / inside, sum_y / inside};
}

}  // namespace

RayReach ray_reach(const OpticsDescription& optics) {
  const auto zernike_um = without_tilt(optics.zernike_um);
  double largest = 0, sum = 0, weight = 0;
  constexpr int rings = 16, spokes = 48;
  for (int i = 0; i <= rings; ++i)
    for (int j = 0; j < spokes; ++j) {
      const double rho = static_cast<double>(i) / rings, turn = static_cast<double>(j) / spokes;
      const Slope slope = zernike_slope(zernike_um, rho * math::cos_turns(turn), rho * math::sin_turns(turn));
      const double square = slope.x * slope.x + slope.y * slope.y;
      largest = std::max(largest, square);
      sum += rho * square;
      weight += rho;
    }
  return {std::sqrt(sum / weight) / optics.wavelength_um, std::sqrt(largest) / optics.wavelength_um};
}

// Each sample of the pupil is its mean over a square of the grid: a hard edge on points would make the
// aperture's area and the far tail depend on the grid. The mean multiplies the image's amplitude by sinc(x /
// period) sinc(y / period), which is divided out of the intensity.
std::vector<std::complex<double>> transfer_function(const OpticsDescription& optics, int size, double step) {
  const auto zernike_um = without_tilt(optics.zernike_um);
  const bool flat = std::all_of(zernike_um.begin(), zernike_um.end(), [](double a) { return a == 0; });
  const double period = size * step, spacing = 1 / period;  // of pupil samples, in aperture radii
  const int reach = static_cast<int>(period) + 2;
  FourierGrid amplitude(size);
  double energy = 0;
  for (int j = -reach; j <= reach; ++j)
    for (int i = -reach; i <= reach; ++i) {
      const Part part = part_inside(i * spacing, j * spacing, spacing);
      if (part.share == 0) continue;
      double strength = part.share;
      if (optics.apodisation) {
        const double sine_square =
            optics.numerical_aperture * optics.numerical_aperture * (part.x * part.x + part.y * part.y);
        strength /= std::sqrt(std::sqrt(1 - sine_square));
      }
      energy += strength * strength / part.share;
      if (flat) {
        amplitude.at(j, i) = strength;
        continue;
      }
      const auto values = zernike_values(part.x, part.y);
      double wavefront_um = 0;
      for (int n = 3; n < zernike_terms; ++n) wavefront_um += zernike_um[n] * values[n];
      const Slope slope = zernike_slope(zernike_um, part.x, part.y);
      strength *=
          sinc(slope.x / optics.wavelength_um * spacing) * sinc(slope.y / optics.wavelength_um * spacing);
      const double turns = wavefront_um / optics.wavelength_um;
      amplitude.at(j, i) = {strength * math::cos_turns(turns), strength * math::sin_turns(turns)};
    }
  amplitude.transform();
  std::vector<double> correction(static_cast<std::size_t>(size));
  for (int n = 0; n < size; ++n) {
    const double value = sinc(static_cast<double>(n < size / 2 ? n : n - size) / size);
    correction[n] = 1 / (value * value);
  }
  return amplitude.spectrum_of_intensity(correction, energy * size * size);
}

}  // namespace atomcam
