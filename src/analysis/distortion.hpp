#pragma once
// Displacements of sites that follow the field, as a lens distorts.

#include <span>

namespace atomcam::analysis {

/// How much of the displacements `d` of sites at (x, y), of weights `w`, is smooth along the field, as a lens
/// distorts: logarithm of the mean square of the polynomials of second and third order over that of what
/// these leave (place, scale and angles of the lattice, the orders before them, apart). Not a number where
/// the sites are hardly more than the polynomials.
double log_distortion(std::span<const double> x, std::span<const double> y, std::span<const double> w,
                      std::span<const double> d);

}  // namespace atomcam::analysis
