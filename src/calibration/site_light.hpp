#pragma once
// A frame split into the light of its sites and what is left over.

#include <span>
#include <vector>

#include "analysis/stack_model.hpp"

namespace atomcam {

/// Per pixel and electron of every site's light, what falls outside of the sites' stamps. It comes from many
/// sites: its mean is as good as itself. All 0 for a model without its sites' light.
std::vector<double> light_beyond_stamps(const StackModel& model);

class SiteLight {
 public:
  /// Refers to `model`. With the shutter closed there are no sites and no stray light.
  explicit SiteLight(const StackModel& model, bool shutter_open = true);
  void split(const CountImage& frame);
  /// Of the last frame: electrons of each site, in the model's order.
  std::span<const double> brightness_e() const { return brightness_; }
  /// Of the last frame: counts above the expected level, the sites' light taken off.
  std::span<const double> rest_counts() const { return rest_; }
  /// Light expected at a pixel from all sites, an atom at every one of them, electrons.
  double lit_e(std::size_t pixel) const;

 private:
  const StackModel& model_;
  bool open_;
  std::vector<double> level_, rest_, brightness_;
};

/// The mean of many sites' images on a grid finer than the pixels: each pixel of an image falls to the cell
/// of its distance from its site. Cells that no pixel hits are NaN.
struct FoldedSite {
  int oversampling = 1;
  Image<double, unit::counts> mean;  // square, the site in its middle
};
/// `image` per pixel, in any unit; up to `radius_px` from each site.
FoldedSite fold_sites(const StackModel& model, std::span<const double> image, int radius_px);

}  // namespace atomcam
