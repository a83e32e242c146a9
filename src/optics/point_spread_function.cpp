#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "base/error.hpp"
#include "base/math.hpp"
#include "optics/cell_aliases.hpp"
#include "optics/cells.hpp"
#include "optics/optics.hpp"
#include "optics/photon_draws.hpp"

namespace atomcam {
namespace {

void require(bool holds, const char* place, double value, const char* allowed) {
  if (!holds) throw Error(place, "is " + std::to_string(value) + ", must be " + allowed);
}

void check(const OpticsDescription& optics, double defocus_um, const Blur& blur) {
  require(optics.wavelength_um > 0, "wavelength_um", optics.wavelength_um, "above 0");
  require(optics.numerical_aperture > 0 && optics.numerical_aperture < 1, "numerical_aperture",
          optics.numerical_aperture, "between 0 and 1");
  require(optics.magnification > 0, "magnification", optics.magnification, "above 0");
  require(optics.pixel_um > 0, "pixel_um", optics.pixel_um, "above 0");
  for (const double value : optics.zernike_um) require(std::isfinite(value), "zernike_um", value, "finite");
  require(optics.pupil_edge_loss >= 0 && optics.pupil_edge_loss <= 1, "pupil_edge_loss",
          optics.pupil_edge_loss, "0 to 1");
  require(std::isfinite(defocus_um), "defocus_um", defocus_um, "finite");
  require(blur.major_um >= 0 && blur.minor_um >= 0, "blur_um", std::min(blur.major_um, blur.minor_um),
          "0 or more");
}

/// Area of the disc of radius r about the origin within [0, x] x [0, y], odd in x and in y.
double disc_quadrant(double x, double y, double r) {
  const double sign = (x < 0) != (y < 0) ? -1 : 1;
  x = std::min(std::fabs(x), r);
  y = std::min(std::fabs(y), r);
  if (x * x + y * y <= r * r) return sign * x * y;
  const auto primitive = [r](double t) {
    return 0.5 * (t * std::sqrt(std::max(0.0, r * r - t * t)) + r * r * std::asin(std::min(1.0, t / r)));
  };
  const double knee = std::sqrt(r * r - y * y);
  return sign * (y * knee + primitive(x) - primitive(knee));
}

/// The part of a cell's extent that falls on one output pixel.
struct Share {
  int cell;
  int pixel;
  double fraction;
};

/// Splits `cells` cells of width `width` from `begin` on over the pixels 0 .. pixels - 1; all in units of a
/// pixel whose pixel 0 covers [0, 1).
std::vector<Share> split(double begin, double width, int cells, int pixels) {
  std::vector<Share> shares;
  for (int cell = 0; cell < cells; ++cell) {
    const double low = begin + cell * width, high = begin + (cell + 1) * width;
    if (high <= 0 || low >= pixels) continue;
    const int first = low < 0 ? 0 : static_cast<int>(low);
    for (int pixel = first; pixel < pixels && pixel < high; ++pixel) {
      const double overlap = std::min(high, pixel + 1.0) - std::max(low, static_cast<double>(pixel));
      if (overlap > 0) shares.push_back({cell, pixel, overlap / width});
    }
  }
  return shares;
}

}  // namespace

double collected_fraction(double numerical_aperture) {
  require(numerical_aperture >= 0 && numerical_aperture <= 1, "numerical_aperture", numerical_aperture,
          "from 0 to 1");
  return (1 - std::sqrt(1 - numerical_aperture * numerical_aperture)) / 2;
}

struct PointSpreadFunction::Table {
  PhotonTable photons;
  std::array<double, cell_levels> width_px{};
  double shift_x_px = 0, shift_y_px = 0;  // by the tilts
  std::vector<std::uint32_t> weights;     // as Cells::share, sum 2^32
};

PointSpreadFunction::PointSpreadFunction(const OpticsDescription& optics, double defocus_um, double blur_um)
    : PointSpreadFunction(optics, defocus_um, Blur{blur_um, blur_um, 0}) {}

PointSpreadFunction::PointSpreadFunction(const OpticsDescription& optics, double defocus_um, Blur blur) {
  check(optics, defocus_um, blur);
  OpticsDescription actual = optics;
  actual.zernike_um[3] += defocus_um;
  const Cells cells = point_spread_cells(actual, blur);

  auto table = std::make_shared<Table>();
  const double pixels_per_um = optics.magnification / optics.pixel_um;
  const double unit_px = optics.wavelength_um / optics.numerical_aperture * pixels_per_um;
  table->photons.side = cells.side;
  double width_px = finest_cell * unit_px;
  for (int level = 0; level < cell_levels; ++level, width_px *= 3) {
    table->width_px[level] = width_px;
    table->photons.level_px[level] = static_cast<float>(width_px);
  }
  // A tilt of rms a um has the slope 2 a per aperture radius: it leaves the shape alone and moves it by 2 a /
  // NA.
  table->shift_x_px = 2 * optics.zernike_um[1] / optics.numerical_aperture * pixels_per_um;
  table->shift_y_px = 2 * optics.zernike_um[2] / optics.numerical_aperture * pixels_per_um;
  table->photons.shift_x_px = static_cast<float>(table->shift_x_px);
  table->photons.shift_y_px = static_cast<float>(table->shift_y_px);
  table->weights = integer_weights(cells.share, std::uint64_t{1} << 32);

  const CellAliases alias = make_cell_aliases(table->weights);
  const auto level_cells = static_cast<std::uint32_t>(cells.side * cells.side);
  const auto pack = [&](std::uint32_t index) -> std::uint64_t {
    const std::uint32_t level = index / level_cells, within = index % level_cells;
    const auto side = static_cast<std::uint32_t>(cells.side);
    return level << 16 | (within / side) << 8 | within % side;
  };
  table->photons.low_bits = alias.low_bits;
  table->photons.slots.reserve(alias.slots.size());
  for (const CellAlias& slot : alias.slots)
    table->photons.slots.push_back(std::uint64_t{slot.threshold} << PhotonTable::threshold_shift |
                                   pack(slot.own) << PhotonTable::cell_bits | pack(slot.alias));
  table_ = std::move(table);
}

PointSpreadFunction::Displacement PointSpreadFunction::draw(std::uint32_t cell_word,
                                                            std::uint32_t jitter_word) const {
  return table_->photons.draw(cell_word, jitter_word);
}

void PointSpreadFunction::draw(std::span<const std::uint32_t> words, std::span<Displacement> out) const {
  if (words.size() < 2 * out.size())
    throw Error("words", "are " + std::to_string(words.size()) + ", must be two for each of " +
                             std::to_string(out.size()) + " photons");
  draw_photons(table_->photons, words.data(), out.size(), out.data());
}

void PointSpreadFunction::add_expected(PhotonImage& image, double photons, double x_px, double y_px,
                                       int origin_x, int origin_y, int binning_x, int binning_y) const {
  require(binning_x >= 1, "binning_x", binning_x, "1 or more");
  require(binning_y >= 1, "binning_y", binning_y, "1 or more");
  const Table& table = *table_;
  const int side = table.photons.side;
  const double centre_x = (x_px + table.shift_x_px + 0.5 - origin_x) / binning_x;
  const double centre_y = (y_px + table.shift_y_px + 0.5 - origin_y) / binning_y;
  std::vector<double> line(static_cast<std::size_t>(image.columns()));
  for (int level = 0; level < cell_levels; ++level) {
    const double width_x = table.width_px[level] / binning_x, width_y = table.width_px[level] / binning_y;
    const auto across = split(centre_x - side / 2 * width_x, width_x, side, image.columns());
    const auto down = split(centre_y - side / 2 * width_y, width_y, side, image.rows());
    if (across.empty() || down.empty()) continue;
    const int first = across.front().pixel, last = across.back().pixel;
    int summed = -1;
    for (const Share& share : down) {
      if (share.cell != summed) {
        summed = share.cell;
        std::fill(line.begin() + first, line.begin() + last + 1, 0.0);
        const std::uint32_t* weights = &table.weights[static_cast<std::size_t>(level * side + share.cell) *
                                                      static_cast<std::size_t>(side)];
        for (const Share& part : across) line[part.pixel] += weights[part.cell] * part.fraction;
      }
      const double scale = photons * share.fraction * 0x1p-32;
      const auto row = image.row(share.pixel);
      for (int column = first; column <= last; ++column)
        row[column] = static_cast<float>(row[column] + scale * line[column]);
    }
  }
}

double PointSpreadFunction::fraction_within(double radius_px) const {
  require(radius_px >= 0, "radius_px", radius_px, "0 or more");
  const Table& table = *table_;
  const int side = table.photons.side;
  double sum = 0;
  for (int level = 0; level < cell_levels; ++level) {
    const double width = table.width_px[level];
    for (int j = 0; j < side; ++j)
      for (int i = 0; i < side; ++i) {
        const double weight = table.weights[static_cast<std::size_t>((level * side + j) * side + i)];
        if (weight == 0) continue;
        const double x0 = table.shift_x_px + (i - side / 2) * width, x1 = x0 + width;
        const double y0 = table.shift_y_px + (j - side / 2) * width, y1 = y0 + width;
        const double far = std::max(x0 * x0, x1 * x1) + std::max(y0 * y0, y1 * y1);
        double share = 1;
        if (far > radius_px * radius_px)
          share = (disc_quadrant(x1, y1, radius_px) - disc_quadrant(x0, y1, radius_px) -
                   disc_quadrant(x1, y0, radius_px) + disc_quadrant(x0, y0, radius_px)) /
                  (width * width);
        sum += weight * share;
      }
  }
  return sum * 0x1p-32;
}

double PointSpreadFunction::reach_px() const {
  return table_->photons.side / 2 * table_->width_px[cell_levels - 1] +
         std::max(std::fabs(table_->shift_x_px), std::fabs(table_->shift_y_px));
}

}  // namespace atomcam
