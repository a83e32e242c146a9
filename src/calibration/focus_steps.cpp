#include "calibration/focus_steps.hpp"

#include <algorithm>
#include <cmath>

#include "calibration/cubic_spline.hpp"

namespace atomcam {

FocusSteps::FocusSteps(const PupilImage& image, const PupilImage& changes,
                       std::array<double, zernike_terms> zernike_um, double lowest_um, double highest_um,
                       bool derivatives)
    : lowest_(lowest_um) {
  constexpr double widest_step = 0.008;  // um: the peak is right to 0.3 %
  constexpr int most_steps = 24;
  const int steps =
      std::clamp(static_cast<int>(std::ceil((highest_um - lowest_um) / widest_step)), 0, most_steps);
  step_ = steps > 0 ? (highest_um - lowest_um) / steps : 0;
  const double middle = zernike_um[3];
  for (int k = 0; k <= steps; ++k) {
    zernike_um[3] = middle + lowest_ + k * step_;
    FineImage fine = image(zernike_um, false);
    if (derivatives) fine.by_zernike = changes(zernike_um, true).by_zernike;
    to_spline(fine.share);
    for (Eigen::ArrayXXd& change : fine.by_zernike) to_spline(change);
    images_.push_back(std::move(fine));
  }
}

const FineImage& FocusSteps::at(double defocus_um, FineImage& between) const {
  if (images_.size() == 1) return images_.front();
  const double where = std::clamp((defocus_um - lowest_) / step_, 0.0, images_.size() - 1.0);
  const std::size_t k = std::min(static_cast<std::size_t>(where), images_.size() - 2);
  const double part = where - static_cast<double>(k);
  const auto mixed = [part](const Eigen::ArrayXXd& a, const Eigen::ArrayXXd& b) -> Eigen::ArrayXXd {
    return (1 - part) * a + part * b;
  };
  between.centre = images_[k].centre;
  between.share = mixed(images_[k].share, images_[k + 1].share);
  between.by_zernike.resize(images_[k].by_zernike.size());
  for (std::size_t term = 0; term < between.by_zernike.size(); ++term)
    between.by_zernike[term] = mixed(images_[k].by_zernike[term], images_[k + 1].by_zernike[term]);
  return between;
}

}  // namespace atomcam
