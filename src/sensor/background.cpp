#include "sensor/background.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "base/error.hpp"
#include "base/samplers.hpp"

namespace atomcam {
namespace {

double largest_of(const RatioMap& map) {
  float largest = 0;
  for (const float value : map.pixels()) largest = value > largest ? value : largest;
  return largest;
}

}  // namespace

Background::Background(Cache& cache, Shape plane, double uniform_e, double light_e,
                       std::shared_ptr<const RatioMap> ratio, std::uint64_t seed, std::uint64_t frame)
    : uniform_e_(uniform_e),
      light_e_(light_e),
      largest_e_(uniform_e + light_e),
      ratio_(std::move(ratio)),
      keys_(UniformPoisson::keys(seed, "sensor/collect")),
      thinning_(stream_key(seed, stream_id("sensor/thinning"))),
      frame_(frame) {
  if (!(largest_e_ >= 0) || !(largest_e_ <= 1e9))
    throw Error("background_e", fmt::format("{} electrons per pixel; 0 to 1e9", largest_e_));
  if (ratio_ != nullptr) {
    if (ratio_->shape() != plane)
      throw Error("background_ratio",
                  fmt::format("{} x {} pixels; the readout has {} x {}", ratio_->columns(), ratio_->rows(),
                              plane.columns, plane.rows));
    largest_e_ = uniform_e + light_e * *cache.largest_ratios.get(ratio_, [&] { return largest_of(*ratio_); });
  }
  law_ = cache.laws.get(largest_e_, [&] { return UniformPoisson(largest_e_); });
}

void Background::fill(int row, std::span<std::int32_t> electrons) const {
  const auto block = static_cast<std::uint32_t>(row);
  if (ratio_ == nullptr || largest_e_ <= 0) {
    law_->fill(keys_, frame_, block, electrons);
    return;
  }
  const std::span<const float> ratio = ratio_->row(row);
  RandomStream random(thinning_, frame_, block);
  if (largest_e_ > UniformPoisson::largest_threshold_mean) {
    for (std::size_t c = 0; c < electrons.size(); ++c)
      electrons[c] = static_cast<std::int32_t>(sample_poisson(random, uniform_e_ + light_e_ * ratio[c]));
    return;
  }
  law_->fill(keys_, frame_, block, electrons);
  const double scale = 0x1p32 / largest_e_;
  for (std::size_t c = 0; c < electrons.size(); ++c) {
    if (electrons[c] == 0) continue;
    const double mean = std::max(uniform_e_ + light_e_ * ratio[c], 0.0);
    const auto kept = static_cast<std::uint64_t>(mean * scale);
    std::int32_t n = 0;
    for (std::int32_t i = 0; i < electrons[c]; ++i) n += random() < kept ? 1 : 0;
    electrons[c] = n;
  }
}

}  // namespace atomcam
