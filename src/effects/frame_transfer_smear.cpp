#include "effects/patterns.hpp"

namespace atomcam {
namespace {

class FrameTransferSmear : public Effect {
 public:
  explicit FrameTransferSmear(const ParameterValues& values)
      : scale_(values[0]), above_(std::min(1.0, 1 - values[1])), below_(std::min(1.0, 1 + values[1])) {}

  /// The light goes on during the shift: photons of their own, not the ones that the exposure has collected.
  void apply_to_light(LightField& light, const FrameContext& context) const override {
    const CameraSettings& settings = *context.settings;
    if (!settings.frame_transfer || settings.pulsed_light || settings.exposure_s <= 0) return;
    // A row spends vertical_shift_s at the place of every row; binned rows bring the charge of all of theirs.
    // On its way in it passes the places on one side, on its way out those on the other.
    const double share =
        scale_ * settings.vertical_shift_s * PlaneGeometry(context).step_y / settings.exposure_s;
    light.smear_from_above = above_ * share;
    light.smear_from_below = below_ * share;
  }

 private:
  double scale_, above_, below_;
};

}  // namespace

EffectDeclaration frame_transfer_smear() {
  return {
      .name = "frame_transfer_smear",
      .plane = Plane::electrons,
      .summary =
          "Pixels pass under the light while the frame is shifted into the storage area: streaks along "
          "columns.",
      .reference =
          "Frame-transfer sensors without a shutter: row time x rows / exposure of the column's light",
      .parameters =
          {{.key = "scale",
            .unit = "1",
            .minimum = 0,
            .maximum = 10000,
            .default_value = 1,
            .scale = ParameterScale::linear,
            .meaning = "Multiple of the smear that shift speed and exposure give; 1 is the camera as it is."},
           {.key = "asymmetry",
            .unit = "1",
            .minimum = -1,
            .maximum = 1,
            .default_value = 0,
            .scale = ParameterScale::linear,
            .meaning = "Streaks to one side: 1 has none from the rows above (of lower number), as where rows "
                       "are cleared in the dark before an exposure; -1 none from those below."}},
      .observables = {"column_smear", "site_histogram"},
      .emccd = true,
      .qcmos = false,
      .acts_on_light = true,
      .make = make_effect<FrameTransferSmear>};
}

}  // namespace atomcam
