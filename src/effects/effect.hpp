#pragma once
// A physical effect beyond the plain model: one file each, two lines in catalogue.cpp. The declaration feeds
// the lab file, `atomcam effects`, the documents, the camera's features, calibration and diagnosis.

#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "base/camera_settings.hpp"
#include "base/image.hpp"
#include "base/parameter.hpp"
#include "base/random.hpp"
#include "optics/optics.hpp"
#include "scene/scene.hpp"
#include "sensor/sensor.hpp"

namespace atomcam {

/// Where an effect acts. scene -> stage "scene"; photons -> "optics"; electrons, electron_register, counts ->
/// "sensor".
enum class Plane { scene, photons, electrons, electron_register, counts };
/// "scene", "photons", "electrons", "register", "counts"
std::string_view plane_name(Plane plane);

/// What every hook knows of its frame. `random("row")` is a stream private to the effect: keyed by
/// (seed, "effects/<name>/<what>") and addressed by (frame, block).
struct FrameContext {
  std::uint64_t seed = 0;
  std::uint64_t frame = 0;
  std::string_view effect;  // name of the effect whose hook runs
  std::string_view serial;  // the sensor's serial number: fixed patterns of a sensor come from it
  const CameraSettings* settings = nullptr;
  const SceneDescription* scene = nullptr;
  const OpticsDescription* optics = nullptr;
  const Sensor* sensor = nullptr;
  /// Electrons of an earlier frame with the same settings, before any effect of the electrons plane; empty
  /// for frames before the first. For effects with memory (a fixed finite history).
  const std::function<ElectronImage(std::uint64_t frame)>* electrons_of = nullptr;

  RandomStream random(std::string_view what, std::uint32_t block = 0) const {
    return random_at(what, frame, block);
  }
  /// The same stream at another frame number, for walks that are evaluated at any n.
  RandomStream random_at(std::string_view what, std::uint64_t at_frame, std::uint32_t block = 0) const;
  /// The key of such streams, where one is used for many blocks.
  PhiloxKey key(std::string_view what) const;
  /// A pattern fixed to the sensor: depends on its serial number and the effect only.
  RandomStream fixed(std::string_view what, std::uint32_t block = 0) const;
};

/// Light on its way to the sensor. Maps are per output pixel of the readout plane.
struct LightField {
  std::vector<Emitter>* emitters = nullptr;
  double shift_x_px = 0;  // of the whole image this frame
  double shift_y_px = 0;
  double pupil_edge_loss = 0;  // of amplitude at the pupil's edge, beside its centre
  double halo_fraction = 0;    // of every atom's light, scattered into a halo
  double halo_scale_px = 0;    // its exponential radius
  /// Part of the light of every pixel of lower (higher) row, and of its own, that a pixel of the plane is
  /// under while the frame is shifted.
  double smear_from_above = 0, smear_from_below = 0;
  double background_photons = 0;                     // uniform stray light per physical pixel
  std::shared_ptr<const RatioMap> background_ratio;  // multiplies the background; null: 1
  std::shared_ptr<const RatioMap> response_ratio;    // multiplies atoms' light and background alike; null: 1

  bool smears() const { return smear_from_above > 0 || smear_from_below > 0; }
};

class Effect {
 public:
  virtual ~Effect() = default;
  /// Hooks; an effect overrides those of its plane. All are const and thread safe: state is drawn from the
  /// context.
  virtual void apply_to_scene(SceneFrame&, const FrameContext&) const {}
  virtual void apply_to_light(LightField&, const FrameContext&) const {}
  virtual void apply_to_electrons(ElectronImage&, const FrameContext&) const {}
  /// Electrons plane, after all of its effects: one row of what the pixels held, as it is read (behind the
  /// register of an EMCCD), and all that is held; the readout's noise comes on top.
  virtual void apply_to_voltages(int /*row*/, std::span<float> /*output_e*/, const ElectronImage& /*held*/,
                                 const Sensor::Readout&, const FrameContext&) const {}
  /// One row at the end of the EM register (or of the pixels, for a qCMOS), in electrons.
  virtual void apply_to_register(int /*row*/, std::span<float> /*output_e*/, const Sensor::Readout&,
                                 const FrameContext&) const {}
  /// One row of counts before rounding.
  virtual void apply_to_counts(int /*row*/, std::span<float> /*analog_counts*/, const FrameContext&) const {}
};

struct EffectDeclaration {
  std::string name;  // snake_case, the field's term
  Plane plane = Plane::scene;
  std::string summary;                           // one line
  std::string reference;                         // where the model comes from
  std::vector<ParameterDeclaration> parameters;  // the first is the strength: at zero the effect is absent
  std::vector<std::string> observables;          // names of base/observable.hpp it moves
  /// Nothing else moves these as it does: it may be named for them alone, whatever else is odd.
  bool own_law = false;
  /// Of its observables those without which it is not known: in the others it does what anything could, and
  /// it is not named for them alone.
  std::vector<std::string> known_by = {};
  bool emccd = true;  // cameras it makes sense on
  bool qcmos = true;
  bool acts_on_light = false;  // also, beside its own plane: apply_to_light
  std::unique_ptr<Effect> (*make)(const ParameterValues& values) = nullptr;

  /// Whether it makes sense on such a camera.
  bool on(CameraKind kind) const { return kind == CameraKind::emccd ? emccd : qcmos; }
  std::string_view stage() const;
};

/// Every effect, in the fixed order in which they apply within a plane.
std::span<const EffectDeclaration> effect_catalogue();
/// nullptr if unknown.
const EffectDeclaration* find_effect(std::string_view name);

}  // namespace atomcam
