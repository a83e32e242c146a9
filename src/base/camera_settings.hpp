#pragma once
// What a client has set on a camera when a frame's exposure begins. The camera fills it, the simulation obeys
// it; it carries no physics of its own. Together with the lab, the seed and the frame number it determines a
// frame.

#include <string>
#include <vector>

namespace atomcam {

enum class CameraKind { emccd, qcmos };
enum class ScanMode { standard, ultra_quiet };
enum class Amplifier { electron_multiplying, conventional };
enum class HotPixelCorrection { minimum, standard, aggressive };

/// A rectangle of physical (unbinned) sensor pixels.
struct Region {
  int offset_x = 0;
  int offset_y = 0;
  int width = 0;
  int height = 0;
  bool operator==(const Region&) const = default;
};

/// One way of reading a sensor out, as its data sheet tabulates it.
struct ReadoutMode {
  Amplifier amplifier = Amplifier::electron_multiplying;  // EMCCD
  ScanMode scan = ScanMode::standard;                     // qCMOS
  double pixel_rate_hz = 0;                               // EMCCD: horizontal shift rate
  std::string preamp;                                     // label of the preamp setting, "1x"
  double electrons_per_count = 1;                         // e-/count without EM gain
  double read_noise_e = 0;                                // rms, e-, EM gain off
  bool operator==(const ReadoutMode&) const = default;
};

struct CameraSettings {
  double exposure_s = 0.08;
  Region region;  // multiple of the binning on each axis
  int binning_x = 1;
  int binning_y = 1;
  bool shutter_open = true;
  double bias_counts = 200;
  double sensor_temperature_c = -80;
  double frame_interval_s = 0.1;  // start to start, as realised by trigger and readout

  int readout_mode = 0;  // index into the sensor's ReadoutModes
  // EMCCD
  double em_gain = 300;              // 1 = off; ignored by the conventional amplifier
  double vertical_shift_s = 0.5e-6;  // per row
  bool frame_transfer = true;
  // qCMOS
  bool photon_number_resolving = false;
  bool defect_correction = true;
  HotPixelCorrection hot_pixel_correction = HotPixelCorrection::standard;
  bool pulsed_light = false;  // light only while every row of the region exposes

  /// Overrides of lab parameters by their dotted key ("atoms.filling", "effects.row_noise.sigma_e"), sorted
  /// by key, at most one each. The camera passes them through; the simulation knows the keys.
  std::vector<std::pair<std::string, double>> overrides;

  int output_width() const { return region.width / binning_x; }
  int output_height() const { return region.height / binning_y; }
  bool operator==(const CameraSettings&) const = default;
};

}  // namespace atomcam
