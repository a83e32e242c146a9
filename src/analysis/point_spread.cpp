// The image of a site: how the pixels around it follow its brightness from frame to frame, against the share
// that the model expects; the array's position and the width of its sites' images from frame to frame, and
// whether fainter atoms' images are wider; the noise in a site's image.

#include <algorithm>
#include <cmath>

#include "analysis/distortion.hpp"
#include "analysis/products.hpp"
#include "analysis/series.hpp"
#include "analysis/shape_templates.hpp"
#include "analysis/stamp_templates.hpp"

namespace atomcam::analysis {
namespace {

/// Brightness from which a site counts as occupied, up to which as empty; classes of occupied sites.
constexpr double occupied_from = 0.65, empty_to = 0.25, dim_to = 0.92, bright_from = 1.08;

/// How the pixels of each column, or row, answer to the light of the sites, beside the model.
class LineResponse {
 public:
  explicit LineResponse(int lines) : product_(static_cast<std::size_t>(lines)), norm_(product_.size()) {}

  /// A pixel's answer and what the model expects of it, weighed by its noise; norm: the variance of the
  /// product by noise.
  void add(int line, double product, double norm) {
    product_[static_cast<std::size_t>(line)] += product;
    norm_[static_cast<std::size_t>(line)] += norm;
  }
  void put(Sheet& sheet, std::string_view lines, bool enough) const {
    double square = 0, count = 0, largest = 0, odd = 0, odd_norm = 0;
    for (std::size_t k = 0; k < product_.size(); ++k) {
      if (!(norm_[k] > 0)) continue;
      const double z = product_[k] / std::sqrt(norm_[k]);
      square += z * z, ++count;
      largest = std::max(largest, std::abs(z));
      odd += k % 2 ? product_[k] : -product_[k];
      odd_norm += norm_[k];
    }
    const auto ok = [&](double value) { return enough && count > 0 ? value : not_a_number; };
    sheet.kind({lines == "rows" ? "row_means" : "column_means", "space", lines});
    sheet.put(lines, "response_variance", ok(std::log(square / count)));
    sheet.put_unsteady(lines, "response_largest", ok(std::log(largest)));
    sheet.put(lines, "response_period_2", ok(std::asinh(odd / std::sqrt(odd_norm) / 4)));
  }

 private:
  std::vector<double> product_, norm_;
};

/// How much farther off its share a site's oddest pixel is than the pixels around it are, in deviations of
/// its noise. A change of the image's shape does this to every site, a pixel that hardly answers to one.
double loneliest(const std::vector<double>& deviation, const PackedSite& packed) {
  const auto at = [&](int r, int c) {
    return r < 0 || c < 0 || r >= packed.rows || c >= packed.columns
               ? 0.0
               : std::abs(
                     deviation[packed.width * static_cast<std::size_t>(r) + static_cast<std::size_t>(c)]);
  };
  double farthest = 0;
  for (int r = 0; r < packed.rows; ++r)
    for (int c = 0; c < packed.columns; ++c) {
      double around = 0;
      for (int y = r - 1; y <= r + 1; ++y)
        for (int x = c - 1; x <= c + 1; ++x)
          if (y != r || x != c) around = std::max(around, at(y, x));
      farthest = std::max(farthest, at(r, c) - around);
    }
  return farthest;
}

constexpr int rings = 8, tails = 4;
enum Class { empty, dim, usual, bright, class_count };

/// How much of the widening there is in the images of single atoms, by their brightness: if all are as wide,
/// more than expected or not, a straight line.
struct WidthCurve {
  std::array<double, 5> of_brightness{};  // sums of its powers
  std::array<double, 3> of_width{};       // of the widening times its powers

  void add(double b, double widening, double norm) {
    double power = 1;
    for (std::size_t k = 0; k < of_brightness.size(); ++k, power *= b) {
      of_brightness[k] += norm * power;
      if (k < of_width.size()) of_width[k] += widening * power;
    }
  }
  WidthCurve& operator+=(const WidthCurve& other) {
    for (std::size_t k = 0; k < of_brightness.size(); ++k) of_brightness[k] += other.of_brightness[k];
    for (std::size_t k = 0; k < of_width.size(); ++k) of_width[k] += other.of_width[k];
    return *this;
  }
  /// Least squares of the square, beside constant and line.
  double curvature() const {
    const auto moment = [this](std::size_t k) { return of_brightness[k] / of_brightness[0]; };
    const double mean = moment(1), variance = moment(2) - mean * mean,
                 third = moment(3) - 3 * mean * moment(2) + 2 * mean * mean * mean,
                 fourth = moment(4) - 4 * mean * moment(3) + 6 * mean * mean * moment(2) -
                          3 * mean * mean * mean * mean,
                 line = third / variance;
    const double product =
        of_width[2] - (2 * mean + line) * of_width[1] + (mean * mean + line * mean - variance) * of_width[0];
    return product / of_brightness[0] / (fourth - variance * variance - third * line);
  }
};

struct Sums {
  Floats response;                 // all sites' stamps one after the other
  std::vector<double> change2;     // per site: sum of the squared changes of brightness
  std::vector<double> core, wing;  // per site, occupied frames
  std::vector<double> occupied;    // per site: their number
  std::array<double, class_count> class_core{}, class_wing{}, class_cube{}, class_number{};
  WidthCurve width;
  Sums& operator+=(const Sums& other) {
    const auto add = [](auto& to, const auto& from) {
      for (std::size_t i = 0; i < to.size(); ++i) to[i] += from[i];
    };
    add(response, other.response), add(change2, other.change2), add(core, other.core), add(wing, other.wing),
        add(occupied, other.occupied);
    add(class_core, other.class_core), add(class_wing, other.class_wing), add(class_cube, other.class_cube),
        add(class_number, other.class_number);
    width += other.width;
    return *this;
  }
};

class PointSpread : public Family {
 public:
  explicit PointSpread(const Layout& layout) : layout_(layout) {
    std::size_t size = 0;
    double x_sum = 0, y_sum = 0, extent = 1;
    for (const SiteImage& site : layout.sites) x_sum += site.x_px, y_sum += site.y_px;
    x_sum /= static_cast<double>(layout.sites.size()), y_sum /= static_cast<double>(layout.sites.size());
    for (const SiteImage& site : layout.sites)
      extent = std::max({extent, std::abs(site.x_px - x_sum), std::abs(site.y_px - y_sum)});
    for (std::size_t s = 0; s < layout.packed.size(); ++s) {
      const PackedSite& packed = layout.packed[s];
      begin_.push_back(size);
      size += packed.share.size();
      field_x_.push_back((layout.sites[s].x_px - x_sum) / extent);
      field_y_.push_back((layout.sites[s].y_px - y_sum) / extent);
      templates_.emplace_back(layout, packed);
      shapes_.emplace_back(layout, packed);
    }
    const std::size_t sites = layout.packed.size();
    Sums zero;
    zero.response.resize(size);
    zero.change2.resize(sites), zero.core.resize(sites), zero.wing.resize(sites), zero.occupied.resize(sites);
    sums_ = Halves<Sums>(zero);
  }

  void second_look(const SecondLook& look) override {
    Sums& sums = sums_[look.part];
    double x = 0, x_norm = 0, y = 0, y_norm = 0, width = 0, width_norm = 0;
    for (std::size_t s = 0; s < layout_.packed.size(); ++s) {
      const PackedSite& packed = layout_.packed[s];
      const StampTemplates& templates = templates_[s];
      const double b = static_cast<double>(look.brightness[s]);
      const float change = look.brightness[s] - look.mean_brightness[s];
      const StampSums stamp =
          add_stamp(packed, templates, look.light.all() + packed.offset, look.mean.all() + packed.offset,
                    layout_.shape.stride, change, sums.response.data() + begin_[s]);
      sums.change2[s] += static_cast<double>(change) * static_cast<double>(change);
      const int k = b < empty_to        ? empty
                    : b < occupied_from ? class_count
                    : b < dim_to        ? dim
                    : b < bright_from   ? usual
                                        : bright;
      sums.width.add(b, static_cast<double>(stamp.atom_width), templates.norm_atom_width);
      if (k == class_count) continue;
      const auto index = static_cast<std::size_t>(k);
      sums.class_core[index] += static_cast<double>(stamp.core);
      sums.class_wing[index] += static_cast<double>(stamp.wing);
      sums.class_cube[index] += static_cast<double>(stamp.cube);
      ++sums.class_number[index];
      if (k == empty) continue;
      sums.core[s] += static_cast<double>(stamp.core);
      sums.wing[s] += static_cast<double>(stamp.wing);
      ++sums.occupied[s];
      // A shift by d takes d * slope away.
      x -= b * static_cast<double>(stamp.x), x_norm += b * b * templates.norm_x;
      y -= b * static_cast<double>(stamp.y), y_norm += b * b * templates.norm_y;
      width += b * static_cast<double>(stamp.width), width_norm += b * b * templates.norm_width;
    }
    x_.resize(look.frame + 1, not_a_number);
    y_.resize(look.frame + 1, not_a_number);
    x_white_.resize(look.frame + 1);
    width_.resize(look.frame + 1, not_a_number);
    width_white_.resize(look.frame + 1);
    if (width_norm > 0) {
      width_[look.frame] = width / width_norm;
      width_white_[look.frame] = 1 / width_norm;
    }
    if (x_norm > 0 && y_norm > 0) {
      x_[look.frame] = x / x_norm;
      y_[look.frame] = y / y_norm;
      x_white_[look.frame] = 1 / x_norm;
    }
  }

  void summarise(Part which, const Record& record, Sheet& sheet) const override {
    const std::size_t sites = layout_.packed.size();
    const Sums sums = sums_.of(which);
    const bool enough = record.count(which) >= 4;
    const auto ok = [&](double value) { return enough ? value : not_a_number; };

    // Every site's image against its share.
    std::vector<OfImageChange<double>> changes(sites);
    std::array<double, rings> ring_sum{}, ring_norm{};
    std::array<double, tails> tail_x{}, tail_y{};
    std::vector<double> lonely(sites);
    std::vector<double> deviation;
    LineResponse columns(layout_.shape.columns), rows(layout_.shape.rows);
    double all_change = 0, misfit = 0, misfit_wing = 0, misfit_count = 0, wing_count = 0;
    for (std::size_t s = 0; s < sites; ++s) {
      const PackedSite& packed = layout_.packed[s];
      const float* response = sums.response.data() + begin_[s];
      const double change2 = sums.change2[s] + 1e-12;
      all_change += change2;
      deviation.assign(packed.share.size(), 0.0);
      for (int r = 0; r < packed.rows; ++r)
        for (int c = 0; c < packed.columns; ++c) {
          const std::size_t i = packed.width * static_cast<std::size_t>(r) + static_cast<std::size_t>(c);
          const double e = static_cast<double>(response[i]);  // times change2: counts of a whole atom
          const double scale = static_cast<double>(layout_.inverse_scale_at(packed, r, c));
          const double w = scale * scale, x = layout_.sites[s].left + c - layout_.sites[s].x_px,
                       y = layout_.sites[s].top + r - layout_.sites[s].y_px;
          const double distance = std::sqrt(x * x + y * y);
          if (const int k = static_cast<int>(distance); k < rings) {
            ring_sum[static_cast<std::size_t>(k)] += e;
            ring_norm[static_cast<std::size_t>(k)] += change2;
          }
          const double share = static_cast<double>(packed.share[i]), expected = share * w;
          columns.add(layout_.sites[s].left + c, e * expected, share * expected * change2);
          rows.add(layout_.sites[s].top + r, e * expected, share * expected * change2);
          const double z2 = e * e * w / change2;
          deviation[i] = e * std::sqrt(w / change2);
          if (packed.core[i] > 0)
            misfit += z2, ++misfit_count;
          else
            misfit_wing += z2, ++wing_count;
          for (int d = 2; d < 2 + tails; ++d) {
            if (std::abs(y) < 1.5 && std::abs(std::abs(x) - d) < 0.5)
              tail_x[static_cast<std::size_t>(d - 2)] += x > 0 ? e : -e;
            if (std::abs(x) < 1.5 && std::abs(std::abs(y) - d) < 0.5)
              tail_y[static_cast<std::size_t>(d - 2)] += y > 0 ? e : -e;
          }
        }
      for (std::size_t k = 0; k < image_change_names.size(); ++k) {
        const Floats& weighed = shapes_[s].weighed[k];
        const double product = sum_of_products(weighed.size(), response, weighed.data());
        changes[s][k] = product / shapes_[s].norm[k] / change2;
      }
      lonely[s] = loneliest(deviation, packed);
    }
    sheet.family("point_spread");
    for (std::size_t k = 0; k < image_change_names.size(); ++k) {
      double mean = 0, spread = 0;
      for (std::size_t s = 0; s < sites; ++s) mean += changes[s][k] * sums.change2[s] / all_change;
      sheet.kind({k >= width_x && k <= diagonal ? "point_spread_width" : "point_spread_field", "shape",
                  "all sites"});
      sheet.put(image_change_names[k], "mean", ok(mean));
      if (k > diagonal) continue;
      double fx = 0, nx = 0, fy = 0, ny = 0, f2 = 0, n2 = 0, radius2 = 0;
      for (std::size_t s = 0; s < sites; ++s)
        radius2 += (field_x_[s] * field_x_[s] + field_y_[s] * field_y_[s]) * sums.change2[s] / all_change;
      for (std::size_t s = 0; s < sites; ++s) {
        const double d = changes[s][k] - mean, w = sums.change2[s],
                     q = field_x_[s] * field_x_[s] + field_y_[s] * field_y_[s] - radius2;
        spread += d * d * w * shapes_[s].norm[k];
        fx += d * w * field_x_[s], nx += w * field_x_[s] * field_x_[s];
        fy += d * w * field_y_[s], ny += w * field_y_[s] * field_y_[s];
        f2 += d * w * q, n2 += w * q * q;
      }
      sheet.kind({"point_spread_field", "shape", "all sites"});
      sheet.put_chi_square(image_change_names[k], "spread", ok(spread), static_cast<double>(sites) - 1);
      sheet.put(image_change_names[k], "along_x", ok(fx / nx));
      sheet.put(image_change_names[k], "along_y", ok(fy / ny));
      sheet.put(image_change_names[k], "radial", ok(f2 / n2));
      if (k > shift_y) continue;
      std::vector<double> shifts;
      for (std::size_t s = 0; s < sites; ++s) shifts.push_back(changes[s][k]);
      sheet.put(image_change_names[k], "smooth",
                ok(log_distortion(field_x_, field_y_, sums.change2, shifts)));
    }
    sheet.kind({"point_spread_halo", "shape", "around sites"});
    constexpr std::string_view ring_names[] = {"0", "1", "2", "3", "4", "5", "6", "7"};
    for (std::size_t k = 0; k < rings; ++k) sheet.put("ring", ring_names[k], ok(ring_sum[k] / ring_norm[k]));
    sheet.kind({"trailing_charge", "shape", "around sites"});
    constexpr std::string_view tail_names[] = {"2", "3", "4", "5"};
    for (std::size_t k = 0; k < tails; ++k) {
      sheet.put("right_against_left", tail_names[k], ok(tail_x[k] / all_change));
      sheet.put("down_against_up", tail_names[k], ok(tail_y[k] / all_change));
    }
    sheet.kind({"point_spread_width", "shape", "all sites"});
    sheet.put("misfit.core", ok(std::log(misfit / misfit_count)));
    sheet.put("misfit.wing", ok(std::log(misfit_wing / wing_count)));
    sheet.kind({"mean_variance_curve", "space", "around sites"});
    std::sort(lonely.begin(), lonely.end());
    sheet.put_unsteady("pixels", "loneliest", ok(std::log(lonely.back() / lonely[sites / 2])));
    columns.put(sheet, "columns", enough);
    rows.put(sheet, "rows", enough);

    // Noise in the image against brightness.
    sheet.family("image_noise");
    sheet.kind({"mean_variance_curve", "intensity", "occupied sites"});
    const auto per = [&](const std::array<double, class_count>& sum, Class k) {
      return std::log(sum[k] / sums.class_number[k]);
    };
    const double occupied = sums.class_number[dim] + sums.class_number[usual] + sums.class_number[bright];
    const double core = sums.class_core[dim] + sums.class_core[usual] + sums.class_core[bright];
    const double wing = sums.class_wing[dim] + sums.class_wing[usual] + sums.class_wing[bright];
    const double cube = sums.class_cube[dim] + sums.class_cube[usual] + sums.class_cube[bright];
    sheet.put("occupied.core", ok(std::log(core / occupied)));
    sheet.put("occupied.wing", ok(std::log(wing / occupied)));
    sheet.put("occupied.skewness", ok(cube / std::pow(core, 1.5) * std::sqrt(occupied)));
    sheet.put("empty.core", ok(per(sums.class_core, empty)));
    sheet.put("empty.wing", ok(per(sums.class_wing, empty)));
    sheet.put("bright_against_dim.core", ok(per(sums.class_core, bright) - per(sums.class_core, dim)));
    sheet.put("bright_against_dim.wing", ok(per(sums.class_wing, bright) - per(sums.class_wing, dim)));
    double site_spread = 0, site_count = 0, log_mean = 0;
    std::vector<double> logs(sites, not_a_number);
    for (std::size_t s = 0; s < sites; ++s)
      if (sums.occupied[s] > 1)
        logs[s] = std::log(sums.core[s] / sums.occupied[s]), log_mean += logs[s], ++site_count;
    log_mean /= site_count;
    for (const double v : logs)
      if (v == v) site_spread += (v - log_mean) * (v - log_mean);
    sheet.kind({"mean_variance_curve", "site", "occupied sites"});
    sheet.put("by_site.spread", ok(site_count > 1 ? std::log(site_spread / (site_count - 1)) : not_a_number));

    sheet.family("position");
    sheet.kind({"centroid_series", "time", "all sites"});
    std::vector<double> x = x_, y = y_;
    x.resize(record.frames, not_a_number), y.resize(record.frames, not_a_number);
    double white = 0, white_count = 0, xy = 0, xx = 0, yy = 0;
    for (std::size_t n = 0; n < record.frames; ++n)
      if (record.holds(which, n) && std::isfinite(x[n]) && std::isfinite(y[n])) {
        white += x_white_[n], ++white_count;
        xy += x[n] * y[n], xx += x[n] * x[n], yy += y[n] * y[n];
      }
    white /= white_count;
    put_series(sheet, "x", x, record, which, white);
    put_series(sheet, "y", y, record, which, white);
    sheet.put("together", ok(xy / std::sqrt(xx * yy)));

    sheet.family("focus");
    sheet.kind({"point_spread_width", "time", "all sites"});
    std::vector<double> width = width_;
    width.resize(record.frames, not_a_number);
    double width_white = 0, width_count = 0;
    for (std::size_t n = 0; n < record.frames; ++n)
      if (record.holds(which, n) && std::isfinite(width[n])) width_white += width_white_[n], ++width_count;
    put_series(sheet, "width", width, record, which, width_white / width_count);
    sheet.kind({"point_spread_width", "intensity", "all sites"});
    sheet.put("width", "against_brightness", ok(sums.width.curvature()));
  }

 private:
  const Layout& layout_;
  std::vector<std::size_t> begin_;
  std::vector<StampTemplates> templates_;
  std::vector<ShapeTemplates> shapes_;
  std::vector<double> field_x_, field_y_;
  std::vector<double> x_, y_, x_white_, width_, width_white_;  // of every frame
  Halves<Sums> sums_;
};

}  // namespace

std::unique_ptr<Family> make_point_spread(const Layout& layout) {
  return std::make_unique<PointSpread>(layout);
}

}  // namespace atomcam::analysis
