#include "sensor/fourier.hpp"

#include <utility>

#include "base/math.hpp"

namespace atomcam {

void fourier_transform(std::vector<std::complex<double>>& value) {
  const std::size_t size = value.size();
  for (std::size_t i = 1, reversed = 0; i < size; ++i) {
    std::size_t bit = size >> 1;
    for (; reversed & bit; bit >>= 1) reversed ^= bit;
    reversed ^= bit;
    if (i < reversed) std::swap(value[i], value[reversed]);
  }
  std::vector<std::complex<double>> turn(size / 2);
  for (std::size_t k = 0; k < turn.size(); ++k) {
    const double angle = static_cast<double>(k) / static_cast<double>(size);
    turn[k] = {math::cos_turns(angle), -math::sin_turns(angle)};
  }
  for (std::size_t length = 2; length <= size; length *= 2) {
    const std::size_t half = length / 2, stride = size / length;
    for (std::size_t begin = 0; begin < size; begin += length) {
      for (std::size_t k = 0; k < half; ++k) {
        const std::complex<double> w = turn[k * stride], a = value[begin + k], b = value[begin + k + half];
        // Written out: the library's product takes a detour for infinities.
        const std::complex<double> t(w.real() * b.real() - w.imag() * b.imag(),
                                     w.real() * b.imag() + w.imag() * b.real());
        value[begin + k] = a + t;
        value[begin + k + half] = a - t;
      }
    }
  }
}

}  // namespace atomcam
