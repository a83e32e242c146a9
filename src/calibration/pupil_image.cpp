#include "calibration/pupil_image.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "optics/pupil.hpp"
#include "optics/sinc.hpp"
#include "optics/zernike.hpp"

namespace atomcam {
namespace {

constexpr double pi = std::numbers::pi;

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
      // The centre of a square that is cut may lie outside the aperture, where the amplitude has no end.
      const double most = 0.999 / (optics.numerical_aperture * optics.numerical_aperture);
      const double strength = share * pupil_amplitude(optics, std::min(most, x * x + y * y));
      strength_(j, i) = strength;
      energy += strength * strength / share;
      const auto values = zernike_values(x, y);
      for (int k = 0; k < fitted_zernikes; ++k) zernike_[k](j, i) = values[k + first_fitted_zernike];
    }
  cosine_.resize(reach + 1, samples / 2);
  sine_.resize(reach + 1, samples / 2);
  for (int n = 0; n <= reach; ++n)
    for (int i = 0; i < samples / 2; ++i) {
      const double turns = (i + 0.5) * spacing * n * pixel / FineImage::oversampling;
      cosine_(n, i) = std::cos(2 * pi * turns);
      sine_(n, i) = std::sin(2 * pi * turns);
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

// Fourier's sum over each column. Both grids lie evenly about the middle: even and odd parts of the pupil go
// with cosine and sine, a quarter of the products that the exponentials would take.
PupilImage::Amplitude PupilImage::along_columns(const Amplitude& pupil) const {
  const Eigen::Index half = samples_ / 2, reach = cosine_.rows() - 1, columns = pupil.real.cols();
  const auto even = [&](const Eigen::MatrixXd& of) -> Eigen::MatrixXd {
    return cosine_ * (of.bottomRows(half) + of.topRows(half).colwise().reverse());
  };
  const auto odd = [&](const Eigen::MatrixXd& of) -> Eigen::MatrixXd {
    return sine_ * (of.bottomRows(half) - of.topRows(half).colwise().reverse());
  };
  const auto both_sides = [&](const Eigen::MatrixXd& a, const Eigen::MatrixXd& b) {
    Eigen::MatrixXd all(2 * reach + 1, columns);
    all.bottomRows(reach + 1) = a + b;
    all.topRows(reach + 1) = (a - b).colwise().reverse();
    return all;
  };
  return {both_sides(even(pupil.real), odd(pupil.imaginary)),
          both_sides(even(pupil.imaginary), -odd(pupil.real))};
}

PupilImage::Amplitude PupilImage::image_of(const Amplitude& pupil) const {
  const Amplitude halfway = along_columns(pupil);
  const Amplitude turned = along_columns({halfway.real.transpose(), halfway.imaginary.transpose()});
  return {turned.real.transpose(), turned.imaginary.transpose()};
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

void PupilImage::spread_over(std::span<const double> x_px, std::span<const double> y_px) {
  if (x_px.empty()) return;
  constexpr int m = FineImage::oversampling, most = 3 * m;  // beyond three pixels it is another site's
  double widest = 0;
  for (const double v : x_px) widest = std::max(widest, std::fabs(v));
  for (const double v : y_px) widest = std::max(widest, std::fabs(v));
  const int reach = std::min(most, static_cast<int>(std::lround(m * widest)) + 1);
  displaced_.setZero(2 * reach + 1, 2 * reach + 1);
  // Over the three nearest samples, so that mean and mean square stay as they are.
  const auto place = [&](double px) {
    const double at = std::clamp(m * px, 1.0 - reach, reach - 1.0), middle = std::round(at), t = at - middle;
    return std::pair(static_cast<int>(middle) + reach,
                     Eigen::Vector3d(t * (t - 1) / 2, 1 - t * t, t * (t + 1) / 2));
  };
  for (std::size_t n = 0; n < x_px.size(); ++n) {
    const auto [column, across] = place(x_px[n]);
    const auto [row, down] = place(y_px[n]);
    displaced_.block<3, 3>(row - 1, column - 1) +=
        (down * across.transpose()).array() / static_cast<double>(x_px.size());
  }
}

Eigen::ArrayXXd PupilImage::spread(const Eigen::ArrayXXd& share) const {
  if (displaced_.size() == 0) return share;
  const Eigen::Index reach = displaced_.rows() / 2, rows = share.rows(), columns = share.cols();
  Eigen::ArrayXXd moved = Eigen::ArrayXXd::Zero(rows, columns);
  for (Eigen::Index dx = -reach; dx <= reach; ++dx)
    for (Eigen::Index dy = -reach; dy <= reach; ++dy) {
      const double part = displaced_(dy + reach, dx + reach);
      if (part == 0) continue;
      const Eigen::Index high = rows - std::abs(dy), wide = columns - std::abs(dx);
      moved.block(std::max<Eigen::Index>(0, dy), std::max<Eigen::Index>(0, dx), high, wide) +=
          part * share.block(std::max<Eigen::Index>(0, -dy), std::max<Eigen::Index>(0, -dx), high, wide);
    }
  return moved;
}

FineImage PupilImage::operator()(const std::array<double, zernike_terms>& zernike_um,
                                 bool derivatives) const {
  Eigen::ArrayXXd wavefront = Eigen::ArrayXXd::Zero(samples_, samples_);
  for (int k = 0; k < fitted_zernikes; ++k) wavefront += zernike_um[k + first_fitted_zernike] * zernike_[k];
  const double turn = 2 * pi / wavelength_um_;
  const Eigen::ArrayXXd phase = turn * wavefront;
  const Eigen::ArrayXXd real = strength_ * phase.cos(), imaginary = strength_ * phase.sin();
  const Amplitude amplitude = image_of({real, imaginary});
  FineImage fine;
  fine.centre = (radius_px_ + 1) * FineImage::oversampling;
  fine.share = spread(
      integrated((amplitude.real.array().square() + amplitude.imaginary.array().square()) * correction_));
  if (!derivatives) return fine;
  for (const Eigen::ArrayXXd& term : zernike_) {
    const Eigen::ArrayXXd by = turn * term;
    const Amplitude change = image_of({-by * imaginary, by * real});
    fine.by_zernike.push_back(spread(integrated(2 *
                                                (amplitude.real.array() * change.real.array() +
                                                 amplitude.imaginary.array() * change.imaginary.array()) *
                                                correction_)));
  }
  return fine;
}

}  // namespace atomcam
