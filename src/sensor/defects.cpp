#include "sensor/defects.hpp"

#include <algorithm>
#include <array>
#include <cstdint>

namespace atomcam {
namespace {

bool before(const PixelAddress& a, const PixelAddress& b) {
  return a.row != b.row ? a.row < b.row : a.column < b.column;
}

}  // namespace

std::vector<PixelAddress> find_defects(const RatioMap& read_noise_ratio, const RatioMap& dark_ratio,
                                       HotPixelCorrection level) {
  float noise_limit = 3, dark_limit = 10;
  if (level == HotPixelCorrection::minimum) {
    noise_limit = 4;
    dark_limit = 15;
  } else if (level == HotPixelCorrection::aggressive) {
    noise_limit = 2.5;
    dark_limit = 7;
  }
  std::vector<PixelAddress> defects;
  for (int r = 0; r < read_noise_ratio.rows(); ++r) {
    const std::span<const float> noise = read_noise_ratio.row(r), dark = dark_ratio.row(r);
    for (std::size_t c = 0; c < noise.size(); ++c)
      if (noise[c] > noise_limit || dark[c] > dark_limit) defects.push_back({r, static_cast<int>(c)});
  }
  return defects;
}

void correct_defects(const std::vector<PixelAddress>& defects, const Region& region, CountImage& image) {
  const auto begin =
      std::lower_bound(defects.begin(), defects.end(), PixelAddress{region.offset_y, 0}, before);
  const auto end =
      std::lower_bound(begin, defects.end(), PixelAddress{region.offset_y + region.height, 0}, before);
  std::array<std::uint16_t, 9> good{};
  // A defect is never among the good ones, so the order of the replacements does not matter.
  for (auto defect = begin; defect != end; ++defect) {
    const int row = defect->row - region.offset_y, column = defect->column - region.offset_x;
    if (column < 0 || column >= image.columns()) continue;
    std::size_t count = 0;
    for (int r = std::max(row - 1, 0); r <= std::min(row + 1, image.rows() - 1); ++r) {
      for (int c = std::max(column - 1, 0); c <= std::min(column + 1, image.columns() - 1); ++c) {
        const PixelAddress there{r + region.offset_y, c + region.offset_x};
        if (std::binary_search(begin, end, there, before)) continue;
        std::size_t place = count++;  // kept in order
        for (; place > 0 && good[place - 1] > image(r, c); --place) good[place] = good[place - 1];
        good[place] = image(r, c);
      }
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
