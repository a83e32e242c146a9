// Pixel by pixel along the stack: variance, flatness of the law, memory of the frame before.

#include <algorithm>
#include <cmath>

#include "analysis/family.hpp"
#include "analysis/lanes.hpp"
#include "analysis/robust.hpp"

namespace atomcam::analysis {
namespace {

struct Sums {
  Plane square, fourth, linear, lag1, lag2;
  std::size_t frames = 0, pairs1 = 0, pairs2 = 0;

  Sums() = default;
  explicit Sums(PlaneShape shape) : square(shape), fourth(shape), linear(shape), lag1(shape), lag2(shape) {}
  Sums& operator+=(const Sums& other) {
    for (const auto member : {&Sums::square, &Sums::fourth, &Sums::linear, &Sums::lag1, &Sums::lag2}) {
      float* to = (this->*member).inner();
      const float* from = (other.*member).inner();
      for (std::size_t i = 0; i < square.size(); ++i) to[i] += from[i];
    }
    frames += other.frames, pairs1 += other.pairs1, pairs2 += other.pairs2;
    return *this;
  }
};

ATOMCAM_VECTOR_CLONES
void add_moments(std::size_t n, const float* residual, const float* light, const float* mean, float* square,
                 float* fourth, float* linear) {
  for (std::size_t i = 0; i < n; i += lane_count) {
    const Lanes q = load(residual + i), q2 = q * q, r = load(light + i) - load(mean + i);
    store(square + i, load(square + i) + q2);
    store(fourth + i, load(fourth + i) + q2 * q2);
    store(linear + i, load(linear + i) + r * r);
  }
}

ATOMCAM_VECTOR_CLONES
void add_product(std::size_t n, const float* a, const float* b, float* sum) {
  for (std::size_t i = 0; i < n; i += lane_count) store(sum + i, load(sum + i) + load(a + i) * load(b + i));
}

/// Natural logarithm of a positive number to about 1e-4, in a form that becomes vector code.
inline float quick_log(float x) {
  std::uint32_t bits;
  std::memcpy(&bits, &x, sizeof bits);
  const auto exponent = static_cast<float>(static_cast<std::int32_t>(bits >> 23) - 127);
  bits = (bits & 0x007fffffu) | 0x3f800000u;
  float m;
  std::memcpy(&m, &bits, sizeof m);
  // (m - 1) / (m + 1), then the series of atanh.
  const float t = (m - 1) / (m + 1), t2 = t * t;
  return 0.69314718f * exponent + 2 * t * (1 + t2 * (1.0f / 3 + t2 * (0.2f + t2 * (1.0f / 7))));
}

class TemporalMaps : public Family {
 public:
  explicit TemporalMaps(const Layout& layout) : layout_(layout), sums_(Sums(layout.shape)) {
    std::uint32_t i = 0;
    for (int r = 0; r < layout.shape.rows; ++r)
      for (int c = 0; c < layout.shape.columns; ++c, ++i)
        if (layout.quiet.at(r, c) > 0.5f) quiet_.push_back(i);
    peer_.assign(layout.shape.pixels(), 0);
    if (!layout.packed.empty()) {
      float peak = 1e-20f;
      for (std::size_t k = 0; k < layout.site_light.size(); ++k)
        peak = std::max(peak, layout.site_light.inner()[k]);
      std::size_t k = 0;
      for (int r = 0; r < layout.shape.rows; ++r)
        for (int c = 0; c < layout.shape.columns; ++c, ++k) {
          // Octaves below the brightest pixel; the last holds all that is darker.
          const float octaves = -std::log2(std::max(layout.site_light.at(r, c) / peak, 1e-6f));
          peer_[k] = static_cast<std::uint8_t>(std::min<float>(octaves, peers - 1));
        }
    }
    for (const std::uint8_t peer : peer_) ++peer_count_[peer];
    // Sites so close that no pixel is quiet: the least lit ones.
    if (quiet_.size() < layout.shape.pixels() / 10) quiet_ = layout.dark_pixels;
  }

  void second_look(const SecondLook& look) override {
    Sums& sums = sums_[look.part];
    const std::size_t n = layout_.shape.inner();
    add_moments(n, look.residual.inner(), look.light.inner(), look.mean.inner(), sums.square.inner(),
                sums.fourth.inner(), sums.linear.inner());
    ++sums.frames;
    if (look.before) {
      add_product(n, look.residual.inner(), look.before->inner(), sums.lag1.inner());
      ++sums.pairs1;
    }
    if (look.before_that) {
      add_product(n, look.residual.inner(), look.before_that->inner(), sums.lag2.inner());
      ++sums.pairs2;
    }
  }

  void summarise(Part which, const Record&, Sheet& sheet) const override {
    sheet.family("temporal_maps");
    const Sums sums = sums_.of(which);
    const double frames = static_cast<double>(sums.frames);
    const std::size_t pixels = layout_.shape.pixels();
    std::vector<float> variance, kurtosis, lag1, lag2, linear;  // logs and correlations, per pixel
    for (auto* map : {&variance, &kurtosis, &lag1, &lag2, &linear}) map->resize(pixels);
    const float n1 = static_cast<float>(frames / std::max(1.0, static_cast<double>(sums.pairs1))),
                n2 = static_cast<float>(frames / std::max(1.0, static_cast<double>(sums.pairs2)));
    const float inverse = static_cast<float>(1 / std::max(frames, 1.0));
    double still = 0, total_square = 0, total_fourth = 0, total_lag1 = 0, total_lag2 = 0;
    std::size_t pixel = 0;
    for (int r = 0; r < layout_.shape.rows; ++r)
      for (int c = 0; c < layout_.shape.columns; ++c, ++pixel) {
        const float s = sums.square.at(r, c), floor = 1e-9f;
        still += s <= 0;
        const float safe = std::max(s, floor);
        variance[pixel] = safe * inverse;
        kurtosis[pixel] = sums.fourth.at(r, c) / (safe * safe) * static_cast<float>(frames);
        lag1[pixel] = sums.lag1.at(r, c) / safe * n1;
        lag2[pixel] = sums.lag2.at(r, c) / safe * n2;
        const float w = layout_.inverse_scale.at(r, c);
        linear[pixel] = sums.linear.at(r, c) * inverse * w * w;
        total_square += static_cast<double>(s);
        total_fourth += static_cast<double>(sums.fourth.at(r, c));
        total_lag1 += static_cast<double>(sums.lag1.at(r, c));
        total_lag2 += static_cast<double>(sums.lag2.at(r, c));
      }
    const bool enough = sums.frames >= 4;
    const auto ok = [&](double value) { return enough ? value : not_a_number; };
    // By quarters: amplifiers that differ, glow at an edge.
    double quarter[2][2] = {}, row_square = 0, column_square = 0, mean = 0;
    std::vector<float> logs(pixels);
    for (std::size_t i = 0; i < pixels; ++i) {
      logs[i] = quick_log(variance[i]);
      mean += static_cast<double>(variance[i]) / static_cast<double>(pixels);
    }
    among_peers(logs);
    std::vector<double> rows(static_cast<std::size_t>(layout_.shape.rows)),
        columns(static_cast<std::size_t>(layout_.shape.columns));
    double gx = 0, gy = 0, norm_x = 0, norm_y = 0, radial = 0, norm_radial = 0;
    for (int r = 0; r < layout_.shape.rows; ++r) {
      double left = 0, right = 0;
      for (int c = 0; c < layout_.shape.columns; ++c) {
        const auto i = static_cast<std::size_t>(r) * static_cast<std::size_t>(layout_.shape.columns) +
                       static_cast<std::size_t>(c);
        const double d = static_cast<double>(logs[i]);
        const double y = (2.0 * r + 1) / layout_.shape.rows - 1,
                     x = (2.0 * c + 1) / layout_.shape.columns - 1;
        const double q = x * x + y * y - 2.0 / 3;
        gx += d * x, norm_x += x * x, gy += d * y, norm_y += y * y, radial += d * q, norm_radial += q * q;
        rows[static_cast<std::size_t>(r)] += d, columns[static_cast<std::size_t>(c)] += d;
        (2 * c >= layout_.shape.columns ? right : left) += d;
      }
      quarter[2 * r >= layout_.shape.rows][0] += left;
      quarter[2 * r >= layout_.shape.rows][1] += right;
    }
    for (const double d : rows) row_square += d * d;
    for (const double d : columns) column_square += d * d;
    double own = 0;
    for (const float v : logs) own += static_cast<double>(v) * static_cast<double>(v);
    std::vector<float> quiet_logs;
    quiet_logs.reserve(quiet_.size());
    for (const std::uint32_t p : quiet_) quiet_logs.push_back(logs[p]);
    const double spread = core_spread(quiet_logs);
    sheet.kind({"variance_map", "space", "whole frame"});
    sheet.put_unsteady("variance", ok(std::log(mean)));
    sheet.put("variance_spread", ok(std::log(spread * std::sqrt(std::max(frames, 1.0) / 2))));
    sheet.put("gradient_x", ok(gx / norm_x));
    sheet.put("gradient_y", ok(gy / norm_y));
    sheet.put("radial", ok(radial / norm_radial));
    const double n = static_cast<double>(pixels);
    sheet.put("left_right", ok((quarter[0][0] + quarter[1][0] - quarter[0][1] - quarter[1][1]) / n));
    sheet.put("top_bottom", ok((quarter[0][0] + quarter[0][1] - quarter[1][0] - quarter[1][1]) / n));
    sheet.put("crosswise", ok((quarter[0][0] + quarter[1][1] - quarter[0][1] - quarter[1][0]) / n));
    sheet.put("rows", ok(std::log(row_square / own)));
    sheet.put("columns", ok(std::log(column_square / own)));
    // Outliers among the quiet pixels: under the sites the law of the noise is another in every stack.
    const std::vector<std::uint32_t>& quiet = quiet_;
    Outliers noisy;
    for (const std::uint32_t p : quiet) noisy.take(static_cast<double>(logs[p]) / spread);
    sheet.put_outliers("noisy", {}, ok(noisy.above));
    sheet.put_outliers("quiet", {}, ok(noisy.below));
    sheet.put_unsteady("noisiest", ok(std::log1p(noisy.highest)));
    sheet.put("still", ok(std::asinh(still)));
    float top_linear = 0;
    double sum_linear = 0;
    for (const std::uint32_t p : quiet)
      sum_linear += static_cast<double>(linear[p]), top_linear = std::max(top_linear, linear[p]);
    sum_linear *= n / static_cast<double>(quiet.size());
    sheet.put("linear_variance", ok(std::log(sum_linear / n)));
    sheet.put_unsteady("largest_linear_variance",
                       ok(std::log(static_cast<double>(top_linear) / (sum_linear / n))));

    // The noisiest half per cent: two levels that alternate (flat law, memory) or are drawn anew (no memory).
    const std::size_t few = std::min(std::max<std::size_t>(quiet.size() / 200, 4), quiet.size() - 1);
    std::vector<std::uint32_t> order = quiet;
    std::nth_element(order.begin(), order.begin() + static_cast<std::ptrdiff_t>(few), order.end(),
                     [&](std::uint32_t a, std::uint32_t b) { return logs[a] > logs[b]; });
    double noisy_variance = 0, noisy_kurtosis = 0, noisy_lag1 = 0, noisy_lag2 = 0;
    for (std::size_t i = 0; i < few; ++i) {
      noisy_variance += static_cast<double>(logs[order[i]]) / static_cast<double>(few);
      noisy_kurtosis += static_cast<double>(kurtosis[order[i]]) / static_cast<double>(few);
      noisy_lag1 += static_cast<double>(lag1[order[i]]) / static_cast<double>(few);
      noisy_lag2 += static_cast<double>(lag2[order[i]]) / static_cast<double>(few);
    }
    sheet.put_unsteady("noisiest_few.variance", ok(noisy_variance));
    sheet.kind({"kurtosis_map", "intensity", "whole frame"});
    sheet.put_unsteady("noisiest_few.kurtosis", ok(std::log(noisy_kurtosis)));
    sheet.kind({"lag_correlation", "time", "whole frame"});
    sheet.put_unsteady("noisiest_few.lag_1", ok(noisy_lag1));
    sheet.put_unsteady("noisiest_few.lag_2", ok(noisy_lag2));
    sheet.put("lag_1", ok(total_lag1 / total_square * static_cast<double>(n1)));
    sheet.put("lag_2", ok(total_lag2 / total_square * static_cast<double>(n2)));
    const auto tails = [&](std::string_view name, const std::vector<float>& map) {
      const double sigma = 1 / std::sqrt(std::max(frames, 1.0));
      Outliers outliers;
      double square = 0;
      for (const std::uint32_t p : quiet) {
        const double v = static_cast<double>(map[p]) / sigma;
        if (std::abs(v) > 2) outliers.take(v);
        square += v * v;
      }
      sheet.put_outliers(name, "above", ok(outliers.above));
      sheet.put_unsteady(name, "largest", ok(outliers.highest));
      sheet.put_unsteady(name, "spread", ok(std::log(square / static_cast<double>(quiet.size()))));
      sheet.put_outliers(name, "below", ok(outliers.below));
    };
    tails("lag_1_map", lag1);
    sheet.kind({"kurtosis_map", "intensity", "whole frame"});
    among_peers(kurtosis);
    std::vector<float> centred;
    centred.reserve(quiet.size());
    for (const std::uint32_t p : quiet) centred.push_back(kurtosis[p]);
    const double kurtosis_spread = core_spread(centred);
    Outliers shapes;
    for (const float v : centred) shapes.take(static_cast<double>(v) / kurtosis_spread);
    sheet.put("kurtosis", ok(std::log(total_fourth / total_square / total_square * n * frames)));
    sheet.put_outliers("flat_pixels", {}, ok(shapes.below));
    sheet.put_outliers("peaked_pixels", {}, ok(shapes.above));
    if (layout_.packed.empty()) return;
    // The noise left over a site's fit, by the share of its light.
    float peak = 0;
    for (int r = 0; r < layout_.shape.rows; ++r)
      for (int c = 0; c < layout_.shape.columns; ++c) peak = std::max(peak, layout_.site_light.at(r, c));
    constexpr float steps[] = {.003f, .01f, .03f, .1f, .3f};
    double bin_sum[6] = {}, bin_count[6] = {};
    std::size_t i = 0;
    for (int r = 0; r < layout_.shape.rows; ++r)
      for (int c = 0; c < layout_.shape.columns; ++c, ++i) {
        std::size_t bin = 0;
        while (bin < 5 && layout_.site_light.at(r, c) > steps[bin] * peak) ++bin;
        bin_sum[bin] += static_cast<double>(linear[i]);
        ++bin_count[bin];
      }
    sheet.kind({"mean_variance_curve", "intensity", "whole frame"});
    constexpr std::string_view names[] = {"0", "1", "2", "3", "4", "5"};
    for (std::size_t k = 0; k < 6; ++k)
      sheet.put_unsteady("by_light", names[k], ok(std::log(bin_sum[k] / bin_count[k])));
  }

 private:
  const Layout& layout_;
  /// Takes the mean over pixels with as much light away from each value.
  void among_peers(std::vector<float>& values) const {
    std::array<double, peers> sum{};
    for (std::size_t i = 0; i < values.size(); ++i) sum[peer_[i]] += static_cast<double>(values[i]);
    std::array<float, peers> mean{};
    for (std::size_t k = 0; k < peers; ++k)
      mean[k] = peer_count_[k] > 0 ? static_cast<float>(sum[k] / peer_count_[k]) : 0.0f;
    for (std::size_t i = 0; i < values.size(); ++i) values[i] -= mean[peer_[i]];
  }

  static constexpr std::size_t peers = 16;
  std::vector<std::uint8_t> peer_;  // of each pixel: octaves of light below the brightest
  std::array<double, peers> peer_count_{};
  std::vector<std::uint32_t> quiet_;  // indices into a frame
  Halves<Sums> sums_;
};

}  // namespace

std::unique_ptr<Family> make_temporal_maps(const Layout& layout) {
  return std::make_unique<TemporalMaps>(layout);
}

}  // namespace atomcam::analysis
