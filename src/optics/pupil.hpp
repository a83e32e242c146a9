#pragma once
// From the wavefront in the pupil to the intensity in the image, without the tilts (they are a displacement,
// exactly). Lengths are in diffraction units: wavelength / NA in the object plane; spatial frequencies in NA
// / wavelength, where the pupil is the unit disc and the intensity holds nothing beyond 2.

#include <complex>
#include <vector>

#include "optics/fourier.hpp"
#include "optics/optics.hpp"

namespace atomcam {

/// Amplitude in the pupil at this squared radius (aperture: 1), beside the centre's.
double pupil_amplitude(const OpticsDescription& optics, double radius_square);

/// How far rays leave the geometric image, in diffraction units: the wavefront's slope over the wavelength.
struct RayReach {
  double rms, largest;
};
RayReach ray_reach(const OpticsDescription& optics);

/// The intensity in the image, periodic with `size` (even) samples `step` < 1 / 4 diffraction units apart:
/// close enough for its highest frequency, 2.
class ImageSamples {
 public:
  ImageSamples(const OpticsDescription& optics, int size, double step);
  /// One column of the image: to[n * stride] is the light per square sample at row n - size / 2, column
  /// `column` - size / 2; the sum over the image is 1.
  void column(int column, double* to, std::size_t stride);

 private:
  int size_, reach_;
  FourierLine line_;
  double scale_ = 0;
  std::vector<double> correction_;             // by place, from -size / 2 on
  std::vector<std::complex<double>> halfway_;  // [image column, pupil row]: transformed along the rows only
  std::vector<std::complex<double>> from_, to_;
};

}  // namespace atomcam
