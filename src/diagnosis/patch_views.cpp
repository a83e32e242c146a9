#include "diagnosis/patch_views.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <numbers>

#include "base/random.hpp"

namespace atomcam {
namespace {

constexpr int random_views = 5;  // of each shape, besides the even one
constexpr double places = 500;   // per frame and shape
/// Parts of the pixels whose mean tells about the frame, from the brightest on.
constexpr std::array tails = {0.001, 0.01, 0.1, 0.5};

/// asinh of each, in vectors.
template <class Values>
void compress(Values&& values) {
  values = values.sign() * (values.abs() + (values.square() + 1).sqrt()).log();
}

}  // namespace

PatchViews::PatchViews(const StackModel& model, std::uint64_t seed) {
  const double g = model.counts_per_electron;
  const double events = model.dark_e + model.background_e;
  level_ = static_cast<float>(model.bias_counts + g * events);
  per_count_ =
      static_cast<float>(1 / std::sqrt(std::max(1e-6, model.read_noise_counts * model.read_noise_counts +
                                                          model.excess_noise * g * g * events)));
  const PhiloxKey key = stream_key(seed, stream_id("diagnosis/patch_views"));
  constexpr std::array<std::array<int, 2>, 3> shapes = {{{6, 6}, {1, 24}, {24, 1}}};
  for (std::size_t s = 0; s < shapes.size(); ++s) {
    Patch patch;
    patch.rows = std::min(shapes[s][0], model.shape.rows);
    patch.columns = std::min(shapes[s][1], model.shape.columns);
    patch.weights.resize(static_cast<Eigen::Index>(patch.rows) * patch.columns, 1 + random_views);
    RandomStream random(key, s, 0);
    for (Eigen::Index view = 0; view < patch.weights.cols(); ++view) {
      for (Eigen::Index n = 0; n < patch.weights.rows(); ++n) {
        const double u = random.uniform(), v = random.uniform();
        patch.weights(n, view) =
            view == 0 ? 1.0F
                      : static_cast<float>(std::sqrt(-2 * std::log(u)) * std::cos(2 * std::numbers::pi * v));
      }
      patch.weights.col(view).normalize();
    }
    views_ += static_cast<std::size_t>(patch.weights.cols());
    patches_.push_back(std::move(patch));
  }
}

Eigen::Index PatchViews::features() const {
  return 2 * static_cast<Eigen::Index>(views_) + static_cast<Eigen::Index>(tails.size()) + 1;
}

void PatchViews::look(std::size_t frame_number, const CountImage& frame,
                      Eigen::Ref<Eigen::RowVectorXd> features, std::span<std::uint64_t> histograms) const {
  Eigen::Index feature = 0;
  std::size_t view = 0;
  for (const Patch& patch : patches_) {
    const int rows = frame.rows() - patch.rows + 1, columns = frame.columns() - patch.columns + 1;
    // Every step-th place, each frame beginning elsewhere.
    const int step = std::max(1, static_cast<int>(std::sqrt(static_cast<double>(rows) * columns / places)));
    const auto first = static_cast<int>(frame_number % static_cast<std::size_t>(step * step));
    const int first_row = std::min(first / step, rows - 1),
              first_column = std::min(first % step, columns - 1);
    const int down = (rows - 1 - first_row) / step + 1, across = (columns - 1 - first_column) / step + 1;
    Eigen::MatrixXf pixels(patch.weights.rows(), static_cast<Eigen::Index>(down) * across);
    Eigen::Index place = 0;
    for (int r = first_row; r < rows; r += step)
      for (int c = first_column; c < columns; c += step, ++place) {
        float* to = pixels.col(place).data();
        for (int y = 0; y < patch.rows; ++y) {
          const auto line = frame.row(r + y);
          for (int x = 0; x < patch.columns; ++x)
            *to++ = (static_cast<float>(line[static_cast<std::size_t>(c + x)]) - level_) * per_count_;
        }
      }
    Eigen::MatrixXf sums = pixels.transpose() * patch.weights;
    compress(sums.array());
    for (Eigen::Index k = 0; k < sums.cols(); ++k, ++view) {
      for (Eigen::Index n = 0; n < sums.rows(); ++n) {
        const int bin =
            std::clamp(static_cast<int>(std::floor(static_cast<double>(sums(n, k)) / bin_width)) + bins / 2,
                       0, bins - 1);
        ++histograms[view * bins + static_cast<std::size_t>(bin)];
      }
      features(feature++) = sums.col(k).cast<double>().mean();
      features(feature++) = sums.col(k).cast<double>().squaredNorm() / static_cast<double>(sums.rows());
    }
  }
  std::vector<std::uint16_t> sorted(frame.pixels().begin(), frame.pixels().end());
  // From the brightest pixels to ever more of them; what is left at last are the darkest.
  const auto tell = [&](std::size_t from, std::size_t to) {
    Eigen::ArrayXf seen(static_cast<Eigen::Index>(to - from));
    for (std::size_t n = from; n < to; ++n)
      seen(static_cast<Eigen::Index>(n - from)) = (static_cast<float>(sorted[n]) - level_) * per_count_;
    compress(seen);
    features(feature++) = to > from ? seen.cast<double>().mean() : 0;
  };
  std::size_t from = 0;
  for (const double part : tails) {
    const auto to =
        std::clamp(static_cast<std::size_t>(std::lround(part * static_cast<double>(sorted.size()))), from,
                   sorted.size());
    if (to > from && to < sorted.size())
      std::nth_element(sorted.begin() + static_cast<std::ptrdiff_t>(from),
                       sorted.begin() + static_cast<std::ptrdiff_t>(to), sorted.end(), std::greater<>());
    tell(from, to);
    from = to;
  }
  tell(from, sorted.size());
}

}  // namespace atomcam
