#include "camera/camera.hpp"

#include <fmt/format.h>

#include <cmath>
#include <cstring>
#include <mutex>

#include "base/error.hpp"
#include "camera/acquisition.hpp"
#include "camera/big_endian.hpp"
#include "camera/feature_state.hpp"
#include "camera/genicam_xml.hpp"
#include "camera/register_map.hpp"

namespace atomcam {

namespace {

class RegisterCamera final : public Camera {
 public:
  RegisterCamera(CameraModel model, std::shared_ptr<FrameSource> source,
                 const std::vector<SourceControl>& controls)
      : state_(model, make_features(model, *source, controls)),
        map_(state_.features()),
        thermal_(model.power_up.sensor_temperature_c),
        acquisition_(std::move(source), model.render_threads) {
    update();
  }

  // TransportCamera
  Identity identity() const override {
    const std::lock_guard lock(mutex_);
    const CameraModel& model = state_.model();
    return {model.vendor,       model.model,  model.version,
            "simulated camera", model.serial, state_.text(state_.index("DeviceUserID"))};
  }
  void set_user_name(const std::string& name) override {
    const std::lock_guard lock(mutex_);
    state_.set_text(state_.index("DeviceUserID"), name.substr(0, 16));
  }
  RegisterStatus read(std::uint32_t address, std::span<std::uint8_t> bytes) override {
    const std::lock_guard lock(mutex_);
    refresh();
    return map_.read(state_, address, bytes);
  }
  RegisterStatus write(std::uint32_t address, std::span<const std::uint8_t> bytes) override {
    const std::lock_guard lock(mutex_);
    RegisterStatus status = RegisterStatus::ok;
    const FeatureRegister* hit = map_.writable(address, bytes.size(), status);
    if (hit == nullptr) return status;
    switch (declaration(hit->feature).type) {
      case FeatureType::string:
        return set_text(hit->feature, {reinterpret_cast<const char*>(bytes.data()), bytes.size()});
      case FeatureType::floating:
        return set_number(hit->feature, load_big_endian<double>(bytes.data()));
      case FeatureType::integer: {
        const auto value = load_big_endian<std::int64_t>(bytes.data());
        constexpr auto exact = std::int64_t{1} << 53;  // as a double
        if (value > exact || value < -exact) return RegisterStatus::invalid_parameter;
        return set_number(hit->feature, static_cast<double>(value));
      }
      case FeatureType::boolean:
      case FeatureType::enumeration:
        return set_number(hit->feature, load_big_endian<std::int32_t>(bytes.data()));
      case FeatureType::command:
        return load_big_endian<std::int32_t>(bytes.data()) == 0 ? RegisterStatus::ok : run(hit->feature);
    }
    return RegisterStatus::invalid_address;
  }
  std::string genicam_xml(std::span<const FeatureDeclaration> transport_features) const override {
    // Declarations and addresses never change: no lock.
    return atomcam::genicam_xml(state_.model(), state_.features(), map_, transport_features);
  }
  void attach(FrameSink* sink) override { acquisition_.attach(sink); }
  void stop_acquisition() override {
    const std::lock_guard lock(mutex_);
    acquisition_.stop();
    state_.store("TLParamsLocked", 0);
    update();
  }
  std::uint64_t timestamp_ns() const override { return acquisition_.clock_ns(); }
  void reset_timestamp() override { acquisition_.reset_clock(); }
  void fire_action(int signal) override { acquisition_.action(signal); }
  void report_lost(std::uint64_t frame_id) override { acquisition_.report_lost(frame_id); }

  // Camera
  FeatureValue get(std::string_view name) override {
    const std::lock_guard lock(mutex_);
    refresh();
    const int feature = state_.index(name);
    const FeatureDeclaration& d = declaration(feature);
    if (d.chunk_id != 0) throw Error(name, "is told by the chunks of a frame");
    switch (d.type) {
      case FeatureType::integer:
        return state_.integer(feature);
      case FeatureType::floating:
        return state_.number(feature);
      case FeatureType::boolean:
        return state_.number(feature) != 0;
      case FeatureType::enumeration:
        return d.entries[static_cast<std::size_t>(state_.entry_position(name))].name;
      case FeatureType::string:
        return state_.text(feature);
      case FeatureType::command:
        break;
    }
    throw Error(name, "is a command and has no value");
  }
  void set(std::string_view name, const FeatureValue& value) override {
    const std::lock_guard lock(mutex_);
    refresh();
    const int feature = state_.index(name);
    const FeatureDeclaration& d = declaration(feature);
    if (d.type == FeatureType::command) throw Error(name, "is a command and has no value");
    if (d.type == FeatureType::string) {
      const auto* text = std::get_if<std::string>(&value);
      if (text == nullptr) throw Error(name, "takes text");
      return check(feature, set_text(feature, *text), *text);
    }
    if (const auto* text = std::get_if<std::string>(&value)) {
      if (d.type != FeatureType::enumeration)
        throw Error(name, fmt::format("takes a number, not '{}'", *text));
      std::vector<std::string> names;
      for (const EnumEntry& entry : d.entries) {
        if (entry.name == *text)
          return check(feature, set_number(feature, static_cast<double>(entry.value)), *text);
        names.push_back(entry.name);
      }
      throw_unknown(name, "entry", *text, names);
    }
    const double number = std::visit(
        [](const auto& v) {
          if constexpr (std::is_same_v<std::decay_t<decltype(v)>, std::string>)
            return 0.0;
          else
            return static_cast<double>(v);
        },
        value);
    if (d.type == FeatureType::integer && number != std::floor(number))
      throw Error(name, fmt::format("{} is no whole number", number));
    check(feature, set_number(feature, number), fmt::format("{}", number));
  }
  void execute(std::string_view name) override {
    const std::lock_guard lock(mutex_);
    refresh();
    const int feature = state_.index(name);
    if (declaration(feature).type != FeatureType::command) throw Error(name, "is no command");
    check(feature, run(feature), "the command");
  }
  FeatureRange range(std::string_view name) override {
    const std::lock_guard lock(mutex_);
    refresh();
    return state_.range(state_.index(name));
  }
  std::vector<FeatureDeclaration> features() const override {
    std::vector<FeatureDeclaration> declarations;
    for (std::size_t i = 0; i < state_.features().size(); ++i) {
      FeatureDeclaration d = state_.features()[i].declaration;
      d.length = value_length(d);
      if (d.chunk_id == 0) d.address = map_.address(static_cast<int>(i), RegisterPart::value);
      declarations.push_back(std::move(d));
    }
    return declarations;
  }
  CameraSettings settings() const override {
    const std::lock_guard lock(mutex_);
    refresh();
    return state_.settings();
  }
  Statistics statistics() const override { return acquisition_.statistics(); }

 private:
  const FeatureDeclaration& declaration(int feature) const {
    return state_.features()[static_cast<std::size_t>(feature)].declaration;
  }

  // Brings what the running camera tells into the state.
  void refresh() const {
    acquisition_.fill(state_.live);
    const double time_s = acquisition_.seconds_open();
    state_.live.temperature_c = thermal_.at(time_s);
    state_.live.stepped_temperature_c = thermal_.stepped(time_s);
    state_.live.temperature_stable = thermal_.stable(time_s);
  }

  // Tells the acquisition what the features say now.
  void update() {
    const double time_s = acquisition_.seconds_open();
    if (const double target = cooling_target_c(state_); target != thermal_.target_c())
      thermal_.set_target(time_s, target);
    if (const double constant = state_.number("SimCoolingTimeConstant");
        constant != thermal_time_constant_s_) {
      thermal_time_constant_s_ = constant;
      thermal_.set_time_constant(time_s, constant);
    }
    refresh();
    ExposurePlan plan;
    plan.settings = state_.settings();
    plan.settings.sensor_temperature_c = 0;  // the thermal model's, when the exposure starts
    plan.layout = state_.layout();
    plan.timing = state_.timing();
    if (state_.has("Amplifier") && !state_.is("Amplifier", "Conventional"))
      plan.chunk_gain = plan.settings.em_gain;
    plan.thermal = thermal_;
    plan.seed = state_.integer(state_.index("SimulationSeed"));
    if (state_.on("TriggerMode")) {
      const auto source = static_cast<int>(state_.number("TriggerSource"));
      plan.trigger = source == 0   ? ExposurePlan::Trigger::software
                     : source == 1 ? ExposurePlan::Trigger::line
                                   : ExposurePlan::Trigger::action;
      plan.action_signal = source - 2;
    }
    plan.trigger_delay_s = state_.number("TriggerDelay") / 1e6;
    plan.trigger_overlap = state_.on("TriggerOverlap");
    plan.line_rate_hz = state_.number("LineTriggerRate");
    plan.line_inverted = state_.selected_number("LineInverter", 0) != 0;
    plan.falling_edge = state_.on("TriggerActivation");
    plan.notify_exposure_end = state_.selected_number("EventNotification", 0) != 0;
    plan.notify_lost = state_.selected_number("EventNotification", 1) != 0;
    acquisition_.configure(plan);
  }

  RegisterStatus set_number(int feature, double value) {
    refresh();
    const RegisterStatus status = state_.set_number(feature, value);
    if (status == RegisterStatus::ok) update();
    return status;
  }
  RegisterStatus set_text(int feature, std::string_view text) {
    refresh();
    return state_.set_text(feature, text);
  }

  RegisterStatus run(int feature) {
    refresh();
    const std::string& name = declaration(feature).name;
    if (state_.locked(feature)) return RegisterStatus::access_denied;
    if (name == "AcquisitionStart") {
      const auto count = static_cast<std::uint64_t>(state_.number("AcquisitionFrameCount"));
      acquisition_.start(state_.is("AcquisitionMode", "SingleFrame")  ? 1
                         : state_.is("AcquisitionMode", "MultiFrame") ? count
                                                                      : 0);
    } else if (name == "AcquisitionStop" || name == "AcquisitionAbort") {
      acquisition_.stop();
    } else if (name == "TriggerSoftware") {
      acquisition_.software_trigger();
    } else if (name == "TimestampLatch") {
      state_.live.timestamp_latch_ns = acquisition_.clock_ns();
    } else if (name == "TimestampReset") {
      acquisition_.reset_clock();
    } else if (name == "UserSetLoad") {
      state_.load_user_set(static_cast<int>(state_.number("UserSetSelector")));
      update();
    } else if (name == "UserSetSave") {
      state_.save_user_set(static_cast<int>(state_.number("UserSetSelector")));
    } else {
      return RegisterStatus::invalid_address;
    }
    return RegisterStatus::ok;
  }

  void check(int feature, RegisterStatus status, const std::string& value) const {
    const FeatureDeclaration& d = declaration(feature);
    switch (status) {
      case RegisterStatus::ok:
        return;
      case RegisterStatus::write_protect:
        throw Error(d.name, "is read-only");
      case RegisterStatus::access_denied:
        throw Error(d.name, fmt::format("{} is refused{}", value,
                                        state_.live.acquiring ? " while the camera acquires"
                                                              : " in the present mode"));
      default:
        break;
    }
    if (d.type == FeatureType::integer || d.type == FeatureType::floating) {
      const FeatureRange allowed = state_.range(feature);
      throw Error(d.name,
                  fmt::format("{} is not allowed: {} to {}{}{}", value, allowed.minimum, allowed.maximum,
                              allowed.increment > 0 ? fmt::format(" in steps of {}", allowed.increment) : "",
                              d.unit.empty() ? "" : " " + d.unit));
    }
    throw Error(d.name, fmt::format("{} is not allowed in the present mode", value));
  }

  mutable std::mutex mutex_;  // before the acquisition's
  mutable FeatureState state_;
  RegisterMap map_;
  ThermalModel thermal_;
  double thermal_time_constant_s_ = 20;
  Acquisition acquisition_;
};

}  // namespace

std::unique_ptr<Camera> Camera::open(CameraModel model, std::shared_ptr<FrameSource> source,
                                     std::vector<SourceControl> controls) {
  if (source == nullptr) throw Error("camera", "needs a source of frames");
  if (model.readout_modes.empty()) throw Error(model.model, "needs at least one readout mode");
  return std::make_unique<RegisterCamera>(std::move(model), std::move(source), controls);
}

}  // namespace atomcam
