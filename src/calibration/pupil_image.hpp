#pragma once
// The image of a point by a pupil with given Zernike terms, and its derivatives: what the optics are fitted
// with. Agrees with PointSpreadFunction (a test compares them) but is made in milliseconds, near the site
// only.

#include <Eigen/Dense>
#include <array>
#include <span>
#include <vector>

#include "optics/optics.hpp"

namespace atomcam {

inline constexpr int first_fitted_zernike = 3;  // piston is nothing, tilt is a displacement
inline constexpr int fitted_zernikes = zernike_terms - first_fitted_zernike;

/// The pixel-integrated image on a fine grid about the site: sample (j, i) is the share of light in a pixel
/// whose centre lies (i - centre, j - centre) / oversampling pixels from the site.
struct FineImage {
  static constexpr int oversampling = 4;
  int centre = 0;
  Eigen::ArrayXXd share;                    // [row, column]
  std::vector<Eigen::ArrayXXd> by_zernike;  // d share / d coefficient (um), for terms 3 ... 14; or empty
};

class PupilImage {
 public:
  /// Samples across the pupil, a margin of two on each side: rough ones find the way, with fine ones the
  /// light 16 pixels from a site is right to 0.1 % of the whole.
  static constexpr int rough = 44, precise = 124;
  /// Up to `radius_px` pixels from the site. Uses all of `optics` but its Zernike terms.
  PupilImage(const OpticsDescription& optics, int radius_px, int samples = precise);
  FineImage operator()(const std::array<double, zernike_terms>& zernike_um, bool derivatives) const;
  /// From now on the image of a point that was displaced by these (px, with the same weight each).
  void spread_over(std::span<const double> x_px, std::span<const double> y_px);
  int radius_px() const { return radius_px_; }

 private:
  struct Amplitude {
    Eigen::MatrixXd real, imaginary;
  };
  Amplitude along_columns(const Amplitude& pupil) const;
  Amplitude image_of(const Amplitude& pupil) const;
  Eigen::ArrayXXd integrated(const Eigen::ArrayXXd& intensity) const;
  Eigen::ArrayXXd spread(const Eigen::ArrayXXd& share) const;

  int radius_px_, samples_;
  double wavelength_um_;
  Eigen::ArrayXXd strength_;                              // [pupil row, pupil column]
  std::array<Eigen::ArrayXXd, fitted_zernikes> zernike_;  // values over the pupil
  Eigen::MatrixXd cosine_, sine_;                         // [fine sample, pupil sample], both from the middle
  Eigen::ArrayXXd correction_;                            // fine samples: normalisation and sample width
  Eigen::ArrayXXd displaced_;  // share of each displacement, in fine samples about the middle; empty: none
};

}  // namespace atomcam
