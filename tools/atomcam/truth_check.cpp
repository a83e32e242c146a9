#include "atomcam/truth_check.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <nlohmann/json.hpp>
#include <optional>

#include "base/error.hpp"

namespace atomcam {
namespace {

constexpr double light_in_window = 0.75;
constexpr double least_electrons = 1000;  // fewer cannot place an atom to a tenth of a pixel
constexpr double step_px = 0.1;           // of the derivative

template <std::size_t n>
using Normal = std::array<std::array<double, n + 1>, n>;

/// Solves n equations by elimination with pivots.
template <std::size_t n>
std::array<double, n> solve(Normal<n> m) {
  for (std::size_t k = 0; k < n; ++k) {
    std::size_t pivot = k;
    for (std::size_t i = k + 1; i < n; ++i)
      if (std::fabs(m[i][k]) > std::fabs(m[pivot][k])) pivot = i;
    std::swap(m[k], m[pivot]);
    for (std::size_t i = 0; i < n; ++i) {
      if (i == k) continue;
      const double factor = m[i][k] / m[k][k];
      for (std::size_t j = k; j <= n; ++j) m[i][j] -= factor * m[k][j];
    }
  }
  std::array<double, n> solution;
  for (std::size_t k = 0; k < n; ++k) solution[k] = m[k][n] / m[k][k];
  return solution;
}

/// Weighted least squares: coefficients of `templates` in `data`.
template <std::size_t n>
std::array<double, n> fit(const std::array<const std::vector<double>*, n>& templates,
                          const std::vector<double>& weights, const std::vector<double>& data) {
  Normal<n> m{};
  for (std::size_t p = 0; p < data.size(); ++p) {
    for (std::size_t i = 0; i < n; ++i) {
      const double weighted = weights[p] * (*templates[i])[p];
      for (std::size_t j = 0; j < n; ++j) m[i][j] += weighted * (*templates[j])[p];
      m[i][n] += weighted * data[p];
    }
  }
  return solve<n>(m);
}

/// The pixels around a site and how an atom there lights them.
struct Window {
  int row = 0, column = 0, rows = 0, columns = 0;
  std::vector<double> constant, atom, along_x, along_y, weights;
  std::vector<double> residual;  // summed over the frames with an atom

  double electrons = 0;  // true, over the frames with an atom
  double excess = 0;     // measured beyond the truth
  double empty = 0;      // measured over the frames without one
  std::uint64_t filled = 0, vacant = 0;

  std::vector<double> cut(const PhotonImage& image) const {
    std::vector<double> pixels;
    for (int r = row; r < row + rows; ++r)
      for (int c = column; c < column + columns; ++c) pixels.push_back(image(r, c));
    return pixels;
  }
};

class Checker {
 public:
  Checker(const Lab& lab, const StackSettings& settings, Shape shape)
      : lab_(lab), settings_(settings), spread_(lab.optics, 0, lab.scene.atom_extent_um), model_(shape) {
    double radius = 2;
    while (radius < 16 && spread_.fraction_within(radius) < light_in_window) radius += 0.5;
    for (const Site& site : lab.scene.sites) {
      windows_.push_back(window(site.x_px, site.y_px, radius));
      inside_.push_back(light_inside(site.x_px, site.y_px));
    }
    electrons_per_count_ = settings.electrons_per_count / settings.em_gain;
  }

  void add(const CountImage& counts, const FrameAtoms& truth) {
    std::ranges::fill(model_.pixels(), 0.f);
    for (const FrameAtoms::Atom& atom : truth.atoms)
      add_atom(model_, atom.electrons / inside(atom.site), atom.x_px, atom.y_px);
    // What the truth does not explain, in electrons.
    for (int r = 0; r < model_.rows(); ++r) {
      const auto row = model_.row(r);
      const auto read = counts.row(r);
      for (int c = 0; c < model_.columns(); ++c)
        row[c] = static_cast<float>((read[c] - settings_.bias_counts) * electrons_per_count_ - row[c]);
    }
    std::vector<const FrameAtoms::Atom*> at(windows_.size(), nullptr);
    for (const FrameAtoms::Atom& atom : truth.atoms)
      if (atom.site >= 0 && static_cast<std::size_t>(atom.site) < at.size())
        at[static_cast<std::size_t>(atom.site)] = &atom;
    for (std::size_t i = 0; i < windows_.size(); ++i) {
      if (!windows_[i]) continue;
      Window& window = *windows_[i];
      const std::vector<double> pixels = window.cut(model_);
      const double measured = fit<2>({&window.constant, &window.atom}, window.weights, pixels)[1];
      if (at[i]) {
        ++window.filled;
        const double electrons = at[i]->electrons / inside(at[i]->site);
        window.electrons += electrons;
        window.excess += measured;
        std::ranges::transform(window.residual, pixels, window.residual.begin(), std::plus<>());
        filled_.push_back({electrons, measured});
      } else {
        ++window.vacant;
        window.empty += measured;
        vacant_square_ += measured * measured;
        ++vacant_;
      }
    }
    ++frames_;
  }

  TruthCheck result() const {
    TruthCheck check;
    check.frames = frames_;
    check.atom_images = filled_.size();
    // The variance of a measured brightness is `noise` + `per_electron` * electrons: from the scatter over
    // frames without an atom, and with one.
    const double noise = vacant_ > 0 ? vacant_square_ / static_cast<double>(vacant_) : 0;
    double electrons = 0, excess = 0;
    for (const auto& [truth, more] : filled_) electrons += truth, excess += more;
    const double offset = electrons > 0 ? excess / electrons : 0;
    double scatter = 0;
    for (const auto& [truth, more] : filled_) scatter += std::pow(more - offset * truth, 2) - noise;
    const double per_electron = electrons > 0 ? std::max(0.0, scatter / electrons) : 0;
    check.brightness = 1 + offset;
    check.brightness_error =
        std::sqrt(per_electron * electrons + noise * static_cast<double>(filled_.size())) /
        std::max(1.0, electrons);
    for (std::size_t i = 0; i < windows_.size(); ++i) {
      if (!windows_[i] || windows_[i]->electrons < least_electrons) {
        ++check.dim_sites;
        continue;
      }
      const Window& window = *windows_[i];
      SiteCheck site;
      site.site = static_cast<int>(i);
      site.frames = window.filled;
      site.electrons = window.electrons;
      const auto found = fit<4>({&window.constant, &window.atom, &window.along_x, &window.along_y},
                                window.weights, window.residual);
      site.dx_px = found[2] / window.electrons;
      site.dy_px = found[3] / window.electrons;
      site.deviation_sigma = window.excess / std::sqrt(per_electron * window.electrons +
                                                       noise * static_cast<double>(window.filled));
      if (window.vacant > 0)
        site.empty_sigma = window.empty / std::sqrt(noise * static_cast<double>(window.vacant));
      check.sites.push_back(site);
    }
    return check;
  }

 private:
  void add_atom(PhotonImage& image, double electrons, double x_px, double y_px) const {
    spread_.add_expected(image, electrons, x_px, y_px, settings_.offset_x, settings_.offset_y,
                         settings_.binning_x, settings_.binning_y);
  }

  double inside(int site) const {
    return site >= 0 && static_cast<std::size_t>(site) < inside_.size()
               ? inside_[static_cast<std::size_t>(site)]
               : 1;
  }

  /// Share of an atom's light that the frame holds: its electrons are counted within the frame only.
  double light_inside(double x_px, double y_px) const {
    const double reach = spread_.reach_px() + 1;
    const double right = settings_.offset_x + model_.columns() * settings_.binning_x;
    const double bottom = settings_.offset_y + model_.rows() * settings_.binning_y;
    if (x_px - reach > settings_.offset_x && x_px + reach < right && y_px - reach > settings_.offset_y &&
        y_px + reach < bottom)
      return 1;
    PhotonImage image(model_.shape());
    add_atom(image, 1, x_px, y_px);
    double sum = 0;
    for (const float light : image.pixels()) sum += light;
    return std::max(sum, 1e-3);
  }

  std::optional<Window> window(double x_px, double y_px, double radius_px) const {
    const double x = (x_px + 0.5 - settings_.offset_x) / settings_.binning_x - 0.5;
    const double y = (y_px + 0.5 - settings_.offset_y) / settings_.binning_y - 0.5;
    const int across = std::max(2, static_cast<int>(std::ceil(radius_px / settings_.binning_x)));
    const int down = std::max(2, static_cast<int>(std::ceil(radius_px / settings_.binning_y)));
    Window window;
    window.column = static_cast<int>(std::lround(x)) - across;
    window.row = static_cast<int>(std::lround(y)) - down;
    window.columns = 2 * across + 1;
    window.rows = 2 * down + 1;
    if (window.row < 0 || window.column < 0 || window.row + window.rows > model_.rows() ||
        window.column + window.columns > model_.columns())
      return std::nullopt;
    const auto lit = [&](double dx, double dy) {
      PhotonImage patch({window.rows, window.columns});
      spread_.add_expected(
          patch, 1, x_px + dx, y_px + dy, settings_.offset_x + window.column * settings_.binning_x,
          settings_.offset_y + window.row * settings_.binning_y, settings_.binning_x, settings_.binning_y);
      return std::vector<double>(patch.pixels().begin(), patch.pixels().end());
    };
    const auto slope = [](std::vector<double> ahead, const std::vector<double>& behind) {
      for (std::size_t p = 0; p < ahead.size(); ++p) ahead[p] = (ahead[p] - behind[p]) / (2 * step_px);
      return ahead;
    };
    window.atom = lit(0, 0);
    window.along_x = slope(lit(step_px, 0), lit(-step_px, 0));
    window.along_y = slope(lit(0, step_px), lit(0, -step_px));
    window.constant.assign(window.atom.size(), 1);
    window.residual.assign(window.atom.size(), 0);
    // Bright pixels are noisy ones; any weights leave the fit without bias.
    const double peak = *std::ranges::max_element(window.atom);
    for (const double light : window.atom) window.weights.push_back(1 / (light / peak + 0.15));
    return window;
  }

  const Lab& lab_;
  const StackSettings& settings_;
  PointSpreadFunction spread_;
  PhotonImage model_;
  double electrons_per_count_ = 1;
  std::vector<std::optional<Window>> windows_;  // by site; none where it does not fit into the frame
  std::vector<double> inside_;                  // by site
  struct Measured {
    double truth, more;
  };
  std::vector<Measured> filled_;
  double vacant_square_ = 0;
  std::uint64_t vacant_ = 0, frames_ = 0;
};

}  // namespace

FrameAtoms frame_atoms(const std::string& truth, const std::string& place) {
  FrameAtoms frame;
  try {
    const auto json = nlohmann::json::parse(truth);
    frame.frame = json.at("frame");
    frame.initial = json.at("initial");
    const std::string final_ones = json.at("final");
    for (const auto& atom : json.at("atoms")) {
      const int site = atom.at("site");
      frame.atoms.push_back({site, atom.at("x_px"), atom.at("y_px"), atom.at("detected_e"),
                             final_ones.at(static_cast<std::size_t>(site)) == '0'});
    }
  } catch (const std::exception&) {
    throw Error(
        place,
        "a frame without truth; frames of `atomcam render` and of a camera of `atomcam serve` have it");
  }
  return frame;
}

TruthCheck check_truth(StackReader& stack, const Lab& lab, const StackSettings& settings,
                       const std::string& place) {
  if (settings.electrons_per_count <= 0)
    throw Error(place, "its settings do not tell the electrons per count");
  if (settings.pixel_format != "Mono16")
    throw Error(place, "pixel format " + settings.pixel_format + "; allowed Mono16");
  Checker checker(lab, settings, stack.shape().frame());
  for (std::uint64_t n = 0; n < stack.frames(); ++n)
    checker.add(stack.counts(n), frame_atoms(stack.truth(n), place));
  return checker.result();
}

}  // namespace atomcam
