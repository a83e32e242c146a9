#pragma once
// Power spectra of planes and series, by FFTW3 in single precision.

#include <complex>
#include <span>
#include <vector>

#include "analysis/plane.hpp"

namespace atomcam::analysis {

/// The spectrum of a real image, rows x (columns / 2 + 1) values.
class ImageSpectrum {
 public:
  ImageSpectrum(int rows, int columns);
  ImageSpectrum(const ImageSpectrum&) = delete;
  ImageSpectrum& operator=(const ImageSpectrum&) = delete;

  int rows() const { return rows_; }
  int columns() const { return columns_; }
  int half() const { return columns_ / 2 + 1; }
  /// [row, column], to be filled before transform(), which keeps it.
  std::span<float> image() { return image_; }
  /// [row frequency, column frequency].
  std::span<const std::complex<float>> spectrum() const { return spectrum_; }
  void transform();
  /// Adds |spectrum|^2.
  void add_power(std::span<float> sums) const;

 private:
  int rows_, columns_;
  std::vector<float, CacheAligned<float>> image_;
  std::vector<std::complex<float>, CacheAligned<std::complex<float>>> spectrum_;
  void* plan_;
};

}  // namespace atomcam::analysis
