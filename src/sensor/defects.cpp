#include "sensor/defects.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cstdint>

namespace atomcam {
namespace {

struct Step {
  int x, y;
};
constexpr std::array<Step, 8> neighbours = {
    {{-1, -1}, {0, -1}, {1, -1}, {-1, 0}, {1, 0}, {-1, 1}, {0, 1}, {1, 1}}};

constexpr std::size_t lanes = 32;  // defects that are corrected side by side

/// Neighbours of several defects: values[n][lane].
using Neighbourhoods = std::array<std::array<std::uint16_t, lanes>, 8>;

/// Sorts the eight values of every lane: Batcher's network of 19 comparators, each a vector minimum and
/// maximum.
void sort(Neighbourhoods& values) {
  constexpr std::uint8_t network[19][2] = {{0, 1}, {2, 3}, {4, 5}, {6, 7}, {0, 2}, {1, 3}, {4, 6},
                                           {5, 7}, {1, 2}, {5, 6}, {0, 4}, {1, 5}, {2, 6}, {3, 7},
                                           {2, 4}, {3, 5}, {1, 2}, {3, 4}, {5, 6}};
  for (const auto& [low, high] : network) {
    std::uint16_t* a = values[low].data();
    std::uint16_t* b = values[high].data();
    for (std::size_t lane = 0; lane < lanes; ++lane) {
      const std::uint16_t smaller = std::min(a[lane], b[lane]), larger = std::max(a[lane], b[lane]);
      a[lane] = smaller;
      b[lane] = larger;
    }
  }
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
  // A defect is never among the good ones, so neither the order of the replacements matters nor that several
  // are made at once.
  Neighbourhoods values{};
  std::array<std::uint16_t*, lanes> pixels{};
  std::array<int, lanes> counts{};
  std::size_t filled = 0;
  const auto replace = [&] {
    sort(values);
    for (std::size_t lane = 0; lane < filled; ++lane) {
      const auto count = static_cast<std::size_t>(counts[lane]);
      if (count == 0) continue;
      const std::uint32_t sum = std::uint32_t{values[(count - 1) / 2][lane]} + values[count / 2][lane];
      *pixels[lane] = static_cast<std::uint16_t>((sum + 1) / 2);
    }
    filled = 0;
  };
  const int columns = image.columns(), last_row = image.rows() - 1;
  for (auto defect = begin; defect != end; ++defect) {
    const int row = defect->row - region.offset_y, column = defect->column - region.offset_x;
    if (column < 0 || column >= columns) continue;
    std::uint32_t good = defect->good;
    if (row == 0) good &= ~0b00000111u;
    if (row == last_row) good &= ~0b11100000u;
    if (column == 0) good &= ~0b00101001u;
    if (column == columns - 1) good &= ~0b10010100u;
    std::uint16_t* here = &image(row, column);
    // Bad neighbours count as the largest number: the good ones come first.
    for (std::size_t n = 0; n < neighbours.size(); ++n)
      values[n][filled] = (good >> n & 1) != 0 ? here[neighbours[n].y * columns + neighbours[n].x] : 0xffff;
    pixels[filled] = here;
    counts[filled] = std::popcount(good);
    if (++filled == lanes) replace();
  }
  replace();
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
