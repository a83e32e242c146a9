#pragma once

#include <complex>
#include <vector>

namespace atomcam {

/// In place: value[m] -> sum over k of value[k] exp(-2 pi i k m / size); size a power of two. A plain radix-2
/// transform of our own: the laws computed with it decide which random word gives which electron number, so
/// they must have the same bits on every machine, which a library that picks its kernels by processor does
/// not promise.
void fourier_transform(std::vector<std::complex<double>>& value);

}  // namespace atomcam
