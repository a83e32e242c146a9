// Light of the atoms where none should be: halo, smear along the columns, ghosts. The noise of cells of
// pixels is correlated with every site's brightness, at all distances between the two, and for the array
// mirrored left-right, top-bottom and through a point, about any centre.

#include <algorithm>
#include <cmath>

#include "analysis/family.hpp"
#include "analysis/lanes.hpp"

namespace atomcam::analysis {
namespace {

/// to[i] += factor * from[i]
ATOMCAM_VECTOR_CLONES
void add_rows(int rows, std::size_t width, float factor, const float* from, float* to,
              std::ptrdiff_t to_stride) {
  const Lanes f = lanes(factor);
  for (int r = 0; r < rows; ++r, from += width, to += to_stride)
    for (std::size_t c = 0; c < width; c += lane_count) store(to + c, load(to + c) + f * load(from + c));
}

/// Sums over each cell of pixels.
ATOMCAM_VECTOR_CLONES
void sum_cells(const Plane& plane, int cell, std::size_t width, float* rows_sum, float* cells) {
  const PlaneShape& shape = plane.shape();
  for (int r = 0; r < shape.rows; ++r) {
    const float* p = plane.row(r);
    const bool first = r % cell == 0, last = r % cell == cell - 1 || r + 1 == shape.rows;
    for (std::ptrdiff_t c = 0; c < shape.stride; c += static_cast<std::ptrdiff_t>(lane_count))
      store(rows_sum + c, first ? load(p + c) : load(rows_sum + c) + load(p + c));
    if (!last) continue;
    float* to = cells + static_cast<std::size_t>(r / cell) * width;
    for (int c = 0; c < shape.columns; c += cell) {
      float sum = 0;
      for (int k = c; k < std::min(c + cell, shape.columns); ++k) sum += rows_sum[k];
      to[c / cell] = sum;
    }
  }
}

enum Kind { shifted, mirrored_x, mirrored_y, turned, kind_count };

struct Sums {
  std::array<Floats, kind_count> product;
  std::array<double, kind_count> change2{};
  double cell2 = 0, cells = 0;
  Sums& operator+=(const Sums& other) {
    for (std::size_t k = 0; k < kind_count; ++k) {
      for (std::size_t i = 0; i < product[k].size(); ++i) product[k][i] += other.product[k][i];
      change2[k] += other.change2[k];
    }
    cell2 += other.cell2, cells += other.cells;
    return *this;
  }
};

class FarLight : public Family {
 public:
  explicit FarLight(const Layout& layout)
      : layout_(layout),
        cell_(std::max(6, (std::min(layout.shape.rows, layout.shape.columns) + 31) / 32)),
        rows_((layout.shape.rows + cell_ - 1) / cell_),
        columns_((layout.shape.columns + cell_ - 1) / cell_),
        width_((static_cast<std::size_t>(columns_) + lane_count - 1) / lane_count * lane_count),
        stride_(2 * width_),
        rows_sum_(static_cast<std::size_t>(layout.shape.stride)),
        cells_(static_cast<std::size_t>(rows_) * width_) {
    for (const SiteImage& site : layout.sites) {
      site_row_.push_back(std::clamp(static_cast<int>(std::lround(site.y_px)) / cell_, 0, rows_ - 1));
      site_column_.push_back(std::clamp(static_cast<int>(std::lround(site.x_px)) / cell_, 0, columns_ - 1));
    }
    Sums zero;
    for (Floats& product : zero.product) product.resize(2 * static_cast<std::size_t>(rows_) * stride_);
    sums_ = Halves<Sums>(zero);
  }

  void second_look(const SecondLook& look) override {
    Sums& sums = sums_[look.part];
    sum_cells(look.quiet, cell_, width_, rows_sum_.data(), cells_.data());
    double square = 0;
    for (const float v : cells_) square += static_cast<double>(v) * static_cast<double>(v);
    sums.cell2 += square;
    sums.cells += static_cast<double>(rows_) * columns_;
    // Every frame for the distances, every third for each of the mirrors.
    add(sums, shifted, look);
    add(sums, static_cast<Kind>(1 + look.frame % 3), look);
  }

  void summarise(Part which, const Record& record, Sheet& sheet) const override {
    sheet.family("far_light");
    const Sums sums = sums_.of(which);
    const bool enough = record.count(which) >= 4;
    const double cell_variance = sums.cell2 / sums.cells;
    // In standard errors; row and column count from the first entry of the map.
    const auto z = [&](Kind kind, int row, int column) {
      return static_cast<double>(sums.product[kind][static_cast<std::size_t>(row) * stride_ +
                                                    static_cast<std::size_t>(column)]) /
             std::sqrt(cell_variance * sums.change2[kind]);
    };
    const auto put = [&](std::string_view name, double value) {
      sheet.put(name, enough ? value : not_a_number);
    };
    double halo[3] = {}, halo_count[3] = {}, up = 0, down = 0, left = 0, right = 0, up_n = 0, left_n = 0,
           down_n = 0, right_n = 0;
    double ghost = 0;
    const auto width = static_cast<int>(width_);
    for (int dr = 1 - rows_; dr < rows_; ++dr)
      for (int dc = 1 - columns_; dc < columns_; ++dc) {
        // Pairs overlap less at large distances: all values as if they had their full number.
        const double value = z(shifted, dr + rows_, dc + width);
        const double distance = std::sqrt(static_cast<double>(dr * dr + dc * dc));
        if (distance > 1.5 && distance < 6) {
          const int k = distance < 2.5 ? 0 : distance < 4 ? 1 : 2;
          halo[k] += value, ++halo_count[k];
        }
        if (dc == 0 && dr < -1) up += value, ++up_n;
        if (dc == 0 && dr > 1) down += value, ++down_n;
        if (dr == 0 && dc < -1) left += value, ++left_n;
        if (dr == 0 && dc > 1) right += value, ++right_n;
        if (distance > 2.5) ghost = std::max(ghost, value);
      }
    sheet.kind({"point_spread_halo", "space", "far from sites"});
    constexpr std::string_view names[] = {"halo.near", "halo.middle", "halo.far"};
    for (int k = 0; k < 3; ++k) put(names[k], halo[k] / std::sqrt(halo_count[k]));
    sheet.kind({"column_smear", "space", "columns"});
    put("up", up / std::sqrt(up_n));
    put("down", down / std::sqrt(down_n));
    sheet.kind({"trailing_charge", "space", "rows"});
    put("left", left / std::sqrt(left_n));
    put("right", right / std::sqrt(right_n));
    sheet.kind({"point_spread_halo", "space", "whole frame"});
    put("ghost.shifted", ghost);
    constexpr std::string_view ghosts[] = {"", "ghost.mirrored_left_right", "ghost.mirrored_top_bottom",
                                           "ghost.turned"};
    for (const Kind kind : {mirrored_x, mirrored_y, turned}) {
      double largest = 0;
      // A site near its own mirror image is no ghost: distances of a cell around the array's own symmetry are
      // among the largest anyway in plain stacks, alike in real and simulated ones.
      for (int r = 0; r < 2 * rows_; ++r)
        for (int c = 0; c < static_cast<int>(stride_); ++c) largest = std::max(largest, z(kind, r, c));
      put(ghosts[kind], largest);
    }
  }

 private:
  void add(Sums& sums, Kind kind, const SecondLook& look) {
    for (std::size_t s = 0; s < site_row_.size(); ++s) {
      const float change = look.brightness[s] - look.mean_brightness[s];
      sums.change2[kind] += static_cast<double>(change) * static_cast<double>(change);
      // Where cell (0, 0) of the frame goes in the map.
      const int row = kind == shifted || kind == mirrored_x ? rows_ - site_row_[s] : site_row_[s];
      const int column = kind == shifted || kind == mirrored_y ? static_cast<int>(width_) - site_column_[s]
                                                               : site_column_[s];
      add_rows(rows_, width_, change, cells_.data(),
               sums.product[kind].data() + static_cast<std::size_t>(row) * stride_ +
                   static_cast<std::size_t>(column),
               static_cast<std::ptrdiff_t>(stride_));
    }
  }

  const Layout& layout_;
  int cell_, rows_, columns_;
  std::size_t width_, stride_;
  Floats rows_sum_, cells_;
  std::vector<int> site_row_, site_column_;
  Halves<Sums> sums_;
};

}  // namespace

std::unique_ptr<Family> make_far_light(const Layout& layout) {
  return std::make_unique<FarLight>(layout);
}

}  // namespace atomcam::analysis
