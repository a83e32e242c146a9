// The mean frame: slopes, lines, outliers, waves.

#include <algorithm>
#include <cmath>

#include "analysis/family.hpp"
#include "analysis/fourier.hpp"
#include "analysis/robust.hpp"
#include "analysis/spectrum_shapes.hpp"

namespace atomcam::analysis {
namespace {

class StaticMaps : public Family {
 public:
  explicit StaticMaps(const Layout& layout) : layout_(layout) {
    const int rows = layout.shape.rows, columns = layout.shape.columns;
    for (int r = 0; r < rows; ++r) y_.push_back((2.0 * r + 1) / rows - 1);
    for (int c = 0; c < columns; ++c) x_.push_back((2.0 * c + 1) / columns - 1);
    weight_.reserve(layout.shape.pixels());
    for (int r = 0; r < rows; ++r)
      for (int c = 0; c < columns; ++c) {
        const float weight = layout.quiet.at(r, c);
        weight_.push_back(weight);
        const double a = static_cast<double>(weight);
        norm_ += a * a;
        const auto shapes = shapes_at(r, c);
        for (std::size_t k = 0; k < shape_count; ++k) shape_norm_[k] += a * a * shapes[k] * shapes[k];
      }
  }

  void summarise(Part which, const Record& record, Sheet& sheet) const override {
    const double frames = static_cast<double>(record.count(which));
    const PlaneShape& shape = layout_.shape;
    const auto mean_of = [&](const std::array<Plane, 2>& sums, auto scale) {
      std::vector<float> map(shape.pixels());
      std::size_t i = 0;
      for (int r = 0; r < shape.rows; ++r)
        for (int c = 0; c < shape.columns; ++c, ++i) {
          const float sum = which == Part::whole ? sums[0].at(r, c) + sums[1].at(r, c)
                                                 : sums[which == Part::first ? 0 : 1].at(r, c);
          map[i] = frames > 0 ? sum / static_cast<float>(frames) * scale(r, c) : 0.0f;
        }
      return map;
    };
    // On the scale of the read noise, where a single electron counts little: offsets.
    sheet.family("static_offsets");
    summarise_map(mean_of(record.clipped_sum, [&](int r, int c) { return layout_.quiet.at(r, c); }), frames,
                  1, sheet, true);
    // All charge: background, dark current, hot pixels.
    sheet.family("static_charge");
    summarise_map(mean_of(record.sum, [&](int r, int c) { return layout_.quiet.at(r, c); }), frames,
                  layout_.white, sheet, false);
  }

 private:
  /// Five shapes of a slope, each by itself: nearly orthogonal on a frame.
  enum { x1, y1, xx, yy, xy, shape_count };
  std::array<double, shape_count> shapes_at(int row, int column) const {
    const double y = y_[static_cast<std::size_t>(row)], x = x_[static_cast<std::size_t>(column)];
    return {x, y, x * x - 1.0 / 3, y * y - 1.0 / 3, x * y};
  }

  /// `map` [pixel], multiplied by the quiet weight; `sigma`: expected noise of one frame.
  void summarise_map(std::vector<float> map, double frames, double sigma, Sheet& sheet, bool all) const {
    const int rows = layout_.shape.rows, columns = layout_.shape.columns;
    const auto width = static_cast<std::size_t>(columns);
    const bool enough = frames >= 1;
    const auto ok = [&](double value) { return enough ? value : not_a_number; };
    const std::vector<float>& weight = weight_;
    const double norm = norm_;
    double sum = 0;
    std::size_t i = 0;
    for (; i < map.size(); ++i) sum += static_cast<double>(map[i]) * static_cast<double>(weight[i]);
    const double mean = sum / norm;
    sheet.kind({"mean_map", "space", "whole frame"});
    sheet.put("mean", ok(mean / sigma));
    double shape_sum[shape_count] = {};
    i = 0;
    for (int r = 0; r < rows; ++r)
      for (int c = 0; c < columns; ++c, ++i) {
        const double a = static_cast<double>(weight[i]), u = (static_cast<double>(map[i]) - mean * a) * a;
        map[i] = static_cast<float>(static_cast<double>(map[i]) - mean * a);
        const auto shapes = shapes_at(r, c);
        for (std::size_t k = 0; k < shape_count; ++k) shape_sum[k] += u * shapes[k];
      }
    double amplitude[shape_count];
    for (std::size_t k = 0; k < shape_count; ++k) amplitude[k] = shape_sum[k] / shape_norm_[k];
    const double scale = sigma / std::sqrt(std::max(frames, 1.0) * norm);  // of an amplitude by noise
    const auto slope = [&](double value) { return ok(std::asinh(value / scale / 4)); };
    sheet.put("gradient_x", slope(amplitude[x1]));
    sheet.put("gradient_y", slope(amplitude[y1]));
    sheet.put("radial", slope(amplitude[xx] + amplitude[yy]));
    if (all) sheet.put("saddle", slope(amplitude[xx] - amplitude[yy]));
    if (all) sheet.put("diagonal", slope(amplitude[xy]));
    i = 0;
    for (int r = 0; r < rows; ++r)
      for (int c = 0; c < columns; ++c, ++i) {
        const double y = y_[static_cast<std::size_t>(r)], x = x_[static_cast<std::size_t>(c)];
        map[i] -= weight[i] * static_cast<float>(amplitude[x1] * x + amplitude[y1] * y +
                                                 amplitude[xx] * (x * x - 1.0 / 3) +
                                                 amplitude[yy] * (y * y - 1.0 / 3) + amplitude[xy] * x * y);
      }
    const double spread = core_spread(map);
    sheet.put("spread", ok(std::log(spread * std::sqrt(std::max(frames, 1.0)) / sigma)));
    Outliers outliers;
    const float inverse = spread > 0 ? static_cast<float>(1 / spread) : 0.0f;
    for (float& v : map) {
      v *= inverse;
      // Some pixel is beyond 2 in every stack; beyond 3, in a small one, not.
      if (std::abs(v) > 2) outliers.take(static_cast<double>(v));
      v = std::clamp(v, -4.0f, 4.0f);
    }
    sheet.put_outliers("above", {}, ok(outliers.above));
    if (all) sheet.put_outliers("below", {}, ok(outliers.below));
    sheet.put_unsteady("highest", ok(std::log(outliers.highest + 1)));
    if (all) sheet.put_unsteady("lowest", ok(std::log(1 - outliers.lowest)));
    // Lines, each in units of its own noise.
    const auto lines = [&](bool along_rows, std::string_view name, std::string_view observable) {
      const auto n = static_cast<std::size_t>(along_rows ? rows : columns);
      std::vector<double> profile(n), square(n);
      for (int r = 0; r < rows; ++r)
        for (int c = 0; c < columns; ++c) {
          const std::size_t k = static_cast<std::size_t>(r) * width + static_cast<std::size_t>(c);
          const auto line = static_cast<std::size_t>(along_rows ? r : c);
          profile[line] += static_cast<double>(map[k]) * static_cast<double>(weight[k]);
          square[line] += static_cast<double>(weight[k]) * static_cast<double>(weight[k]);
        }
      double variance = 0, next = 0, re4 = 0, im4 = 0, re8 = 0, im8 = 0, odd = 0, largest = 0;
      for (std::size_t k = 0; k < n; ++k) {
        profile[k] /= std::sqrt(square[k] + 1e-9);
        variance += profile[k] * profile[k];
        if (k) next += profile[k] * profile[k - 1];
        odd += k % 2 ? profile[k] : -profile[k];
        constexpr double c8[8] = {1, .70710678, 0, -.70710678, -1, -.70710678, 0, .70710678};
        re4 += profile[k] * c8[2 * k % 8], im4 += profile[k] * c8[(2 * k + 6) % 8];
        re8 += profile[k] * c8[k % 8], im8 += profile[k] * c8[(k + 6) % 8];
        largest = std::max(largest, std::abs(profile[k]));
      }
      sheet.kind({observable, "space", along_rows ? "rows" : "columns"});
      sheet.put(name, "variance", ok(std::log(variance / static_cast<double>(n))));
      sheet.put(name, "first", ok(std::asinh(profile.front() / 4)));
      sheet.put(name, "last", ok(std::asinh(profile.back() / 4)));
      sheet.put(name, "next", ok(next / variance));
      sheet.put_unsteady(name, "largest", ok(std::log(largest)));
      const double root = std::sqrt(static_cast<double>(n));
      sheet.put(name, "period_2", ok(std::asinh(odd / root / 4)));
      sheet.put(name, "period_4", ok(std::log((re4 * re4 + im4 * im4) / static_cast<double>(n) + 0.3)));
      sheet.put(name, "period_8", ok(std::log((re8 * re8 + im8 * im8) / static_cast<double>(n) + 0.3)));
    };
    if (!all) return;
    {
      lines(true, "rows", "mean_map");
      lines(false, "columns", "column_means");
    }
    // Neighbours.
    struct Step {
      std::string_view name;
      int rows, columns;
    };
    constexpr Step steps[] = {{"right_1", 0, 1}, {"down_1", 1, 0}, {"diagonal", 1, 1}};
    double own = 0;
    for (const float v : map) own += static_cast<double>(v) * static_cast<double>(v);
    sheet.kind({"mean_map", "space", "whole frame"});
    for (const Step& step : steps) {
      double product = 0;
      for (int r = 0; r + step.rows < rows; ++r) {
        const float* a = map.data() + static_cast<std::size_t>(r) * width;
        const float* b =
            a + static_cast<std::size_t>(step.rows) * width + static_cast<std::size_t>(step.columns);
        float lanes[16] = {};
        int c = 0;
        for (; c + 16 + step.columns <= columns; c += 16)
          for (int l = 0; l < 16; ++l) lanes[l] += a[c + l] * b[c + l];
        for (; c + step.columns < columns; ++c) product += static_cast<double>(a[c] * b[c]);
        for (const float lane : lanes) product += static_cast<double>(lane);
      }
      sheet.put("neighbours", step.name, ok(product / own));
    }
    // Two amplifiers: steps between halves on top of the slopes, and their noise.
    double quarter[2][2] = {}, quarter_square[2][2] = {};
    i = 0;
    for (int r = 0; r < rows; ++r) {
      double left = 0, right = 0, left_square = 0, right_square = 0;
      for (int c = 0; c < columns; ++c, ++i) {
        const double v = static_cast<double>(map[i]);
        (2 * c >= columns ? right : left) += v;
        (2 * c >= columns ? right_square : left_square) += v * v;
      }
      quarter[2 * r >= rows][0] += left, quarter[2 * r >= rows][1] += right;
      quarter_square[2 * r >= rows][0] += left_square, quarter_square[2 * r >= rows][1] += right_square;
    }
    const double root = 4 * std::sqrt(static_cast<double>(map.size()));
    sheet.put("left_right",
              ok(std::asinh((quarter[0][0] + quarter[1][0] - quarter[0][1] - quarter[1][1]) / root)));
    sheet.put("top_bottom",
              ok(std::asinh((quarter[0][0] + quarter[0][1] - quarter[1][0] - quarter[1][1]) / root)));
    if (all) {
      sheet.put("left_right_spread", ok(std::log((quarter_square[0][0] + quarter_square[1][0]) /
                                                 (quarter_square[0][1] + quarter_square[1][1]))));
      sheet.put("top_bottom_spread", ok(std::log((quarter_square[0][0] + quarter_square[0][1]) /
                                                 (quarter_square[1][0] + quarter_square[1][1]))));
    }
    if (all) put_seams(map, enough, sheet);
    ImageSpectrum spectrum(rows, columns);
    std::copy(map.begin(), map.end(), spectrum.image().begin());
    spectrum.transform();
    std::vector<float> power(spectrum.spectrum().size());
    if (enough) spectrum.add_power(power);
    sheet.kind({"mean_map", "frequency", "whole frame"});
    put_spectrum(sheet, power, rows, columns);
  }

  /// Steps where two amplifiers' halves meet: each side's straight line, led on to the seam. A wave that sets
  /// the halves apart is smooth there. `map` [pixel]: no slopes, in units of its own noise.
  void put_seams(const std::vector<float>& map, bool enough, Sheet& sheet) const {
    const int rows = layout_.shape.rows, columns = layout_.shape.columns;
    const auto step = [&](std::string_view name, bool across_columns, bool second) {
      const int length = across_columns ? columns : rows, width = across_columns ? rows : columns;
      const int reach = std::max(2, length / 16), middle = length / 2;
      const int from = second ? width / 2 : 0, to = second ? width : width / 2;
      double sum = 0, square = 0;
      for (int along = middle - reach; along < middle + reach; ++along) {
        const double away = std::abs(along + 0.5 - middle), centre = 0.5 * reach;
        const double weight =
            (1 - 12 * centre * (away - centre) / (reach * reach - 1)) * (along < middle ? -1 : 1) / reach;
        square += weight * weight * (to - from);
        for (int k = from; k < to; ++k) {
          const int r = across_columns ? k : along, c = across_columns ? along : k;
          sum += weight *
                 static_cast<double>(map[static_cast<std::size_t>(r) * static_cast<std::size_t>(columns) +
                                         static_cast<std::size_t>(c)]);
        }
      }
      sheet.put("seam", name, enough ? std::asinh(sum / std::sqrt(square) / 4) : not_a_number);
    };
    step("columns_top", true, false);
    step("columns_bottom", true, true);
    step("rows_left", false, false);
    step("rows_right", false, true);
  }

  const Layout& layout_;
  std::vector<double> y_, x_;  // of rows and columns, from -1 to 1
  std::vector<float> weight_;  // quiet weight [pixel]
  double norm_ = 0;            // sum of its squares
  std::array<double, shape_count> shape_norm_{};
};

}  // namespace

std::unique_ptr<Family> make_static_maps(const Layout& layout) {
  return std::make_unique<StaticMaps>(layout);
}

}  // namespace atomcam::analysis
