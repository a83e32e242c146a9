#include "judging/detectors.hpp"

#include <algorithm>
#include <cmath>

#include "base/error.hpp"
#include "optics/optics.hpp"

namespace atomcam {
namespace {

constexpr double light_in_square = 0.75;
constexpr int widest = 32;

/// Mean and variance of what is added.
struct Moments {
  double number = 0, sum = 0, squares = 0;
  void add(double value) { ++number, sum += value, squares += value * value; }
  double mean() const { return number > 0 ? sum / number : 0; }
  double variance() const { return number > 1 ? std::max(0.0, squares / number - mean() * mean()) : 0; }
};

}  // namespace

ReferenceDetector::ReferenceDetector(const Lab& lab, const StackPlace& place, Shape shape, Detector kind,
                                     int half_width_px)
    : shape_(shape), kind_(kind) {
  if (half_width_px > widest)
    throw Error("half width", std::to_string(half_width_px) + "; at most " + std::to_string(widest));
  const PointSpreadFunction spread(lab.optics, 0, lab.scene.atom_extent_um);
  int half_width = half_width_px;
  if (half_width <= 0) {
    double radius = 0.5;
    while (radius < widest && spread.fraction_within(radius) < light_in_square) radius += 0.25;
    half_width =
        std::max(1, static_cast<int>(std::lround(radius / std::max(place.binning_x, place.binning_y))));
  }
  for (const Site& site : lab.scene.sites) {
    const auto column =
        static_cast<int>(std::lround((site.x_px + 0.5 - place.offset_x_px) / place.binning_x - 0.5));
    const auto row =
        static_cast<int>(std::lround((site.y_px + 0.5 - place.offset_y_px) / place.binning_y - 0.5));
    const int side = 2 * half_width + 1;
    PhotonImage light({side, side});
    spread.add_expected(
        light, 1, site.x_px, site.y_px, place.offset_x_px + (column - half_width) * place.binning_x,
        place.offset_y_px + (row - half_width) * place.binning_y, place.binning_x, place.binning_y);
    Window window;
    for (int r = 0; r < side; ++r) {
      for (int c = 0; c < side; ++c) {
        const int y = row - half_width + r, x = column - half_width + c;
        if (y < 0 || x < 0 || y >= shape.rows || x >= shape.columns) continue;
        window.pixels.push_back(static_cast<std::size_t>(y) * static_cast<std::size_t>(shape.columns) +
                                static_cast<std::size_t>(x));
        window.light.push_back(light(r, c));
      }
    }
    window.weights.assign(window.pixels.size(), 1);
    windows_.push_back(std::move(window));
  }
}

/// Best against noise that grows with the light: share of light over variance. The variance of a pixel is
/// that of empty sites and, half the time, an atom's in proportion to its light there.
void ReferenceDetector::weigh(const Frames& frames, std::span<const SiteTruth> truth) {
  double most = 0;
  for (const Window& window : windows_)
    for (const double light : window.light) most = std::max(most, light);
  const std::size_t sites = windows_.size();
  Moments empty;
  std::vector<Moments> filled(16);  // by light
  std::vector<double> light_in(filled.size(), 0);
  const SiteTruth* site = truth.data();
  frames([&](std::span<const float> frame) {
    for (std::size_t s = 0; s < sites; ++s) {
      const bool atom = (site++)->filled;
      for (std::size_t i = 0; i < windows_[s].pixels.size(); ++i) {
        const double value = static_cast<double>(frame[windows_[s].pixels[i]]);
        if (!atom) {
          empty.add(value);
          continue;
        }
        const auto bin = std::min(
            filled.size() - 1,
            static_cast<std::size_t>(windows_[s].light[i] / most * static_cast<double>(filled.size())));
        filled[bin].add(value);
        light_in[bin] += windows_[s].light[i];
      }
    }
  });
  const double dark = std::max(empty.variance(), 1e-6);
  double above = 0, square = 0;
  for (std::size_t bin = 0; bin < filled.size(); ++bin) {
    if (filled[bin].number < 2) continue;
    const double light = light_in[bin] / filled[bin].number;
    above += filled[bin].number * light * std::max(0.0, filled[bin].variance() - dark);
    square += filled[bin].number * light * light;
  }
  const double slope = square > 0 ? above / square : 0;
  for (Window& window : windows_) {
    double norm = 0;
    for (std::size_t i = 0; i < window.weights.size(); ++i) {
      window.weights[i] = window.light[i] / (dark + 0.5 * slope * window.light[i]);
      norm += window.weights[i] * window.light[i];
    }
    for (double& weight : window.weights) weight /= std::max(norm, 1e-12);
  }
}

void ReferenceDetector::teach(const Frames& frames, std::span<const SiteTruth> truth) {
  const auto fail = [&](std::uint64_t number) {
    throw Error("truth", std::to_string(truth.size()) + " sites; " + std::to_string(number) + " frames of " +
                             std::to_string(sites()));
  };
  const Frames checked = [&](const Visit& visit) {
    std::uint64_t number = 0;
    frames([&](std::span<const float> frame) {
      if (++number * sites() > truth.size()) fail(number);
      visit(frame);
    });
    if (number * sites() != truth.size()) fail(number);
  };
  if (kind_ == Detector::matched) weigh(checked, truth);
  SiteScores scores{0, sites(), std::vector<float>(truth.size())};
  checked([&](std::span<const float> frame) {
    score(frame, std::span(scores.values).subspan(scores.frames * scores.sites, scores.sites));
    ++scores.frames;
  });
  threshold_ = best_threshold(scores, {truth.begin(), truth.end()});
  taught_ = true;
}

void ReferenceDetector::score(std::span<const float> frame, std::span<float> scores) const {
  for (std::size_t s = 0; s < windows_.size(); ++s) {
    const Window& window = windows_[s];
    double sum = 0;
    for (std::size_t i = 0; i < window.pixels.size(); ++i)
      sum += window.weights[i] * static_cast<double>(frame[window.pixels[i]]);
    scores[s] = static_cast<float>(sum);
  }
}

Detected detect(StackReader& stack, const Lab& lab, const StackPlace& place, Detector detector,
                const std::vector<SiteTruth>& truth, int half_width_px) {
  const std::size_t sites = lab.scene.sites.size();
  const std::uint64_t frames = stack.frames();
  if (frames < 2)
    throw Error(stack.file().string(),
                "1 frame; a built-in detector learns from one half of the frames and is judged by the other");
  if (truth.size() != frames * sites) throw Error(stack.file().string(), "truth of other frames or sites");
  ReferenceDetector reference(lab, place, stack.shape().frame(), detector, half_width_px);
  std::vector<float> frame(stack.shape().pixels());
  const auto every_other = [&](std::uint64_t first, const ReferenceDetector::Visit& visit) {
    for (std::uint64_t n = first; n < frames; n += 2) {
      stack.read(n, std::span(frame));
      visit(frame);
    }
  };
  const auto truth_of = [&](std::uint64_t first) {
    std::vector<SiteTruth> half;
    for (std::uint64_t n = first; n < frames; n += 2)
      half.insert(half.end(), truth.begin() + static_cast<std::ptrdiff_t>(n * sites),
                  truth.begin() + static_cast<std::ptrdiff_t>((n + 1) * sites));
    return half;
  };
  reference.teach([&](const auto& visit) { every_other(0, visit); }, truth_of(0));
  Detected detected;
  detected.threshold = reference.threshold();
  detected.truth = truth_of(1);
  detected.scores.sites = sites;
  std::vector<float> scores(sites);
  every_other(1, [&](std::span<const float> pixels) {
    ++detected.scores.frames;
    reference.score(pixels, scores);
    detected.scores.values.insert(detected.scores.values.end(), scores.begin(), scores.end());
  });
  return detected;
}

}  // namespace atomcam
