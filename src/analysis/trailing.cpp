// What follows a bright pixel: in the columns after it along the readout, in the rows, in the next frames.

#include <cmath>

#include "analysis/family.hpp"
#include "analysis/lanes.hpp"

namespace atomcam::analysis {
namespace {

constexpr int column_distances[] = {1, 2, 3, 5};
constexpr int row_distances[] = {1, 2};

/// How much a pixel stands out, from the given scale on; else zero.
ATOMCAM_VECTOR_CLONES
double drivers(std::size_t n, const float* scaled, float from, float cap, float* drive) {
  const Lanes most = lanes(cap), least = lanes(from);
  Lanes sum = lanes(0);
  for (std::size_t i = 0; i < n; i += lane_count) {
    const Lanes x = load(scaled + i), d = where_above(x, least, smaller(x, most));
    store(drive + i, d);
    sum += d;
  }
  return total(sum);
}

/// sums[k] += sum of d[i] (q[i + shift[k]] - q[i - shift[k]]).
ATOMCAM_VECTOR_CLONES
void add_differences(std::size_t n, const float* drive, const float* q, const std::ptrdiff_t* shifts,
                     double* sums) {
  Lanes s0 = lanes(0), s1 = s0, s2 = s0, s3 = s0, s4 = s0, s5 = s0;
  for (std::size_t i = 0; i < n; i += lane_count) {
    const Lanes d = load(drive + i);
    const float* p = q + i;
    s0 += d * (load(p + shifts[0]) - load(p - shifts[0]));
    s1 += d * (load(p + shifts[1]) - load(p - shifts[1]));
    s2 += d * (load(p + shifts[2]) - load(p - shifts[2]));
    s3 += d * (load(p + shifts[3]) - load(p - shifts[3]));
    s4 += d * (load(p + shifts[4]) - load(p - shifts[4]));
    s5 += d * (load(p + shifts[5]) - load(p - shifts[5]));
  }
  const Lanes all[] = {s0, s1, s2, s3, s4, s5};
  for (std::size_t k = 0; k < 6; ++k) sums[k] += total(all[k]);
}

/// Sum of drive[i] q[i], and of drive[i].
ATOMCAM_VECTOR_CLONES
void add_later(std::size_t n, const float* scaled_before, float from, float cap, const float* q,
               double* sums) {
  const Lanes most = lanes(cap), least = lanes(from);
  Lanes product = lanes(0), sum = product;
  for (std::size_t i = 0; i < n; i += lane_count) {
    const Lanes x = load(scaled_before + i), d = where_above(x, least, smaller(x, most));
    product += d * load(q + i);
    sum += d;
  }
  sums[0] += total(product);
  sums[1] += total(sum);
}

class Trailing : public Family {
 public:
  explicit Trailing(const Layout& layout) : layout_(layout), drive_(layout.shape), sums_(Numbers(11)) {
    std::size_t k = 0;
    for (const int d : column_distances) shifts_[k++] = d;
    for (const int d : row_distances) shifts_[k++] = d * layout.shape.stride;
  }

  void second_look(const SecondLook& look) override {
    Numbers& sums = sums_[look.part];
    const std::size_t n = look.scaled.size();
    sums[6] += drivers(n, look.scaled.inner(), from, layout_.drive_cap, drive_.inner());
    add_differences(n, drive_.inner(), look.quiet.inner(), shifts_, sums.data());
    if (look.scaled_before)
      add_later(n, look.scaled_before->inner(), from, layout_.drive_cap, look.residual.inner(), &sums[7]);
    if (look.scaled_before_that)
      add_later(n, look.scaled_before_that->inner(), from, layout_.drive_cap, look.residual.inner(),
                &sums[9]);
  }

  void summarise(Part which, const Record&, Sheet& sheet) const override {
    sheet.family("trailing");
    const Numbers sums = sums_.of(which);
    // As if a few drivers more had been seen without a trail: no jumps where drivers are rare.
    const double few = 100;
    std::size_t k = 0;
    constexpr std::string_view names[] = {"right_1", "right_2", "right_3", "right_5", "down_1", "down_2"};
    for (const std::string_view name : names) {
      sheet.kind({"trailing_charge", "space", k < 4 ? "columns" : "rows"});
      sheet.put(name, sums[6] > 0 ? sums[k] / std::sqrt(sums[6] + few) : not_a_number);
      ++k;
    }
    sheet.kind({"lag_correlation", "time", "whole frame"});
    sheet.put("next_frame", sums[8] > 0 ? sums[7] / std::sqrt(sums[8] + few) : not_a_number);
    sheet.put("second_next_frame", sums[10] > 0 ? sums[9] / std::sqrt(sums[10] + few) : not_a_number);
  }

 private:
  static constexpr float from = 5;
  const Layout& layout_;
  Plane drive_;
  Halves<Numbers> sums_;
  std::ptrdiff_t shifts_[6];
};

}  // namespace

std::unique_ptr<Family> make_trailing(const Layout& layout) {
  return std::make_unique<Trailing>(layout);
}

}  // namespace atomcam::analysis
