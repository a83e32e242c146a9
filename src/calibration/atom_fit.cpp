#include "calibration/atom_fit.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "calibration/pearson.hpp"

namespace atomcam {
namespace {

double logit(double p) {
  p = std::clamp(p, 1e-4, 1 - 1e-4);
  return std::log(p / (1 - p));
}
double logistic(double x) {
  return 1 / (1 + std::exp(-x));
}

}  // namespace

AtomFit fit_atoms(const std::vector<float>& brightness, const BrightnessNoise& noise, double filling,
                  double survival, double atom_e) {
  enum { fill, lost, light, empty, empty_noise, light_noise, parameters };
  const double sigma0 = std::sqrt(noise.empty_variance);
  const double sigma1 = std::sqrt(noise.empty_variance + noise.variance_per_e * atom_e);
  const double low = -6 * sigma0, high = atom_e + 7 * sigma1;
  const double width = std::max((high - low) / 400, std::min(sigma0 / 3, (high - low) / 60));
  const int bins = static_cast<int>((high - low) / width) + 1;
  std::vector<double> seen(static_cast<std::size_t>(bins));
  double total = 0;
  for (const float value : brightness) {
    const double k = (value - low) / width;
    if (k < 0 || k >= bins) continue;
    seen[static_cast<std::size_t>(k)] += 1;
    total += 1;
  }
  const auto expected = [&](const Eigen::VectorXd& p) {
    const double f = logistic(p(fill)), loss_probability = logistic(p(lost)), mu = std::exp(p(light));
    const double v0 = noise.empty_variance * std::exp(p(empty_noise));
    const double slope = noise.variance_per_e * std::exp(p(light_noise));
    const double third0 = noise.empty_skewness * std::pow(v0, 1.5);
    const auto component = [&](double electrons, const Surroundings& by = {}) {
      const double variance = v0 * by.variance_factor + slope * electrons;
      return Pearson(p(empty) + by.shift_e + electrons, variance,
                     (third0 * by.variance_factor + noise.third_per_e * electrons) / std::pow(variance, 1.5));
    };
    constexpr int steps = 48;
    const double rate = -std::log1p(-loss_probability);
    std::vector<Pearson> parts;
    std::vector<double> shares;
    for (const Surroundings& by : noise.surroundings) {
      parts.push_back(component(0, by));
      shares.push_back((1 - f) * by.share);
      parts.push_back(component(mu, by));
      shares.push_back(f * (1 - loss_probability) * by.share);
    }
    for (int k = 0; k < steps; ++k) {
      const double a = static_cast<double>(k) / steps, b = static_cast<double>(k + 1) / steps;
      parts.push_back(component(mu * 0.5 * (a + b)));
      shares.push_back(f * (std::exp(-rate * a) - std::exp(-rate * b)));
    }
    std::vector<double> law(static_cast<std::size_t>(bins), 0.0);
    double sum = 0;
    for (int n = 0; n < bins; ++n) {
      const double x = low + (n + 0.5) * width;
      for (std::size_t k = 0; k < parts.size(); ++k)
        if (shares[k] > 0) law[n] += shares[k] * parts[k](x);
      sum += law[n];
    }
    // A few values may come from something else (a track, a neighbour far away). More of them would be taken
    // from the lost atoms, which lie between the peaks as well.
    constexpr double foreign = 1e-4;
    for (double& value : law) value = (1 - foreign) * value / sum + foreign / bins;
    return law;
  };
  Eigen::VectorXd from(static_cast<Eigen::Index>(parameters));
  from << logit(filling), logit(1 - survival), std::log(atom_e), 0, 0, 0;
  const auto evaluate = [&](const Eigen::VectorXd& p, bool derivatives) {
    Likelihood out;
    out.gradient.setZero(parameters);
    out.information.setZero(parameters, parameters);
    if (!p.allFinite() || p.cwiseAbs().maxCoeff() > 1e4 || std::fabs(p(light) - from(light)) > 3 ||
        std::fabs(p(empty_noise)) > 4 || std::fabs(p(light_noise)) > 4) {
      out.minus_log = std::numeric_limits<double>::infinity();
      return out;
    }
    const std::vector<double> law = expected(p);
    for (int n = 0; n < bins; ++n) out.minus_log -= seen[n] * std::log(law[n]);
    // Weak priors: the logits of filling and loss must not run away where the data say 0 or 1.
    for (const int k : {fill, lost}) out.minus_log += 0.5 * p(k) * p(k) / 100;
    if (!derivatives) return out;
    for (const int k : {fill, lost}) {
      out.gradient(k) += p(k) / 100;
      out.information(k, k) += 0.01;
    }
    std::vector<std::vector<double>> by;
    for (int k = 0; k < parameters; ++k) {
      const double step = k == empty ? 0.02 * sigma0 : 2e-3;
      Eigen::VectorXd up = p, down = p;
      up(k) += step;
      down(k) -= step;
      auto change = expected(up);
      const auto below = expected(down);
      for (int n = 0; n < bins; ++n) change[n] = (change[n] - below[n]) / (2 * step);
      by.push_back(std::move(change));
    }
    for (int a = 0; a < parameters; ++a) {
      for (int n = 0; n < bins; ++n) out.gradient(a) -= seen[n] * by[a][n] / law[n];
      for (int b = 0; b < parameters; ++b) {
        double sum = 0;
        for (int n = 0; n < bins; ++n) sum += by[a][n] * by[b][n] / law[n];
        out.information(a, b) += total * sum;
      }
    }
    return out;
  };
  const MaximumLikelihood found = maximise(from, evaluate, 1e-3, 80);
  AtomFit fit;
  fit.converged = found.converged;
  fit.noise = noise;
  const Eigen::MatrixXd covariance = found.covariance();
  const auto error = [&](int k) { return std::sqrt(std::max(0.0, covariance(k, k))); };
  fit.filling = logistic(found.values(fill));
  fit.filling_error = fit.filling * (1 - fit.filling) * error(fill);
  const double loss_probability = logistic(found.values(lost));
  fit.survival = 1 - loss_probability;
  fit.survival_error = loss_probability * fit.survival * error(lost);
  fit.atom_e = std::exp(found.values(light));
  fit.atom_error = fit.atom_e * error(light);
  fit.empty_e = found.values(empty);
  fit.empty_variance_ratio = std::exp(found.values(empty_noise));
  fit.atom_variance_ratio = std::exp(found.values(light_noise));
  fit.atom_variance_error = fit.atom_variance_ratio * error(light_noise);
  const std::vector<double> law = expected(found.values);
  double due = 0, got = 0;
  for (int n = 0; n < bins; ++n) {
    due += total * law[n];
    got += seen[n];
    if (due < 10) continue;
    fit.chi_square += (got - due) * (got - due) / due;
    ++fit.bins;
    due = got = 0;
  }
  return fit;
}

}  // namespace atomcam
