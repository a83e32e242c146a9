#include "effects/patterns.hpp"

namespace atomcam {
namespace {

class FrameTransferSmear : public Effect {
 public:
  explicit FrameTransferSmear(const ParameterValues& values) : scale_(values[0]) {}

  void apply_to_electrons(ElectronImage& electrons, const FrameContext& context) const override {
    const CameraSettings& settings = *context.settings;
    if (!settings.frame_transfer || !settings.shutter_open || settings.exposure_s <= 0) return;
    // A row spends vertical_shift_s at the place of every row; binned rows bring the charge of all of theirs.
    const double share =
        scale_ * settings.vertical_shift_s * PlaneGeometry(context).step_y / settings.exposure_s;
    std::vector<std::int64_t> sums(static_cast<std::size_t>(electrons.columns()));
    for (int row = 0; row < electrons.rows(); ++row)
      for (int column = 0; column < electrons.columns(); ++column) sums[column] += electrons(row, column);
    for (int row = 0; row < electrons.rows(); ++row) {
      RandomStream random = context.random("row", static_cast<std::uint32_t>(row));
      for (int column = 0; column < electrons.columns(); ++column)
        if (sums[column] > 0)
          electrons(row, column) +=
              static_cast<std::int32_t>(sample_poisson(random, share * static_cast<double>(sums[column])));
    }
  }

 private:
  double scale_;
};

}  // namespace

EffectDeclaration frame_transfer_smear() {
  return {.name = "frame_transfer_smear",
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
                .maximum = 100,
                .default_value = 1,
                .scale = ParameterScale::linear,
                .meaning =
                    "Multiple of the smear that shift speed and exposure give; 1 is the camera as it is."}},
          .observables = {"column_smear", "site_histogram"},
          .emccd = true,
          .qcmos = false,
          .make = make_effect<FrameTransferSmear>};
}

}  // namespace atomcam
