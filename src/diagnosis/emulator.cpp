#include "diagnosis/emulator.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

namespace atomcam {
namespace {

constexpr int anchors = 5;  // stacks without the effect
constexpr std::size_t noise_groups = 8;

double noise_of_group(std::size_t group) {
  return 2e-4 * std::pow(5.0, static_cast<double>(group));  // relative to the signal's variance: 2e-4 ... 16
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
  std::vector<std::size_t> group(static_cast<std::size_t>(p));  // of each statistic, by its noise
  for (Eigen::Index i = 0; i < p; ++i) {
    // Most statistics do not know of the effect: what the stacks' own scatter makes by chance is no response.
    const double power = targets.col(i).squaredNorm() / static_cast<double>(n);
    const double noise = 1 / std::max(0.01, power - 1 - 1.5 * std::sqrt(2 / static_cast<double>(n)));
    std::size_t& own = group[static_cast<std::size_t>(i)];
    while (own < noise_groups - 1 && noise_of_group(own) < noise) ++own;
  }
  // Length scales by the leave-one-out errors of the statistics that respond.
  double best = std::numeric_limits<double>::infinity(), best_strength = 0, best_shape = 0;
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
      for (std::size_t g = 0; g < noise_groups; ++g) {
        Eigen::MatrixXd noisy = gram;
        noisy.diagonal().array() += noise_of_group(g);
        inverse.push_back(noisy.ldlt().solve(Eigen::MatrixXd::Identity(all, all)));
      }
      Eigen::MatrixXd weights(all, p), missed(n, p);
      for (Eigen::Index i = 0; i < p; ++i) {
        const Eigen::MatrixXd& inv = inverse[group[static_cast<std::size_t>(i)]];
        weights.col(i) = inv * targets.col(i);
        missed.col(i) = (weights.col(i).head(n).array() / inv.diagonal().head(n).array()).square();
      }
      const double error = (missed.array() / 4).log1p().sum();
      if (error >= best) continue;
      best = error;
      best_strength = strength;
      best_shape = shape;
      weights_ = std::move(weights);
      missed_ = std::move(missed);
    }
  strength_length_ = best_strength;
  shape_length_ = best_shape;
}

Eigen::MatrixXd Emulator::mean(const Eigen::MatrixXd& places) const {
  Eigen::MatrixXd near(std::ssize(points_), places.cols());
  for (Eigen::Index n = 0; n < places.cols(); ++n) {
    const Eigen::VectorXd at = features(places.col(n));
    for (std::size_t k = 0; k < points_.size(); ++k)
      near(static_cast<Eigen::Index>(k), n) = kernel(at, points_[k]);
  }
  return weights_.transpose() * near;
}

Eigen::MatrixXd Emulator::variance(const Eigen::MatrixXd& places) const {
  constexpr double strength_reach = 0.1, shape_reach = 0.3;  // of the parameters' ranges
  // Where few stacks are near, those of about the strength count beside them; and beside these some that do
  // not scatter more than usual.
  constexpr double beside = 2;
  const Eigen::Index stacks = missed_.rows(), count = places.cols();
  Eigen::MatrixXd weights(stacks, 2 * count);
  auto alike = weights.leftCols(count), near = weights.rightCols(count);
  for (Eigen::Index n = 0; n < count; ++n) {
    const Eigen::VectorXd at = features(places.col(n));
    for (Eigen::Index k = 0; k < stacks; ++k) {
      const Eigen::VectorXd off = points_[static_cast<std::size_t>(k)] - at;
      alike(k, n) = std::exp(-0.5 * std::pow(off(0) / strength_reach, 2));
      near(k, n) =
          alike(k, n) * std::exp(-0.5 * off.tail(off.size() - 1).squaredNorm() / (shape_reach * shape_reach));
    }
  }
  const Eigen::MatrixXd missed = missed_.transpose() * weights;
  Eigen::MatrixXd variance(missed.rows(), count);
  for (Eigen::Index n = 0; n < count; ++n) {
    const double all_alike = alike.col(n).sum() + beside, all_near = near.col(n).sum() + beside;
    const Eigen::ArrayXd scatter_alike = (missed.col(n).array() + beside) / all_alike;
    const Eigen::ArrayXd scatter = (missed.col(count + n).array() + beside * scatter_alike) / all_near;
    const double by_chance = std::sqrt(2 * (near.col(n).sum() + beside * beside / all_alike)) / all_near;
    variance.col(n) = (scatter - 1 - by_chance).max(0.0);
  }
  return variance;
}

}  // namespace atomcam
