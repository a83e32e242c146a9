#pragma once
// The transforms that a point-spread function needs, by FFTW3. A negative index is stored wrapped around.

#include <complex>
#include <vector>

namespace atomcam {

/// The transform of lines of one length: to[n] = sum over l of from[l] exp(-2 pi i l n / size). Plans are
/// made once per length and kept; use by several threads is safe.
class FourierLine {
 public:
  explicit FourierLine(int size);
  /// Does not touch `from`; the two must not overlap.
  void transform(const std::complex<double>* from, std::complex<double>* to) const;

 private:
  void* plan_;
};

/// The half spectrum (size rows, size / 2 + 1 columns) of a real image: sum over all (n, m) of image(n, m)
/// exp(-2 pi i (l n + k m) / size).
std::vector<std::complex<double>> spectrum_of_image(std::vector<double> image, int size);

/// The real image of a half spectrum as above (size rows, size / 2 + 1 columns): sum over all (l, k) of
/// spectrum(l, k) exp(+2 pi i (l n + k m) / size). The spectrum is used up.
std::vector<double> image_of_spectrum(std::vector<std::complex<double>> spectrum, int size);

}  // namespace atomcam
