#pragma once
// Frames seen through small patches: sums of pixels with weights drawn at random, which no model was ever
// fitted to.

#include <Eigen/Dense>
#include <cstdint>
#include <span>
#include <vector>

#include "analysis/stack_model.hpp"

namespace atomcam {

/// A view is a patch of pixel weights (unit norm). Three shapes: a spot, a piece of a row, a piece of a
/// column; of each, one with even weights and some with normal ones. What a view sees at a place is its
/// weighted sum of counts above the dark level, in standard deviations of a dark pixel, asinh of it (twice):
/// linear within the noise, a logarithm beyond.
class PatchViews {
 public:
  static constexpr int bins = 400;  // of a view's histogram
  static constexpr double bin_width = 0.06;

  PatchViews(const StackModel& model, std::uint64_t seed);

  std::size_t views() const { return views_; }
  /// Of a frame: mean and mean square of each view over its places, then means of the darkest, middle and
  /// brightest pixels.
  Eigen::Index features() const;
  /// Looks at some hundreds of places, others in the next frame. `histograms`: [view][bin], added to.
  void look(std::size_t frame_number, const CountImage& frame, Eigen::Ref<Eigen::RowVectorXd> features,
            std::span<std::uint64_t> histograms) const;

 private:
  struct Patch {
    int rows = 1, columns = 1;
    Eigen::MatrixXf weights;  // [pixel, view]
  };
  std::vector<Patch> patches_;
  std::size_t views_ = 0;
  float level_ = 0, per_count_ = 1;
};

}  // namespace atomcam
