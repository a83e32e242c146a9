#pragma once
// How the tables of features are written: one expression per feature, its behaviour beside its declaration.

#include <utility>

#include "camera/feature_state.hpp"

namespace atomcam {

class Declare {
 public:
  Declare(FeatureType type, std::string name, std::string tooltip) {
    feature_.declaration.type = type;
    feature_.declaration.name = std::move(name);
    feature_.declaration.tooltip = std::move(tooltip);
  }
  static Declare integer(std::string name, std::string tooltip) {
    return {FeatureType::integer, std::move(name), std::move(tooltip)};
  }
  static Declare floating(std::string name, std::string tooltip) {
    return {FeatureType::floating, std::move(name), std::move(tooltip)};
  }
  static Declare boolean(std::string name, std::string tooltip) {
    return std::move(Declare(FeatureType::boolean, std::move(name), std::move(tooltip)).within(0, 1));
  }
  static Declare enumeration(std::string name, std::string tooltip, std::vector<EnumEntry> entries) {
    Declare declare(FeatureType::enumeration, std::move(name), std::move(tooltip));
    declare.feature_.declaration.entries = std::move(entries);
    return declare;
  }
  static Declare command(std::string name, std::string tooltip) {
    Declare declare(FeatureType::command, std::move(name), std::move(tooltip));
    declare.feature_.declaration.access = Access::write_only;
    return declare;
  }
  /// A read-only string that never changes.
  static Declare label(std::string name, std::string tooltip, std::string value) {
    Declare declare(FeatureType::string, std::move(name), std::move(tooltip));
    declare.feature_.declaration.default_string = std::move(value);
    return std::move(declare.read_only());
  }

  Declare& unit(std::string unit) { return feature_.declaration.unit = std::move(unit), *this; }
  Declare& within(double minimum, double maximum, double increment = 0) {
    feature_.declaration.minimum = minimum;
    feature_.declaration.maximum = maximum;
    feature_.declaration.increment = increment;
    return *this;
  }
  Declare& initially(double value) { return feature_.declaration.default_value = value, *this; }
  Declare& initially(std::vector<double> values) {
    return feature_.selected_defaults = std::move(values), *this;
  }
  Declare& length(int bytes) { return feature_.declaration.string_length = bytes, *this; }
  Declare& read_only() { return feature_.declaration.access = Access::read_only, *this; }
  Declare& expert() { return feature_.declaration.visibility = Visibility::expert, *this; }
  Declare& guru() { return feature_.declaration.visibility = Visibility::guru, *this; }
  Declare& invisible() { return feature_.declaration.visibility = Visibility::invisible, *this; }
  Declare& custom() { return feature_.declaration.custom = true, *this; }
  Declare& logarithmic() { return feature_.declaration.logarithmic = true, *this; }
  Declare& selected_by(std::string selector) {
    return feature_.declaration.selector = std::move(selector), *this;
  }
  Declare& held_while_acquiring() { return feature_.declaration.locked_while_acquiring = true, *this; }
  Declare& not_saved() { return feature_.saved = false, *this; }
  Declare& in_chunk(Chunk chunk) {
    feature_.declaration.chunk_id = chunk_id(chunk);
    return not_saved().read_only();
  }

  Declare& number(std::function<double(const FeatureState&)> value) {
    return feature_.number = std::move(value), *this;
  }
  Declare& integer_value(std::function<std::int64_t(const FeatureState&)> value) {
    feature_.integer = std::move(value);
    return read_only().within(-9.2e18, 9.2e18);
  }
  Declare& range(std::function<FeatureRange(const FeatureState&)> range) {
    feature_.range = std::move(range);
    feature_.declaration.dynamic_range = true;
    return *this;
  }
  Declare& choices(std::function<std::uint64_t(const FeatureState&)> entries) {
    return feature_.entries = std::move(entries), *this;
  }
  Declare& locked_if(std::function<bool(const FeatureState&)> locked) {
    return feature_.locked = std::move(locked), *this;
  }
  Declare& on_write(std::function<double(FeatureState&, double)> written) {
    return feature_.written = std::move(written), *this;
  }

  Feature take(std::string category) {
    feature_.declaration.category = std::move(category);
    return std::move(feature_);
  }

 private:
  Feature feature_;
};

/// A table that grows category by category.
class FeatureTable {
 public:
  void category(std::string name) { category_ = std::move(name); }
  void add(Declare& declare) { features_.push_back(declare.take(category_)); }
  void add(Declare&& declare) { features_.push_back(declare.take(category_)); }
  void add(Feature feature) { features_.push_back(std::move(feature)); }
  std::vector<Feature> take() { return std::move(features_); }

 private:
  std::string category_;
  std::vector<Feature> features_;
};

// The parts of a category in which the two kinds of camera differ.
void add_emccd_image_format(FeatureTable& table, const CameraModel& model);
void add_qcmos_image_format(FeatureTable& table, const CameraModel& model);
void add_emccd_readout(FeatureTable& table, const CameraModel& model);
void add_qcmos_readout(FeatureTable& table, const CameraModel& model);
void add_emccd_cooling(FeatureTable& table, const CameraModel& model);
void add_qcmos_cooling(FeatureTable& table, const CameraModel& model);

/// The four edges of the image on the sensor and binning; steps in physical pixels.
void add_region(FeatureTable& table, const CameraModel& model, int step_px, int minimum_px);

inline constexpr double ambient_temperature_c = 20;

}  // namespace atomcam
