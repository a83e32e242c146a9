#include "sensor/background.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <vector>

#include "base/error.hpp"
#include "base/samplers.hpp"
#include "sensor/row_loops.hpp"

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
  if (largest_e_ > UniformPoisson::largest_threshold_mean) {
    RandomStream random(thinning_, frame_, block);
    for (std::size_t c = 0; c < electrons.size(); ++c)
      electrons[c] =
          static_cast<std::int32_t>(sample_poisson(random, std::max(0.0, uniform_e_ + light_e_ * ratio[c])));
    return;
  }
  law_->fill(keys_, frame_, block, electrons);
  thread_local row_loops::Packets packets;
  thread_local std::vector<float> unused;
  thread_local std::vector<std::uint32_t> words;
  unused.resize(electrons.size());
  row_loops::spread_electrons(electrons, 0, unused, packets);
  std::int32_t candidates = 0;
  for (std::size_t i = 0; i < packets.count; ++i) candidates += packets.electrons[i];
  words.resize(static_cast<std::size_t>(candidates));
  fill_random(thinning_, frame_, block, words);
  const std::uint32_t* word = words.data();
  const double scale = 0x1p32 / largest_e_;
  for (std::size_t i = 0; i < packets.count; ++i) {
    const auto c = static_cast<std::size_t>(packets.columns[i]);
    const auto kept = static_cast<std::uint64_t>(std::max(0.0, uniform_e_ + light_e_ * ratio[c]) * scale);
    std::int32_t n = 0;
    for (const std::uint32_t* end = word + packets.electrons[i]; word != end; ++word)
      n += *word < kept ? 1 : 0;
    electrons[c] = n;
  }
}

}  // namespace atomcam
