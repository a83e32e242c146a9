#include "sensor/defects.hpp"

#include <algorithm>
#include <array>
#include <cstdint>

namespace atomcam {
namespace {

struct Step {
  int x, y;
};
constexpr std::array<Step, 8> neighbours = {
    {{-1, -1}, {0, -1}, {1, -1}, {-1, 0}, {1, 0}, {-1, 1}, {0, 1}, {1, 1}}};

/// The two middle ones of eight values: a sorting network (Batcher's, 19 comparators), so without branches.
std::uint32_t middle_sum(std::array<std::uint16_t, 8> v) {
  constexpr std::uint8_t network[19][2] = {{0, 1}, {2, 3}, {4, 5}, {6, 7}, {0, 2}, {1, 3}, {4, 6},
                                           {5, 7}, {1, 2}, {5, 6}, {0, 4}, {1, 5}, {2, 6}, {3, 7},
                                           {2, 4}, {3, 5}, {1, 2}, {3, 4}, {5, 6}};
#pragma GCC unroll 19
  for (const auto& [a, b] : network) {
    const std::uint16_t low = std::min(v[a], v[b]), high = std::max(v[a], v[b]);
    v[a] = low;
    v[b] = high;
  }
  return std::uint32_t{v[3]} + v[4];
}

}  // namespace

std::vector<Defect> find_defects(const FixedMap<std::uint16_t>& read_noise_ratio, const RatioMap& dark_ratio,
                                 HotPixelCorrection level) {
  float noise_limit = 3, dark_limit = 10;
  if (level == HotPixelCorrection::minimum) {
    noise_limit = 4;
    dark_limit = 15;
  } else if (level == HotPixelCorrection::aggressive) {
    noise_limit = 2.5;
    dark_limit = 7;
  }
  const Shape shape = dark_ratio.shape();
  const auto bad = [&](int r, int c) {
    return read_noise_ratio.row(r, c)[0] > noise_limit || dark_ratio(r, c) > dark_limit;
  };
  std::vector<Defect> defects;
  for (int r = 0; r < shape.rows; ++r)
    for (int c = 0; c < shape.columns; ++c) {
      if (!bad(r, c)) continue;
      Defect defect{r, c, 0};
      for (std::size_t n = 0; n < neighbours.size(); ++n) {
        const int y = r + neighbours[n].y, x = c + neighbours[n].x;
        if (y >= 0 && y < shape.rows && x >= 0 && x < shape.columns && !bad(y, x)) defect.good |= 1u << n;
      }
      defects.push_back(defect);
    }
  return defects;
}

void correct_defects(const std::vector<Defect>& defects, const Region& region, CountImage& image) {
  const auto above = [](const Defect& defect, int row) { return defect.row < row; };
  const auto begin = std::lower_bound(defects.begin(), defects.end(), region.offset_y, above);
  const auto end = std::lower_bound(begin, defects.end(), region.offset_y + region.height, above);
  std::array<std::uint16_t, 8> good{};
  // A defect is never among the good ones, so the order of the replacements does not matter.
  for (auto defect = begin; defect != end; ++defect) {
    const int row = defect->row - region.offset_y, column = defect->column - region.offset_x;
    if (column < 0 || column >= image.columns()) continue;
    if (defect->good == 0xff && row > 0 && column > 0 && row + 1 < image.rows() &&
        column + 1 < image.columns()) {
      const std::uint16_t* above_it = &image(row - 1, column);
      const std::uint16_t* beside = &image(row, column);
      const std::uint16_t* below = &image(row + 1, column);
      const std::uint32_t sum = middle_sum(
          {above_it[-1], above_it[0], above_it[1], beside[-1], beside[1], below[-1], below[0], below[1]});
      image(row, column) = static_cast<std::uint16_t>((sum + 1) / 2);
      continue;
    }
    std::size_t count = 0;
    for (std::size_t n = 0; n < neighbours.size(); ++n) {
      const int r = row + neighbours[n].y, c = column + neighbours[n].x;
      if ((defect->good >> n & 1) == 0 || r < 0 || r >= image.rows() || c < 0 || c >= image.columns())
        continue;
      std::size_t place = count++;  // kept in order
      for (; place > 0 && good[place - 1] > image(r, c); --place) good[place] = good[place - 1];
      good[place] = image(r, c);
    }
    if (count == 0) continue;
    image(row, column) =
        static_cast<std::uint16_t>((std::uint32_t{good[(count - 1) / 2]} + good[count / 2] + 1) / 2);
  }
}

CountImage bin_digitally(CountImage image, int binning_x, int binning_y) {
  if (binning_x == 1 && binning_y == 1) return image;
  CountImage binned({image.rows() / binning_y, image.columns() / binning_x});
  std::vector<std::uint32_t> sums(static_cast<std::size_t>(binned.columns()));
  for (int r = 0; r < binned.rows(); ++r) {
    std::fill(sums.begin(), sums.end(), 0u);
    for (int y = 0; y < binning_y; ++y) {
      const std::span<const std::uint16_t> row = image.row(r * binning_y + y);
      for (std::size_t c = 0; c < sums.size(); ++c)
        for (int x = 0; x < binning_x; ++x)
          sums[c] += row[c * static_cast<std::size_t>(binning_x) + static_cast<std::size_t>(x)];
    }
    for (std::size_t c = 0; c < sums.size(); ++c)
      binned(r, static_cast<int>(c)) = static_cast<std::uint16_t>(std::min<std::uint32_t>(sums[c], 65535));
  }
  return binned;
}

}  // namespace atomcam
