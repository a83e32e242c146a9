#pragma once
// A scientific camera without physics and without network: features, triggers, exposure, frame timing,
// buffers. It asks a FrameSource for pixels and hands frames to a FrameSink.

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "base/camera_settings.hpp"
#include "base/feature.hpp"
#include "camera/frame_source.hpp"
#include "camera/transport.hpp"

namespace atomcam {

/// What a model of camera is: identity, sensor geometry, readout modes, timing figures, set-points at
/// power-up.
struct CameraModel {
  CameraKind kind = CameraKind::emccd;
  std::string vendor = "atomcam";
  std::string model;  // "iXon Ultra 897" / "ORCA-Quest C15550-20UP" (simulated)
  std::string version;
  std::string serial;
  std::string user_name;
  Shape sensor;
  double pixel_um = 16;
  std::vector<ReadoutMode> readout_modes;
  CameraSettings power_up;  // region = whole sensor
  int adc_bits = 16;
  int render_threads = 1;  // frames rendered ahead of their time
};

/// A control that the camera passes through to its FrameSource as an override: a feature and the override's
/// key.
struct SourceControl {
  FeatureDeclaration feature;  // category SimulationControl (or one below it)
  /// "atoms.filling"; value = number in the key's unit. Only values that differ from the default are passed
  /// on. With feature.selector, a '*' in the key stands for the name of the selector's entry
  /// ("optics.zernike_um.*"); the selector itself is a control before it, an enumeration with an empty key.
  /// The key "seed" is the source's seed: SimulationSeed and ChunkSeed tell its value.
  std::string key;
  /// One per entry of the selector; empty: feature.default_value for all.
  std::vector<double> selected_defaults;
};

using FeatureValue =
    std::variant<std::int64_t, double, bool, std::string>;  // enumerations: entry name as string

struct FeatureRange {
  double minimum = 0, maximum = 0, increment = 0;
};

class Camera : public TransportCamera {
 public:
  /// Opens the camera: frames count from here. `source` outlives nothing else: shared.
  static std::unique_ptr<Camera> open(CameraModel model, std::shared_ptr<FrameSource> source,
                                      std::vector<SourceControl> controls = {});

  // By name, for vendor libraries, the command line and tests. Errors name the feature, the value and the
  // range.
  virtual FeatureValue get(std::string_view feature) = 0;
  virtual void set(std::string_view feature, const FeatureValue& value) = 0;
  virtual void execute(std::string_view command) = 0;
  virtual FeatureRange range(std::string_view feature) = 0;
  virtual std::vector<FeatureDeclaration> features() const = 0;

  /// The settings a frame exposed now would have.
  virtual CameraSettings settings() const = 0;

  struct Statistics {
    std::uint64_t frames = 0, late_frames = 0, lost_frames = 0, missed_triggers = 0;
    double frame_rate_hz = 0;
  };
  virtual Statistics statistics() const = 0;
};

}  // namespace atomcam
