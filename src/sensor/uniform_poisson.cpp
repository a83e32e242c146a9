#include "sensor/uniform_poisson.hpp"

#include <algorithm>
#include <cmath>
#include <string>

#include "base/math.hpp"
#include "sensor/row_loops.hpp"

namespace atomcam {

PoissonCumulative poisson_cumulative(double mean) {
  if (mean <= 0) return {0, {1.0}};
  // From the mode outwards by the ratio of neighbours, then summed from the small end.
  const double mode = std::floor(mean);
  const double at_mode = math::exp(mode * math::log(mean) - mean - math::log_gamma(mode + 1));
  std::vector<double> down, up;
  for (double k = mode, p = at_mode; k > 0 && p > 1e-19;) {
    p *= k / mean;
    k -= 1;
    down.push_back(p);
  }
  for (double k = mode, p = at_mode; p > 1e-19;) {
    k += 1;
    p *= mean / k;
    up.push_back(p);
  }
  PoissonCumulative result;
  result.first = static_cast<std::int64_t>(mode) - static_cast<std::int64_t>(down.size());
  result.cumulative.assign(down.rbegin(), down.rend());
  result.cumulative.push_back(at_mode);
  result.cumulative.insert(result.cumulative.end(), up.begin(), up.end());
  double total = 0;
  for (double& p : result.cumulative) p = total += p;
  for (double& p : result.cumulative) p = std::min(p / total, 1.0);
  return result;
}

UniformPoisson::UniformPoisson(double mean) : mean_(mean) {
  const PoissonCumulative law = poisson_cumulative(mean);
  if (mean > largest_threshold_mean) {
    table_.emplace(law.cumulative, law.first);
    return;
  }
  for (std::int64_t k = 0; k < law.first; ++k) thresholds_.push_back(0);
  for (const double p : law.cumulative) {
    const auto threshold = static_cast<std::uint64_t>(p * 0x1p48 + 0.5);
    if (threshold >= std::uint64_t{1} << 48) break;
    thresholds_.push_back(threshold);
  }
  // No 16 bits lie above 65535: one such threshold does, to say that 65535 itself is undecided.
  for (const std::uint64_t threshold : thresholds_) {
    coarse_thresholds_.push_back(static_cast<std::uint16_t>(threshold >> 32));
    if (coarse_thresholds_.back() == 0xffff) break;
  }
}

UniformPoisson::Keys UniformPoisson::keys(std::uint64_t seed, std::string_view stream) {
  return {stream_key(seed, stream_id(stream)), stream_key(seed, stream_id(std::string(stream) + "/fine"))};
}

std::int32_t UniformPoisson::resolve(const Keys& keys, std::uint64_t frame, std::uint32_t block,
                                     std::uint32_t column, std::uint16_t coarse) const {
  const PhiloxCounter words = philox4x32(
      {column / 4, block, static_cast<std::uint32_t>(frame), static_cast<std::uint32_t>(frame >> 32)},
      keys.fine);
  const std::uint64_t u = std::uint64_t{coarse} << 32 | words[column % 4];
  return static_cast<std::int32_t>(
      std::count_if(thresholds_.begin(), thresholds_.end(), [u](std::uint64_t t) { return u >= t; }));
}

void UniformPoisson::fill_plainly(const Keys& keys, std::uint64_t frame, std::uint32_t block,
                                  std::span<std::int32_t> electrons) const {
  RandomStream random(keys.coarse, frame, block);
  if (table_) {
    for (std::int32_t& n : electrons) n = table_->draw(random());
    return;
  }
  std::uint32_t word = 0;
  for (std::uint32_t column = 0; column < electrons.size(); ++column) {
    word = column % 2 == 0 ? random() : word >> 16;
    electrons[column] = resolve(keys, frame, block, column, static_cast<std::uint16_t>(word));
  }
}

void UniformPoisson::fill(const Keys& keys, std::uint64_t frame, std::uint32_t block,
                          std::span<std::int32_t> electrons) const {
  if (!table_ && thresholds_.empty()) {
    std::fill(electrons.begin(), electrons.end(), 0);
    return;
  }
  thread_local std::vector<std::uint32_t> words;
  words.resize(table_ ? electrons.size() : (electrons.size() + 1) / 2);
  fill_random(keys.coarse, frame, block, words);
  if (table_) {
    for (std::size_t c = 0; c < electrons.size(); ++c) electrons[c] = table_->draw(words[c]);
    return;
  }
  // In pieces: only a piece in which 16 bits could not decide, one in forty or so, is looked through again.
  constexpr std::size_t piece = 256;
  for (std::size_t begin = 0; begin < electrons.size(); begin += piece) {
    const std::span<std::int32_t> part = electrons.subspan(begin, std::min(piece, electrons.size() - begin));
    const std::uint32_t* part_words = words.data() + begin / 2;
    if (!row_loops::count_thresholds(part_words, coarse_thresholds_, part)) continue;
    for (std::size_t c = 0; c < part.size(); ++c) {
      const auto coarse = static_cast<std::uint16_t>(part_words[c / 2] >> (16 * (c % 2)));
      if (std::find(coarse_thresholds_.begin(), coarse_thresholds_.end(), coarse) != coarse_thresholds_.end())
        part[c] = resolve(keys, frame, block, static_cast<std::uint32_t>(begin + c), coarse);
    }
  }
}

}  // namespace atomcam
