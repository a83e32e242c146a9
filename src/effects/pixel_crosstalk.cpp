#include "effects/patterns.hpp"

namespace atomcam {
namespace {

class PixelCrosstalk : public Effect {
 public:
  explicit PixelCrosstalk(const ParameterValues& values)
      : fraction_(values[0]), coupled_(values[1]), noise_(values[2]) {}

  void apply_to_electrons(ElectronImage& electrons, const FrameContext& context) const override {
    const double diffusing = couples(context) ? fraction_ * (1 - coupled_) : fraction_;
    if (diffusing == 0) return;
    const BinomialLaw leaves(diffusing);
    static const BinomialLaw goes_here[] = {BinomialLaw(1.0 / 4), BinomialLaw(1.0 / 3), BinomialLaw(1.0 / 2),
                                            BinomialLaw(1)};
    const int rows = electrons.rows(), columns = electrons.columns();
    // Charge leaves from what a row held before any arrived.
    std::vector<std::int32_t> before, next;
    const auto copy_of = [&](int row) {
      const auto pixels = electrons.row(std::min(row, rows - 1));
      return std::vector<std::int32_t>(pixels.begin(), pixels.end());
    };
    if (rows > 0) next = copy_of(0);
    for (int row = 0; row < rows; ++row) {
      before = std::move(next);
      next = copy_of(row + 1);
      RandomStream random = context.random("row", static_cast<std::uint32_t>(row));
      for (int column = 0; column < columns; ++column) {
        const std::int64_t held = before[static_cast<std::size_t>(column)];
        if (held <= 0) continue;
        std::int64_t leaving = leaves(random, held);
        if (leaving == 0) continue;
        electrons(row, column) -= static_cast<std::int32_t>(leaving);
        constexpr int step_x[] = {1, -1, 0, 0}, step_y[] = {0, 0, 1, -1};
        for (int side = 0; side < 4 && leaving > 0; ++side) {
          const std::int64_t here = goes_here[side](random, leaving);
          leaving -= here;
          // At the edge of the plane the neighbour is the pixel itself: no charge is lost.
          const int r = std::clamp(row + step_y[side], 0, rows - 1);
          const int c = std::clamp(column + step_x[side], 0, columns - 1);
          electrons(r, c) += static_cast<std::int32_t>(here);
        }
      }
    }
  }

  /// Every pixel's voltage drags its neighbours' along: shot noise and all, so that neighbours correlate;
  /// what couples behind the amplifiers, their noise as well.
  void apply_to_voltages(int row, std::span<float> output_e, const ElectronImage& held,
                         const Sensor::Readout& readout, const FrameContext& context) const override {
    if (!couples(context)) return;
    const auto part = static_cast<float>(fraction_ * coupled_), noise_part = static_cast<float>(noise_);
    const int rows = held.rows();
    const auto columns = static_cast<std::size_t>(held.columns());
    thread_local std::vector<float> around[3];  // the row above, this one, the row below
    for (int k = 0; k < 3; ++k) {
      const int at = std::clamp(row + k - 1, 0, rows - 1);
      std::vector<float>& seen = around[k];
      seen.assign(columns, 0);
      if (noise_ > 0) readout.read_noise(at, seen);
      for (std::size_t c = 0; c < columns; ++c)
        seen[c] = noise_part * seen[c] + static_cast<float>(held(at, static_cast<int>(c)));
    }
    const auto& [above, own, below] = around;
    for (std::size_t c = 0; c < columns; ++c) {
      const float left = own[c > 0 ? c - 1 : 0], right = own[std::min(columns - 1, c + 1)];
      output_e[c] += part * (0.25f * (above[c] + below[c] + left + right) - own[c]);
    }
  }

 private:
  /// A CCD's charge leaves its pixel before it becomes a voltage.
  bool couples(const FrameContext& context) const {
    return coupled_ > 0 && context.sensor->kind() == CameraKind::qcmos;
  }

  double fraction_;
  double coupled_;
  double noise_;
};

}  // namespace

EffectDeclaration pixel_crosstalk() {
  return {
      .name = "pixel_crosstalk",
      .plane = Plane::electrons,
      .summary = "Charge diffuses into the four neighbouring pixels, or their voltages couple.",
      .reference = "Charge diffusion in back-illuminated sensors: 0.5-3 %; interpixel capacitance (CMOS)",
      .parameters =
          {{.key = "fraction",
            .unit = "1",
            .minimum = 0,
            .maximum = 0.5,
            .default_value = 0.02,
            .scale = ParameterScale::linear,
            .meaning = "Part of the light that shows up in the neighbours, a quarter on each side."},
           {.key = "coupled_share",
            .unit = "1",
            .minimum = 0,
            .maximum = 1,
            .default_value = 0,
            .scale = ParameterScale::linear,
            .meaning = "Share that the pixels' capacitance couples after the shot noise, which correlates "
                       "neighbours; the rest diffuses as charge. A qCMOS only: a CCD's is all charge."},
           {.key = "noise_share",
            .unit = "1",
            .minimum = 0,
            .maximum = 1,
            .default_value = 0,
            .scale = ParameterScale::linear,
            .meaning = "Share of the coupling that is behind the pixels' amplifiers: the read noise couples "
                       "as well."}},
      .observables = {"point_spread_width"},
      .emccd = true,
      .qcmos = true,
      .make = make_effect<PixelCrosstalk>};
}

}  // namespace atomcam
