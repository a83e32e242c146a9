#include "diagnosis/emulator.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

namespace atomcam {
namespace {

constexpr int anchors = 5;  // stacks without the effect
constexpr int noise_groups = 8;

double noise_of_group(int group) {
  return 2e-4 * std::pow(5.0, group);  // relative to the signal's variance: 2e-4 ... 16
}

}  // namespace

// Every parameter over its range of the prior becomes 0 ... 1; an angle a point on a circle.
Eigen::VectorXd Emulator::features(const Eigen::VectorXd& coordinates) const {
  std::vector<double> out;
  for (std::size_t k = 0; k < open_.size(); ++k) {
    const Uncertain& one = open_[k];
    const double c = coordinates(static_cast<Eigen::Index>(k));
    if (one.cycle > 0) {
      const double turn = 2 * std::numbers::pi * (c - one.lowest) / one.cycle;
      out.push_back(0.5 * std::cos(turn));
      out.push_back(0.5 * std::sin(turn));
    } else {
      out.push_back((c - one.lowest) / (one.highest - one.lowest));
    }
  }
  return Eigen::Map<Eigen::VectorXd>(out.data(), static_cast<Eigen::Index>(out.size()));
}

double Emulator::kernel(const Eigen::VectorXd& a, const Eigen::VectorXd& b) const {
  const double strength = (a(0) - b(0)) / strength_length_;
  double shape = 0;
  for (Eigen::Index k = 1; k < a.size(); ++k) shape += (a(k) - b(k)) * (a(k) - b(k));
  // A weak effect has no shape: where the strengths are small the stacks are alike.
  const double distance = strength * strength + shape / (shape_length_ * shape_length_);
  return std::exp(-0.5 * distance);
}

Emulator::Emulator(std::vector<Uncertain> open, const Eigen::MatrixXd& draws, const Eigen::MatrixXd& values)
    : open_(std::move(open)) {
  const Eigen::Index n = draws.rows(), p = values.cols();
  for (Eigen::Index k = 0; k < n; ++k) points_.push_back(features(draws.row(k).transpose()));
  for (int k = 0; k < anchors; ++k) {
    Eigen::VectorXd point = points_[static_cast<std::size_t>(k) * points_.size() / (anchors + 1)];
    point(0) = 0;
    points_.push_back(point);
  }
  const auto all = static_cast<Eigen::Index>(points_.size());
  Eigen::MatrixXd targets = Eigen::MatrixXd::Zero(all, p);
  targets.topRows(n) = values;
  amplitude_.resize(p);
  group_.resize(static_cast<std::size_t>(p));
  for (Eigen::Index i = 0; i < p; ++i) {
    // Most statistics do not know of the effect: what the stacks' own scatter makes by chance is no response.
    const double power = targets.col(i).squaredNorm() / static_cast<double>(n);
    const double by_chance = 1.5 * std::sqrt(2 / static_cast<double>(n));
    amplitude_(i) = std::max(0.01, power - 1 - by_chance);
    const double noise = 1 / amplitude_(i);
    int group = 0;
    while (group < noise_groups - 1 && noise_of_group(group) < noise) ++group;
    group_[static_cast<std::size_t>(i)] = group;
  }
  // Length scales by the leave-one-out errors of the statistics that respond.
  double best = std::numeric_limits<double>::infinity();
  for (const double strength : {0.1, 0.2, 0.4})
    for (const double shape : {0.3, 0.8, 2.5}) {
      strength_length_ = strength;
      shape_length_ = shape;
      Eigen::MatrixXd gram(all, all);
      for (Eigen::Index a = 0; a < all; ++a)
        for (Eigen::Index b = 0; b <= a; ++b)
          gram(a, b) = gram(b, a) =
              kernel(points_[static_cast<std::size_t>(a)], points_[static_cast<std::size_t>(b)]);
      std::vector<Eigen::MatrixXd> inverse;
      for (int g = 0; g < noise_groups; ++g) {
        Eigen::MatrixXd noisy = gram;
        noisy.diagonal().array() += noise_of_group(g);
        inverse.push_back(noisy.ldlt().solve(Eigen::MatrixXd::Identity(all, all)));
      }
      Eigen::MatrixXd weights(all, p);
      double error = 0;
      for (Eigen::Index i = 0; i < p; ++i) {
        const Eigen::MatrixXd& inv = inverse[static_cast<std::size_t>(group_[static_cast<std::size_t>(i)])];
        weights.col(i) = inv * targets.col(i);
        for (Eigen::Index k = 0; k < n; ++k) {
          const double miss = weights(k, i) / inv(k, k);
          error += std::log1p(miss * miss / 4);
        }
      }
      if (error < best) {
        best = error;
        inverse_ = std::move(inverse);
        weights_ = std::move(weights);
      } else {
        continue;
      }
      chosen_strength_ = strength;
      chosen_shape_ = shape;
    }
  strength_length_ = chosen_strength_;
  shape_length_ = chosen_shape_;
}

Emulator::Prediction Emulator::operator()(const Eigen::VectorXd& coordinates) const {
  const Eigen::VectorXd at = features(coordinates);
  Eigen::VectorXd near(static_cast<Eigen::Index>(points_.size()));
  for (std::size_t k = 0; k < points_.size(); ++k)
    near(static_cast<Eigen::Index>(k)) = kernel(at, points_[k]);
  Prediction prediction;
  prediction.mean = weights_.transpose() * near;
  Eigen::VectorXd left(noise_groups);
  for (int g = 0; g < noise_groups; ++g)
    left(g) = std::max(0.0, 1 - near.dot(inverse_[static_cast<std::size_t>(g)] * near));
  prediction.variance.resize(prediction.mean.size());
  for (Eigen::Index i = 0; i < prediction.mean.size(); ++i)
    prediction.variance(i) = amplitude_(i) * left(group_[static_cast<std::size_t>(i)]);
  return prediction;
}

}  // namespace atomcam
