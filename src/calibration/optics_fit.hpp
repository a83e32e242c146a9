#pragma once
// Where the sites are and what the optics do, from the mean image: all sites share one image, their
// brightness is free.

#include <Eigen/Dense>
#include <array>
#include <vector>

#include "analysis/image_motion.hpp"
#include "calibration/lattice.hpp"
#include "calibration/mean_image.hpp"
#include "optics/optics.hpp"

namespace atomcam {

struct OpticsFit {
  Lattice lattice;
  std::array<double, zernike_terms> zernike_um{};
  std::vector<double> site_e;  // mean electrons per frame of each site, row by row
  double mean_site_e() const;  // over the sites, not below 0
  double background_e = 0, background_error = 0;
  /// Parameters: origin x, y, a x, y, b x, y (about the lattice's middle), Zernike terms 3 ... 14.
  Eigen::MatrixXd covariance;
  double chi_square = 0;
  int degrees_of_freedom = 0;
  bool converged = false;
  double position_error_px = 0;  // of a site at the lattice's middle
};

/// Stamps reach this far from a site; light beyond is taken from the simulation's own table.
int stamp_radius_px(const Lattice& lattice);

/// From a lattice known to a pixel or better. Zernike terms of degree 2 to 4 are free; the sign that the even
/// terms share is chosen for defocus >= 0, or as `known` has it.
/// `known`: terms to start from; without it several starts are tried. `motion`: what the image did meanwhile,
/// so that the mean is not of the optics alone. `threads` for the starts, 0: as many as cores.
OpticsFit fit_optics(const MeanImage& mean, const OpticsDescription& optics, const Lattice& start,
                     const std::array<double, zernike_terms>* known = nullptr,
                     const ImageMotion* motion = nullptr, int threads = 0);

/// An image does not tell the sign that the even terms share: the one with which the fit is nearer to these
/// terms (um).
void take_sign_of(OpticsFit& fit, const std::array<double, zernike_terms>& zernike_um);

/// A defocus (um rms) that changes across the image: x u + y v + curvature (u^2 + v^2), where u and v go from
/// the image's middle, 1 at half its width.
struct FieldFocus {
  double x_um = 0, y_um = 0, curvature_um = 0;
  std::array<double, zernike_terms> zernike_um{};  // in the image's middle
  double gain = 0;  // of the logarithmic likelihood, over optics that are the same everywhere
};

/// The mean image with a defocus that changes across it: sharp spots on one line, the same optics fitted to
/// all. What optics common to all sites have to take for a defocus may be another term then.
FieldFocus fit_field_focus(const MeanImage& mean, const OpticsDescription& optics, const OpticsFit& common,
                           int threads = 0);

}  // namespace atomcam
