#pragma once

#include <cstddef>

namespace atomcam::analysis {

/// Sum of a[i] b[i], i < n, in sixteen lanes of single precision; n a multiple of sixteen.
double sum_of_products(std::size_t n, const float* a, const float* b);

}  // namespace atomcam::analysis
