#include "optics/cells.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <string>

#include "base/error.hpp"
#include "base/math.hpp"
#include "optics/cell_sums.hpp"
#include "optics/fourier.hpp"
#include "optics/pupil.hpp"
#include "optics/sinc.hpp"

namespace atomcam {
namespace {

// The intensity is sampled at cells of level 2, closer than its Nyquist distance 1 / 4.
constexpr int sampled_level = 2;
constexpr double sample_step = 9 * finest_cell;
static_assert(sample_step < 0.25);

/// Diffraction units beyond which an ideal lens sends less than 0.1 % of the light: 1 - E(r) ~ 1 / (pi^2 r).
constexpr double far_tail = 101.4;

int choose_side(const OpticsDescription& optics, double blur) {
  const RayReach rays = ray_reach(optics);
  const double core = std::min(2.0, rays.rms);
  const double reach = far_tail + rays.largest + 5 * blur;
  int side = 0;
  for (const int candidate : {108, 144, 162, 180, 216, 240}) {  // sizes that Fourier transforms like
    side = candidate;
    if (side * finest_cell / 2 >= core && side * finest_cell / 2 * 81 >= reach) return side;
  }
  if (side * finest_cell / 2 * 81 >= reach) return side;
  const double unit_um = optics.wavelength_um / optics.numerical_aperture;
  throw Error("optics", "the wavefront and the blur spread the light over " +
                            std::to_string(reach * unit_um) + " um of the atom plane, must be at most " +
                            std::to_string(side * finest_cell / 2 * 81 * unit_um));
}

/// Gaussian blur in the domain of frequencies; `unit_um`: one diffraction unit.
class BlurTransfer {
 public:
  BlurTransfer(Blur blur, double unit_um)
      : major_(blur.major_um / unit_um),
        minor_(blur.minor_um / unit_um),
        cosine_(math::cos_turns(blur.angle_deg / 360)),
        sine_(math::sin_turns(blur.angle_deg / 360)) {}
  bool none() const { return major_ == 0 && minor_ == 0; }
  double operator()(double fx, double fy) const {
    const double a = major_ * (cosine_ * fx + sine_ * fy), b = minor_ * (cosine_ * fy - sine_ * fx);
    return math::exp(-2 * math::pi * math::pi * (a * a + b * b));
  }

 private:
  double major_, minor_, cosine_, sine_;
};

// The light in a cell is a sum over the samples about it: the intensity holds no frequency beyond 0.45 per
// sample, so between samples it is a sum of sinc functions, and these may be cut off smoothly (Kaiser's
// window) where their spectrum has fallen from 1 at 0.45 to 0 at 0.55.
constexpr int sinc_reach = 72;  // samples; what is cut off is 2e-11
constexpr double window_slope = 2 * math::pi * sinc_reach * (0.5 - 2 * sample_step);

double bessel_i0(double x) {
  double sum = 1, term = 1;
  for (int n = 1; term > 1e-17 * sum; ++n) {
    term *= x * x / (4.0 * n * n);
    sum += term;
  }
  return sum;
}

double windowed_sinc(double x) {
  const double part = x / sinc_reach;
  if (part * part >= 1) return 0;
  return sinc(x) * bessel_i0(window_slope * std::sqrt(1 - part * part)) / bessel_i0(window_slope);
}

/// One axis: the weights of samples in the cells of every level. Finest cells are 1/9 of a sample wide, so
/// their places within a sample, and the weights, come around.
class CellWeights {
 public:
  CellWeights() {
    // Gauss-Legendre, 4 nodes: a finest cell holds 1/20 of the shortest wave.
    constexpr double node[2] = {0.3399810435848563, 0.8611363115940526};
    constexpr double weight[2] = {0.6521451548625461, 0.3478548451374538};
    for (int place = 0; place < 9; ++place) {
      std::vector<double>& sums = weights_[0].emplace_back(2 * sinc_reach);
      for (std::size_t n = 0; n < sums.size(); ++n)
        for (int g = 0; g < 4; ++g) {
          const double x = (place + 0.5 * (1 + (g < 2 ? -node[g] : node[g - 2]))) / 9.0;
          sums[n] += weight[g % 2] / 18 * windowed_sinc(x - (static_cast<double>(n) - sinc_reach + 1));
        }
    }
    // A coarser cell is three finer ones.
    for (int level = 1; level < cell_levels; ++level) {
      const auto& finer = weights_[level - 1];
      for (std::size_t place = 0; place < std::max<std::size_t>(1, finer.size() / 3); ++place) {
        const std::size_t step = finer.size() >= 3 ? 0 : level == 3 ? 1 : 3;  // samples from one to the next
        std::vector<double>& sums = weights_[level].emplace_back(finer[0].size() + 2 * step);
        for (std::size_t part = 0; part < 3; ++part) {
          const std::vector<double>& each = step == 0 ? finer[3 * place + part] : finer[0];
          for (std::size_t n = 0; n < each.size(); ++n) sums[n + part * step] += each[n];
        }
      }
    }
  }

  /// Cell `index` counted from the centre: its light is the sum of weights[n] sample(first + n).
  struct Sum {
    int first;
    std::span<const double> weights;
  };
  Sum at(int level, int index) const {
    const int places = static_cast<int>(weights_[level].size());
    const int place = ((index % places) + places) % places;
    const int samples_wide = level <= sampled_level ? 1 : level == 3 ? 3 : 9;
    return {(index - place) / places * samples_wide - sinc_reach + 1, weights_[level][place]};
  }

 private:
  std::array<std::vector<std::vector<double>>, cell_levels> weights_;  // [level][place within a sample]
};

using Lines = std::vector<double>;  // [block of cell_sum_lines, place, line]

/// Periodic: place p of `size`, -size / 2 on, stands at p + size / 2 + margin; margins repeat the other end.
constexpr int margin = sinc_reach;

void fill_margins(double* block, int size) {
  const auto width = cell_sum_lines * static_cast<std::size_t>(margin);
  const auto period = cell_sum_lines * static_cast<std::size_t>(size);
  std::copy_n(block + period, width, block);
  std::copy_n(block + width, width, block + period + width);
}

/// Samples -> cells along the columns, then along the rows. `column(m, to, stride)` gives column m.
template <class Column>
std::vector<double> cells_of_samples(int side, int size, Column column) {
  static const CellWeights weights;
  constexpr int lines = cell_sum_lines;
  const int half = side / 2, places = size + 2 * margin;
  const int blocks = (side + lines - 1) / lines;
  const auto block_size = static_cast<std::size_t>(places) * cell_sum_lines;
  std::array<Lines, cell_levels> down;  // [block of cell rows, image column, cell row]
  std::array<int, cell_levels> first{}, last{};
  for (int level = 0; level < cell_levels; ++level) {
    down[level].resize(static_cast<std::size_t>(blocks) * block_size);
    // Columns that the level's cells look at; the outermost level looks at all.
    const auto begin = weights.at(level, -half), end = weights.at(level, side - half - 1);
    first[level] = std::max(0, begin.first + size / 2);
    last[level] = std::min(size, end.first + static_cast<int>(end.weights.size()) + size / 2);
  }
  Lines samples(block_size);
  std::array<double, cell_sum_lines> sums;
  for (int start = 0; start < size; start += lines) {
    const int some = std::min(lines, size - start);
    for (int c = 0; c < some; ++c) column(start + c, &samples[margin * cell_sum_lines + c], cell_sum_lines);
    fill_margins(samples.data(), size);
    for (int level = 0; level < cell_levels; ++level) {
      if (start >= last[level] || start + some <= first[level]) continue;
      for (int j = 0; j < side; ++j) {
        const auto sum = weights.at(level, j - half);
        cell_sums(sum.weights,
                  &samples[static_cast<std::size_t>(sum.first + size / 2 + margin) * cell_sum_lines],
                  sums.data());
        double* to = &down[level][static_cast<std::size_t>(j / lines) * block_size +
                                  static_cast<std::size_t>(start + margin) * cell_sum_lines + j % lines];
        for (int c = 0; c < some; ++c) to[static_cast<std::size_t>(c) * cell_sum_lines] = sums[c];
      }
    }
  }
  std::vector<double> cells(static_cast<std::size_t>(cell_levels * side * side));
  for (int level = 0; level < cell_levels; ++level)
    for (int block = 0; block < blocks; ++block) {
      double* from = &down[level][static_cast<std::size_t>(block) * block_size];
      if (level == cell_levels - 1) fill_margins(from, size);
      const int rows = std::min(lines, side - block * lines);
      for (int i = 0; i < side; ++i) {
        const auto sum = weights.at(level, i - half);
        cell_sums(sum.weights,
                  from + static_cast<std::size_t>(sum.first + size / 2 + margin) * cell_sum_lines,
                  sums.data());
        for (int r = 0; r < rows; ++r)
          cells[static_cast<std::size_t>((level * side + block * lines + r) * side + i)] = sums[r];
      }
    }
  return cells;
}

/// The image, all of it, blurred.
std::vector<double> blurred_image(ImageSamples& samples, const BlurTransfer& blurred, int size,
                                  double period) {
  const auto columns = static_cast<std::size_t>(size);
  std::vector<double> image(columns * columns);  // [row, column]
  for (int m = 0; m < size; ++m) samples.column(m, &image[static_cast<std::size_t>(m)], columns);
  auto spectrum = spectrum_of_image(std::move(image), size);
  std::size_t n = 0;
  for (int l = 0; l < size; ++l)
    for (int k = 0; k <= size / 2; ++k, ++n)
      spectrum[n] *=
          blurred(k / period, (l < size / 2 ? l : l - size) / period) / (static_cast<double>(size) * size);
  return image_of_spectrum(std::move(spectrum), size);
}

/// Photons are spread evenly over a cell, which blurs: with the cell's own integral by w^2 / 6 in variance,
/// per axis. The light is sharpened by as much, where the cells are much finer than the diffraction; none
/// goes from one level to another.
void sharpen(std::vector<double>& share, int level, int side) {
  constexpr double part = 1.0 / 12;  // of the second difference: half of 1 / 6
  const int hole = level == 0 ? side : side / 3;
  const auto inner = [&](int n) { return n >= hole && n < side - hole; };
  const auto grid = std::span(share).subspan(static_cast<std::size_t>(level) * side * side,
                                             static_cast<std::size_t>(side) * side);
  const std::vector<double> even(grid.begin(), grid.end());
  const auto along = [&](int step, int line_step) {
    for (int line = 0; line < side; ++line)
      for (int n = 0; n + 1 < side; ++n) {
        if (inner(line) && inner(n) != inner(n + 1)) continue;
        const auto at = static_cast<std::size_t>(line * line_step + n * step),
                   next = at + static_cast<std::size_t>(step);
        const double moved = part * (even[next] - even[at]);
        grid[at] -= moved;
        grid[next] += moved;
      }
  };
  along(1, side);
  along(side, 1);
  for (double& value : grid) value = std::max(0.0, value);
}
constexpr int sharpened_levels = 2;

}  // namespace

Cells point_spread_cells(const OpticsDescription& optics, Blur blur) {
  const double unit_um = optics.wavelength_um / optics.numerical_aperture;
  Cells cells;
  cells.side = choose_side(optics, std::max(blur.major_um, blur.minor_um) / unit_um);
  const int side = cells.side, size = 9 * side;  // level 4 covers exactly one period
  const auto level_cells = static_cast<std::size_t>(side) * static_cast<std::size_t>(side);

  ImageSamples samples(optics, size, sample_step);
  const BlurTransfer blurred(blur, unit_um);
  if (blurred.none()) {
    cells.share = cells_of_samples(
        side, size, [&](int column, double* to, std::size_t stride) { samples.column(column, to, stride); });
  } else {
    const auto image = blurred_image(samples, blurred, size, size * sample_step);
    cells.share = cells_of_samples(side, size, [&](int column, double* to, std::size_t stride) {
      for (int n = 0; n < size; ++n)
        to[static_cast<std::size_t>(n) * stride] = image[static_cast<std::size_t>(n * size + column)];
    });
  }
  for (int level = 0; level < sharpened_levels; ++level) sharpen(cells.share, level, side);
  for (int level = 1; level < cell_levels; ++level)
    for (int j = side / 3; j < side - side / 3; ++j)
      for (int i = side / 3; i < side - side / 3; ++i) cells.share[cells.index(level, j, i)] = 0;
  // Light beyond the table is laid on its outermost grid.
  const auto outermost = std::span(cells.share).last(level_cells);
  const double inside = std::accumulate(cells.share.begin(), cells.share.end() - outermost.size(), 0.0);
  const double outside = std::accumulate(outermost.begin(), outermost.end(), 0.0);
  for (double& share : outermost) share *= (1 - inside) / outside;
  return cells;
}

std::vector<std::uint32_t> integer_weights(std::span<const double> share, std::uint64_t total) {
  std::vector<std::uint32_t> weights(share.size());
  std::int64_t left = static_cast<std::int64_t>(total);
  for (std::size_t i = 0; i < share.size(); ++i) {
    const double weight = std::floor(std::max(0.0, share[i]) * static_cast<double>(total) + 0.5);
    weights[i] = static_cast<std::uint32_t>(weight);
    left -= weights[i];
  }
  const auto largest = std::max_element(weights.begin(), weights.end());
  *largest = static_cast<std::uint32_t>(static_cast<std::int64_t>(*largest) + left);
  return weights;
}

}  // namespace atomcam
