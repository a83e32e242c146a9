#include "calibration/sensor_fit.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <numbers>
#include <numeric>

#include "base/quantile.hpp"

namespace atomcam {
namespace {

/// Standard deviation of a normal law with these 16 % and 84 % quantiles, read off at the ranks where they
/// are to be expected among few values (Blom).
double robust_sigma(std::vector<double> values) {
  const std::size_t n = values.size();
  if (n < 3) return 0;
  std::sort(values.begin(), values.end());
  const double rank = (static_cast<double>(n) + 0.25) * 0.1587 + 0.375 - 1;
  const auto below = static_cast<std::size_t>(std::max(0.0, rank));
  const double part = std::max(0.0, rank) - static_cast<double>(below);
  const double low = std::lerp(values[below], values[below + 1], part);
  const double high = std::lerp(values[n - 1 - below], values[n - 2 - below], part);
  return 0.5 * (high - low);
}
/// Mean of the middle half.
double middle_mean(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  const auto quarter = static_cast<std::ptrdiff_t>(values.size() / 4);
  return std::accumulate(values.begin() + quarter, values.end() - quarter, 0.0) /
         static_cast<double>(static_cast<std::ptrdiff_t>(values.size()) - 2 * quarter);
}
constexpr double middle_loss = 1.195;  // its variance over that of a mean, for a normal law
constexpr double robust_loss = 1.92;   // error of such a sigma^2, in sigma^2 / sqrt(n); the best is 1.41
double square(double x) {
  return x * x;
}
/// Second derivative of ln Gamma, for x >= 1.
double trigamma(double x) {
  double sum = 0;
  for (; x < 12; x += 1) sum += 1 / (x * x);
  const double r = 1 / (x * x);
  return sum + 1 / x + r / 2 + r / x * (1.0 / 6 - r * (1.0 / 30 - r / 42));
}

}  // namespace

double StackSums::variance(std::size_t pixel) const {
  const double n = static_cast<double>(frames), m = sum.pixels()[pixel] / n;
  return n < 2 ? 0 : std::max(0.0, (sum_of_squares.pixels()[pixel] - n * m * m) / (n - 1));
}

double StackSums::median_mean() const {
  std::vector<double> values(sum.pixels().size());
  for (std::size_t i = 0; i < values.size(); ++i) values[i] = mean(i);
  return median(std::move(values));
}

double StackSums::median_variance() const {
  std::vector<double> values(sum.pixels().size());
  for (std::size_t i = 0; i < values.size(); ++i) values[i] = variance(i);
  return median(std::move(values));
}

namespace {

std::size_t rows_lost(const CountImage& frame, double mean) {
  constexpr int least_columns = 16;  // fewer may agree by chance
  constexpr double far_counts = 10;
  if (frame.columns() < least_columns) return 0;
  std::size_t lost = 0;
  for (int row = 0; row < frame.rows(); ++row) {
    const std::uint16_t first = frame(row, 0);
    if (std::fabs(first - mean) < far_counts) continue;
    int column = 1;
    while (column < frame.columns() && frame(row, column) == first) ++column;
    lost += column == frame.columns();
  }
  return lost;
}

}  // namespace

StackSums sum_stack(const FrameSequence& frames) {
  StackSums sums;
  sums.sum = Image<double, unit::counts>(frames.shape());
  sums.sum_of_squares = Image<double, unit::counts>(frames.shape());
  sums.occurrences.assign(65536, 0);
  frames.visit([&](std::size_t, const CountImage& frame) {
    const auto counts = frame.pixels();
    const auto sum = sums.sum.pixels(), squares = sums.sum_of_squares.pixels();
    double total = 0;
    bool even = true;
    for (std::size_t i = 0; i < counts.size(); ++i) {
      const double c = counts[i];
      even &= counts[i] == counts[0];
      sum[i] += c;
      squares[i] += c * c;
      total += c;
      ++sums.occurrences[counts[i]];
    }
    sums.frame_mean.push_back(total / static_cast<double>(std::max<std::size_t>(1, counts.size())));
    sums.lost_rows += rows_lost(frame, sums.frame_mean.back());
    sums.even_frames += even;
    ++sums.frames;
  });
  return sums;
}

StackSums sum_stack_without_strikes(const FrameSequence& frames, double counts_per_electron) {
  // Beyond the pixel's other counts. A site that is filled once in thirty frames is not struck. Of two
  // strikes the second shows once the first is left out.
  constexpr double electrons = 40, deviations = 6;
  constexpr int rounds = 4;
  const double least = electrons * counts_per_electron;
  const StackSums all = sum_stack(frames);
  const std::size_t pixels = all.sum.pixels().size();
  const double n = static_cast<double>(all.frames);
  StackSums sums = all;
  std::vector<double> struck(pixels, 0);
  double before = 0;
  for (int round = 0; round < rounds; ++round) {
    const auto is_struck = [&](std::size_t i, double c) {
      const double above = c - sums.mean(i), kept = n - struck[i];
      if (above <= least || kept < 3) return false;
      const double off = above * kept / (kept - 1);  // from the mean of the others
      const double variance = ((kept - 1) * sums.variance(i) - off * above) / (kept - 2);
      return off > least + deviations * std::sqrt(std::max(0.0, variance));
    };
    std::vector<double> number(pixels, 0), sum(pixels, 0), squares(pixels, 0);
    std::vector<double> frame_mean = all.frame_mean;
    frames.visit([&](std::size_t k, const CountImage& frame) {
      const auto counts = frame.pixels();
      for (std::size_t i = 0; i < pixels; ++i) {
        const double c = counts[i];
        if (!is_struck(i, c)) continue;
        ++number[i];
        sum[i] += c;
        squares[i] += c * c;
        frame_mean[k] -= (c - sums.mean(i)) / static_cast<double>(pixels);
      }
    });
    const double found = std::accumulate(number.begin(), number.end(), 0.0);
    if (found == before) break;
    before = found;
    struck = std::move(number);
    sums.frame_mean = std::move(frame_mean);
    for (std::size_t i = 0; i < pixels; ++i) {
      const double as_all = n / std::max(1.0, n - struck[i]);
      sums.sum.pixels()[i] = (all.sum.pixels()[i] - sum[i]) * as_all;
      sums.sum_of_squares.pixels()[i] = (all.sum_of_squares.pixels()[i] - squares[i]) * as_all;
    }
  }
  return sums;
}

CountFit fit_counts(const std::vector<CountHistogram>& histograms, bool first_is_dark, const CountLaw& start,
                    const CountFitOptions& options) {
  const int count = static_cast<int>(histograms.size());
  const bool gain_free = options.gain && start.em_gain > 1;
  // bias, ln read noise, [ln em gain], [ln serial], then per histogram ln events and, with light, ln spread.
  const int gain_at = gain_free ? 2 : -1, serial_at = options.serial ? 2 + (gain_free ? 1 : 0) : -1;
  const int first_at = 2 + (gain_free ? 1 : 0) + (options.serial ? 1 : 0);
  std::vector<int> events_at, spread_at;
  int parameters = first_at;
  for (int h = 0; h < count; ++h) {
    events_at.push_back(parameters++);
    spread_at.push_back(h == 0 && first_is_dark ? -1 : parameters++);
  }
  Eigen::VectorXd from = Eigen::VectorXd::Zero(parameters);
  from(0) = start.bias_counts;
  from(1) = std::log(start.read_noise_counts);
  if (gain_free) from(gain_at) = std::log(start.em_gain);
  if (options.serial) from(serial_at) = std::log(std::max(start.serial_events, 1e-3));
  const double per_electron = start.em_gain / start.electrons_per_count;
  for (int h = 0; h < count; ++h) {
    double sum = 0, total = 0;
    for (std::size_t k = 0; k < histograms[h].occurrences.size(); ++k) {
      sum += static_cast<double>(histograms[h].occurrences[k]) *
             (histograms[h].first + static_cast<double>(k) - start.bias_counts);
      total += static_cast<double>(histograms[h].occurrences[k]);
    }
    from(events_at[h]) = std::log(std::clamp(sum / std::max(1.0, total) / per_electron, 1e-4, 1e3));
    if (spread_at[h] >= 0) from(spread_at[h]) = std::log(0.05);
  }
  const auto law_of = [&](const Eigen::VectorXd& p, int h) {
    CountLaw law = start;
    law.bias_counts = p(0);
    law.read_noise_counts = std::exp(p(1));
    if (gain_free) law.em_gain = std::exp(p(gain_at));
    law.serial_events = options.serial ? std::exp(p(serial_at)) : start.serial_events;
    law.events_e = std::exp(p(events_at[h]));
    law.events_spread = spread_at[h] >= 0 ? std::exp(p(spread_at[h])) : 0;
    return law;
  };
  const auto expected = [&](const Eigen::VectorXd& p, int h) {
    const CountHistogram& histogram = histograms[h];
    const int size =
        static_cast<int>(std::bit_ceil(std::max<std::size_t>(1024, histogram.occurrences.size() * 3 / 2)));
    std::vector<double> law = count_probabilities(law_of(p, h), histogram.first, size);
    law.resize(histogram.occurrences.size());
    double total = 0;
    for (double& value : law) total += value += 1e-12;
    for (double& value : law) value /= total;  // the law within the histogram's range
    return law;
  };
  const auto evaluate = [&](const Eigen::VectorXd& p, bool derivatives) {
    Likelihood out;
    out.gradient.setZero(parameters);
    out.information.setZero(parameters, parameters);
    for (Eigen::Index k = 1; k < parameters; ++k)
      if (!(std::fabs(p(k)) < 30)) {
        out.minus_log = std::numeric_limits<double>::infinity();
        return out;
      }
    for (int h = 0; h < count; ++h) {
      const CountHistogram& histogram = histograms[h];
      const double total = static_cast<double>(histogram.total());
      const std::vector<double> law = expected(p, h);
      for (std::size_t k = 0; k < law.size(); ++k)
        if (histogram.occurrences[k])
          out.minus_log -= static_cast<double>(histogram.occurrences[k]) * std::log(law[k]);
      if (!derivatives) continue;
      std::vector<int> moved = {0, 1};
      for (const int at : {gain_at, serial_at, events_at[h], spread_at[h]})
        if (at >= 0) moved.push_back(at);
      std::vector<std::vector<double>> by;
      for (const int at : moved) {
        const double step = at == 0 ? 0.02 : 2e-3;
        Eigen::VectorXd up = p, down = p;
        up(at) += step;
        down(at) -= step;
        std::vector<double> change = expected(up, h);
        const std::vector<double> below = expected(down, h);
        for (std::size_t k = 0; k < change.size(); ++k) change[k] = (change[k] - below[k]) / (2 * step);
        by.push_back(std::move(change));
      }
      for (std::size_t a = 0; a < moved.size(); ++a) {
        double gradient = 0;
        for (std::size_t k = 0; k < law.size(); ++k)
          gradient -= static_cast<double>(histogram.occurrences[k]) * by[a][k] / law[k];
        out.gradient(moved[a]) += gradient;
        for (std::size_t b = 0; b <= a; ++b) {
          double information = 0;
          for (std::size_t k = 0; k < law.size(); ++k) information += by[a][k] * by[b][k] / law[k];
          out.information(moved[a], moved[b]) += total * information;
          if (a != b) out.information(moved[b], moved[a]) += total * information;
        }
      }
    }
    // Priors of many e-folds keep what the data say nothing about in place.
    for (Eigen::Index k = 1; k < parameters; ++k) {
      const double width = 6;
      out.minus_log += 0.5 * square((p(k) - from(k)) / width);
      if (!derivatives) continue;
      out.gradient(k) += (p(k) - from(k)) / square(width);
      out.information(k, k) += 1 / square(width);
    }
    return out;
  };
  const MaximumLikelihood found = maximise(from, evaluate, 1e-3);
  CountFit fit;
  fit.law = law_of(found.values, 0);
  const Eigen::MatrixXd covariance = found.covariance();
  fit.bias_error = std::sqrt(covariance(0, 0));
  fit.read_noise_error = fit.law.read_noise_counts * std::sqrt(covariance(1, 1));
  if (gain_free) {
    fit.em_gain_error = fit.law.em_gain * std::sqrt(covariance(gain_at, gain_at));
    fit.events_by_gain = covariance(events_at[0], gain_at) / covariance(gain_at, gain_at);
  }
  if (options.serial) fit.serial_error = fit.law.serial_events * std::sqrt(covariance(serial_at, serial_at));
  for (int h = 0; h < count; ++h) {
    const CountLaw law = law_of(found.values, h);
    fit.events_e.push_back(law.events_e);
    fit.spread.push_back(law.events_spread);
    fit.events_error.push_back(law.events_e * std::sqrt(covariance(events_at[h], events_at[h])));
    const std::vector<double> probabilities = expected(found.values, h);
    const double total = static_cast<double>(histograms[h].total());
    double seen = 0, due = 0;
    for (std::size_t k = 0; k < probabilities.size(); ++k) {
      seen += static_cast<double>(histograms[h].occurrences[k]);
      due += total * probabilities[k];
      if (due >= 10) {
        fit.chi_square += square(seen - due) / due;
        ++fit.bins;
        seen = due = 0;
      }
    }
  }
  return fit;
}

double Spread::error() const {
  return error_of_square > 0 ? error_of_square / std::max(2 * value(), std::sqrt(error_of_square)) : 0;
}

QcmosDarkFit fit_qcmos_darks(const StackSums& darks) {
  QcmosDarkFit fit;
  const int rows = darks.sum.rows(), columns = darks.sum.columns();
  const double n = static_cast<double>(darks.frames), pixels = static_cast<double>(rows) * columns;
  std::vector<double> means, log_variances;
  for (std::size_t i = 0; i < darks.sum.pixels().size(); ++i) {
    means.push_back(darks.mean(i));
    const double variance = darks.variance(i);
    // Rounding to whole counts adds the same to all; without it the law of the read noise is log-normal.
    log_variances.push_back(std::log(std::max({1e-6, 0.02 * variance, variance - 1.0 / 12})));
  }
  fit.bias_counts = median(means);
  // Read noise from the quiet part of the pixels (3 % to 22 %): those that are noisier for a reason of their
  // own must neither raise nor widen the law. ln s^2 is the sum of ln sigma^2 (normal) and of ln chi^2 / n,
  // whose cumulants are known; quantiles by Cornish and Fisher's terms to the second order.
  const double degrees = std::max(1.0, n - 1);
  const double chi_variance = trigamma(degrees / 2), x = degrees / 2;
  const double chi_skewness =
      -(1 / (x * x) + 1 / (x * x * x) + 0.5 / (x * x * x * x)) / std::pow(chi_variance, 1.5);
  const double chi_kurtosis =
      (2 / (x * x * x) + 3 / std::pow(x, 4) + 2 / std::pow(x, 5)) / square(chi_variance);
  constexpr double low = -1.8808, high = -0.7722;  // normal quantiles of 3 % and 22 %
  const double distance = quantile(log_variances, 0.22) - quantile(log_variances, 0.03);
  double width = std::sqrt(chi_variance), skewness = chi_skewness, kurtosis = chi_kurtosis;
  const auto quantile_at = [&](double z) {  // in widths
    return z + skewness / 6 * (z * z - 1) + kurtosis / 24 * (z * z - 3) * z -
           skewness * skewness / 36 * (2 * z * z - 5) * z;
  };
  const auto stretch_at = [&](double z) {  // its slope
    return 1 + skewness / 3 * z + kurtosis / 8 * (z * z - 1) - skewness * skewness / 36 * (6 * z * z - 5);
  };
  for (int round = 0; round < 6; ++round) {
    const double chi_part = std::min(1.0, std::sqrt(chi_variance) / width);
    skewness = chi_skewness * std::pow(chi_part, 3);
    kurtosis = chi_kurtosis * std::pow(chi_part, 4);
    width = distance / (quantile_at(high) - quantile_at(low));
  }
  fit.read_noise_log_sigma.square = (square(width) - chi_variance) / 4;
  const double mean_log = quantile(log_variances, 0.22) - width * quantile_at(high);
  const double sigma_median = std::exp(0.5 * (mean_log + 1 / degrees));
  fit.read_noise_counts = sigma_median * std::exp(square(fit.read_noise_log_sigma.value()));
  // Error of ln noise = mean_log / 2 + log_sigma^2 from the covariance of the two quantiles.
  constexpr double density_low = 0.06804, density_high = 0.29611;  // of the normal law there
  const double scatter_low = stretch_at(low) / density_low, scatter_high = stretch_at(high) / density_high;
  const double variance_low = 0.03 * 0.97 * square(scatter_low),
               variance_high = 0.22 * 0.78 * square(scatter_high),
               covariance = 0.03 * 0.78 * scatter_low * scatter_high;
  const double by_width = 0.5 * (-high + width) / (high - low), by_high = 0.5 + by_width, by_low = -by_width;
  const double quantile_variance =
      by_high * by_high * variance_high + by_low * by_low * variance_low + 2 * by_high * by_low * covariance;
  fit.read_noise_error = fit.read_noise_counts * width * std::sqrt(quantile_variance / pixels);
  // 4 log_sigma^2 = width^2 less a constant.
  const double width_error =
      width / (high - low) * std::sqrt((variance_low + variance_high - 2 * covariance) / pixels);
  fit.read_noise_log_sigma.error_of_square = width * width_error / 2;
  // Offsets: columns and rows by the middle of the other axis.
  std::vector<double> column_level, row_level, rest;
  for (int c = 0; c < columns; ++c) {
    std::vector<double> values;
    for (int r = 0; r < rows; ++r) values.push_back(means[static_cast<std::size_t>(r) * columns + c]);
    column_level.push_back(middle_mean(std::move(values)) - fit.bias_counts);
  }
  for (int r = 0; r < rows; ++r) {
    std::vector<double> values;
    for (int c = 0; c < columns; ++c)
      values.push_back(means[static_cast<std::size_t>(r) * columns + c] - column_level[c]);
    row_level.push_back(middle_mean(std::move(values)) - fit.bias_counts);
  }
  for (int r = 0; r < rows; ++r)
    for (int c = 0; c < columns; ++c)
      rest.push_back(means[static_cast<std::size_t>(r) * columns + c] - column_level[c] - row_level[r] -
                     fit.bias_counts);
  const double noise_of_mean = square(fit.read_noise_counts) / n;
  // Less what went into the levels of columns and rows. Noise of unequal pixels has long tails, which draws
  // the quantiles in (Cornish and Fisher's term of the kurtosis).
  const double seen =
      square(robust_sigma(rest)) * pixels / (std::max(1, rows - 1) * std::max(1, columns - 1));
  const double tails = 3 * std::expm1(4 * square(fit.read_noise_log_sigma.value())) *
                       square(std::min(1.0, noise_of_mean / std::max(seen, 1e-300)));
  const double pixel_spread = seen * (1 + std::min(0.5, tails / 6));
  fit.offset_sigma_counts = {pixel_spread - noise_of_mean, robust_loss * pixel_spread / std::sqrt(pixels)};
  // The levels of columns and rows with what the pixels leave in them.
  const double column_total = square(robust_sigma(column_level)), row_total = square(robust_sigma(row_level));
  // Half the distance of the 16 % and 84 % quantiles of Gumbel's law in its scale, and its error as above.
  constexpr double gumbel_sigma = 1.1829, gumbel_loss = 2.19;
  fit.column_gumbel_counts = {(column_total - middle_loss * pixel_spread / rows) / square(gumbel_sigma),
                              gumbel_loss * column_total / square(gumbel_sigma) / std::sqrt(columns)};
  fit.row_offset_sigma_counts = {row_total - middle_loss * pixel_spread / columns,
                                 robust_loss * row_total / std::sqrt(rows)};
  const double row_variance = square(fit.row_offset_sigma_counts.value());
  // Error of the median of normal values, of which those of a column and of a row have a part in common: the
  // signs of two with correlation r agree as 2/pi asin r says (Sheppard).
  const double column_variance = square(fit.column_gumbel_counts.value() * std::numbers::pi) / 6;
  const double all = pixel_spread + column_variance + row_variance;
  if (!(all > 0)) return fit;
  constexpr double third_cumulant = 2.404;  // of Gumbel's law, whose median lies below the mean
  fit.bias_counts += third_cumulant * std::pow(fit.column_gumbel_counts.value(), 3) / (6 * all);
  fit.bias_error =
      std::sqrt(all * (std::numbers::pi / 2 / pixels + std::asin(column_variance / all) / columns +
                       std::asin(row_variance / all) / rows));
  return fit;
}

}  // namespace atomcam
