#include "diagnosis/site_detectors.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace atomcam {
namespace {

constexpr double light_in_square = 0.75;
constexpr int histogram_bins = 300;
constexpr int rounds = 80;
constexpr int bridge_steps = 12;

double tail(double z) {
  return 0.5 * std::erfc(z / std::sqrt(2.0));
}

/// Half width of the smallest square about the sites that holds three quarters of the light they have.
int half_width(const StackModel& model) {
  for (int half = 1;; ++half) {
    double inside = 0, all = 0;
    bool wider = false;
    for (const SiteImage& site : model.sites) {
      const int row = static_cast<int>(std::lround(site.y_px)) - site.top,
                column = static_cast<int>(std::lround(site.x_px)) - site.left;
      for (int r = 0; r < site.share.rows(); ++r)
        for (int c = 0; c < site.share.columns(); ++c) {
          const auto share = static_cast<double>(site.share(r, c));
          const bool in = std::abs(r - row) <= half && std::abs(c - column) <= half;
          all += share;
          inside += in ? share : 0;
          wider = wider || !in;
        }
    }
    if (inside >= light_in_square * all || !wider) return half;
  }
}

}  // namespace

SiteDetector::SiteDetector(const StackModel& model, Kind kind) {
  const double g = model.counts_per_electron;
  level_ = model.bias_counts + g * (model.dark_e + model.background_e);
  const double dark = model.read_noise_counts * model.read_noise_counts +
                      model.excess_noise * g * g * (model.dark_e + model.background_e);
  const double per_share = 0.5 * model.excess_noise * g * g * model.atom_e;
  const int half = model.sites.empty() ? 0 : half_width(model);
  for (const SiteImage& site : model.sites) {
    const int row = static_cast<int>(std::lround(site.y_px)) - site.top,
              column = static_cast<int>(std::lround(site.x_px)) - site.left;
    Window window;
    double norm = 0;
    for (int r = 0; r < site.share.rows(); ++r)
      for (int c = 0; c < site.share.columns(); ++c) {
        const auto share = static_cast<double>(site.share(r, c));
        const bool matched = kind == Kind::matched;
        if (!matched && (std::abs(r - row) > half || std::abs(c - column) > half)) continue;
        const double weight = matched ? share / std::max(1e-12, dark + per_share * share) : 1;
        norm += matched ? weight * share : 0;
        window.pixels.push_back(static_cast<std::size_t>(site.top + r) *
                                    static_cast<std::size_t>(model.shape.columns) +
                                static_cast<std::size_t>(site.left + c));
        window.weights.push_back(static_cast<float>(weight));
      }
    const double scale = 1 / (g * (kind == Kind::matched && norm > 0 ? norm : 1));
    for (float& weight : window.weights) weight = static_cast<float>(static_cast<double>(weight) * scale);
    windows_.push_back(std::move(window));
  }
}

void SiteDetector::score(const CountImage& frame, std::span<float> scores) const {
  const auto pixels = frame.pixels();
  for (std::size_t s = 0; s < windows_.size(); ++s) {
    const Window& window = windows_[s];
    double sum = 0;
    for (std::size_t n = 0; n < window.pixels.size(); ++n)
      sum +=
          static_cast<double>(window.weights[n]) * (static_cast<double>(pixels[window.pixels[n]]) - level_);
    scores[s] = static_cast<float>(sum);
  }
}

namespace {

/// Where in the bridge a step stands: 0 at the lower peak, 1 at the upper one.
double place_of(int step) {
  return (step + 0.5) / bridge_steps;
}
struct Normal {
  double mean = 0, width = 1;
  double density(double x) const {
    const double z = (x - mean) / width;
    return std::exp(-0.5 * z * z) / width;
  }
  double below(double x) const { return tail((mean - x) / width); }
};
Normal bridge_at(const TwoPeaks& peaks, int step) {
  const double t = place_of(step);
  return {
      peaks.lower + t * (peaks.upper - peaks.lower),
      std::sqrt((1 - t) * peaks.lower_width * peaks.lower_width + t * peaks.upper_width * peaks.upper_width)};
}
double bridge_density(const TwoPeaks& peaks, double x) {
  double sum = 0;
  for (int step = 0; step < bridge_steps; ++step) sum += bridge_at(peaks, step).density(x) / bridge_steps;
  return sum;
}

TwoPeaks no_peaks() {
  constexpr double nothing = std::numeric_limits<double>::quiet_NaN();
  return {nothing, nothing, nothing, nothing, nothing, nothing, nothing};
}

}  // namespace

double TwoPeaks::separation() const {
  return (upper - lower) / std::sqrt(0.5 * (lower_width * lower_width + upper_width * upper_width));
}

double TwoPeaks::fidelity() const {
  double missed = filled * Normal{upper, upper_width}.below(threshold);
  for (int step = 0; step < bridge_steps; ++step)
    missed += lost / bridge_steps * bridge_at(*this, step).below(threshold);
  return 1 - missed - (1 - filled - lost) * (1 - Normal{lower, lower_width}.below(threshold));
}

TwoPeaks two_peaks(std::span<const float> scores) {
  if (scores.size() < 50) return no_peaks();
  std::vector<float> sorted(scores.begin(), scores.end());
  std::sort(sorted.begin(), sorted.end());
  const auto at = [&](double q) {
    return static_cast<double>(sorted[static_cast<std::size_t>(q * static_cast<double>(sorted.size() - 1))]);
  };
  // A few scores far out must not widen the bins.
  const double low = at(0.001), high = at(0.999), step = std::max(1e-9, (high - low) / histogram_bins);
  std::vector<double> number(histogram_bins, 0);
  for (const float score : sorted) {
    const double bin = std::floor((static_cast<double>(score) - low) / step);
    number[static_cast<std::size_t>(std::clamp(bin, 0.0, histogram_bins - 1.0))] += 1;
  }
  const auto centre = [&](int bin) { return low + (bin + 0.5) * step; };
  // Whatever the filling: begin with the scores below and above the middle of their range.
  const double middle = 0.5 * (at(0.01) + at(0.99));
  double sums[2] = {0, 0}, numbers[2] = {0, 0};
  for (int bin = 0; bin < histogram_bins; ++bin) {
    const int side = centre(bin) > middle ? 1 : 0;
    sums[side] += number[static_cast<std::size_t>(bin)] * centre(bin);
    numbers[side] += number[static_cast<std::size_t>(bin)];
  }
  if (numbers[0] < 1 || numbers[1] < 1) return no_peaks();
  TwoPeaks peaks;
  peaks.lower = sums[0] / numbers[0], peaks.upper = sums[1] / numbers[1];
  peaks.filled = numbers[1] / (numbers[0] + numbers[1]);
  peaks.lost = 0.02 * peaks.filled;
  peaks.filled -= peaks.lost;
  peaks.lower_width = peaks.upper_width = std::max(2 * step, 0.25 * (peaks.upper - peaks.lower));
  double n[3] = {0, 0, 0};
  for (int round = 0; round < rounds; ++round) {
    double sum[2] = {0, 0}, squares[2] = {0, 0};
    std::fill(std::begin(n), std::end(n), 0.0);
    for (int bin = 0; bin < histogram_bins; ++bin) {
      const double weight = number[static_cast<std::size_t>(bin)], x = centre(bin);
      if (weight == 0) continue;
      double part[3] = {(1 - peaks.filled - peaks.lost) * Normal{peaks.lower, peaks.lower_width}.density(x),
                        peaks.filled * Normal{peaks.upper, peaks.upper_width}.density(x),
                        peaks.lost * bridge_density(peaks, x)};
      const double all = part[0] + part[1] + part[2];
      // Beyond all that the model expects: the nearer peak's.
      if (!(all > 0)) part[x < middle ? 0 : 1] = 1;
      for (int k = 0; k < 3; ++k) {
        const double share = weight * part[k] / (all > 0 ? all : 1);
        n[k] += share;
        if (k < 2) sum[k] += share * x, squares[k] += share * x * x;
      }
    }
    if (n[0] < 20 || n[1] < 20) return no_peaks();
    const TwoPeaks before = peaks;
    const double all = n[0] + n[1] + n[2];
    peaks.filled = n[1] / all, peaks.lost = n[2] / all;
    peaks.lower = sum[0] / n[0], peaks.upper = sum[1] / n[1];
    peaks.lower_width =
        std::max(step, std::sqrt(std::max(0.0, squares[0] / n[0] - peaks.lower * peaks.lower)));
    peaks.upper_width =
        std::max(step, std::sqrt(std::max(0.0, squares[1] / n[1] - peaks.upper * peaks.upper)));
    if (std::fabs(peaks.lower - before.lower) + std::fabs(peaks.upper - before.upper) < 1e-6 * (high - low))
      break;
  }
  if (!(peaks.separation() > 2)) return no_peaks();
  // Between the peaks the odds of an atom rise steadily.
  double from = peaks.lower, to = peaks.upper;
  for (int k = 0; k < 50; ++k) {
    const double x = 0.5 * (from + to);
    const double atom = peaks.filled * Normal{peaks.upper, peaks.upper_width}.density(x) +
                        peaks.lost * bridge_density(peaks, x);
    const double empty = (1 - peaks.filled - peaks.lost) * Normal{peaks.lower, peaks.lower_width}.density(x);
    (atom > empty ? to : from) = x;
  }
  peaks.threshold = 0.5 * (from + to);
  return peaks;
}

}  // namespace atomcam
