#include "calibration/site_light.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace atomcam {

std::vector<double> light_beyond_stamps(const StackModel& model) {
  std::vector<double> far(model.shape.pixels(), 0);
  if (model.site_light.empty()) return far;
  std::vector<double> near(far.size(), 0);
  for (const SiteImage& site : model.sites)
    for (int r = 0; r < site.share.rows(); ++r)
      for (int c = 0; c < site.share.columns(); ++c)
        near[static_cast<std::size_t>(site.top + r) * static_cast<std::size_t>(model.shape.columns) +
             static_cast<std::size_t>(site.left + c)] += static_cast<double>(site.share(r, c));
  for (std::size_t i = 0; i < far.size(); ++i)
    far[i] = std::max(0.0, static_cast<double>(model.site_light.pixels()[i]) - near[i]);
  return far;
}

SiteLight::SiteLight(const StackModel& model, bool shutter_open) : model_(model), open_(shutter_open) {
  const std::size_t pixels = model.shape.pixels();
  const double k = model.counts_per_electron;
  level_.assign(pixels, model.bias_counts + (model.dark_e + (open_ ? model.background_e : 0)) * k);
  rest_.resize(pixels);
  if (!open_) return;
  brightness_.resize(model.sites.size());
  const std::vector<double> far = light_beyond_stamps(model);
  for (std::size_t i = 0; i < pixels; ++i) level_[i] += far[i] * model.filling * model.atom_e * k;
}

double SiteLight::lit_e(std::size_t pixel) const {
  return open_ && !model_.site_light.empty()
             ? static_cast<double>(model_.site_light.pixels()[pixel]) * model_.atom_e
             : 0;
}

void SiteLight::split(const CountImage& frame) {
  const auto counts = frame.pixels();
  for (std::size_t i = 0; i < rest_.size(); ++i) rest_[i] = counts[i] - level_[i];
  if (!open_) return;
  const double k = model_.counts_per_electron;
  const auto at = [&](const SiteImage& site, int r) {
    return &rest_[static_cast<std::size_t>(site.top + r) * static_cast<std::size_t>(model_.shape.columns) +
                  static_cast<std::size_t>(site.left)];
  };
  for (std::size_t s = 0; s < model_.sites.size(); ++s) {
    const SiteImage& site = model_.sites[s];
    double sum = 0;
    for (int r = 0; r < site.weight.rows(); ++r) {
      const double* row = at(site, r);
      const auto weight = site.weight.row(r);
      for (std::size_t c = 0; c < weight.size(); ++c) sum += static_cast<double>(weight[c]) * row[c];
    }
    brightness_[s] = sum / k;
  }
  for (std::size_t s = 0; s < model_.sites.size(); ++s) {
    const SiteImage& site = model_.sites[s];
    const double light = brightness_[s] * k;
    for (int r = 0; r < site.share.rows(); ++r) {
      double* row = at(site, r);
      const auto share = site.share.row(r);
      for (std::size_t c = 0; c < share.size(); ++c) row[c] -= light * static_cast<double>(share[c]);
    }
  }
}

namespace {

FoldedSite fold(const StackModel& model, std::span<const double> image, int radius_px, int over) {
  FoldedSite folded;
  folded.oversampling = over;
  const int half = radius_px * over;
  const int side = 2 * half + 1;
  folded.mean = Image<double, unit::counts>({side, side});
  Image<double, unit::counts> hits({side, side});
  for (const SiteImage& site : model.sites) {
    const int x0 = std::max(0, static_cast<int>(std::ceil(site.x_px - radius_px))),
              x1 = std::min(model.shape.columns - 1, static_cast<int>(std::floor(site.x_px + radius_px))),
              y0 = std::max(0, static_cast<int>(std::ceil(site.y_px - radius_px))),
              y1 = std::min(model.shape.rows - 1, static_cast<int>(std::floor(site.y_px + radius_px)));
    for (int y = y0; y <= y1; ++y)
      for (int x = x0; x <= x1; ++x) {
        const int c = half + static_cast<int>(std::lround((x - site.x_px) * over)),
                  r = half + static_cast<int>(std::lround((y - site.y_px) * over));
        folded.mean(r, c) +=
            image[static_cast<std::size_t>(y) * static_cast<std::size_t>(model.shape.columns) +
                  static_cast<std::size_t>(x)];
        hits(r, c) += 1;
      }
  }
  for (std::size_t i = 0; i < hits.pixels().size(); ++i)
    folded.mean.pixels()[i] = hits.pixels()[i] > 0 ? folded.mean.pixels()[i] / hits.pixels()[i]
                                                   : std::numeric_limits<double>::quiet_NaN();
  return folded;
}

}  // namespace

FoldedSite fold_sites(const StackModel& model, std::span<const double> image, int radius_px) {
  // As fine as the sites' places allow without holes.
  for (const int over : {3, 2}) {
    FoldedSite folded = fold(model, image, radius_px, over);
    const auto cells = folded.mean.pixels();
    const auto empty = std::count_if(cells.begin(), cells.end(), [](double v) { return std::isnan(v); });
    if (static_cast<double>(empty) < 0.01 * static_cast<double>(cells.size())) return folded;
  }
  return fold(model, image, radius_px, 1);
}

}  // namespace atomcam
