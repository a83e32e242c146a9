#include "diagnosis/profiles.hpp"

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <deque>
#include <limits>

#include "analysis/fourier.hpp"
#include "analysis/plane.hpp"
#include "analysis/products.hpp"
#include "calibration/site_light.hpp"
#include "simulation/parallel.hpp"

namespace atomcam {
namespace {

constexpr double nan = std::numeric_limits<double>::quiet_NaN();
constexpr int lags = 6;          // of the correlations, pixels or frames
constexpr int behind = 8;        // pixels on either side of a bright one
constexpr int series_bins = 50;  // of the series along the stack

/// Sums of values that fall into bins.
class Bins {
 public:
  Bins(double low, double high, int count) : low_(low), width_((high - low) / count) {
    sum_.resize(static_cast<std::size_t>(count));
    number_.resize(static_cast<std::size_t>(count));
  }
  void add(double x, double value = 1) {
    const double k = (x - low_) / width_;
    if (!(k >= 0 && k < static_cast<double>(sum_.size()))) return;
    sum_[static_cast<std::size_t>(k)] += value;
    number_[static_cast<std::size_t>(k)] += 1;
  }
  std::vector<double> middles() const {
    std::vector<double> x;
    for (std::size_t k = 0; k < sum_.size(); ++k) x.push_back(low_ + (static_cast<double>(k) + 0.5) * width_);
    return x;
  }
  std::vector<double> means() const {
    std::vector<double> y;
    for (std::size_t k = 0; k < sum_.size(); ++k) y.push_back(number_[k] > 0 ? sum_[k] / number_[k] : nan);
    return y;
  }
  /// Number of values over `total`, per unit of x; NaN for none.
  std::vector<double> density(double total) const {
    std::vector<double> y;
    for (const double n : number_) y.push_back(n > 0 ? n / (total * width_) : nan);
    return y;
  }

 private:
  double low_, width_;
  std::vector<double> sum_, number_;
};

std::vector<double> whole_numbers(int first, int count) {
  std::vector<double> x;
  for (int k = 0; k < count; ++k) x.push_back(first + k);
  return x;
}

/// The curves and maps of one sequence.
class Measurement {
 public:
  Measurement(const StackModel& model, const FrameSequence& frames, bool open)
      : model_(model),
        frames_(frames),
        open_(open),
        split_(model, open),
        rows_(model.shape.rows),
        columns_(model.shape.columns),
        pixels_(model.shape.pixels()) {}

  void into(Profiles& profiles) {
    visit();
    add_pixels(profiles);
    add_lines(profiles);
    add_correlations(profiles);
    if (open_ && !model_.sites.empty()) add_sites(profiles);
    add_maps(profiles);
  }

 private:
  std::string key(const char* name) const { return (open_ ? "light." : "dark.") + std::string(name); }
  std::string title(const std::string& words) const { return open_ ? words : "dark frames: " + words; }
  void curve(Profiles& to, const char* name, const std::string& words, std::string x_label,
             std::string y_label, std::vector<double> x, std::vector<double> y, bool log_y = false) const {
    to.curves.push_back(
        {key(name), title(words), std::move(x_label), std::move(y_label), log_y, std::move(x), std::move(y)});
  }

  void visit() {
    const double k = model_.counts_per_electron, sigma = std::max(0.3, model_.read_noise_counts);
    const std::size_t frames = frames_.frames();
    sum_.assign(pixels_, 0), squares_.assign(pixels_, 0), mean_counts_.assign(pixels_, 0);
    dark_.assign(pixels_, 1);
    if (open_ && !model_.sites.empty()) {
      std::vector<float> light(model_.site_light.pixels().begin(), model_.site_light.pixels().end());
      const auto cut = light.begin() + static_cast<std::ptrdiff_t>(pixels_ * 3 / 10);
      std::nth_element(light.begin(), cut, light.end());
      for (std::size_t i = 0; i < pixels_; ++i) dark_[i] = model_.site_light.pixels()[i] <= *cut;
    }
    dark_number_ = static_cast<double>(std::count(dark_.begin(), dark_.end(), 1));
    row_sum_.assign(static_cast<std::size_t>(rows_), 0), row_square_ = row_sum_;
    column_sum_.assign(static_cast<std::size_t>(columns_), 0), column_square_ = column_sum_;
    analysis::ImageSpectrum spectrum(rows_, columns_);
    power_.assign(static_cast<std::size_t>(rows_) * static_cast<std::size_t>(spectrum.half()), 0.0F);
    half_ = spectrum.half();
    const double event = std::max(12 * sigma, 0.7 * k) + 3 * std::sqrt(model_.background_e) * k;
    frames_.visit([&](std::size_t n, const CountImage& frame) {
      split_.split(frame);
      const auto rest = split_.rest_counts();
      double level = 0;
      std::vector<double> column(static_cast<std::size_t>(columns_), 0),
          row(static_cast<std::size_t>(rows_), 0);
      for (int r = 0; r < rows_; ++r)
        for (int c = 0; c < columns_; ++c) {
          const std::size_t i = index(r, c);
          const double value = rest[i];
          sum_[i] += value, squares_[i] += value * value;
          mean_counts_[i] += frame.pixels()[i];
          row[static_cast<std::size_t>(r)] += value / columns_;
          column[static_cast<std::size_t>(c)] += value / rows_;
          level += value;
          spectrum.image()[i] = static_cast<float>(value);
          if (dark_[i]) {
            narrow_.add(frame.pixels()[i] - model_.bias_counts);
            wide_.add(frame.pixels()[i] - model_.bias_counts);
            if (value > event) around(rest, r, c);
          }
        }
      level /= static_cast<double>(pixels_);
      level_.add(static_cast<double>(n) + 0.5, level);
      for (std::size_t r = 0; r < row.size(); ++r)
        row_sum_[r] += row[r], row_square_[r] += (row[r] - level) * (row[r] - level);
      for (std::size_t c = 0; c < column.size(); ++c)
        column_sum_[c] += column[c], column_square_[c] += (column[c] - level) * (column[c] - level);
      spectrum.transform();
      spectrum.add_power(power_);
      correlate(rest, level);
      if (open_) sites(n, frames);
    });
  }

  std::size_t index(int r, int c) const {
    return static_cast<std::size_t>(r) * static_cast<std::size_t>(columns_) + static_cast<std::size_t>(c);
  }

  /// What stands around a bright pixel: charge left behind, smear.
  void around(std::span<const double> rest, int r, int c) {
    const double cap = 4 * std::max(1.0, model_.read_noise_counts);
    for (int d = -behind; d <= behind; ++d) {
      if (d == 0) continue;
      if (c + d >= 0 && c + d < columns_) along_row_.add(d, std::clamp(rest[index(r, c + d)], -cap, cap));
      if (r + d >= 0 && r + d < rows_) along_column_.add(d, std::clamp(rest[index(r + d, c)], -cap, cap));
    }
  }

  /// With zeros around the frame, pixels without a partner add nothing.
  void correlate(std::span<const double> rest, double level) {
    analysis::Plane now{analysis::PlaneShape(model_.shape)};
    for (int r = 0; r < rows_; ++r)
      for (int c = 0; c < columns_; ++c) now.at(r, c) = static_cast<float>(rest[index(r, c)] - level);
    const auto stride = static_cast<std::size_t>(now.shape().stride);
    square_ += analysis::sum_of_products(now.size(), now.inner(), now.inner());
    for (std::size_t d = 1; d <= lags; ++d) {
      along_[d] += analysis::sum_of_products(now.size(), now.inner(), now.inner() + d);
      if (const std::size_t skipped = d * stride; skipped < now.size())
        down_[d] += analysis::sum_of_products(now.size() - skipped, now.inner(), now.inner() + skipped);
      if (d <= before_.size())
        later_[d] += analysis::sum_of_products(now.size(), now.inner(), before_[d - 1].inner());
    }
    before_.push_front(std::move(now));
    if (before_.size() > lags) before_.pop_back();
  }

  void sites(std::size_t n, std::size_t) {
    const auto light = split_.brightness_e();
    double sum = 0, count = 0;
    if (site_sum_.empty()) site_sum_.assign(light.size(), 0), site_number_ = site_sum_;
    for (std::size_t s = 0; s < light.size(); ++s) {
      const double relative = light[s] / std::max(1e-9, model_.atom_e);
      brightness_.add(relative);
      if (relative < 0.5) continue;
      sum += relative, count += 1;
      site_sum_[s] += relative, site_number_[s] += 1;
    }
    if (count > 0) {
      series_.add(static_cast<double>(n) + 0.5, sum / count);
    }
    filling_.add(static_cast<double>(n) + 0.5,
                 count / static_cast<double>(std::max<std::size_t>(1, light.size())));
  }

  double frames() const { return static_cast<double>(frames_.frames()); }
  double variance(std::size_t i) const {
    const double n = frames(), m = sum_[i] / n;
    return std::max(0.0, (squares_[i] - n * m * m) / (n - 1));
  }

  void add_pixels(Profiles& to) const {
    curve(to, "pixel_histogram", open_ ? "counts of dark pixels, tail" : "counts, tail",
          "counts above the bias", "share per count", wide_.middles(), wide_.density(frames() * dark_number_),
          true);
    curve(to, "pixel_histogram_core", open_ ? "counts of dark pixels, core" : "counts, core",
          "counts above the bias", "share per count", narrow_.middles(),
          narrow_.density(frames() * dark_number_), false);
  }

  void add_lines(Profiles& to) const {
    const double n = frames();
    const auto rms = [&](const std::vector<double>& squares) {
      std::vector<double> y;
      for (const double s : squares) y.push_back(std::sqrt(s / n));
      return y;
    };
    const auto mean = [&](const std::vector<double>& sums) {
      std::vector<double> y;
      for (const double s : sums) y.push_back(s / n);
      return y;
    };
    // Of the mean over time the static part remains; what a row does from frame to frame is its rms.
    curve(to, "row_noise", "row means, from frame to frame", "row", "counts rms", whole_numbers(0, rows_),
          rms(row_square_));
    curve(to, "column_noise", "column means, from frame to frame", "column", "counts rms",
          whole_numbers(0, columns_), rms(column_square_));
    curve(to, "row_level", "row means, over all frames", "row", "counts", whole_numbers(0, rows_),
          mean(row_sum_));
    curve(to, "column_level", "column means, over all frames", "column", "counts", whole_numbers(0, columns_),
          mean(column_sum_));
    std::vector<double> fx, along(static_cast<std::size_t>(half_ - 1), 0), fy,
        down(static_cast<std::size_t>(rows_ / 2), 0);
    const double scale = 1 / (n * static_cast<double>(pixels_));
    for (int c = 1; c < half_; ++c) {
      fx.push_back(static_cast<double>(c) / columns_);
      for (int r = 0; r < rows_; ++r)
        along[static_cast<std::size_t>(c - 1)] +=
            static_cast<double>(power_[static_cast<std::size_t>(r) * static_cast<std::size_t>(half_) +
                                       static_cast<std::size_t>(c)]) *
            scale / rows_;
    }
    for (int r = 1; r <= rows_ / 2; ++r) {
      fy.push_back(static_cast<double>(r) / rows_);
      for (int c = 0; c < half_; ++c)
        down[static_cast<std::size_t>(r - 1)] +=
            static_cast<double>(power_[static_cast<std::size_t>(r) * static_cast<std::size_t>(half_) +
                                       static_cast<std::size_t>(c)]) *
            scale / half_;
    }
    curve(to, "spectrum_rows", "power along the rows", "cycles per pixel", "counts² per pixel", fx, along);
    curve(to, "spectrum_columns", "power along the columns", "cycles per pixel", "counts² per pixel", fy,
          down);
    curve(to, "level_series", open_ ? "level without the sites' light" : "level", "frame", "counts",
          level_.middles(), level_.means());
  }

  void add_correlations(Profiles& to) const {
    // `pairs`: the part of all pixels of all frames that has a partner so far away.
    const auto values = [&](const std::array<double, lags + 1>& products, double length) {
      std::vector<double> y;
      for (int d = 1; d <= lags; ++d) {
        const double pairs = 1 - d / length;
        y.push_back(pairs > 0 && square_ > 0 ? products[static_cast<std::size_t>(d)] / (pairs * square_)
                                             : nan);
      }
      return y;
    };
    curve(to, "horizontal_correlation", "correlation with the pixel to the right", "pixels", "correlation",
          whole_numbers(1, lags), values(along_, columns_));
    curve(to, "vertical_correlation", "correlation with the pixel below", "pixels", "correlation",
          whole_numbers(1, lags), values(down_, rows_));
    curve(to, "lag_correlation", "correlation with the same pixel later", "frames", "correlation",
          whole_numbers(1, lags), values(later_, frames()));
    curve(to, "around_bright_row", "along the row of a bright pixel", "pixels from it", "counts, clipped",
          along_row_.middles(), along_row_.means());
    curve(to, "around_bright_column", "along the column of a bright pixel", "pixels from it",
          "counts, clipped", along_column_.middles(), along_column_.means());
  }

  void add_sites(Profiles& to) const {
    const double k = model_.counts_per_electron, n = frames();
    curve(to, "site_brightness", "light of the sites", "of an atom", "share per unit", brightness_.middles(),
          brightness_.density(n * static_cast<double>(model_.sites.size())), true);
    curve(to, "brightness_series", "mean light of the filled sites", "frame", "of an atom", series_.middles(),
          series_.means());
    curve(to, "filling_series", "filled sites", "frame", "share", filling_.middles(), filling_.means());
    // Profile of light about the nearest site.
    const double reach = 0.5 * std::hypot(rows_, columns_);
    Bins radial(0, std::min(24.0, reach), 48);
    for (int r = 0; r < rows_; ++r)
      for (int c = 0; c < columns_; ++c) {
        double nearest = 1e30;
        for (const SiteImage& site : model_.sites)
          nearest = std::min(nearest, (c - site.x_px) * (c - site.x_px) + (r - site.y_px) * (r - site.y_px));
        radial.add(std::sqrt(nearest), (mean_counts_[index(r, c)] / n - model_.bias_counts) / k);
      }
    curve(to, "radial_profile", "light against the distance from the nearest site", "pixels",
          "e per pixel and frame", radial.middles(), radial.means(), true);
    // Photon transfer of what the sites' light leaves over.
    const double top = 0.6 * model_.atom_e * model_.filling * peak_share();
    Bins transfer(0, std::max(top, 1e-3), 24);
    for (std::size_t i = 0; i < pixels_; ++i)
      transfer.add((mean_counts_[i] / n - model_.bias_counts) / k, variance(i) / (k * k));
    curve(to, "mean_variance", "variance over time, the sites' light taken off", "mean light, e", "e²",
          transfer.middles(), transfer.means());
  }

  double peak_share() const {
    float peak = 0;
    for (const float share : model_.site_light.pixels()) peak = std::max(peak, share);
    return static_cast<double>(peak);
  }

  void add_maps(Profiles& to) const {
    const double n = frames();
    Image<double, unit::counts> mean(model_.shape), noise(model_.shape);
    for (std::size_t i = 0; i < pixels_; ++i) {
      mean.pixels()[i] = sum_[i] / n;
      noise.pixels()[i] = std::sqrt(variance(i));
    }
    to.maps.push_back({key("mean_map"),
                       title(open_ && !model_.sites.empty() ? "mean, the sites' light taken off" : "mean"),
                       "counts", true, mean});
    to.maps.push_back({key("noise_map"), title("noise over time"), "counts rms", false, std::move(noise)});
    if (!open_ || model_.sites.empty()) return;
    std::vector<double> light(pixels_);
    const double k = model_.counts_per_electron;
    for (std::size_t i = 0; i < pixels_; ++i)
      light[i] = (mean_counts_[i] / n - model_.bias_counts) / k - model_.dark_e - model_.background_e;
    FoldedSite folded = fold_sites(model_, light, 7);
    to.maps.push_back({key("site_image"), "mean site", "e", false, std::move(folded.mean)});
    int columns = 0, rows = 0;
    for (const SiteImage& site : model_.sites)
      columns = std::max(columns, site.grid_column + 1), rows = std::max(rows, site.grid_row + 1);
    Image<double, unit::counts> sites({rows, columns}, nan);
    for (std::size_t s = 0; s < model_.sites.size(); ++s)
      if (site_number_[s] > 0)
        sites(model_.sites[s].grid_row, model_.sites[s].grid_column) = site_sum_[s] / site_number_[s];
    to.maps.push_back(
        {key("site_map"), "light of the sites when filled", "of an atom", false, std::move(sites)});
  }

  const StackModel& model_;
  const FrameSequence& frames_;
  bool open_;
  SiteLight split_;
  int rows_, columns_, half_ = 0;
  std::size_t pixels_;
  std::vector<double> sum_, squares_, mean_counts_;
  std::vector<std::uint8_t> dark_;
  double dark_number_ = 0;
  Bins narrow_ = narrow_bins(), wide_ = wide_bins();
  std::vector<double> row_sum_, row_square_, column_sum_, column_square_;
  std::vector<float> power_;
  double square_ = 0;  // sum over all pixels of all frames; of products with pixels some lags away:
  std::array<double, lags + 1> along_{}, down_{}, later_{};
  std::deque<analysis::Plane> before_;
  Bins along_row_{-behind - 0.5, behind + 0.5, 2 * behind + 1}, along_column_ = along_row_;
  Bins level_ = series(), series_ = series(), filling_ = series();
  Bins brightness_{-0.6, 2.2, 84};
  std::vector<double> site_sum_, site_number_;

  // Bins of whole counts, so that no bin holds one code more than its neighbours.
  static Bins count_bins(double low, double high, int bins, double bias) {
    const double width = std::max(1.0, std::round((high - low) / bins));
    const double start = std::floor(low + bias) - 0.5 - bias;
    return {start, start + width * bins, bins};
  }
  Bins narrow_bins() const {
    const double sigma = std::max(1.0, model_.read_noise_counts) +
                         (model_.excess_noise > 1.5
                              ? 0
                              : std::sqrt(model_.background_e + model_.dark_e) * model_.counts_per_electron);
    const int bins = static_cast<int>(std::clamp(std::ceil(10 * sigma), 20.0, 60.0));
    return count_bins(-5 * sigma, 5 * sigma, bins, model_.bias_counts);
  }
  Bins wide_bins() const {
    const double sigma = std::max(1.0, model_.read_noise_counts);
    return count_bins(-10 * sigma, std::max(30 * sigma, 6 * model_.counts_per_electron), 110,
                      model_.bias_counts);
  }
  Bins series() const {
    const auto n = static_cast<double>(std::max<std::size_t>(1, frames_.frames()));
    return {0, n, static_cast<int>(std::min<double>(series_bins, n))};
  }
};

}  // namespace

Profiles measure_profiles(const StackModel& model, const FrameSequence& frames, const FrameSequence* darks) {
  Profiles profiles;
  Measurement(model, frames, true).into(profiles);
  if (darks) Measurement(model, *darks, false).into(profiles);
  return profiles;
}

std::vector<Profiles> simulate_profiles(const Lab& lab, const StackPlan& plan, int stacks,
                                        std::uint64_t first, const std::function<void(int)>& progress) {
  std::vector<Profiles> all(static_cast<std::size_t>(stacks));
  std::atomic<int> done{0};
  parallel_for(stacks, plan.threads, 1, [&](int n) {
    const std::uint64_t number = first + static_cast<std::uint64_t>(n);
    const auto light = simulate_stack(lab, plan, number, true);
    const auto darks = plan.dark_frames.count() > 0 ? simulate_stack(lab, plan, number, false) : nullptr;
    all[static_cast<std::size_t>(n)] = measure_profiles(plan.model, *light, darks.get());
    const int count = ++done;
    if (progress) progress(count);
  });
  return all;
}

void scatter_about(const Profiles& real, std::vector<Profiles>& simulated) {
  for (std::size_t k = 0; k < real.curves.size(); ++k) {
    const CurveBand band = band_of(simulated, k);
    for (Profiles& one : simulated)
      for (std::size_t i = 0; i < band.mean.size(); ++i) {
        double& y = one.curves[k].y[i];
        y = real.curves[k].y[i] + std::sqrt(2.0) * (y - band.mean[i]);
      }
  }
  for (Profiles& one : simulated) one.maps = real.maps;
}

CurveBand band_of(std::span<const Profiles> stacks, std::size_t curve) {
  CurveBand band;
  if (stacks.empty()) return band;
  const std::size_t points = stacks.front().curves[curve].y.size();
  band.mean.assign(points, nan);
  std::vector<double> own(points, nan);
  for (std::size_t i = 0; i < points; ++i) {
    double n = 0, sum = 0, squares = 0;
    for (const Profiles& one : stacks)
      if (const double y = one.curves[curve].y[i]; std::isfinite(y)) n += 1, sum += y, squares += y * y;
    if (n == 0) continue;
    band.mean[i] = sum / n;
    if (n > 1) own[i] = std::max(0.0, (squares - sum * sum / n) / (n - 1));
  }
  band.deviation.assign(points, nan);
  constexpr std::size_t reach = 3;
  for (std::size_t i = 0; i < points; ++i) {
    if (!std::isfinite(own[i])) continue;
    double n = 0, sum = 0;
    for (std::size_t j = i > reach ? i - reach : 0; j < std::min(points, i + reach + 1); ++j)
      if (std::isfinite(own[j])) n += 1, sum += own[j];
    // A histogram falls over decades: a neighbour's deviation may not drown a point's own.
    band.deviation[i] = std::sqrt(std::min(0.5 * (own[i] + sum / n), 4 * own[i] + 1e-300));
    if (!(band.deviation[i] > 0)) band.deviation[i] = nan;
  }
  return band;
}

double distance(const Curve& curve, const CurveBand& band) {
  double sum = 0, n = 0;
  for (std::size_t i = 0; i < std::min(curve.y.size(), band.mean.size()); ++i) {
    if (!std::isfinite(curve.y[i]) || !std::isfinite(band.deviation[i])) continue;
    const double z = std::clamp((curve.y[i] - band.mean[i]) / band.deviation[i], -20.0, 20.0);
    sum += z * z, n += 1;
  }
  return n > 0 ? sum / n : 0;
}

}  // namespace atomcam
