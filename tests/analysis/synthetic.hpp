#pragma once
// Plain stacks to measure: a grid of sites with a Gaussian image, loaded at random, on a camera with or
// without gain. Hooks put an effect in.

#include <algorithm>
#include <cmath>
#include <functional>
#include <random>
#include <vector>

#include "analysis/battery.hpp"

namespace atomcam::synthetic {

struct Camera {
  bool multiplied = true;
  int size = 64;
  int sites = 5;  // along an edge; 0: none
  double pitch = 12;
  double survival = 0.97;
};

inline StackModel model_of(const Camera& camera) {
  StackModel model;
  model.shape = {camera.size, camera.size};
  model.bias_counts = 200;
  model.read_noise_counts = camera.multiplied ? 4 : 3;
  model.counts_per_electron = camera.multiplied ? 60 : 9;
  model.excess_noise = camera.multiplied ? 2 : 1;
  model.dark_e = camera.multiplied ? 0.003 : 0.01;
  model.background_e = camera.multiplied ? 0.05 : 0.3;
  model.atom_e = 150;
  model.filling = 0.55;
  model.site_light = PhotonImage(model.shape);
  const double first = (camera.size - 1 - camera.pitch * (camera.sites - 1)) / 2 + 0.3;
  for (int row = 0; row < camera.sites; ++row)
    for (int column = 0; column < camera.sites; ++column) {
      SiteImage site;
      site.x_px = first + column * camera.pitch;
      site.y_px = first + row * camera.pitch;
      site.grid_column = column;
      site.grid_row = row;
      constexpr int edge = 11;
      site.left = static_cast<int>(std::lround(site.x_px)) - edge / 2;
      site.top = static_cast<int>(std::lround(site.y_px)) - edge / 2;
      site.share = RatioMap({edge, edge});
      site.weight = RatioMap({edge, edge});
      double total = 0, square = 0;
      const auto light = [&](int r, int c) {
        return std::exp(-(std::pow(site.left + c - site.x_px, 2) + std::pow(site.top + r - site.y_px, 2)) /
                        (2 * 1.4 * 1.4));
      };
      for (int r = 0; r < edge; ++r)
        for (int c = 0; c < edge; ++c) total += light(r, c);
      for (int r = 0; r < edge; ++r)
        for (int c = 0; c < edge; ++c) {
          const double share = light(r, c) / total;
          site.share(r, c) = static_cast<float>(share);
          square += share * share;
          model.site_light(site.top + r, site.left + c) += static_cast<float>(share);
        }
      for (int r = 0; r < edge; ++r)
        for (int c = 0; c < edge; ++c)
          site.weight(r, c) = static_cast<float>(static_cast<double>(site.share(r, c)) / square);
      model.sites.push_back(std::move(site));
    }
  return model;
}

/// What an effect may touch.
struct Hooks {
  /// Brightness of the sites of a frame.
  std::function<void(std::size_t frame, std::vector<double>& brightness)> brightness = {};
  /// Expected electrons per pixel, [row * size + column].
  std::function<void(std::size_t frame, std::vector<double>& expected)> light = {};
  /// Counts before rounding.
  std::function<void(std::size_t frame, std::vector<double>& counts)> counts = {};
};

inline FramesInMemory frames_of(const Camera& camera, std::size_t frames, std::uint64_t seed, bool darks,
                                const Hooks& hooks = {}) {
  const StackModel model = model_of(camera);
  std::mt19937_64 random(seed * 2 + darks);
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> uniform;
  const std::size_t pixels = model.shape.pixels();
  std::vector<CountImage> stack;
  for (std::size_t n = 0; n < frames; ++n) {
    std::vector<double> expected(pixels, model.dark_e + (darks ? 0 : model.background_e)), counts(pixels);
    if (!darks) {
      std::vector<double> brightness(model.sites.size());
      for (double& b : brightness)
        if (uniform(random) < model.filling) b = uniform(random) < camera.survival ? 1 : uniform(random);
      if (hooks.brightness) hooks.brightness(n, brightness);
      for (std::size_t s = 0; s < brightness.size(); ++s)
        for (int r = 0; r < model.sites[s].share.rows(); ++r)
          for (int c = 0; c < model.sites[s].share.columns(); ++c)
            expected[static_cast<std::size_t>((model.sites[s].top + r) * camera.size + model.sites[s].left +
                                              c)] +=
                brightness[s] * model.atom_e * static_cast<double>(model.sites[s].share(r, c));
      if (hooks.light) hooks.light(n, expected);
    }
    for (std::size_t i = 0; i < pixels; ++i) {
      double electrons = 0;
      if (expected[i] < 0.5) {
        double p = std::exp(-expected[i]), u = uniform(random);
        while (u > p) u -= p, ++electrons, p *= expected[i] / electrons;
      } else {
        electrons = std::poisson_distribution<int>(expected[i])(random);
      }
      double output = electrons * model.counts_per_electron;
      if (camera.multiplied && electrons > 0)
        output = std::gamma_distribution<double>(electrons, model.counts_per_electron)(random);
      counts[i] = model.bias_counts + output + model.read_noise_counts * normal(random);
    }
    if (hooks.counts) hooks.counts(n, counts);
    CountImage image(model.shape);
    for (std::size_t i = 0; i < pixels; ++i)
      image.pixels()[i] = static_cast<std::uint16_t>(std::clamp(std::nearbyint(counts[i]), 0.0, 65535.0));
    stack.push_back(std::move(image));
  }
  return FramesInMemory(std::move(stack));
}

}  // namespace atomcam::synthetic
