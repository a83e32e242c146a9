#include "analysis/series.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "analysis/fourier.hpp"
#include "analysis/robust.hpp"

namespace atomcam::analysis {
namespace {

struct Series {
  std::vector<double> value;  // mean taken away; zero where there is none
  std::vector<char> there;
  double count = 0, variance = 0;
  double noise = 0;  // variance without drift, jumps and what changes between odd and even frames

  Series(std::span<const double> values, const Record& record, Part which)
      : value(record.frames), there(record.frames) {
    double sum = 0;
    for (std::size_t n = 0; n < record.frames; ++n)
      if (record.holds(which, n) && std::isfinite(values[n])) {
        there[n] = 1;
        value[n] = values[n];
        sum += values[n];
        ++count;
      }
    if (count < 2) return;
    for (std::size_t n = 0; n < value.size(); ++n)
      if (there[n]) {
        value[n] -= sum / count;
        variance += value[n] * value[n] / (count - 1);
      }
    std::vector<float> steps;
    for (std::size_t n = 2; n < value.size(); ++n)
      if (there[n] && there[n - 2])
        steps.push_back(static_cast<float>((value[n] - value[n - 2]) / std::numbers::sqrt2));
    noise = steps.size() < 3 ? variance : std::pow(core_spread(steps), 2);
  }
  double correlation(std::size_t lag) const {
    double sum = 0, pairs = 0;
    for (std::size_t n = lag; n < value.size(); ++n)
      if (there[n] && there[n - lag]) sum += value[n] * value[n - lag], ++pairs;
    return pairs < 3 || variance == 0 ? not_a_number : sum / pairs / variance;
  }
  /// Half the mean square of the steps from a frame to the next: a slow drift leaves it alone (von Neumann).
  double step_variance() const {
    double sum = 0, pairs = 0;
    for (std::size_t n = 1; n < value.size(); ++n)
      if (there[n] && there[n - 1]) sum += std::pow(value[n] - value[n - 1], 2) / 2, ++pairs;
    return pairs < 3 ? not_a_number : sum / pairs;
  }
  /// In standard errors of white noise, x from -1 to 1 along the stack.
  double projection(double (*shape)(double)) const {
    if (count < 4 || noise == 0) return not_a_number;
    const double scale = 2 / static_cast<double>(value.size());
    double mean = 0, sum = 0, square = 0;
    for (std::size_t n = 0; n < value.size(); ++n)
      if (there[n]) mean += shape((static_cast<double>(n) + 0.5) * scale - 1) / count;
    for (std::size_t n = 0; n < value.size(); ++n)
      if (there[n]) {
        const double s = shape((static_cast<double>(n) + 0.5) * scale - 1) - mean;
        sum += s * value[n];
        square += s * s;
      }
    return sum / std::sqrt(square * noise);
  }
};

}  // namespace

void put_short_series(Sheet& sheet, std::string_view name, std::span<const double> values,
                      const Record& record, Part which, double white) {
  const Series series(values, record, which);
  const auto enough = [&](double value) { return series.count < 3 ? not_a_number : value; };
  sheet.put(name, "variance", enough(std::log(series.variance / white)));
  sheet.put(name, "correlation_1", enough(series.correlation(1)));
  sheet.put(name, "trend", std::asinh(series.projection([](double x) { return x; }) / 4));
  sheet.put(name, "curvature", std::asinh(series.projection([](double x) { return x * x; }) / 4));
}

void put_series(Sheet& sheet, std::string_view name, std::span<const double> values, const Record& record,
                Part which, double white) {
  put_short_series(sheet, name, values, record, which, white);
  const Series series(values, record, which);
  sheet.put(name, "correlation_5", series.correlation(5));
  sheet.put(name, "steps", std::log(series.step_variance() / white));
  const double sigma = std::sqrt(series.noise);
  double jump = 0, first = 0, first_count = 0, odd = 0, largest = 0;
  for (std::size_t n = 0; n < series.value.size(); ++n) {
    if (!series.there[n]) continue;
    largest = std::max(largest, std::abs(series.value[n]));
    if (n % 2) odd += series.value[n];
    if (n < 3) first += series.value[n], ++first_count;
  }
  // Between the means of eight frames before and after.
  std::vector<double> present;
  for (std::size_t n = 0; n < series.value.size(); ++n)
    if (series.there[n]) present.push_back(series.value[n]);
  constexpr std::size_t width = 8;
  double before = 0, after = 0;
  if (present.size() >= 2 * width) {
    for (std::size_t i = 0; i < width; ++i) before += present[i], after += present[i + width];
    for (std::size_t i = width;; ++i) {
      jump = std::max(jump, std::abs(after - before));
      if (i + width >= present.size()) break;
      before += present[i] - present[i - width];
      after += present[i + width] - present[i];
    }
  }
  sheet.put_unsteady(
      name, "jump",
      present.size() >= 2 * width ? std::log(jump / (sigma * std::sqrt(2.0 * width))) : not_a_number);
  sheet.put_unsteady(name, "largest", series.count < 3 ? not_a_number : std::log(largest / sigma));
  sheet.put_unsteady(name, "first_frames",
                     first_count > 0 && series.count > 5
                         ? std::asinh(first / sigma / std::sqrt(first_count) / 4)
                         : not_a_number);
  sheet.put(name, "odd_frames",
            series.count < 4 ? not_a_number : std::asinh(odd / sigma / std::sqrt(series.count / 4) / 4));
  if (series.count < 16 || series.variance == 0) {
    sheet.put(name, "peak", not_a_number);
    return;
  }
  ImageSpectrum spectrum(1, static_cast<int>(series.value.size()));
  for (std::size_t n = 0; n < series.value.size(); ++n)
    spectrum.image()[n] = static_cast<float>(series.value[n]);
  spectrum.transform();
  double peak = 0, sum = 0;
  for (std::size_t k = 1; k < spectrum.spectrum().size(); ++k) {
    const double power = static_cast<double>(std::norm(spectrum.spectrum()[k]));
    peak = std::max(peak, power);
    sum += power;
  }
  sheet.put(name, "peak", std::log(peak * static_cast<double>(spectrum.spectrum().size() - 1) / sum));
}

}  // namespace atomcam::analysis
