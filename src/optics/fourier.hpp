#pragma once
// The three transforms that a point-spread function needs, on square grids, by FFTW3. Indices count from the
// centre: a negative index is stored wrapped around.

#include <complex>
#include <span>
#include <vector>

namespace atomcam {

/// A complex square grid, zero at first.
class FourierGrid {
 public:
  explicit FourierGrid(int size);
  std::complex<double>& at(int row, int column) {
    return values_[static_cast<std::size_t>(wrapped(row)) * static_cast<std::size_t>(size_) +
                   static_cast<std::size_t>(wrapped(column))];
  }
  /// values(n, m) <- sum over (l, k) of values(l, k) exp(-2 pi i (l n + k m) / size).
  void transform();
  /// The transform, as above, of |values(n, m)|^2 factor(n) factor(m), for columns 0 .. size / 2, divided by
  /// its first value. `factor` in storage order.
  std::vector<std::complex<double>> spectrum_of_intensity(std::span<const double> factor, double total) const;

 private:
  int wrapped(int index) const { return index < 0 ? index + size_ : index; }
  int size_;
  std::vector<std::complex<double>> values_;
};

/// The real image of a half spectrum as above (size rows, size / 2 + 1 columns): sum over all (l, k) of
/// spectrum(l, k) exp(+2 pi i (l n + k m) / size). The spectrum is used up.
std::vector<double> image_of_spectrum(std::vector<std::complex<double>> spectrum, int size);

}  // namespace atomcam
