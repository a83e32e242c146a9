#include "optics/pupil.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <map>
#include <memory>
#include <mutex>
#include <utility>

#include "base/math.hpp"
#include "optics/pupil_row.hpp"
#include "optics/sinc.hpp"
#include "optics/zernike.hpp"

namespace atomcam {
namespace {

std::array<double, zernike_terms> without_tilt(std::array<double, zernike_terms> zernike_um) {
  zernike_um[0] = zernike_um[1] = zernike_um[2] = 0;
  return zernike_um;
}

/// The part of a square of side `side` about (x, y) inside the unit disc: its share and its centre of mass.
struct Part {
  double share, x, y;
};

Part part_inside(double x, double y, double side) {
  const double r = std::sqrt(x * x + y * y), half_diagonal = 0.7072 * side;
  if (r + half_diagonal <= 1) return {1, x, y};
  if (r - half_diagonal >= 1) return {0, x, y};
  constexpr int parts = 16;
  double inside = 0, sum_x = 0, sum_y = 0;
  for (int j = 0; j < parts; ++j)
    for (int i = 0; i < parts; ++i) {
      const double u = x + side * ((i + 0.5) / parts - 0.5), v = y + side * ((j + 0.5) / parts - 0.5);
      if (u * u + v * v >= 1) continue;
      inside += 1;
      sum_x += u;
      sum_y += v;
    }
  if (inside == 0) return {0, x, y};
  return {inside / (parts * parts), sum_x / inside, sum_y / inside};
}

/// The squares of a grid of pupil samples that the aperture fills or cuts; row j is at y = j spacing, j =
/// -reach .. reach.
struct PupilGrid {
  struct Edge {
    int row, column;
    Part part;
  };
  std::vector<int> filled;  // by row: columns -filled[j + reach] .. filled[j + reach] are whole; -1: none
  std::vector<Edge> edges;  // by row
};

PupilGrid make_grid(int reach, double spacing) {
  PupilGrid grid;
  for (int j = -reach; j <= reach; ++j) {
    int filled = -1;
    while (part_inside((filled + 1) * spacing, j * spacing, spacing).share == 1) ++filled;
    grid.filled.push_back(filled);
    for (int i = -reach; i <= reach; ++i) {
      if (std::abs(i) <= filled) continue;
      const Part part = part_inside(i * spacing, j * spacing, spacing);
      if (part.share > 0) grid.edges.push_back({j, i, part});
    }
  }
  return grid;
}

/// Kept for every size: tables come in a handful of them, at one step.
std::shared_ptr<const PupilGrid> shared_grid(int size, int reach, double spacing) {
  static std::mutex mutex;
  static std::map<std::pair<int, double>, std::shared_ptr<const PupilGrid>> grids;
  const std::scoped_lock lock(mutex);
  auto& grid = grids[{size, spacing}];
  if (grid == nullptr) grid = std::make_shared<const PupilGrid>(make_grid(reach, spacing));
  return grid;
}

/// Row y of the pupil, for pupil_row.
PupilRow row_at(const PupilPolynomial& turns, double y, double spacing, double numerical_aperture,
                double edge_loss) {
  PupilRow row{};
  for (std::size_t p = 0; p < 5; ++p) {
    double value = 0, slope = 0;
    for (std::size_t q = 5; q-- > 0;) {
      slope = slope * y + value;
      value = value * y + turns[p][q];
    }
    row.turns[p] = value;
    if (p > 0) row.slope_x[p - 1] = static_cast<double>(p) * value * spacing;
    if (p < 4) row.slope_y[p] = slope * spacing;
  }
  row.spacing = spacing;
  row.sine_square = numerical_aperture * numerical_aperture;
  row.sine_square_y = row.sine_square * y * y;
  row.edge_loss = edge_loss;
  row.edge_loss_y = edge_loss * y * y;
  return row;
}

/// Rows whose transforms are laid down together: their samples fill whole cache lines.
constexpr int rows_at_once = 8;

}  // namespace

double pupil_amplitude(const OpticsDescription& optics, double radius_square) {
  const double aperture = optics.apodisation ? optics.numerical_aperture : 0;
  return (1 - optics.pupil_edge_loss * radius_square) /
         std::sqrt(std::sqrt(1 - aperture * aperture * radius_square));
}

RayReach ray_reach(const OpticsDescription& optics) {
  const auto zernike_um = without_tilt(optics.zernike_um);
  double largest = 0, sum = 0, weight = 0;
  constexpr int rings = 16, spokes = 48;
  for (int i = 0; i <= rings; ++i)
    for (int j = 0; j < spokes; ++j) {
      const double rho = static_cast<double>(i) / rings, turn = static_cast<double>(j) / spokes;
      const Slope slope = zernike_slope(zernike_um, rho * math::cos_turns(turn), rho * math::sin_turns(turn));
      const double square = slope.x * slope.x + slope.y * slope.y;
      largest = std::max(largest, square);
      sum += rho * square;
      weight += rho;
    }
  return {std::sqrt(sum / weight) / optics.wavelength_um, std::sqrt(largest) / optics.wavelength_um};
}

// Each sample of the pupil is its mean over a square of the grid: a hard edge on points would make the
// aperture's area and the far tail depend on the grid. The mean multiplies the image's amplitude by sinc(x /
// period) sinc(y / period), which is divided out of the intensity.
ImageSamples::ImageSamples(const OpticsDescription& optics, int size, double step)
    : size_(size),
      reach_(static_cast<int>(size * step) + 2),
      line_(size),
      from_(static_cast<std::size_t>(size)),
      to_(static_cast<std::size_t>(size)) {
  const auto zernike_um = without_tilt(optics.zernike_um);
  const double spacing = 1 / (size * step);  // of pupil samples, in aperture radii
  const auto grid = shared_grid(size, reach_, spacing);
  PupilPolynomial turns = zernike_polynomial(zernike_um);
  for (auto& line : turns)
    for (double& value : line) value /= optics.wavelength_um;
  const double aperture = optics.apodisation ? optics.numerical_aperture : 0;
  const double edge_loss = optics.pupil_edge_loss;
  const bool even = aperture == 0 && edge_loss == 0;
  const auto apodised = [&optics](double x, double y) { return pupil_amplitude(optics, x * x + y * y); };

  double energy = 0;
  const int rows = 2 * reach_ + 1;
  halfway_.resize(static_cast<std::size_t>(size) * static_cast<std::size_t>(rows));
  std::vector<std::complex<double>> made(static_cast<std::size_t>(rows + pupil_row_step));
  std::vector<std::complex<double>> transformed(static_cast<std::size_t>(rows_at_once * size));
  auto edge = grid->edges.begin();
  for (int first = 0; first < rows; first += rows_at_once) {
    const int some = std::min(rows_at_once, rows - first);
    for (int r = 0; r < some; ++r) {
      const int j = first + r - reach_;
      const int filled = grid->filled[static_cast<std::size_t>(j + reach_)];
      std::fill(from_.begin(), from_.end(), 0.0);
      if (filled >= 0) {
        const int count = 2 * filled + 1;
        pupil_row(row_at(turns, j * spacing, spacing, aperture, edge_loss), -filled,
                  (count + pupil_row_step - 1) / pupil_row_step * pupil_row_step, made.data());
        std::copy_n(made.begin() + filled, filled + 1, from_.begin());
        std::copy_n(made.begin(), filled, from_.end() - filled);
        if (even) energy += count;
        for (int i = -filled; !even && i <= filled; ++i) {
          const double strength = apodised(i * spacing, j * spacing);
          energy += strength * strength;
        }
      }
      for (; edge != grid->edges.end() && edge->row == j; ++edge) {
        const Part& part = edge->part;
        double strength = part.share * apodised(part.x, part.y);
        energy += strength * strength / part.share;
        const auto values = zernike_values(part.x, part.y);
        double wavefront_um = 0;
        for (std::size_t n = 3; n < zernike_terms; ++n) wavefront_um += zernike_um[n] * values[n];
        const Slope slope = zernike_slope(zernike_um, part.x, part.y);
        strength *=
            sinc(slope.x / optics.wavelength_um * spacing) * sinc(slope.y / optics.wavelength_um * spacing);
        const double turn = wavefront_um / optics.wavelength_um;
        from_[static_cast<std::size_t>(edge->column < 0 ? edge->column + size : edge->column)] = {
            strength * math::cos_turns(turn), strength * math::sin_turns(turn)};
      }
      line_.transform(from_.data(), &transformed[static_cast<std::size_t>(r * size)]);
    }
    for (int m = 0; m < size; ++m)
      for (int r = 0; r < some; ++r)
        halfway_[static_cast<std::size_t>(m) * static_cast<std::size_t>(rows) +
                 static_cast<std::size_t>(first + r)] = transformed[static_cast<std::size_t>(r * size + m)];
  }
  scale_ = 1 / (energy * size * size);
  for (int n = -size / 2; n < size / 2; ++n) {
    const double value = sinc(static_cast<double>(n) / size);
    correction_.push_back(1 / (value * value));
  }
  std::fill(from_.begin(), from_.end(), 0.0);
}

void ImageSamples::column(int column, double* to, std::size_t stride) {
  const int half = size_ / 2;
  const auto rows = static_cast<std::size_t>(2 * reach_ + 1);
  const auto wrapped = static_cast<std::size_t>(column < half ? column + half : column - half);
  const auto at = halfway_.begin() + static_cast<std::ptrdiff_t>(wrapped * rows);
  std::copy_n(at + reach_, reach_ + 1, from_.begin());
  std::copy_n(at, reach_, from_.end() - reach_);
  line_.transform(from_.data(), to_.data());
  const double scale = scale_ * correction_[static_cast<std::size_t>(column)];
  for (int n = 0; n < size_; ++n, to += stride)
    *to = std::norm(to_[static_cast<std::size_t>(n < half ? n + half : n - half)]) *
          (scale * correction_[static_cast<std::size_t>(n)]);
}

}  // namespace atomcam
