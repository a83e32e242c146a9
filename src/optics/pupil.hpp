#pragma once
// From the wavefront in the pupil to the intensity in the image, without the tilts (they are a displacement,
// exactly). Lengths are in diffraction units: wavelength / NA in the object plane; spatial frequencies in NA
// / wavelength, where the pupil is the unit disc and the intensity holds nothing beyond 2.

#include <complex>
#include <vector>

#include "optics/optics.hpp"

namespace atomcam {

/// How far rays leave the geometric image, in diffraction units: the wavefront's slope over the wavelength.
struct RayReach {
  double rms, largest;
};
RayReach ray_reach(const OpticsDescription& optics);

/// The complex optical transfer function of the pupil, sampled at multiples of 1 / (size * step) for an image
/// that is periodic with size * step diffraction units: rows l = 0 .. size - 1 (negative ones wrapped),
/// columns k = 0 .. size / 2 (the rest follows by symmetry); 1 at zero. Needs step < 1 / 4, so that the
/// intensity is not aliased.
std::vector<std::complex<double>> transfer_function(const OpticsDescription& optics, int size, double step);

}  // namespace atomcam
