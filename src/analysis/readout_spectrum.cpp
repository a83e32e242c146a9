// The two-dimensional spectrum of single frames' noise: stripes, whatever their phase in a frame.

#include <algorithm>

#include "analysis/family.hpp"
#include "analysis/fourier.hpp"
#include "analysis/spectrum_shapes.hpp"

namespace atomcam::analysis {
namespace {

struct Power {
  std::vector<float> sums;
  Power& operator+=(const Power& other) {
    for (std::size_t i = 0; i < sums.size(); ++i) sums[i] += other.sums[i];
    return *this;
  }
};

class ReadoutSpectrum : public Family {
 public:
  explicit ReadoutSpectrum(const Layout& layout)
      : layout_(layout),
        frame_(layout.shape.rows, layout.shape.columns),
        power_(Power{std::vector<float>(frame_.spectrum().size())}) {}

  void first_look(const FirstLook&) override { ++frames_; }

  void second_look(const SecondLook& look) override {
    // A sample of the frames is enough; transforms are dear.
    const std::size_t every = (frames_ + sampled_frames - 1) / sampled_frames;
    if (look.frame % every) return;
    const int columns = layout_.shape.columns;
    for (int r = 0; r < layout_.shape.rows; ++r)
      std::copy_n(look.quiet.row(r), columns,
                  frame_.image().data() + static_cast<std::ptrdiff_t>(r) * columns);
    frame_.transform();
    frame_.add_power(power_[look.part].sums);
  }

  void summarise(Part which, const Record&, Sheet& sheet) const override {
    sheet.family("readout_spectrum");
    sheet.kind({"row_spectrum", "frequency", "dark pixels"});
    put_spectrum(sheet, power_.of(which).sums, layout_.shape.rows, layout_.shape.columns);
  }

 private:
  static constexpr std::size_t sampled_frames = 60;
  const Layout& layout_;
  std::size_t frames_ = 0;
  ImageSpectrum frame_;
  Halves<Power> power_;
};

}  // namespace

std::unique_ptr<Family> make_readout_spectrum(const Layout& layout) {
  return std::make_unique<ReadoutSpectrum>(layout);
}

}  // namespace atomcam::analysis
