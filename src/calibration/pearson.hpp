#pragma once
// The law of a sum of many small lights: a mean, a variance, a skewness.

#include <cmath>
#include <numbers>
#include <unsupported/Eigen/SpecialFunctions>

namespace atomcam {

/// With given mean, variance and skewness >= 0: Pearson III, or normal.
class Pearson {
 public:
  Pearson(double mean, double variance, double skewness)
      : mean_(mean), deviation_(std::sqrt(variance)), skewness_(skewness) {
    if (skewness_ > 0.02) {
      shape_ = 4 / (skewness_ * skewness_);
      constant_ = 0.5 * std::log(shape_) + (shape_ - 1) * std::log(shape_) - shape_ - std::lgamma(shape_);
    }
  }

  /// Density.
  double operator()(double x) const {
    const double z = (x - mean_) / deviation_;
    if (z < -12 || z > 100) return 0;
    if (shape_ == 0) return std::exp(-0.5 * z * z) / (deviation_ * std::sqrt(2 * std::numbers::pi));
    // y = 1 + z / sqrt(shape) is gamma distributed with mean 1.
    const double excess = z / std::sqrt(shape_);
    if (excess <= -1) return 0;
    return std::exp(constant_ + (shape_ - 1) * std::log1p(excess) - shape_ * excess) / deviation_;
  }

  /// Whether the density rises so steeply at its lower end that a bin must be integrated over.
  bool steep() const { return skewness_ > 0.5; }

  /// Probability of less than x.
  double below(double x) const {
    if (shape_ == 0) return 0.5 * std::erfc((mean_ - x) / (deviation_ * std::numbers::sqrt2));
    const double y = shape_ + std::sqrt(shape_) * (x - mean_) / deviation_;
    return y > 0 ? Eigen::numext::igamma(shape_, y) : 0;
  }

 private:
  double mean_, deviation_, skewness_, shape_ = 0, constant_ = 0;
};

}  // namespace atomcam
