#pragma once

#include <cstddef>
#include <span>

namespace atomcam {

/// Lines that are summed at once.
inline constexpr std::size_t cell_sum_lines = 32;

/// out[c] = sum over n of weights[n] samples[n][c], c < cell_sum_lines, in the order of n: the same bits on
/// every instruction set.
void cell_sums(std::span<const double> weights, const double* samples, double* out);

}  // namespace atomcam
