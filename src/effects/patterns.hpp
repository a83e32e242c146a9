#pragma once
// What several effects are made of: where a plane's pixels lie on the sensor, patterns that are drawn once
// and kept, noise that wanders from frame to frame, and sparse pixels with a defect.

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <span>
#include <string>
#include <string_view>
#include <tuple>
#include <vector>

#include "base/math.hpp"
#include "base/samplers.hpp"
#include "effects/effect.hpp"

namespace atomcam {

/// Pixels of the readout's plane in physical sensor pixels: an EMCCD bins on the chip, a qCMOS after
/// conversion.
struct PlaneGeometry {
  explicit PlaneGeometry(const FrameContext& context)
      : region(context.settings->region), sensor(context.sensor->shape()) {
    if (context.sensor->kind() == CameraKind::emccd) {
      step_x = context.settings->binning_x;
      step_y = context.settings->binning_y;
    }
  }
  Shape shape() const { return {region.height / step_y, region.width / step_x}; }
  double x_px(int column) const { return region.offset_x + (column + 0.5) * step_x - 0.5; }
  double y_px(int row) const { return region.offset_y + (row + 0.5) * step_y - 0.5; }
  /// Position from the sensor's centre in units of half its width: -1 to 1 along x.
  double u(double x) const { return (x - (sensor.columns - 1) / 2.0) / (sensor.columns / 2.0); }
  double v(double y) const { return (y - (sensor.rows - 1) / 2.0) / (sensor.columns / 2.0); }

  Region region;
  Shape sensor;
  int step_x = 1;
  int step_y = 1;
};

/// What is made once for a sensor, region and binning, and shared by all frames and threads.
template <class Value>
class Kept {
 public:
  template <class Make>
  std::shared_ptr<const Value> get(const FrameContext& context, const Make& make) const {
    const CameraSettings& s = *context.settings;
    Key key{std::string(context.serial),
            context.seed,
            s.region.offset_x,
            s.region.offset_y,
            s.region.width,
            s.region.height,
            s.binning_x,
            s.binning_y};
    const std::lock_guard lock(mutex_);
    if (!value_ || key != key_) {
      value_ = std::make_shared<const Value>(make());
      key_ = std::move(key);
    }
    return value_;
  }

 private:
  using Key = std::tuple<std::string, std::uint64_t, int, int, int, int, int, int>;
  mutable std::mutex mutex_;
  mutable Key key_;
  mutable std::shared_ptr<const Value> value_;
};

/// A map over the pixels of the readout's plane.
class KeptMap {
 public:
  using Pixel = std::function<double(int row, int column)>;
  std::shared_ptr<const RatioMap> get(const FrameContext& context, const Pixel& pixel) const {
    return kept_.get(context, [&] {
      RatioMap map(PlaneGeometry(context).shape());
      for (int row = 0; row < map.rows(); ++row)
        for (int column = 0; column < map.columns(); ++column)
          map(row, column) = static_cast<float>(pixel(row, column));
      return map;
    });
  }

 private:
  Kept<RatioMap> kept_;
};

inline void multiply(std::shared_ptr<const RatioMap>& into, std::shared_ptr<const RatioMap> factor) {
  if (!into) {
    into = std::move(factor);
    return;
  }
  auto product = std::make_shared<RatioMap>(*into);
  for (std::size_t i = 0; i < product->pixels().size(); ++i) product->pixels()[i] *= factor->pixels()[i];
  into = std::move(product);
}

/// Gaussian noise of unit variance that wanders over about `period` frames, known at any frame by itself:
/// normal knots every `period` frames, joined by weights cos and sin of a quarter turn, so the variance is 1
/// everywhere.
inline double wandering(const FrameContext& context, std::string_view what, double period) {
  const double place = static_cast<double>(context.frame) / period;
  const double knot = std::floor(place), t = place - knot;
  const auto at = [&](double k) {
    RandomStream random = context.random_at(what, static_cast<std::uint64_t>(k));
    return sample_normal(random);
  };
  return math::cos_turns(t / 4) * at(knot) + math::sin_turns(t / 4) * at(knot + 1);
}

/// First-order autoregressive noise of unit variance and correlation `rho` from frame to frame, from its last
/// innovations until their weight falls below 1e-6.
inline double autoregressive(const FrameContext& context, std::string_view what, double rho) {
  double value = 0, weight = std::sqrt(1 - rho * rho);
  std::uint64_t frame = context.frame;
  for (int k = 0; k < 3000 && weight > 1e-6; ++k) {
    RandomStream random = context.random_at(what, frame);
    value += weight * sample_normal(random);
    weight *= rho;
    if (frame-- == 0) frame = ~std::uint64_t{0};  // before the first frame the noise was there, too
  }
  return value;
}

/// A random walk with normal steps of unit variance that starts at zero with every block of `walk_frames`
/// frames, known at any frame by itself: the block's end first, then the middle given the ends, and so on
/// (Levy's construction).
inline constexpr std::uint64_t walk_frames = 1024;
inline double random_walk(const FrameContext& context, std::string_view what) {
  const std::uint64_t start = context.frame / walk_frames * walk_frames, at = context.frame - start;
  const auto normal = [&](std::uint64_t level, std::uint64_t place) {
    RandomStream random = context.random_at(what, start + place, static_cast<std::uint32_t>(level));
    return sample_normal(random);
  };
  double left = 0, right = std::sqrt(static_cast<double>(walk_frames)) * normal(0, 0);
  std::uint64_t from = 0;
  for (std::uint64_t half = walk_frames / 2, level = 1; at > from; half /= 2, ++level) {
    const double middle =
        0.5 * (left + right) + std::sqrt(0.5 * static_cast<double>(half)) * normal(level, from + half);
    if (at < from + half) {
      right = middle;
    } else {
      left = middle;
      from += half;
    }
  }
  return left;
}

/// A defect's size relative to the mean of all: a gamma law of relative standard deviation `spread`; 0: all
/// alike, 1: exponential.
inline double relative_size(RandomStream& random, double spread) {
  if (spread < 1e-3) return 1;
  const double shape = 1 / (spread * spread);
  return sample_gamma(random, shape) / shape;
}

inline constexpr std::string_view spread_of_sizes_key = "spread";

/// The parameter that relative_size() takes. `of`: what is spread.
inline ParameterDeclaration spread_of_sizes(std::string_view of, double default_value) {
  return {.key = std::string(spread_of_sizes_key),
          .unit = "1",
          .minimum = 0,
          .maximum = 2,
          .default_value = default_value,
          .scale = ParameterScale::linear,
          .meaning = "Relative spread of " + std::string(of) + " (gamma law; 0: all alike, 1: exponential)."};
}

/// The pixels that carry a defect: a fraction of the sensor's physical pixels, fixed by its serial number,
/// each with a size relative to the mean of all.
class Defects {
 public:
  struct Defect {
    int column;           // in the plane
    std::uint32_t pixel;  // of the sensor
    double size;
  };
  class Rows {
   public:
    std::span<const Defect> of(int row) const {
      const auto r = static_cast<std::size_t>(row);
      return std::span(defects_).subspan(begin_[r], begin_[r + 1] - begin_[r]);
    }
    std::span<const Defect> all() const { return defects_; }
    /// Of all, of one of these.
    std::size_t number(const Defect& one) const { return static_cast<std::size_t>(&one - defects_.data()); }

   private:
    friend class Defects;
    std::vector<Defect> defects_;
    std::vector<std::size_t> begin_{0};
  };

  /// `spread`: relative standard deviation of the sizes.
  Defects(double fraction, double spread) : fraction_(fraction), spread_(spread) {}
  std::shared_ptr<const Rows> in(const FrameContext& context) const {
    return kept_.get(context, [&] { return find(context); });
  }

 private:
  Rows find(const FrameContext& context) const {
    const PlaneGeometry plane(context);
    Rows rows;
    for (int row = 0; row < plane.shape().rows; ++row) {
      const int first = plane.region.offset_y + row * plane.step_y;
      for (int y = first; y < first + plane.step_y && fraction_ > 0; ++y) add_line(context, plane, y, rows);
      rows.begin_.push_back(rows.defects_.size());
    }
    return rows;
  }

  void add_line(const FrameContext& context, const PlaneGeometry& plane, int y, Rows& rows) const {
    // From one such pixel to the next: a geometric law, so that no pixel carries two.
    const double log_free = fraction_ < 1 ? math::log(1 - fraction_) : 0;
    const auto gap = [&](RandomStream& random) {
      if (log_free == 0) return 0;
      return static_cast<int>(std::min(1e6, math::log(random.uniform()) / log_free));
    };
    RandomStream random = context.fixed("pixels", static_cast<std::uint32_t>(y));
    for (int x = gap(random); x < plane.sensor.columns; x += 1 + gap(random)) {
      const std::uint64_t properties = random.next64();
      const int column = (x - plane.region.offset_x) / plane.step_x;
      if (x < plane.region.offset_x || column >= plane.shape().columns) continue;
      RandomStream own(properties, stream_id("defect"), 0, 0);
      rows.defects_.push_back(
          {column, static_cast<std::uint32_t>(y * plane.sensor.columns + x), relative_size(own, spread_)});
    }
  }

  double fraction_, spread_;
  Kept<Rows> kept_;
};

template <class Kind>
std::unique_ptr<Effect> make_effect(const ParameterValues& values) {
  return std::make_unique<Kind>(values);
}

}  // namespace atomcam
