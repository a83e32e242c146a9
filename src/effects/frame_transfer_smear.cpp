#include "effects/patterns.hpp"

namespace atomcam {
namespace {

constexpr double most_electrons = 1e9;  // of a pixel's smear: far beyond any full well, within its integer

class FrameTransferSmear : public Effect {
 public:
  explicit FrameTransferSmear(const ParameterValues& values)
      : scale_(values[0]), above_(std::min(1.0, 1 - values[1])), below_(std::min(1.0, 1 + values[1])) {}

  void apply_to_electrons(ElectronImage& electrons, const FrameContext& context) const override {
    const CameraSettings& settings = *context.settings;
    if (!settings.frame_transfer || !settings.shutter_open || settings.exposure_s <= 0) return;
    // A row spends vertical_shift_s at the place of every row; binned rows bring the charge of all of theirs.
    const double share =
        scale_ * settings.vertical_shift_s * PlaneGeometry(context).step_y / settings.exposure_s;
    // On its way in a row passes the places on one side, on its way out those on the other, and its own.
    const auto columns = static_cast<std::size_t>(electrons.columns());
    std::vector<std::int64_t> above(columns), below(columns);
    for (int row = 0; row < electrons.rows(); ++row)
      for (std::size_t c = 0; c < columns; ++c) below[c] += electrons.row(row)[c];
    for (int row = 0; row < electrons.rows(); ++row) {
      RandomStream random = context.random("row", static_cast<std::uint32_t>(row));
      const auto held = electrons.row(row);
      for (std::size_t c = 0; c < columns; ++c) {
        const std::int32_t own = held[c];
        below[c] -= own;
        const double passed =
            above_ * static_cast<double>(above[c]) + below_ * static_cast<double>(below[c]) + own;
        const double smeared = std::min(share * passed, most_electrons);
        if (smeared > 0) held[c] += static_cast<std::int32_t>(sample_poisson(random, smeared));
        above[c] += own;
      }
    }
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
      .make = make_effect<FrameTransferSmear>};
}

}  // namespace atomcam
