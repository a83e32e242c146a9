#include "simulation/simulation.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <deque>
#include <functional>
#include <mutex>
#include <utility>

#include "base/error.hpp"
#include "effects/patterns.hpp"
#include "simulation/exposure.hpp"
#include "simulation/kept_electrons.hpp"
#include "simulation/landing.hpp"
#include "simulation/parallel.hpp"

namespace atomcam {
namespace {

using Overrides = std::vector<std::pair<std::string, double>>;

struct ActiveEffect {
  const EffectDeclaration* declaration;
  std::unique_ptr<Effect> effect;
};

std::shared_ptr<const Sensor> make_sensor(const Lab& lab) {
  if (const auto* emccd = std::get_if<EmccdDescription>(&lab.sensor)) return make_emccd(*emccd, lab.serial);
  return make_qcmos(std::get<QcmosDescription>(lab.sensor), lab.serial);
}

/// Line time of a rolling shutter under these settings; 0 for an EMCCD.
double line_time_s(const Lab& lab, const CameraSettings& settings) {
  const auto* qcmos = std::get_if<QcmosDescription>(&lab.sensor);
  if (!qcmos) return 0;
  const bool slow = settings.photon_number_resolving ||
                    qcmos->readout_modes.at(settings.readout_mode).scan == ScanMode::ultra_quiet;
  return slow ? qcmos->line_time_ultra_quiet_s : qcmos->line_time_s;
}

void check(const CameraSettings& settings, const Sensor& sensor) {
  const Region& r = settings.region;
  const Shape shape = sensor.shape();
  if (settings.binning_x < 1 || settings.binning_y < 1)
    throw Error("binning", fmt::format("{} x {}, must be 1 or more", settings.binning_x, settings.binning_y));
  if (r.width < 1 || r.height < 1 || r.offset_x < 0 || r.offset_y < 0 ||
      r.offset_x + r.width > shape.columns || r.offset_y + r.height > shape.rows)
    throw Error("region", fmt::format("x {} + {}, y {} + {} does not lie within the sensor of {} x {} pixels",
                                      r.offset_x, r.width, r.offset_y, r.height, shape.columns, shape.rows));
  if (r.width % settings.binning_x != 0 || r.height % settings.binning_y != 0)
    throw Error("region", fmt::format("{} x {} is not a multiple of the binning {} x {}", r.width, r.height,
                                      settings.binning_x, settings.binning_y));
  const int modes = static_cast<int>(sensor.readout_modes().size());
  if (settings.readout_mode < 0 || settings.readout_mode >= modes)
    throw Error("readout_mode",
                fmt::format("{}, the sensor has modes 0 to {}", settings.readout_mode, modes - 1));
  if (!(settings.exposure_s >= 0))
    throw Error("exposure_s", fmt::format("{}, must be 0 or more", settings.exposure_s));
}

/// The laboratory under one set of overrides: effects made, point-spread functions at hand.
struct State {
  /// Takes from `like`, if there is one, what is dear to make and would be the same.
  State(Lab the_lab, const State* like, Overrides the_overrides)
      : lab(std::move(the_lab)),
        sensor(like && lab.sensor == like->lab.sensor && lab.serial == like->lab.serial ? like->sensor
                                                                                        : make_sensor(lab)),
        overrides(std::move(the_overrides)),
        point_spread(
            like && lab.optics == like->lab.optics &&
                    lab.scene.atom_extent_um == like->lab.scene.atom_extent_um
                ? like->point_spread
                : std::make_shared<const PointSpreadFunctions>(lab.optics, lab.scene.atom_extent_um)),
        electrons_per_photon(collected_fraction(lab.optics.numerical_aperture) * lab.optics.transmission *
                             sensor->quantum_efficiency()) {
    for (const EffectDeclaration& declaration : effect_catalogue()) {
      const auto found = lab.effects.find(declaration.name);
      if (found == lab.effects.end() || found->second.empty() || found->second.front() == 0) continue;
      if (found->second.size() != declaration.parameters.size())
        throw Error(
            "effects." + declaration.name,
            fmt::format("has {} values, must have {}", found->second.size(), declaration.parameters.size()));
      auto& list = declaration.plane == Plane::scene               ? scene_effects
                   : declaration.plane == Plane::photons           ? light_effects
                   : declaration.plane == Plane::electrons         ? electron_effects
                   : declaration.plane == Plane::electron_register ? register_effects
                                                                   : count_effects;
      list.push_back({&declaration, declaration.make(found->second)});
      if (declaration.acts_on_light) light_effects.push_back({&declaration, declaration.make(found->second)});
    }
  }

  Lab lab;
  std::shared_ptr<const Sensor> sensor;
  Overrides overrides;
  std::shared_ptr<const PointSpreadFunctions> point_spread;
  double electrons_per_photon;
  std::vector<ActiveEffect> scene_effects, light_effects, electron_effects, register_effects, count_effects;
  mutable KeptElectrons electrons;
};

/// One frame in the making.
class Exposure {
 public:
  Exposure(const State& state, const CameraSettings& settings, std::uint64_t number, int threads)
      : state_(state),
        settings_(settings),
        number_(number),
        threads_(threads),
        window_(exposure_window(settings, line_time_s(state.lab, settings))) {
    electrons_of_ = [this](std::uint64_t earlier) {
      if (const auto kept = state_.electrons.find(earlier, settings_)) return *kept;
      return Exposure(state_, settings_, earlier, threads_).electrons();
    };
    form_light();
  }

  Frame render() {
    const auto detected = expose();
    Frame frame;
    CountImage converted(readout_->plane_shape());
    read_out(converted.pixels());
    frame.counts = readout_->finish(std::move(converted));
    frame.truth = truth(detected);
    return frame;
  }

  FrameTruth render_into(std::span<std::uint16_t> counts) {
    const auto detected = expose();
    if (readout_->finishes()) {
      CountImage converted(readout_->plane_shape());
      read_out(converted.pixels());
      std::ranges::copy(readout_->finish(std::move(converted)).pixels(), counts.begin());
    } else {
      read_out(counts);
    }
    return truth(detected);
  }

  PhotonImage expected() {
    PhotonImage image({settings_.output_height(), settings_.output_width()});
    landing(settings_.binning_x, settings_.binning_y).add_expected(image);
    const double area = settings_.binning_x * settings_.binning_y;
    const auto ratio = background_ratio();
    // Maps are given in pixels of the readout plane; a digitally binned output averages them.
    const Shape plane = ratio ? ratio->shape() : image.shape();
    const int fold_x = plane.columns / image.columns(), fold_y = plane.rows / image.rows();
    for (int row = 0; row < image.rows(); ++row)
      for (int column = 0; column < image.columns(); ++column) {
        double mean = 1;
        if (ratio) {
          mean = 0;
          for (int y = 0; y < fold_y; ++y)
            for (int x = 0; x < fold_x; ++x)
              mean +=
                  static_cast<double>((*ratio)(row * fold_y + y, column * fold_x + x)) / (fold_x * fold_y);
        }
        image(row, column) += static_cast<float>(background_e() * area * mean);
      }
    return image;
  }

 private:
  FrameContext context(const ActiveEffect& active) const {
    return {.seed = state_.lab.seed,
            .frame = number_,
            .effect = active.declaration->name,
            .serial = state_.lab.serial,
            .settings = &settings_,
            .scene = &state_.lab.scene,
            .optics = &state_.lab.optics,
            .sensor = state_.sensor.get(),
            .electrons_of = &electrons_of_};
  }

  void form_light() {
    const Lab& lab = state_.lab;
    const Occupancy* given = nullptr;
    if (!lab.given_occupancies.empty()) {
      const std::uint64_t shot = number_ / static_cast<std::uint64_t>(std::max(1, lab.scene.images_per_shot));
      given = &lab.given_occupancies[shot % lab.given_occupancies.size()];
    }
    scene_ = draw_scene(lab.scene, window_.light_s(), lab.seed, number_, given);
    for (const ActiveEffect& active : state_.scene_effects)
      active.effect->apply_to_scene(scene_, context(active));
    if (!settings_.shutter_open || window_.light_s() <= 0) scene_.emitters.clear();
    light_.emitters = &scene_.emitters;
    const double lit_s = window_.pulsed ? window_.light_s() : settings_.exposure_s;
    light_.background_photons = settings_.shutter_open ? lab.stray_light_photons_per_s * lit_s : 0;
    for (const ActiveEffect& active : state_.light_effects)
      active.effect->apply_to_light(light_, context(active));
  }

  double background_e() const { return light_.background_photons * state_.sensor->quantum_efficiency(); }

  std::shared_ptr<const RatioMap> background_ratio() const {
    auto product = light_.background_ratio;
    if (light_.response_ratio) multiply(product, light_.response_ratio);
    if (light_.smears()) {
      const Shape plane = landing_on_sensor().plane();
      auto smeared = product ? std::make_shared<RatioMap>(*product) : std::make_shared<RatioMap>(plane, 1.0f);
      add_smear(smeared->pixels(), smeared->shape(), light_);
      product = std::move(smeared);
    }
    return product;
  }

  Landing landing(int binning_x, int binning_y) const {
    return {.point_spread = state_.point_spread.get(),
            .light = &light_,
            .region = settings_.region,
            .binning_x = binning_x,
            .binning_y = binning_y,
            .window = window_,
            .electrons_per_photon = state_.electrons_per_photon,
            .pixels_per_um = state_.lab.optics.magnification / state_.lab.optics.pixel_um,
            .seed = state_.lab.seed,
            .frame = number_};
  }

  /// An EMCCD bins on the chip, so its plane is already binned; a qCMOS bins numbers after conversion.
  Landing landing_on_sensor() const {
    const bool on_chip = state_.sensor->kind() == CameraKind::emccd;
    return landing(on_chip ? settings_.binning_x : 1, on_chip ? settings_.binning_y : 1);
  }

  /// Lands the light and begins the readout; electrons detected by emitter.
  std::vector<std::int64_t> expose() {
    std::vector<std::int64_t> detected(scene_.emitters.size());
    SensorLight light{.atoms = landing_on_sensor().draw(detected, threads_),
                      .background_e = background_e(),
                      .background_ratio = background_ratio()};
    light_on_sensor_ = std::move(light);
    readout_ = state_.sensor->begin(settings_, light_on_sensor_, state_.lab.seed, number_);
    return detected;
  }

  ElectronImage electrons() {
    if (!readout_) expose();
    ElectronImage image(readout_->plane_shape());
    parallel_for(image.rows(), threads_, 16, [&](int row) { readout_->collect(row, image.row(row)); });
    state_.electrons.keep(number_, settings_, image);
    return image;
  }

  /// `converted`: [row, column] of the readout's plane.
  void read_out(std::span<std::uint16_t> converted) {
    const auto [rows, columns] = readout_->plane_shape();
    const auto width = static_cast<std::size_t>(columns);
    const auto row_of = [&](int row) {
      return converted.subspan(static_cast<std::size_t>(row) * width, width);
    };
    const bool plane = !state_.electron_effects.empty();
    if (!plane && state_.register_effects.empty() && state_.count_effects.empty()) {
      parallel_for(rows, threads_, 16, [&](int row) { readout_->read_row(row, row_of(row)); });
      return;
    }
    ElectronImage collected;
    if (plane) {
      collected = electrons();
      for (const ActiveEffect& active : state_.electron_effects)
        active.effect->apply_to_electrons(collected, context(active));
    }
    parallel_for(rows, threads_, 16, [&](int row) {
      thread_local std::vector<std::int32_t> electrons;
      thread_local std::vector<float> output_e, analog_counts;
      electrons.resize(columns);
      output_e.resize(columns);
      analog_counts.resize(columns);
      if (plane)
        std::copy(collected.row(row).begin(), collected.row(row).end(), electrons.begin());
      else
        readout_->collect(row, electrons);
      readout_->multiply(row, electrons, output_e);
      for (const ActiveEffect& active : state_.electron_effects)
        active.effect->apply_to_voltages(row, output_e, collected, *readout_, context(active));
      for (const ActiveEffect& active : state_.register_effects)
        active.effect->apply_to_register(row, output_e, *readout_, context(active));
      readout_->amplify(row, output_e, analog_counts);
      for (const ActiveEffect& active : state_.count_effects)
        active.effect->apply_to_counts(row, analog_counts, context(active));
      readout_->digitise(row, analog_counts, row_of(row));
    });
  }

  FrameTruth truth(std::span<const std::int64_t> detected) const {
    FrameTruth truth{.frame = number_,
                     .seed = state_.lab.seed,
                     .shift_x_px = light_.shift_x_px,
                     .shift_y_px = light_.shift_y_px,
                     .background_e = background_e(),
                     .atoms = {}};
    truth.atoms.resize(scene_.atoms.size());
    for (std::size_t i = 0; i < scene_.atoms.size(); ++i) {
      const Atom& atom = scene_.atoms[i];
      const Site& site = state_.lab.scene.sites[i];
      truth.atoms[i] = {.site = static_cast<int>(i),
                        .x_px = site.x_px + light_.shift_x_px,
                        .y_px = site.y_px + light_.shift_y_px,
                        .present_at_start = atom.present_at_start,
                        .present_at_end = atom.present_at_end,
                        .loss_time_s = atom.loss_time_s,
                        .photons_emitted = 0};
    }
    const Landing where = landing(1, 1);
    for (std::size_t e = 0; e < scene_.emitters.size(); ++e) {
      const Emitter& emitter = scene_.emitters[e];
      if (emitter.site < 0 || emitter.site >= static_cast<int>(truth.atoms.size())) continue;
      AtomTruth& atom = truth.atoms[emitter.site];
      atom.photons_emitted += emitter.emitted();
      atom.electrons_expected += where.expected_electrons(emitter);
      atom.electrons_detected += detected[e];
    }
    return truth;
  }

  const State& state_;
  const CameraSettings& settings_;
  std::uint64_t number_;
  int threads_;
  ExposureWindow window_;
  SceneFrame scene_;
  LightField light_;
  SensorLight light_on_sensor_;
  std::unique_ptr<Sensor::Readout> readout_;
  std::function<ElectronImage(std::uint64_t)> electrons_of_;
};

}  // namespace

struct Simulation::Impl {
  Impl(Lab lab, const State* like) : base(std::make_shared<const State>(std::move(lab), like, Overrides{})) {}

  /// States are few (a client turning a knob), and each is kept while it is among the last ones used.
  std::shared_ptr<const State> state(const Overrides& overrides) {
    if (overrides.empty()) return base;
    {
      const std::lock_guard lock(mutex);
      for (const auto& kept : recent)
        if (kept->overrides == overrides) return kept;
    }
    Lab lab = base->lab;
    for (const auto& [key, value] : overrides) set_parameter(lab, key, value);
    lab.place_sites();
    auto made = std::make_shared<const State>(std::move(lab), base.get(), overrides);
    const std::lock_guard lock(mutex);
    recent.push_front(made);
    if (recent.size() > 4) recent.pop_back();
    return made;
  }

  std::shared_ptr<const State> base;
  std::mutex mutex;
  std::deque<std::shared_ptr<const State>> recent;
};

Simulation::Simulation(Lab lab) {
  lab.place_sites();
  impl_ = std::make_unique<Impl>(std::move(lab), nullptr);
}
Simulation::Simulation(Lab lab, const Simulation& previous) {
  lab.place_sites();
  impl_ = std::make_unique<Impl>(std::move(lab), previous.impl_->base.get());
}
Simulation::~Simulation() = default;

const Lab& Simulation::lab() const {
  return impl_->base->lab;
}
const Sensor& Simulation::sensor() const {
  return *impl_->base->sensor;
}

Frame Simulation::render(std::uint64_t number, const CameraSettings& settings, int threads) const {
  const auto state = impl_->state(settings.overrides);
  check(settings, *state->sensor);
  return Exposure(*state, settings, number, threads).render();
}

FrameTruth Simulation::render_into(std::span<std::uint16_t> counts, std::uint64_t number,
                                   const CameraSettings& settings, int threads) const {
  const auto state = impl_->state(settings.overrides);
  check(settings, *state->sensor);
  const Shape shape{settings.output_height(), settings.output_width()};
  if (counts.size() != shape.pixels())
    throw Error("counts", fmt::format("room for {} pixels; a frame has {} x {}", counts.size(), shape.columns,
                                      shape.rows));
  return Exposure(*state, settings, number, threads).render_into(counts);
}

PhotonImage Simulation::expected_electrons(std::uint64_t number, const CameraSettings& settings) const {
  const auto state = impl_->state(settings.overrides);
  check(settings, *state->sensor);
  return Exposure(*state, settings, number, 1).expected();
}

}  // namespace atomcam
