#pragma once

#include <cstddef>
#include <span>

namespace atomcam {

/// Padding of the sums' columns: a multiple of every vector's length.
inline constexpr std::size_t core_sum_columns = 16;

/// The inner sums of a Fourier integral: for every column i,
///   even_re[i] = sum over k of re[k] cosine[k][i],   even_im[i] = sum of im[k] cosine[k][i],
///   odd_re[i] = sum of re[k] sine[k][i],             odd_im[i] = sum of im[k] sine[k][i],
/// in the order of k, the same bits on every instruction set. `columns`: a multiple of core_sum_columns.
struct CoreSums {
  double *even_re, *even_im, *odd_re, *odd_im;
};
void core_sums(std::span<const double> re, std::span<const double> im, const double* cosine,
               const double* sine, std::size_t columns, CoreSums sums);

}  // namespace atomcam
