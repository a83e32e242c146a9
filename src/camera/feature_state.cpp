#include "camera/feature_state.hpp"

#include <algorithm>
#include <cmath>

#include "base/error.hpp"

namespace atomcam {

FeatureState::FeatureState(CameraModel model, std::vector<Feature> features)
    : model_(std::move(model)), features_(std::move(features)) {
  for (std::size_t i = 0; i < features_.size(); ++i) {
    const std::string& name = features_[i].declaration.name;
    if (!indices_.emplace(name, static_cast<int>(i)).second) throw Error(name, "two features of this name");
  }
  for (const Feature& feature : features_) {
    const FeatureDeclaration& declaration = feature.declaration;
    std::size_t count = 1;
    if (!declaration.selector.empty())
      count = features_[static_cast<std::size_t>(index(declaration.selector))].declaration.entries.size();
    if (!feature.selected_defaults.empty() && feature.selected_defaults.size() != count)
      throw Error(declaration.name, "as many defaults as its selector has entries");
    values_.numbers.push_back(feature.selected_defaults.empty()
                                  ? std::vector<double>(count, declaration.default_value)
                                  : feature.selected_defaults);
    values_.texts.push_back(declaration.default_string);
  }
  locked_ = index("TLParamsLocked");
  normalise();
  user_sets_.assign(3, values_);
}

int FeatureState::index(std::string_view name) const {
  if (const auto found = indices_.find(name); found != indices_.end()) return found->second;
  std::vector<std::string> names;
  for (const Feature& feature : features_) names.push_back(feature.declaration.name);
  throw_unknown("camera", "feature", name, names);
}

std::size_t FeatureState::slot(const Feature& feature) const {
  if (feature.declaration.selector.empty()) return 0;
  return static_cast<std::size_t>(entry_position(feature.declaration.selector));
}

double FeatureState::number(int feature) const {
  const Feature& entry = features_[static_cast<std::size_t>(feature)];
  if (entry.number) return entry.number(*this);
  if (entry.integer) return static_cast<double>(entry.integer(*this));
  return values_.numbers[static_cast<std::size_t>(feature)][slot(entry)];
}

double FeatureState::selected_number(std::string_view name, int entry) const {
  return values_.numbers[static_cast<std::size_t>(index(name))][static_cast<std::size_t>(entry)];
}

std::int64_t FeatureState::integer(int feature) const {
  const Feature& entry = features_[static_cast<std::size_t>(feature)];
  return entry.integer ? entry.integer(*this) : std::llround(number(feature));
}

std::string FeatureState::text(int feature) const {
  const Feature& entry = features_[static_cast<std::size_t>(feature)];
  return entry.text ? entry.text(*this) : values_.texts[static_cast<std::size_t>(feature)];
}

int FeatureState::entry_position(std::string_view name) const {
  const int feature = index(name);
  const auto& entries = features_[static_cast<std::size_t>(feature)].declaration.entries;
  const std::int64_t value = integer(feature);
  for (std::size_t i = 0; i < entries.size(); ++i)
    if (entries[i].value == value) return static_cast<int>(i);
  throw Error(name, "its value is none of its entries");
}

bool FeatureState::is(std::string_view name, std::string_view entry) const {
  const auto& entries = features_[static_cast<std::size_t>(index(name))].declaration.entries;
  return entries[static_cast<std::size_t>(entry_position(name))].name == entry;
}

FeatureRange FeatureState::range(int feature) const {
  const Feature& entry = features_[static_cast<std::size_t>(feature)];
  if (entry.range) return entry.range(*this);
  const FeatureDeclaration& declaration = entry.declaration;
  const double step = declaration.type == FeatureType::integer ? 1 : 0;
  return {declaration.minimum, declaration.maximum, declaration.increment > 0 ? declaration.increment : step};
}

std::uint64_t FeatureState::entries(int feature) const {
  const Feature& entry = features_[static_cast<std::size_t>(feature)];
  if (entry.entries) return entry.entries(*this);
  return ~std::uint64_t{0} >> (64 - entry.declaration.entries.size());
}

bool FeatureState::locked(int feature) const {
  const Feature& entry = features_[static_cast<std::size_t>(feature)];
  return (entry.declaration.locked_while_acquiring && parameters_locked()) ||
         (entry.locked && entry.locked(*this));
}

RegisterStatus FeatureState::set_number(int feature, double value) {
  const Feature& entry = features_[static_cast<std::size_t>(feature)];
  const FeatureDeclaration& declaration = entry.declaration;
  if (declaration.access == Access::read_only) return RegisterStatus::write_protect;
  if (locked(feature)) return RegisterStatus::access_denied;
  switch (declaration.type) {
    case FeatureType::enumeration: {
      const auto found =
          std::find_if(declaration.entries.begin(), declaration.entries.end(),
                       [&](const EnumEntry& e) { return static_cast<double>(e.value) == value; });
      if (found == declaration.entries.end()) return RegisterStatus::invalid_parameter;
      if (!(entries(feature) >> (found - declaration.entries.begin()) & 1))
        return RegisterStatus::invalid_parameter;
      break;
    }
    case FeatureType::boolean:
      if (value != 0 && value != 1) return RegisterStatus::invalid_parameter;
      break;
    case FeatureType::integer:
    case FeatureType::floating: {
      const FeatureRange allowed = range(feature);
      if (!(value >= allowed.minimum && value <= allowed.maximum)) return RegisterStatus::invalid_parameter;
      if (declaration.type == FeatureType::integer && allowed.increment > 1 &&
          std::fmod(value - allowed.minimum, allowed.increment) != 0)
        return RegisterStatus::invalid_parameter;
      break;
    }
    default:
      return RegisterStatus::invalid_parameter;
  }
  if (entry.written) value = entry.written(*this, value);
  if (std::isnan(value)) return RegisterStatus::invalid_parameter;
  values_.numbers[static_cast<std::size_t>(feature)][slot(entry)] = value;
  normalise();
  return RegisterStatus::ok;
}

RegisterStatus FeatureState::set_text(int feature, std::string_view value) {
  const Feature& entry = features_[static_cast<std::size_t>(feature)];
  if (entry.declaration.access == Access::read_only) return RegisterStatus::write_protect;
  if (locked(feature)) return RegisterStatus::access_denied;
  value = value.substr(0, value.find('\0'));
  if (value.size() > static_cast<std::size_t>(entry.declaration.string_length))
    return RegisterStatus::invalid_parameter;
  values_.texts[static_cast<std::size_t>(feature)] = value;
  return RegisterStatus::ok;
}

void FeatureState::store(std::string_view name, double value) {
  const auto feature = static_cast<std::size_t>(index(name));
  values_.numbers[feature][slot(features_[feature])] = value;
}

// Brings stored values back into the bounds that other values set. Bounds depend on features further up the
// table or, in pairs (Width and OffsetX), on each other; two passes settle both.
void FeatureState::normalise() {
  for (int pass = 0; pass < 2; ++pass) {
    for (std::size_t i = 0; i < features_.size(); ++i) {
      const Feature& feature = features_[i];
      if (feature.computed()) continue;
      double& value = values_.numbers[i][slot(feature)];
      if (feature.range) {
        const FeatureRange allowed = feature.range(*this);
        double inside = std::clamp(value, allowed.minimum, std::max(allowed.minimum, allowed.maximum));
        if (feature.declaration.type == FeatureType::integer && allowed.increment > 1)
          inside = allowed.minimum +
                   std::floor((inside - allowed.minimum) / allowed.increment) * allowed.increment;
        value = inside;
      } else if (feature.entries) {
        const std::uint64_t mask = feature.entries(*this);
        const auto& entries = feature.declaration.entries;
        std::size_t first = entries.size();
        bool allowed = false;
        for (std::size_t e = 0; e < entries.size(); ++e) {
          if (!(mask >> e & 1)) continue;
          if (first == entries.size()) first = e;
          allowed = allowed || static_cast<double>(entries[e].value) == value;
        }
        if (!allowed && first < entries.size()) value = static_cast<double>(entries[first].value);
      }
    }
  }
}

CameraSettings FeatureState::settings_without_interval() const {
  CameraSettings settings = model_.power_up;
  // A value that was never touched is passed on as the lab gave it, to the last bit.
  const double exposure_us = number("ExposureTime");
  if (exposure_us != model_.power_up.exposure_s * 1e6) settings.exposure_s = exposure_us / 1e6;
  settings.binning_x = static_cast<int>(number("BinningHorizontal"));
  settings.binning_y = static_cast<int>(number("BinningVertical"));
  settings.region.offset_x = static_cast<int>(number("OffsetX")) * settings.binning_x;
  settings.region.offset_y = static_cast<int>(number("OffsetY")) * settings.binning_y;
  settings.region.width = static_cast<int>(number("Width")) * settings.binning_x;
  settings.region.height = static_cast<int>(number("Height")) * settings.binning_y;
  settings.shutter_open = !is("ShutterMode", "Closed");
  settings.bias_counts = number("BlackLevel");
  settings.sensor_temperature_c = live.stepped_temperature_c;
  settings.overrides.clear();
  for (std::size_t i = 0; i < features_.size(); ++i) {
    const Feature& feature = features_[i];
    if (feature.override_key.empty()) continue;
    const std::vector<double>& values = values_.numbers[i];
    for (std::size_t e = 0; e < values.size(); ++e) {
      const double initial = feature.selected_defaults.empty() ? feature.declaration.default_value
                                                               : feature.selected_defaults[e];
      if (values[e] == initial) continue;
      std::string key = feature.override_key;
      if (const auto star = key.find('*'); star != std::string::npos) {
        const auto& selector = features_[static_cast<std::size_t>(index(feature.declaration.selector))];
        key.replace(star, 1, selector.declaration.entries[e].name);
      }
      settings.overrides.emplace_back(std::move(key), values[e]);
    }
  }
  std::sort(settings.overrides.begin(), settings.overrides.end());
  return model_.kind == CameraKind::emccd ? emccd_settings(*this, std::move(settings))
                                          : qcmos_settings(*this, std::move(settings));
}

FrameTiming FeatureState::timing(const CameraSettings& settings) const {
  return model_.kind == CameraKind::emccd ? emccd_timing(*this, settings) : qcmos_timing(*this, settings);
}

double FeatureState::maximum_frame_rate_hz() const {
  const CameraSettings settings = settings_without_interval();
  return 1 / timing(settings).shortest_interval_s(settings.exposure_s);
}

double FeatureState::frame_interval_s() const {
  return settings().frame_interval_s;
}

CameraSettings FeatureState::settings() const {
  CameraSettings settings = settings_without_interval();
  const double shortest = timing(settings).shortest_interval_s(settings.exposure_s);
  settings.frame_interval_s = shortest;
  const auto at_least = [&](double interval_s) {
    settings.frame_interval_s = std::max(settings.frame_interval_s, interval_s);
  };
  if (on("TriggerMode")) {
    // The edges of the simulated line are known; of other triggers only that they cannot come faster.
    const double rate = number("LineTriggerRate");
    if (is("TriggerSource", "Line0") && rate > 0) at_least(1 / rate);
  } else if (on("AcquisitionFrameRateEnable")) {
    const double rate = values_.numbers[static_cast<std::size_t>(index("AcquisitionFrameRate"))][0];
    const double given = model_.power_up.frame_interval_s;
    at_least(given > 0 && rate == 1 / given ? given : 1 / rate);
  }
  return settings;
}

PayloadLayout FeatureState::layout() const {
  PayloadLayout layout;
  layout.format = static_cast<PixelFormat>(integer(index("PixelFormat")));
  layout.width = static_cast<std::uint32_t>(number("Width"));
  layout.height = static_cast<std::uint32_t>(number("Height"));
  layout.offset_x = static_cast<std::uint32_t>(number("OffsetX"));
  layout.offset_y = static_cast<std::uint32_t>(number("OffsetY"));
  layout.chunk_mode = on("ChunkModeActive");
  const auto& selectable = features_[static_cast<std::size_t>(index("ChunkSelector"))].declaration.entries;
  for (std::size_t e = 0; e < selectable.size(); ++e)
    layout.enabled[static_cast<std::size_t>(selectable[e].value)] =
        selected_number("ChunkEnable", static_cast<int>(e)) != 0;
  layout.truth_bytes = static_cast<std::size_t>(
      features_[static_cast<std::size_t>(index("ChunkGroundTruth"))].declaration.string_length);
  return layout;
}

void FeatureState::load_user_set(int set) {
  const Values& saved = user_sets_[static_cast<std::size_t>(set)];
  for (std::size_t i = 0; i < features_.size(); ++i) {
    if (!features_[i].saved || features_[i].declaration.access != Access::read_write) continue;
    values_.numbers[i] = saved.numbers[i];
    values_.texts[i] = saved.texts[i];
  }
  normalise();
}

void FeatureState::save_user_set(int set) {
  user_sets_[static_cast<std::size_t>(set)] = values_;
}

}  // namespace atomcam
