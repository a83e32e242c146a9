#pragma once
// The pixel maps of a qCMOS sensor: what its serial number stands for.

#include <memory>
#include <string>

#include "base/image.hpp"
#include "sensor/sensor.hpp"

namespace atomcam {

/// Maps of the whole sensor. Drawn from a serial number, or from calibration frames; a null map is drawn.
struct QcmosMaps {
  /// Fixed offset of a pixel from the bias, counts: pixel + column + row part.
  std::shared_ptr<const Image<float, unit::counts>> offset_counts;
  /// Counts per electron relative to the mode's, 1 on average.
  std::shared_ptr<const RatioMap> gain_ratio;
  /// Read noise relative to the mode's `read_noise_e`, rms 1 over the pixels.
  std::shared_ptr<const RatioMap> read_noise_ratio;
  /// Dark current relative to `dark_rate_e_per_s`, 1 on average.
  std::shared_ptr<const RatioMap> dark_ratio;
};

/// The maps of serial number `serial`: normal pixel and row offsets, zero-mean Gumbel column offsets, normal
/// gain, log-normal read noise exp(s z - s^2) (s = read_noise_log_sigma, so that the rms over pixels is the
/// mode's value) and gamma dark current. Each map has its own streams: changing one figure leaves the others
/// as they were.
QcmosMaps draw_qcmos_maps(const QcmosDescription& description, const std::string& serial);

/// As make_qcmos in sensor.hpp, with maps from calibration frames in place of drawn ones.
std::shared_ptr<const Sensor> make_qcmos(QcmosDescription description, std::string serial, QcmosMaps maps);

}  // namespace atomcam
