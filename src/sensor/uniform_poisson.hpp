#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string_view>
#include <vector>

#include "base/random.hpp"
#include "sensor/alias_table.hpp"

namespace atomcam {

/// Poisson numbers of one mean for every pixel of a row. Small means compare 16 random bits per pixel with
/// thresholds and draw 32 more where those cannot decide (a law exact to 2^-48); larger ones use an alias
/// table (to 2^-32).
class UniformPoisson {
 public:
  static constexpr double largest_threshold_mean = 12;

  explicit UniformPoisson(double mean);
  double mean() const { return mean_; }

  struct Keys {
    PhiloxKey coarse, fine;
  };
  static Keys keys(std::uint64_t seed, std::string_view stream);
  /// Sets `electrons` to the numbers of row `block` of a frame.
  void fill(const Keys& keys, std::uint64_t frame, std::uint32_t block,
            std::span<std::int32_t> electrons) const;
  /// The same numbers, one pixel at a time.
  void fill_plainly(const Keys& keys, std::uint64_t frame, std::uint32_t block,
                    std::span<std::int32_t> electrons) const;

 private:
  std::int32_t resolve(const Keys& keys, std::uint64_t frame, std::uint32_t block, std::uint32_t column,
                       std::uint16_t coarse) const;

  double mean_;
  std::vector<std::uint64_t> thresholds_;         // P(X <= k) in units of 2^-48
  std::vector<std::uint16_t> coarse_thresholds_;  // their upper 16 bits
  std::optional<AliasTable> table_;
};

/// P(X <= first + i) of a Poisson number, where it is neither 0 nor 1 to within 1e-16 of the law.
struct PoissonCumulative {
  std::int64_t first = 0;
  std::vector<double> cumulative;
};
PoissonCumulative poisson_cumulative(double mean);

}  // namespace atomcam
