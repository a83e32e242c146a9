// Where the image lies in every frame, against images that are really displaced.
#include "analysis/image_motion.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace atomcam {
namespace {

constexpr double width_px = 1.3, atom_e = 200, read_noise = 2, bias = 100, background_e = 0.5;
constexpr int size = 40, radius = 6;

double spot(double dx, double dy) {
  return std::exp(-0.5 * (dx * dx + dy * dy) / (width_px * width_px)) / (2 * M_PI * width_px * width_px);
}

StackModel model_of_sites() {
  StackModel model;
  model.shape = {size, size};
  model.bias_counts = bias;
  model.read_noise_counts = read_noise;
  model.background_e = background_e;
  model.atom_e = atom_e;
  model.filling = 0.6;
  for (const int y : {7, 20, 32})
    for (const int x : {7, 20, 32}) {
      SiteImage site;
      site.x_px = x, site.y_px = y;
      site.left = x - radius, site.top = y - radius;
      site.share = site.weight = RatioMap({2 * radius + 1, 2 * radius + 1});
      double square = 0;
      for (int r = -radius; r <= radius; ++r)
        for (int c = -radius; c <= radius; ++c) {
          const double share = spot(c, r);
          site.share(r + radius, c + radius) = static_cast<float>(share);
          square += share * share;
        }
      for (std::size_t i = 0; i < site.share.pixels().size(); ++i)
        site.weight.pixels()[i] = site.share.pixels()[i] / static_cast<float>(square);
      model.sites.push_back(site);
    }
  return model;
}

TEST(ImageMotion, FollowsTheImageWithinItsError) {
  const StackModel model = model_of_sites();
  std::mt19937_64 random(7);
  std::vector<CountImage> frames;
  std::vector<double> x, y;
  constexpr int count = 400;
  double x_mean = 0, y_mean = 0;
  for (int n = 0; n < count; ++n) {
    x.push_back(0.15 * std::sin(n / 23.0) + 0.05 * std::cos(n / 7.0));
    y.push_back(-0.1 * std::cos(n / 31.0));
    x_mean += x.back() / count, y_mean += y.back() / count;
    CountImage frame({size, size});
    std::vector<bool> there;
    for (std::size_t s = 0; s < model.sites.size(); ++s) there.push_back(random() % 5 < 3);
    for (int r = 0; r < size; ++r)
      for (int c = 0; c < size; ++c) {
        double light = background_e;
        for (std::size_t s = 0; s < model.sites.size(); ++s)
          if (there[s])
            light += atom_e * spot(c - model.sites[s].x_px - x.back(), r - model.sites[s].y_px - y.back());
        const double counts = bias + std::poisson_distribution<int>(light)(random) +
                              std::normal_distribution<double>(0, read_noise)(random);
        frame(r, c) = static_cast<std::uint16_t>(std::lround(counts));
      }
    frames.push_back(std::move(frame));
  }
  const ImageMotion motion = image_motion(model, FramesInMemory(std::move(frames)));
  ASSERT_EQ(motion.x_px.size(), x.size());
  EXPECT_GT(motion.x_error_px, 0.01);
  EXPECT_LT(motion.x_error_px, 0.08);
  double off_x = 0, off_y = 0, square = 0, shrunk = 0, truth = 0;
  const ImageMotion without = motion.without_noise();
  for (std::size_t n = 0; n < x.size(); ++n) {
    off_x += std::pow(motion.x_px[n] - (x[n] - x_mean), 2) / count;
    off_y += std::pow(motion.y_px[n] - (y[n] - y_mean), 2) / count;
    square += motion.x_px[n] * motion.x_px[n] / count;
    shrunk += without.x_px[n] * without.x_px[n] / count;
    truth += std::pow(x[n] - x_mean, 2) / count;
  }
  // A mean square over 400 frames is good to 7 %, and a displacement is seen a few percent short.
  EXPECT_NEAR(off_x / std::pow(motion.x_error_px, 2), 1, 0.3);
  EXPECT_NEAR(off_y / std::pow(motion.y_error_px, 2), 1, 0.3);
  EXPECT_GT(square, 1.1 * truth);
  EXPECT_NEAR(shrunk, truth, 0.08 * truth);
}

TEST(ImageMotion, WithoutAtomsThereIsNone) {
  const StackModel model = model_of_sites();
  std::vector<CountImage> frames(3, CountImage({size, size}));
  for (CountImage& frame : frames)
    for (auto& count : frame.pixels()) count = 100;
  const ImageMotion motion = image_motion(model, FramesInMemory(std::move(frames)));
  EXPECT_TRUE(motion.x_px.empty());
  EXPECT_TRUE(motion.without_noise().x_px.empty());
}

}  // namespace
}  // namespace atomcam
