#include "calibration/pupil_image.hpp"

#include <cmath>
#include <complex>
#include <numbers>

#include "optics/zernike.hpp"

namespace atomcam {
namespace {

constexpr double pi = std::numbers::pi;

double sinc(double x) {
  return std::fabs(x) < 1e-9 ? 1 : std::sin(pi * x) / (pi * x);
}

/// The part of a square of the pupil's grid that lies within the aperture.
double share_inside(double x, double y, double spacing) {
  constexpr int parts = 8;
  int inside = 0;
  for (int j = 0; j < parts; ++j)
    for (int i = 0; i < parts; ++i) {
      const double u = x + spacing * ((i + 0.5) / parts - 0.5), v = y + spacing * ((j + 0.5) / parts - 0.5);
      inside += u * u + v * v < 1;
    }
  return static_cast<double>(inside) / (parts * parts);
}

}  // namespace

PupilImage::PupilImage(const OpticsDescription& optics, int radius_px, int samples)
    : radius_px_(radius_px), samples_(samples), wavelength_um_(optics.wavelength_um) {
  const double spacing = 2.0 / (samples - 4);  // of pupil samples, in aperture radii
  const double pixel = optics.pixel_um / optics.magnification * optics.numerical_aperture /
                       optics.wavelength_um;  // in diffraction units
  const int reach = (radius_px + 1) * FineImage::oversampling + FineImage::oversampling / 2;
  const int fine = 2 * reach + 1;
  strength_.setZero(samples, samples);
  for (auto& term : zernike_) term.setZero(samples, samples);
  double energy = 0;
  for (int j = 0; j < samples; ++j)
    for (int i = 0; i < samples; ++i) {
      const double x = (i - (samples - 1) / 2.0) * spacing, y = (j - (samples - 1) / 2.0) * spacing;
      const double share = share_inside(x, y, spacing);
      if (share == 0) continue;
      double strength = share;
      if (optics.apodisation) {
        const double sine_square =
            std::min(0.999, optics.numerical_aperture * optics.numerical_aperture * (x * x + y * y));
        strength /= std::sqrt(std::sqrt(1 - sine_square));
      }
      strength_(j, i) = strength;
      energy += strength * strength / share;
      const auto values = zernike_values(x, y);
      for (int k = 0; k < fitted_zernikes; ++k) zernike_[k](j, i) = values[k + first_fitted_zernike];
    }
  waves_.resize(fine, samples);
  for (int n = 0; n < fine; ++n)
    for (int i = 0; i < samples; ++i) {
      const double u = (n - reach) * pixel / FineImage::oversampling;
      const double x = (i - (samples - 1) / 2.0) * spacing;
      waves_(n, i) = std::polar(1.0, -2 * pi * x * u);
    }
  Eigen::ArrayXd width(fine);
  for (int n = 0; n < fine; ++n) {
    const double value = sinc((n - reach) * pixel / FineImage::oversampling * spacing);
    // A pupil of squares would dim the intensity by this sinc squared, one of points not at all. The edge is
    // made of squares and what is inside, where the wavefront bends, of points: its root comes nearest (wings
    // right to 0.02 % of the light at the wavefront errors of a good objective).
    width(n) = 1 / std::sqrt(value);
  }
  correction_ =
      (width.matrix() * width.matrix().transpose()).array() * spacing * spacing / energy * pixel * pixel;
}

// Boole's rule over the pixel, along both axes.
Eigen::ArrayXXd PupilImage::integrated(const Eigen::ArrayXXd& intensity) const {
  constexpr double weights[5] = {7.0 / 90, 32.0 / 90, 12.0 / 90, 32.0 / 90, 7.0 / 90};
  static_assert(FineImage::oversampling == 4);
  const Eigen::Index size = intensity.rows() - 4;
  Eigen::ArrayXXd columns = Eigen::ArrayXXd::Zero(intensity.rows(), size);
  for (int k = 0; k < 5; ++k) columns += weights[k] * intensity.middleCols(k, size);
  Eigen::ArrayXXd both = Eigen::ArrayXXd::Zero(size, size);
  for (int k = 0; k < 5; ++k) both += weights[k] * columns.middleRows(k, size);
  return both;
}

FineImage PupilImage::operator()(const std::array<double, zernike_terms>& zernike_um,
                                 bool derivatives) const {
  Eigen::ArrayXXd wavefront = Eigen::ArrayXXd::Zero(samples_, samples_);
  for (int k = 0; k < fitted_zernikes; ++k) wavefront += zernike_um[k + first_fitted_zernike] * zernike_[k];
  const double turn = 2 * pi / wavelength_um_;
  Eigen::MatrixXcd pupil(samples_, samples_);
  for (Eigen::Index n = 0; n < pupil.size(); ++n) pupil(n) = std::polar(strength_(n), turn * wavefront(n));
  const auto image = [&](const Eigen::MatrixXcd& of) -> Eigen::MatrixXcd {
    return (waves_ * of) * waves_.transpose();
  };
  const Eigen::MatrixXcd amplitude = image(pupil);
  FineImage fine;
  fine.centre = (radius_px_ + 1) * FineImage::oversampling;
  fine.share = integrated(amplitude.array().abs2() * correction_);
  if (!derivatives) return fine;
  for (int k = 0; k < fitted_zernikes; ++k) {
    const Eigen::MatrixXcd tilted =
        (pupil.array() * (zernike_[k] * turn).cast<std::complex<double>>() * std::complex<double>(0, 1))
            .matrix();
    const Eigen::MatrixXcd change = image(tilted);
    fine.by_zernike.push_back(
        integrated(2 * (amplitude.conjugate().array() * change.array()).real() * correction_));
  }
  return fine;
}

}  // namespace atomcam
