#include "analysis/image_motion.hpp"

#include <algorithm>
#include <cmath>

namespace atomcam {
namespace {

/// The image of an occupied site with its derivatives, weighted by the noise that is expected of its pixels.
struct Template {
  std::vector<double> x, y;  // weight times slope, per pixel
  double norm_x = 0, norm_y = 0;

  Template(const StackModel& model, const SiteImage& site) {
    const auto share = [&](int r, int c) {
      return r < 0 || c < 0 || r >= site.share.rows() || c >= site.share.columns()
                 ? 0.0
                 : static_cast<double>(site.share(r, c));
    };
    const double read_noise = model.read_noise_counts / model.counts_per_electron;
    for (int r = 0; r < site.share.rows(); ++r)
      for (int c = 0; c < site.share.columns(); ++c) {
        const double light = model.dark_e + model.background_e + model.atom_e * share(r, c);
        const double weight = 1 / (read_noise * read_noise + model.excess_noise * light + 1e-9);
        // Differences of the next pixels alone would blunt the slope of a narrow image by a tenth.
        const auto slope = [&](auto&& at) { return (8 * (at(1) - at(-1)) - (at(2) - at(-2))) / 12; };
        const double slope_x = slope([&](int by) { return share(r, c + by); }),
                     slope_y = slope([&](int by) { return share(r + by, c); });
        x.push_back(weight * slope_x);
        y.push_back(weight * slope_y);
        norm_x += weight * slope_x * slope_x;
        norm_y += weight * slope_y * slope_y;
      }
  }
};

void about_mean(std::vector<double>& values) {
  double mean = 0;
  for (const double v : values) mean += v / static_cast<double>(values.size());
  for (double& v : values) v -= mean;
}

std::vector<double> shrunk(std::vector<double> values, double error) {
  double square = 0;
  for (const double v : values) square += v * v / static_cast<double>(values.size());
  const double part = square > 0 ? std::sqrt(std::max(0.0, 1 - error * error / square)) : 0;
  for (double& v : values) v *= part;
  return values;
}

}  // namespace

ImageMotion ImageMotion::without_noise() const {
  return {shrunk(x_px, x_error_px), shrunk(y_px, y_error_px), 0, 0};
}

ImageMotion image_motion(const StackModel& model, const FrameSequence& frames) {
  constexpr double occupied = 0.5;  // of an atom's light
  std::vector<Template> templates;
  for (const SiteImage& site : model.sites) templates.emplace_back(model, site);
  ImageMotion motion;
  std::vector<double> light(model.shape.pixels()), brightness(model.sites.size());
  const auto columns = static_cast<std::size_t>(model.shape.columns);
  const auto over_stamp = [&](const SiteImage& site, auto&& take) {
    std::size_t i = 0;
    for (int r = 0; r < site.share.rows(); ++r)
      for (int c = 0; c < site.share.columns(); ++c, ++i)
        take(i, light[static_cast<std::size_t>(site.top + r) * columns +
                      static_cast<std::size_t>(site.left + c)]);
  };
  const double none = model.dark_e + model.background_e;
  double x_variance = 0, y_variance = 0;
  frames.visit([&](std::size_t, const CountImage& counts) {
    const auto pixels = counts.pixels();
    for (std::size_t i = 0; i < pixels.size(); ++i)
      light[i] = (static_cast<double>(pixels[i]) - model.bias_counts) / model.counts_per_electron - none;
    for (std::size_t s = 0; s < templates.size(); ++s) {
      const auto weight = model.sites[s].weight.pixels();
      brightness[s] = 0;
      over_stamp(model.sites[s],
                 [&](std::size_t i, double e) { brightness[s] += static_cast<double>(weight[i]) * e; });
    }
    for (std::size_t s = 0; s < templates.size(); ++s) {
      const auto share = model.sites[s].share.pixels();
      over_stamp(model.sites[s],
                 [&](std::size_t i, double& e) { e -= brightness[s] * static_cast<double>(share[i]); });
    }
    double x = 0, y = 0, x_norm = 0, y_norm = 0;
    for (std::size_t s = 0; s < templates.size(); ++s) {
      const double b = brightness[s];
      if (b < occupied * model.atom_e) continue;
      const Template& one = templates[s];
      // A shift by d takes d * slope away.
      over_stamp(model.sites[s],
                 [&](std::size_t i, double e) { x -= b * one.x[i] * e, y -= b * one.y[i] * e; });
      x_norm += b * b * one.norm_x;
      y_norm += b * b * one.norm_y;
    }
    if (!(x_norm > 0 && y_norm > 0)) return;
    motion.x_px.push_back(x / x_norm);
    motion.y_px.push_back(y / y_norm);
    x_variance += 1 / x_norm;
    y_variance += 1 / y_norm;
  });
  if (motion.x_px.empty()) return motion;
  const auto count = static_cast<double>(motion.x_px.size());
  motion.x_error_px = std::sqrt(x_variance / count);
  motion.y_error_px = std::sqrt(y_variance / count);
  about_mean(motion.x_px);
  about_mean(motion.y_px);
  return motion;
}

}  // namespace atomcam
