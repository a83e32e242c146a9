#include "optics/cells.hpp"

#include <algorithm>
#include <cmath>
#include <complex>
#include <numeric>
#include <string>

#include "base/error.hpp"
#include "base/math.hpp"
#include "optics/core_sums.hpp"
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

/// A half spectrum of an image that is periodic with `size` samples.
struct Spectrum {
  int size;
  int reach;  // no frequency index beyond this
  std::vector<std::complex<double>> values;
  std::complex<double>& at(int l, int k) {
    return values[static_cast<std::size_t>(l < 0 ? l + size : l) * static_cast<std::size_t>(size / 2 + 1) +
                  static_cast<std::size_t>(k)];
  }
};

/// The light in the side x side cells of width `width` (in samples) about the centre: the integral of the
/// spectrum's trigonometric polynomial over each cell, by separable sums; even and odd parts serve a place
/// and its mirror image.
std::vector<double> core_cells(Spectrum& spectrum, int side, double width) {
  const int half = side / 2, reach = spectrum.reach;
  const std::size_t columns =
      (static_cast<std::size_t>(half) + core_sum_columns - 1) / core_sum_columns * core_sum_columns;
  const double turns = width / spectrum.size;
  // cos and sin of 2 pi k x for the places x = i + 1/2 right of the centre, and the light in a cell at
  // frequency k.
  std::vector<double> cosine(static_cast<std::size_t>(reach + 1) * columns), sine(cosine.size());
  std::vector<double> weight(static_cast<std::size_t>(reach + 1));
  for (int k = 0; k <= reach; ++k) {
    weight[k] = turns * sinc(k * turns);
    for (int i = 0; i < half; ++i) {
      cosine[k * columns + i] = math::cos_turns(k * (i + 0.5) * turns);
      sine[k * columns + i] = math::sin_turns(k * (i + 0.5) * turns);
    }
  }
  std::vector<double> cells(static_cast<std::size_t>(side) * static_cast<std::size_t>(side));
  std::vector<double> even_re(columns), even_im(columns), odd_re(columns), odd_im(columns);
  std::vector<double> re(static_cast<std::size_t>(side)), im(re.size());
  std::vector<double> value_re(weight.size()), value_im(weight.size());
  for (int l = -reach; l <= reach; ++l) {
    const int last =
        static_cast<int>(std::sqrt(static_cast<double>(reach) * reach - static_cast<double>(l) * l));
    for (int k = 0; k <= last; ++k) {
      const std::complex<double> value = (k == 0 ? 1 : 2) * weight[k] * spectrum.at(l, k);
      value_re[k] = value.real();
      value_im[k] = value.imag();
    }
    const auto terms = static_cast<std::size_t>(last + 1);
    core_sums(std::span(value_re).first(terms), std::span(value_im).first(terms), cosine.data(), sine.data(),
              columns, {even_re.data(), even_im.data(), odd_re.data(), odd_im.data()});
    // exp(i p) = cos p + i sin p at a place is conjugate at its mirror image.
    for (int i = 0; i < half; ++i) {
      re[half + i] = even_re[i] - odd_im[i];
      im[half + i] = even_im[i] + odd_re[i];
      re[half - 1 - i] = even_re[i] + odd_im[i];
      im[half - 1 - i] = even_im[i] - odd_re[i];
    }
    const double* c = &cosine[std::abs(l) * columns];
    const double* s = &sine[std::abs(l) * columns];
    const double sign = l < 0 ? -1 : 1;
    for (int j = 0; j < side; ++j) {
      const bool right = j >= half;
      const auto place = static_cast<std::size_t>(right ? j - half : half - 1 - j);
      const double row_re = weight[std::abs(l)] * c[place];
      const double row_im = weight[std::abs(l)] * s[place] * (right ? sign : -sign);
      double* row = &cells[static_cast<std::size_t>(j) * static_cast<std::size_t>(side)];
      for (int i = 0; i < side; ++i) row[i] += row_re * re[i] - row_im * im[i];
    }
  }
  return cells;
}

/// The light in the cells between samples: cell (j, i) covers [i, i + 1) x [j, j + 1) samples, negative ones
/// wrapped.
std::vector<double> sampled_cells(Spectrum& spectrum) {
  const int size = spectrum.size, reach = spectrum.reach;
  std::vector<std::complex<double>> factor(static_cast<std::size_t>(2 * reach + 1));
  for (int k = -reach; k <= reach; ++k) {
    const double turns = static_cast<double>(k) / size;
    factor[k + reach] =
        sinc(turns) / size * std::complex<double>(math::cos_turns(turns / 2), math::sin_turns(turns / 2));
  }
  Spectrum shifted{size, reach, std::vector<std::complex<double>>(spectrum.values.size())};
  for (int l = -reach; l <= reach; ++l)
    for (int k = 0; k <= reach; ++k)
      shifted.at(l, k) = spectrum.at(l, k) * factor[l + reach] * factor[k + reach];
  return image_of_spectrum(std::move(shifted.values), size);
}

}  // namespace

Cells point_spread_cells(const OpticsDescription& optics, Blur blur) {
  const double unit_um = optics.wavelength_um / optics.numerical_aperture;
  Cells cells;
  cells.side = choose_side(optics, std::max(blur.major_um, blur.minor_um) / unit_um);
  const int side = cells.side, size = 9 * side;  // level 4 covers exactly one period
  const double period = size * sample_step;

  Spectrum spectrum{size, std::min(static_cast<int>(2 * period) + 3, size / 2 - 1),
                    transfer_function(optics, size, sample_step)};
  const BlurTransfer blurred(blur, unit_um);
  if (!blurred.none())
    for (int l = -spectrum.reach; l <= spectrum.reach; ++l)
      for (int k = 0; k <= spectrum.reach; ++k) spectrum.at(l, k) *= blurred(k / period, l / period);

  const auto level_cells = static_cast<std::size_t>(side) * static_cast<std::size_t>(side);
  cells.share.reserve(cell_levels * level_cells);
  for (int level = 0, width = 1; level < sampled_level; ++level, width *= 3) {
    const std::vector<double> core = core_cells(spectrum, side, width * finest_cell / sample_step);
    cells.share.insert(cells.share.end(), core.begin(), core.end());
  }
  const std::vector<double> sampled = sampled_cells(spectrum);
  cells.share.resize(cell_levels * level_cells);
  for (int level = sampled_level, width = 1; level < cell_levels; ++level, width *= 3)
    for (int y = -side / 2 * width; y < side / 2 * width; ++y) {
      const double* row =
          &sampled[static_cast<std::size_t>(y < 0 ? y + size : y) * static_cast<std::size_t>(size)];
      double* cell = &cells.share[cells.index(level, (y + side / 2 * width) / width, 0)];
      for (int x = -side / 2 * width; x < side / 2 * width; ++cell)
        for (const int next = x + width; x < next; ++x) *cell += row[x < 0 ? x + size : x];
    }
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
