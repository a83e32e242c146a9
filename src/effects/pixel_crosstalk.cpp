#include "effects/patterns.hpp"

namespace atomcam {
namespace {

class PixelCrosstalk : public Effect {
 public:
  explicit PixelCrosstalk(const ParameterValues& values) : fraction_(values[0]) {}

  void apply_to_electrons(ElectronImage& electrons, const FrameContext& context) const override {
    const BinomialLaw leaves(fraction_);
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

 private:
  double fraction_;
};

}  // namespace

EffectDeclaration pixel_crosstalk() {
  return {
      .name = "pixel_crosstalk",
      .plane = Plane::electrons,
      .summary = "Charge diffuses into the four neighbouring pixels.",
      .reference = "Charge diffusion in back-illuminated sensors: 0.5-3 %",
      .parameters =
          {{.key = "fraction",
            .unit = "1",
            .minimum = 0,
            .maximum = 0.5,
            .default_value = 0.02,
            .scale = ParameterScale::linear,
            .meaning = "Probability that an electron is collected in a neighbour, a quarter on each side."}},
      .observables = {"point_spread_width"},
      .emccd = true,
      .qcmos = true,
      .make = make_effect<PixelCrosstalk>};
}

}  // namespace atomcam
