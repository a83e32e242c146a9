#pragma once
// What a client has set on a camera and what follows from it: stored values, values computed from others,
// ranges, locks. One table of features, made for one model of camera. No threads, no registers.

#include <cstdint>
#include <functional>
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "base/feature.hpp"
#include "camera/camera.hpp"
#include "camera/payload.hpp"
#include "camera/timing.hpp"

namespace atomcam {

class FeatureState;

/// A feature and its behaviour. What is left empty is plain: a stored value with the declaration's bounds.
struct Feature {
  FeatureDeclaration declaration;
  std::function<double(const FeatureState&)> number;          // computed instead of stored
  std::function<std::int64_t(const FeatureState&)> integer;   // computed, all 64 bits
  std::function<std::string(const FeatureState&)> text;       // computed string
  std::function<FeatureRange(const FeatureState&)> range;     // the bounds of this moment
  std::function<std::uint64_t(const FeatureState&)> entries;  // bit i: entry i may be chosen now
  std::function<bool(const FeatureState&)> locked;            // refused for a reason of its own
  /// What is stored when `value` is written (the nearest that the camera can do), and what else changes with
  /// it; not a number, and nothing changed: refused.
  std::function<double(FeatureState&, double value)> written;
  std::vector<double> selected_defaults;  // one per entry of the selector; empty: the declaration's for all
  std::string override_key;               // of a SourceControl
  bool saved = true;                      // part of a user set

  bool computed() const { return number || integer || text; }
};

/// What is true of the running camera, as far as features tell it; refreshed before features are read.
struct LiveValues {
  bool acquiring = false, exposing = false, frame_active = false, waiting_for_trigger = false;
  bool line_input = false;
  double temperature_c = 0, stepped_temperature_c = 0;
  bool temperature_stable = true;
  std::uint64_t timestamp_latch_ns = 0;
  std::uint64_t exposure_end_frame = 0, exposure_end_ns = 0;
  std::uint64_t lost_frame = 0, lost_ns = 0;
  Camera::Statistics statistics;
};

class FeatureState {
 public:
  FeatureState(CameraModel model, std::vector<Feature> features);

  const CameraModel& model() const { return model_; }
  const std::vector<Feature>& features() const { return features_; }
  LiveValues live;

  bool has(std::string_view name) const { return indices_.find(name) != indices_.end(); }
  /// Throws an Error that names the nearest feature.
  int index(std::string_view name) const;

  // Values; of a selected feature the one its selector points at.
  double number(int feature) const;
  double number(std::string_view name) const { return number(index(name)); }
  double selected_number(std::string_view name, int entry) const;
  std::int64_t integer(int feature) const;
  std::string text(int feature) const;
  bool on(std::string_view name) const { return number(name) != 0; }
  bool is(std::string_view name, std::string_view entry) const;
  /// Position of the current value among an enumeration's entries.
  int entry_position(std::string_view name) const;

  FeatureRange range(int feature) const;
  std::uint64_t entries(int feature) const;
  bool locked(int feature) const;
  /// Acquiring, or held by TLParamsLocked.
  bool parameters_locked() const { return live.acquiring || on("TLParamsLocked"); }

  RegisterStatus set_number(int feature, double value);
  RegisterStatus set_text(int feature, std::string_view value);
  /// Stores without checks; for consequences of another feature's value. Follow with normalise().
  void store(std::string_view name, double value);

  /// The settings of a frame exposed now.
  CameraSettings settings() const;
  FrameTiming timing() const { return timing(settings_without_interval()); }
  PayloadLayout layout() const;
  double frame_interval_s() const;
  /// Frames per second that exposure and readout allow.
  double maximum_frame_rate_hz() const;

  // User sets: number 0 is the factory's.
  void load_user_set(int set);
  void save_user_set(int set);

 private:
  struct Values {
    std::vector<std::vector<double>> numbers;  // [feature][entry of its selector]
    std::vector<std::string> texts;
  };

  std::size_t slot(const Feature& feature) const;
  void normalise();
  CameraSettings settings_without_interval() const;
  FrameTiming timing(const CameraSettings& settings) const;

  CameraModel model_;
  std::vector<Feature> features_;
  std::map<std::string, int, std::less<>> indices_;
  Values values_;
  std::vector<Values> user_sets_;
  int locked_ = -1;  // index of TLParamsLocked
};

/// All features of a model, in the order of categories and addresses.
std::vector<Feature> make_features(const CameraModel& model, const FrameSource& source,
                                   const std::vector<SourceControl>& controls);

/// Where the sensor's cooler drives it, and what the sensor drifts to without.
double cooling_target_c(const FeatureState& state);

// Settings as each kind of camera understands its features; and its timing.
CameraSettings emccd_settings(const FeatureState& state, CameraSettings settings);
CameraSettings qcmos_settings(const FeatureState& state, CameraSettings settings);
FrameTiming emccd_timing(const FeatureState& state, const CameraSettings& settings);
FrameTiming qcmos_timing(const FeatureState& state, const CameraSettings& settings);

}  // namespace atomcam
