#pragma once
// The mean image of an array of sites, as a function of what is fitted to it.

#include <Eigen/Dense>
#include <array>
#include <utility>

#include "calibration/lattice.hpp"
#include "calibration/maximise.hpp"
#include "calibration/mean_image.hpp"
#include "calibration/pupil_image.hpp"

namespace atomcam {

/// Likelihood of a mean image, sites of any brightness having the same image, or one whose defocus changes
/// across the field.
class SiteImages {
 public:
  static constexpr int lattice_parameters = 6;
  static constexpr int shape_parameters = lattice_parameters + fitted_zernikes;
  static constexpr int field_parameters = 3;  // of the defocus across the field: along x, along y, curvature

  /// `changes`: gives the derivatives, which only say where to go and how sure that is: a rough one will do.
  /// `field`: the defocus changes across the field.
  SiteImages(const MeanImage& mean, const Lattice& start, double wavelength_um, const PupilImage& image,
             const PupilImage& changes, bool field = false)
      : mean_(mean),
        wavelength_um_(wavelength_um),
        pupil_image_(image),
        pupil_changes_(changes),
        lattice_(start),
        shapes_(shape_parameters + (field ? field_parameters : 0)) {}

  int sites() const { return lattice_.sites(); }
  /// Lattice, Zernike terms, field; then the sites' light and the background.
  Eigen::Index shapes() const { return shapes_; }
  Eigen::Index size() const { return shapes_ + sites() + 1; }

  Lattice lattice(const Eigen::VectorXd& p) const;
  static std::array<double, zernike_terms> zernike(const Eigen::VectorXd& p);
  Eigen::VectorXd start(double defocus_um, double spherical_um) const;
  Eigen::VectorXd start(const std::array<double, zernike_terms>& zernike_um) const {
    return with(start(0, 0), zernike_um);
  }
  /// The same lattice with these terms, and the light that fits best.
  Eigen::VectorXd with(Eigen::VectorXd p, const std::array<double, zernike_terms>& zernike_um) const;
  /// The sites' brightness and the background that fit best at these shapes; at impossible ones as they are.
  void solve_linear(Eigen::VectorXd& p) const;

  /// Expected electrons per pixel, row by row.
  Eigen::ArrayXd image(const Eigen::VectorXd& p) const;
  /// `linear_only`: of the derivatives those of brightness and background, the others stay zero.
  Likelihood evaluate(const Eigen::VectorXd& p, bool derivatives, bool linear_only = false,
                      Eigen::ArrayXd* image = nullptr) const;

 private:
  Eigen::Vector3d in_field(double x, double y) const;
  std::pair<double, double> defocus_range(const Eigen::VectorXd& p, const Lattice& where) const;

  const MeanImage& mean_;
  double wavelength_um_;
  const PupilImage &pupil_image_, &pupil_changes_;
  Lattice lattice_;
  Eigen::Index shapes_;
};

}  // namespace atomcam
