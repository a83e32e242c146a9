#pragma once
// What a qCMOS camera does to an image after conversion: it replaces pixels it knows to be bad, and bins
// digitally.

#include <cstdint>
#include <vector>

#include "base/camera_settings.hpp"
#include "base/image.hpp"
#include "sensor/fixed_map.hpp"

namespace atomcam {

/// A bad pixel: row and column on the sensor, and which of its eight neighbours (in reading order) are good.
struct Defect {
  int row = 0;
  int column = 0;
  std::uint32_t good = 0xff;
};

/// Pixels whose read noise exceeds 4 / 3 / 2.5 times the sensor's rms, or whose dark current 15 / 10 / 7
/// times its mean (minimum / standard / aggressive), in row order.
std::vector<Defect> find_defects(const FixedMap<std::uint16_t>& read_noise_ratio, const RatioMap& dark_ratio,
                                 HotPixelCorrection level);

/// Replaces every defect in the region by the median of its good neighbours (of eight) within the region.
void correct_defects(const std::vector<Defect>& defects, const Region& region, CountImage& image);

/// Sums of binning_x by binning_y counts, clipped to 16 bits; the bias is summed with the rest.
CountImage bin_digitally(CountImage image, int binning_x, int binning_y);

}  // namespace atomcam
