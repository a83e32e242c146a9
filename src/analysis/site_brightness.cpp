// The matrix of brightness, frame by site: its law, what sites have in common, what differs between them.

#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>

#include "analysis/fourier.hpp"
#include "analysis/series.hpp"

namespace atomcam::analysis {
namespace {

constexpr double occupied_above = 0.5;

// Whether a site is bright, empty or between is a coin toss: factors of 0 and 1 instead of branches.
struct Reading {
  double now = 0, bright = 0, residual = 0, empty = 0, above_empty = 0, middle = 0, filled = 0;
};

/// Products of all pairs of sites in one row of the grid (or one column): what a row of traps that fails, or
/// a beam along it that flickers, makes alike. From the lines' sums: pairs are half of what the square of a
/// sum has beyond the sum of squares.
class SameLine {
 public:
  explicit SameLine(const std::vector<std::size_t>& line_of) : line_of_(line_of) {
    for (const std::size_t line : line_of)
      if (line >= sums_.size()) sums_.resize(line + 1);
  }
  void add(const std::vector<Reading>& readings) {
    std::fill(sums_.begin(), sums_.end(), Sums{});
    for (std::size_t s = 0; s < readings.size(); ++s) {
      Sums& sum = sums_[line_of_[s]];
      const Reading& one = readings[s];
      sum.residual += one.residual, sum.residuals += one.residual * one.residual;
      sum.bright += one.bright;
      sum.filled += one.filled, sum.filleds += one.filled * one.filled;
      sum.sites += 1;
    }
    for (const Sums& sum : sums_) {
      light_ += (sum.residual * sum.residual - sum.residuals) / 2;
      light_pairs_ += sum.bright * (sum.bright - 1) / 2;
      occupancy_ += (sum.filled * sum.filled - sum.filleds) / 2;
      pairs_ += sum.sites * (sum.sites - 1) / 2;
    }
  }
  /// In deviations of independent sites, whose variances are given.
  double light(double variance) const { return light_ / std::sqrt(light_pairs_ + 1) / variance; }
  double occupancy(double variance) const { return occupancy_ / std::sqrt(pairs_ + 1) / variance; }

 private:
  struct Sums {
    double residual = 0, residuals = 0, bright = 0, filled = 0, filleds = 0, sites = 0;
  };
  const std::vector<std::size_t>& line_of_;
  std::vector<Sums> sums_;
  double light_ = 0, light_pairs_ = 0, occupancy_ = 0, pairs_ = 0;
};

/// Of how few waves a pattern on the grid is made: the sum of the squares of its spectrum's powers, over the
/// square of their sum. Fringes are made of a few; sites that differ each by itself, of all that there are.
double few_waves(const std::vector<double>& value, const std::vector<std::size_t>& row,
                 const std::vector<std::size_t>& column) {
  // Twice the grid, or waves between its own frequencies would spread over several of them.
  const auto twice = [](const std::vector<std::size_t>& at) {
    return 2 * static_cast<int>(*std::max_element(at.begin(), at.end()) + 1);
  };
  ImageSpectrum spectrum(twice(row), twice(column));
  const auto width = static_cast<std::size_t>(spectrum.columns()),
             half = static_cast<std::size_t>(spectrum.half());
  for (std::size_t s = 0; s < value.size(); ++s)
    spectrum.image()[row[s] * width + column[s]] = static_cast<float>(value[s]);
  spectrum.transform();
  double sum = 0, squares = 0;
  for (std::size_t i = 0; i < spectrum.spectrum().size(); ++i) {
    const std::size_t k = i % half;
    const double count = k == 0 || 2 * k == width ? 1 : 2;  // with its mirror image
    const double power = static_cast<double>(std::norm(spectrum.spectrum()[i]));
    sum += count * power, squares += count * power * power;
  }
  return squares / (sum * sum);
}

class SiteBrightness : public Family {
 public:
  explicit SiteBrightness(const Layout& layout) : layout_(layout) {
    double x_min = 1e30, x_max = -1e30, y_min = 1e30, y_max = -1e30;
    for (const SiteImage& site : layout.sites) {
      x_min = std::min(x_min, site.x_px), x_max = std::max(x_max, site.x_px);
      y_min = std::min(y_min, site.y_px), y_max = std::max(y_max, site.y_px);
    }
    std::map<std::pair<int, int>, std::size_t> at;
    for (std::size_t s = 0; s < layout.sites.size(); ++s) {
      const SiteImage& site = layout.sites[s];
      x_.push_back(x_max > x_min ? 2 * (site.x_px - x_min) / (x_max - x_min) - 1 : 0);
      y_.push_back(y_max > y_min ? 2 * (site.y_px - y_min) / (y_max - y_min) - 1 : 0);
      at[{site.grid_column, site.grid_row}] = s;
      row_.push_back(static_cast<std::size_t>(std::max(0, site.grid_row)));
      column_.push_back(static_cast<std::size_t>(std::max(0, site.grid_column)));
    }
    const auto pairs = [&](int dx, int dy, std::vector<std::pair<std::size_t, std::size_t>>& to) {
      for (std::size_t s = 0; s < layout.sites.size(); ++s)
        if (const auto other = at.find({layout.sites[s].grid_column + dx, layout.sites[s].grid_row + dy});
            other != at.end())
          to.emplace_back(s, other->second);
    };
    pairs(1, 0, near_);
    along_rows_ = near_.size();
    pairs(0, 1, near_);
    pairs(2, 1, far_);
    pairs(1, 2, far_);
  }

  void summarise(Part which, const Record& record, Sheet& sheet) const override {
    sheet.family("sites");
    const std::size_t sites = record.sites();
    const double frames = static_cast<double>(record.count(which));
    const double total = frames * static_cast<double>(sites);
    std::vector<std::size_t> chosen;
    for (std::size_t n = 0; n < record.frames; ++n)
      if (record.holds(which, n)) chosen.push_back(n);
    const bool enough = chosen.size() >= 4 && sites >= 2;
    const auto ok = [&](double value) { return enough ? value : not_a_number; };

    // The histogram.
    constexpr int bins = 24;
    constexpr double from = -0.5, width = 0.1;
    double histogram[bins] = {};
    double empty_sum = 0, empty_square = 0, empty = 0, occupied = 0, partial = 0, double_bright = 0;
    for (const std::size_t n : chosen)
      for (std::size_t s = 0; s < sites; ++s) {
        const double b = record.bright(n, s);
        const auto bin = static_cast<int>(std::clamp(std::floor((b - from) / width), 0.0, bins - 1.0));
        ++histogram[bin];
        if (b < 0.25) empty_sum += b, empty_square += b * b, ++empty;
        if (b > occupied_above) ++occupied;
        partial += b > 0.3 && b < 0.7;
        double_bright += b > 1.6;
      }
    sheet.kind({"site_histogram", "intensity", "all sites"});
    constexpr std::string_view names[bins] = {"m05", "m04", "m03", "m02", "m01", "p00", "p01", "p02",
                                              "p03", "p04", "p05", "p06", "p07", "p08", "p09", "p10",
                                              "p11", "p12", "p13", "p14", "p15", "p16", "p17", "p18"};
    for (int k = 0; k < bins; ++k) sheet.put("histogram", names[k], ok(std::sqrt(histogram[k] / total)));
    const double empty_mean = empty_sum / empty,
                 empty_variance = empty_square / empty - empty_mean * empty_mean;
    sheet.put("empty.mean", ok(empty_mean));
    sheet.put("empty.variance", ok(std::log(empty_variance)));
    sheet.put("partial", ok(std::sqrt(partial / total)));
    sheet.put("more_than_one", ok(std::asinh(double_bright)));
    sheet.put("filling", ok(occupied / total));

    // Occupied sites: the core of the peak, so that losses do not count as noise.
    std::vector<double> site_mean(sites), site_count(sites), site_filled(sites), site_partial(sites),
        site_square(sites), site_empty(sites), site_empties(sites);
    constexpr double core_from = 0.65;
    double m1 = 0, count = 0;
    for (const std::size_t n : chosen)
      for (std::size_t s = 0; s < sites; ++s) {
        const double b = record.bright(n, s);
        site_filled[s] += b > occupied_above;
        site_partial[s] += b > 0.25 && b < core_from;
        if (b < 0.25) site_empty[s] += b, ++site_empties[s];
        if (b <= core_from) continue;
        site_mean[s] += b, ++site_count[s], site_square[s] += b * b;
        m1 += b, ++count;
      }
    m1 /= count;
    double within = 0, within_count = 0;
    for (std::size_t s = 0; s < sites; ++s) {
      site_mean[s] = site_count[s] > 0 ? site_mean[s] / site_count[s] : m1;
      if (site_count[s] > 1)
        within += site_square[s] - site_count[s] * site_mean[s] * site_mean[s],
            within_count += site_count[s] - 1;
    }
    const double noise = within / within_count;  // variance of one reading
    double m2 = 0, m3 = 0, m4 = 0;
    for (const std::size_t n : chosen)
      for (std::size_t s = 0; s < sites; ++s)
        if (const double b = record.bright(n, s); b > core_from) {
          const double d = b - m1;
          m2 += d * d / count, m3 += d * d * d / count, m4 += d * d * d * d / count;
        }
    sheet.kind({"site_brightness", "intensity", "occupied sites"});
    sheet.put("peak.mean", ok(m1));
    sheet.put("peak.variance", ok(std::log(m2)));
    sheet.put("peak.variance_within_sites", ok(std::log(noise)));
    sheet.put("peak.skewness", ok(m3 / std::pow(m2, 1.5)));
    sheet.put("peak.kurtosis", ok(std::log(m4 / (m2 * m2))));

    // Site against site.
    const auto field = [&](std::string_view name, const std::vector<double>& value,
                           const std::vector<double>& error2, Sheet::Kind kind, bool all) {
      sheet.kind(kind);
      double w_sum = 0, mean = 0;
      for (std::size_t s = 0; s < sites; ++s)
        if (error2[s] > 0) w_sum += 1 / error2[s], mean += value[s] / error2[s];
      mean /= w_sum;
      double chi = 0, n = 0, gx = 0, nx = 0, gy = 0, ny = 0, radial = 0, nr = 0, xy = 0, nxy = 0, lr = 0,
             tb = 0, top = 0, bottom = 0, checker = 0;
      std::vector<double> z(sites);
      for (std::size_t s = 0; s < sites; ++s)
        if (error2[s] > 0) {
          const double d = value[s] - mean, w = 1 / error2[s], q = x_[s] * x_[s] + y_[s] * y_[s] - 0.8,
                       root = std::sqrt(w);
          z[s] = d * root;
          chi += d * d * w, ++n;
          gx += d * w * x_[s], nx += w * x_[s] * x_[s], gy += d * w * y_[s], ny += w * y_[s] * y_[s];
          radial += d * w * q, nr += w * q * q, xy += d * w * x_[s] * y_[s],
              nxy += w * x_[s] * x_[s] * y_[s] * y_[s];
          lr += z[s] * (x_[s] > 0 ? 1 : -1), tb += z[s] * (y_[s] > 0 ? 1 : -1);
          top = std::max(top, z[s]), bottom = std::min(bottom, z[s]);
          checker += z[s] * ((layout_.sites[s].grid_column + layout_.sites[s].grid_row) % 2 ? 1 : -1);
        }
      double neighbours = 0;
      for (const auto& [a, b] : near_) neighbours += z[a] * z[b];
      const auto sign = [](double value_) { return std::asinh(value_ / 3); };
      sheet.put_chi_square(name, "spread", ok(chi), n - 1);
      sheet.put(name, "gradient_x", ok(sign(gx / std::sqrt(nx))));
      sheet.put(name, "gradient_y", ok(sign(gy / std::sqrt(ny))));
      sheet.put(name, "radial", ok(sign(radial / std::sqrt(nr))));
      if (!all) return;
      sheet.put(name, "diagonal", ok(sign(xy / std::sqrt(nxy))));
      sheet.put(name, "left_right", ok(sign(lr / std::sqrt(n))));
      sheet.put(name, "top_bottom", ok(sign(tb / std::sqrt(n))));
      sheet.put(name, "neighbours", ok(neighbours / chi));
      sheet.put(name, "checker", ok(sign(checker / std::sqrt(n))));
      sheet.put(name, "few_waves", ok(std::log(few_waves(z, row_, column_))));
      sheet.put_unsteady(name, "highest", ok(sign(top)));
      sheet.put_unsteady(name, "lowest", ok(sign(bottom)));
    };
    std::vector<double> error2(sites), filling(sites), filling_error2(sites), lost(sites), lost_error2(sites),
        empty_error2(sites);
    const double p = occupied / total;
    double lost_all = 0;
    for (const double one : site_partial) lost_all += one / total;
    for (std::size_t s = 0; s < sites; ++s) {
      error2[s] = site_count[s] > 1 ? noise / site_count[s] : 0;
      filling[s] = site_filled[s] / frames;
      filling_error2[s] = (p * (1 - p) + 1e-4) / frames;
      lost[s] = site_partial[s] / frames;
      lost_error2[s] = (lost_all * (1 - lost_all) + 1e-3) / frames;
      site_empty[s] = site_empties[s] > 0 ? site_empty[s] / site_empties[s] : 0;
      empty_error2[s] = site_empties[s] > 1 ? empty_variance / site_empties[s] : 0;
    }
    field("by_site", site_mean, error2, {"site_brightness", "site", "occupied sites"}, true);
    field("filling_by_site", filling, filling_error2, {"site_histogram", "site", "all sites"}, false);
    field("empty_by_site", site_empty, empty_error2, {"mean_map", "site", "empty sites"}, false);
    sheet.kind({"site_histogram", "site", "all sites"});
    double lost_chi = 0;
    for (std::size_t s = 0; s < sites; ++s) lost_chi += std::pow(lost[s] - lost_all, 2) / lost_error2[s];
    sheet.put_chi_square("partial_by_site", "spread", ok(lost_chi), static_cast<double>(sites) - 1);

    // Along the stack: what the occupied sites have in common.
    std::vector<double> common(record.frames, not_a_number), loaded(record.frames, not_a_number);
    double white = 0, white_count = 0;
    for (const std::size_t n : chosen) {
      double sum = 0, k = 0, filled = 0;
      for (std::size_t s = 0; s < sites; ++s) {
        const double b = record.bright(n, s);
        filled += b > occupied_above;
        if (b > core_from) sum += b - site_mean[s], ++k;
      }
      loaded[n] = filled / static_cast<double>(sites);
      if (k > 0) common[n] = sum / k, white += noise / k, ++white_count;
    }
    sheet.kind({"brightness_series", "time", "occupied sites"});
    put_series(sheet, "common", common, record, which, white / white_count);
    sheet.kind({"site_histogram", "time", "all sites"});
    put_short_series(sheet, "loading", loaded, record, which,
                     p * (1 - p) / static_cast<double>(sites) + 1e-6);

    // Pairs.
    double near_product = 0, near_pairs = 0, far_product = 0, far_pairs = 0;
    double exchange = 0, exchange_far = 0, occupancy_near = 0, occupancy_far = 0, row_product = 0,
           row_pairs = 0;
    double spill = 0, spill_pairs = 0;
    std::vector<Reading> readings(sites);
    SameLine rows(row_), columns(column_);
    for (const std::size_t n : chosen) {
      for (std::size_t s = 0; s < sites; ++s) {
        const double b = record.bright(n, s);
        const bool is_bright = b > core_from, is_empty = b < 0.25;
        readings[s] = {.now = b,
                       .bright = static_cast<double>(is_bright),
                       .residual = is_bright ? b - site_mean[s] - common[n] : 0,
                       .empty = static_cast<double>(is_empty),
                       .above_empty = is_empty ? b - site_empty[s] : 0,
                       .middle = static_cast<double>((b > 0.2) & (b < 0.8)),
                       .filled = static_cast<double>(b > occupied_above) - filling[s]};
      }
      const auto each = [&](const std::pair<std::size_t, std::size_t>& pair, double& product, double& pairs,
                            double& swapped, double& both) {
        const Reading &a = readings[pair.first], &b = readings[pair.second];
        product += a.residual * b.residual;
        pairs += a.bright * b.bright;
        swapped += a.middle * b.middle * static_cast<double>(std::abs(a.now + b.now - 1) < 0.3);
        both += a.filled * b.filled;
      };
      for (std::size_t k = 0; k < near_.size(); ++k) {
        const double before = near_product, pairs_before = near_pairs;
        each(near_[k], near_product, near_pairs, exchange, occupancy_near);
        if (k < along_rows_) row_product += near_product - before, row_pairs += near_pairs - pairs_before;
        // Light of an occupied site at its empty neighbour.
        const Reading &a = readings[near_[k].first], &b = readings[near_[k].second];
        spill += a.bright * b.above_empty;
        spill += b.bright * a.above_empty;
        spill_pairs += a.bright * b.empty + b.bright * a.empty;
      }
      for (const auto& pair : far_) each(pair, far_product, far_pairs, exchange_far, occupancy_far);
      rows.add(readings);
      columns.add(readings);
    }
    sheet.kind({"site_correlation", "site", "occupied sites"});
    sheet.put("pairs.near", ok(near_product / (near_pairs + 1) / noise));
    sheet.put("pairs.far", ok(far_product / (far_pairs + 1) / noise));
    sheet.put("pairs.along_rows", ok(row_product / (row_pairs + 1) / noise));
    sheet.put("pairs.light_rows", ok(rows.light(noise)));
    sheet.put("pairs.light_columns", ok(columns.light(noise)));
    sheet.put("pairs.occupancy_rows", ok(rows.occupancy(p * (1 - p) + 1e-3)));
    sheet.put("pairs.occupancy_columns", ok(columns.occupancy(p * (1 - p) + 1e-3)));
    sheet.kind({"neighbour_exchange", "site", "all sites"});
    const double ratio =
        far_.empty() ? 0 : static_cast<double>(near_.size()) / static_cast<double>(far_.size());
    sheet.put("pairs.exchange",
              ok((exchange - ratio * exchange_far) / std::sqrt(exchange + ratio * ratio * exchange_far + 4)));
    sheet.put("pairs.occupancy_near",
              ok(occupancy_near / std::sqrt(static_cast<double>(near_.size()) * frames + 1) /
                 (p * (1 - p) + 1e-3)));
    sheet.put(
        "pairs.occupancy_far",
        ok(occupancy_far / std::sqrt(static_cast<double>(far_.size()) * frames + 1) / (p * (1 - p) + 1e-3)));
    sheet.kind({"point_spread_halo", "site", "empty sites"});
    sheet.put("pairs.spill", ok(spill / std::sqrt((spill_pairs + 1) * empty_variance)));

    // Memory of sites.
    double again[2] = {}, again_pairs[2] = {}, light_again = 0, light_pairs = 0, afterglow = 0,
           afterglow_pairs = 0, foreglow = 0, foreglow_pairs = 0;
    for (const std::size_t n : chosen)
      for (std::size_t lag = 1; lag <= 2; ++lag) {
        if (n < lag || !record.holds(which, n - lag)) continue;
        for (std::size_t s = 0; s < sites; ++s) {
          const double b = record.bright(n, s), then = record.bright(n - lag, s);
          again[lag - 1] += ((b > occupied_above) - filling[s]) * ((then > occupied_above) - filling[s]);
          ++again_pairs[lag - 1];
          if (lag > 1) continue;
          const bool is_bright = b > core_from, was_bright = then > core_from, is_empty = b < 0.25,
                     was_empty = then < 0.25;
          const double light = is_bright ? b - site_mean[s] - common[n] : 0,
                       light_then = was_bright ? then - site_mean[s] - common[n - 1] : 0,
                       above_empty = is_empty ? b - site_empty[s] : 0,
                       above_empty_then = was_empty ? then - site_empty[s] : 0;
          light_again += light * light_then, light_pairs += is_bright & was_bright;
          afterglow += above_empty * was_bright, afterglow_pairs += is_empty & was_bright;
          foreglow += above_empty_then * is_bright, foreglow_pairs += was_empty & is_bright;
        }
      }
    // Atoms that stay; what a sensor keeps of them is far less than an atom.
    sheet.kind({"site_correlation", "time", "all sites"});
    for (int k = 0; k < 2; ++k)
      sheet.put("memory.occupancy", k ? "2" : "1",
                ok(again[k] / std::sqrt(again_pairs[k] + 1) / (p * (1 - p) + 1e-3)));
    sheet.kind({"lag_correlation", "time", "all sites"});
    sheet.put("memory.brightness", ok(light_again / std::sqrt(light_pairs + 1) / noise));
    sheet.put("memory.afterglow", ok(afterglow / std::sqrt((afterglow_pairs + 1) * empty_variance)));
    // And what a frame that is not read out yet gets of the next exposure.
    sheet.put("memory.foreglow", ok(foreglow / std::sqrt((foreglow_pairs + 1) * empty_variance)));

    // Light at empty sites against the atoms that were there over some ten frames, more than at other sites.
    constexpr double stays = 0.9;
    std::vector<double> been(sites);
    double persistence = 0, been_square = 0;
    for (std::size_t n = 0; n < record.frames; ++n) {
      const bool here = record.holds(which, n);
      const double mean = std::accumulate(been.begin(), been.end(), 0.0) / static_cast<double>(sites);
      for (std::size_t s = 0; s < sites; ++s) {
        const double b = here ? record.bright(n, s) : 0, more = been[s] - mean;
        if (here && b < 0.25) persistence += (b - site_empty[s]) * more, been_square += more * more;
        been[s] = stays * been[s] + (b > core_from);
      }
    }
    sheet.put("memory.persistence", ok(persistence / std::sqrt((been_square + 1) * empty_variance)));
  }

 private:
  const Layout& layout_;
  std::vector<double> x_, y_;              // from -1 to 1 over the array
  std::vector<std::size_t> row_, column_;  // of the grid
  std::vector<std::pair<std::size_t, std::size_t>> near_, far_;
  std::size_t along_rows_ = 0;
};

}  // namespace

std::unique_ptr<Family> make_site_brightness(const Layout& layout) {
  return std::make_unique<SiteBrightness>(layout);
}

}  // namespace atomcam::analysis
