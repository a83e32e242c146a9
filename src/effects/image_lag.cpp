#include "effects/patterns.hpp"

namespace atomcam {
namespace {

class ImageLag : public Effect {
 public:
  explicit ImageLag(const ParameterValues& values) : fraction_(values[0]), frames_(values[1]) {}

  void apply_to_electrons(ElectronImage& electrons, const FrameContext& context) const override {
    // The earlier frames are taken as they would be under the present settings: after a change the first
    // frame's lag is that of the new settings.
    double share = fraction_;
    for (std::uint64_t back = 1; back <= static_cast<std::uint64_t>(frames_) && back <= context.frame;
         ++back) {
      const ElectronImage earlier = (*context.electrons_of)(context.frame - back);
      if (earlier.empty()) return;
      const BinomialLaw law(share);
      for (int row = 0; row < electrons.rows(); ++row) {
        RandomStream random =
            context.random("row", static_cast<std::uint32_t>(row) * 4 + static_cast<std::uint32_t>(back - 1));
        for (int column = 0; column < electrons.columns(); ++column)
          if (earlier(row, column) > 0)
            electrons(row, column) += static_cast<std::int32_t>(law(random, earlier(row, column)));
      }
      share *= fraction_;
    }
  }

 private:
  double fraction_;
  double frames_;
};

}  // namespace

EffectDeclaration image_lag() {
  return {.name = "image_lag",
          .plane = Plane::electrons,
          .summary = "A part of the last frames' charge shows up again.",
          .reference = "Incomplete charge transfer and persistence; below 1e-4 to several per cent",
          .parameters = {{.key = "fraction",
                          .unit = "1",
                          .minimum = 0,
                          .maximum = 0.5,
                          .default_value = 0.02,
                          .scale = ParameterScale::linear,
                          .meaning = "Charge of the frame before that is seen again; of the one before that "
                                     "its square, and so on."},
                         {.key = "frames",
                          .unit = "frames",
                          .minimum = 1,
                          .maximum = 4,
                          .default_value = 1,
                          .scale = ParameterScale::linear,
                          .meaning = "How many earlier frames are remembered."}},
          .observables = {"lag_correlation", "site_histogram"},
          .emccd = true,
          .qcmos = true,
          .make = make_effect<ImageLag>};
}

}  // namespace atomcam
