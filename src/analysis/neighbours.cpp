// Correlation of a pixel's noise with its neighbours'.

#include <cmath>

#include "analysis/family.hpp"
#include "analysis/lanes.hpp"

namespace atomcam::analysis {
namespace {

struct Step {
  std::string_view name;
  int rows, columns;
};
constexpr Step steps[] = {{"right_1", 0, 1}, {"right_2", 0, 2},    {"right_3", 0, 3},
                          {"right_4", 0, 4}, {"down_1", 1, 0},     {"down_2", 2, 0},
                          {"down_3", 3, 0},  {"down_right", 1, 1}, {"down_left", 1, -1}};
constexpr std::size_t step_count = std::size(steps);

/// Only the nearest: nothing more is asked for under the sites. sums as in add_products, the others stay.
ATOMCAM_VECTOR_CLONES
void add_near_products(std::size_t n, const float* q, const std::ptrdiff_t* shifts, double* sums) {
  Lanes square = lanes(0), s0 = square, s1 = square, s4 = square, s5 = square, s7 = square, s8 = square;
  for (std::size_t i = 0; i < n; i += lane_count) {
    const float* p = q + i;
    const Lanes v = load(p);
    square += v * v;
    s0 += v * load(p + shifts[0]);
    s1 += v * load(p + shifts[1]);
    s4 += v * load(p + shifts[4]);
    s5 += v * load(p + shifts[5]);
    s7 += v * load(p + shifts[7]);
    s8 += v * load(p + shifts[8]);
  }
  sums[0] += total(square);
  sums[1] += total(s0), sums[2] += total(s1), sums[5] += total(s4);
  sums[6] += total(s5), sums[8] += total(s7), sums[9] += total(s8);
}

/// sums[0] += sum of q^2, sums[1 + k] += sum of q[i] q[i + shift[k]].
ATOMCAM_VECTOR_CLONES
void add_products(std::size_t n, const float* q, const std::ptrdiff_t* shifts, double* sums) {
  Lanes square = lanes(0), s0 = square, s1 = square, s2 = square, s3 = square, s4 = square, s5 = square,
        s6 = square, s7 = square, s8 = square;
  for (std::size_t i = 0; i < n; i += lane_count) {
    const float* p = q + i;
    const Lanes v = load(p);
    square += v * v;
    s0 += v * load(p + shifts[0]);
    s1 += v * load(p + shifts[1]);
    s2 += v * load(p + shifts[2]);
    s3 += v * load(p + shifts[3]);
    s4 += v * load(p + shifts[4]);
    s5 += v * load(p + shifts[5]);
    s6 += v * load(p + shifts[6]);
    s7 += v * load(p + shifts[7]);
    s8 += v * load(p + shifts[8]);
  }
  const Lanes all[] = {square, s0, s1, s2, s3, s4, s5, s6, s7, s8};
  for (std::size_t k = 0; k < 10; ++k) sums[k] += total(all[k]);
}

class Neighbours : public Family {
 public:
  explicit Neighbours(const Layout& layout)
      : layout_(layout), dark_(Numbers(1 + step_count)), all_(Numbers(1 + step_count)) {
    for (std::size_t k = 0; k < step_count; ++k)
      shifts_[k] = steps[k].rows * layout.shape.stride + steps[k].columns;
  }

  void second_look(const SecondLook& look) override {
    add_products(look.quiet.size(), look.quiet.inner(), shifts_, dark_[look.part].data());
    if (!layout_.packed.empty())
      add_near_products(look.residual.size(), look.residual.inner(), shifts_, all_[look.part].data());
  }

  void summarise(Part which, const Record&, Sheet& sheet) const override {
    sheet.family("neighbours");
    const auto put = [&](const Numbers& sums, std::string_view name) {
      for (std::size_t k = 0; k < step_count; ++k) {
        // Under the sites only the nearest.
        if (name == "all" && std::abs(steps[k].columns) + steps[k].rows > 2) continue;
        sheet.kind({steps[k].columns == 0 ? "vertical_correlation" : "horizontal_correlation", "space",
                    name == "dark" ? "dark pixels" : "whole frame"});
        sheet.put(name, steps[k].name, sums[1 + k] / sums[0]);
      }
    };
    put(dark_.of(which), "dark");
    if (!layout_.packed.empty()) put(all_.of(which), "all");
  }

 private:
  const Layout& layout_;
  Halves<Numbers> dark_, all_;
  std::ptrdiff_t shifts_[step_count];
};

}  // namespace

std::unique_ptr<Family> make_neighbours(const Layout& layout) {
  return std::make_unique<Neighbours>(layout);
}

}  // namespace atomcam::analysis
