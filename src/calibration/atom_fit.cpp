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

/// Standard deviation of a site's light as it is expected before the fit.
double noise_at(double electrons, const BrightnessNoise& noise) {
  return std::sqrt(noise.empty_variance + noise.variance_per_e * std::max(0.0, electrons));
}

/// Edges from one light to another, a part of the noise apart, in no fewer than `least` and no more than
/// `most` steps.
std::vector<double> cut_by_noise(double from, double to, const BrightnessNoise& noise, double part, int least,
                                 int most) {
  std::vector<double> edges = {from};
  while (edges.back() < to) {
    const double at = edges.back();
    edges.push_back(at + std::clamp(part * noise_at(at, noise), (to - from) / most, (to - from) / least));
  }
  edges.back() = to;
  return edges;
}

}  // namespace

AtomFit fit_atoms(const std::vector<float>& brightness, const BrightnessNoise& noise, double filling,
                  double survival, double atom_e, const AtomFit* like) {
  enum { fill, lost, light, empty, empty_noise, light_noise, parameters };
  const double sigma0 = noise_at(0, noise), sigma1 = noise_at(atom_e, noise);
  // An empty site's peak may be a hundred times narrower than an occupied one's: bins as fine as the noise
  // there, and lost atoms' lights as near to each other.
  const std::vector<double> edges = cut_by_noise(-6 * sigma0, atom_e + 7 * sigma1, noise, 1.0 / 3, 60, 3000);
  const std::vector<double> lights = cut_by_noise(0, atom_e, noise, 1, 48, 500);
  const auto bins = static_cast<Eigen::Index>(edges.size()) - 1;
  const Eigen::Map<const Eigen::VectorXd> begins(edges.data(), bins), ends(edges.data() + 1, bins);
  const Eigen::VectorXd middle = 0.5 * (begins + ends), width = ends - begins;
  const Eigen::VectorXd even = width / width.sum();
  Eigen::VectorXd seen = Eigen::VectorXd::Zero(bins);
  double total = 0;
  for (const float value : brightness) {
    const auto bin =
        std::upper_bound(edges.begin(), edges.end(), static_cast<double>(value)) - edges.begin() - 1;
    if (bin < 0 || bin >= bins) continue;
    seen(bin) += 1;
    total += 1;
  }
  // The histogram's parts: empty and occupied by the neighbours' being there, then lost ones by their light.
  const auto steps = static_cast<Eigen::Index>(lights.size()) - 1;
  const auto lost_at = [&](Eigen::Index k) { return lights[static_cast<std::size_t>(k)] / atom_e; };
  const auto classes = static_cast<Eigen::Index>(noise.surroundings.size());
  const auto densities = [&](const Eigen::VectorXd& p) {  // [bin, part], times the bin's width
    const double mu = std::exp(p(light));
    const double v0 = noise.empty_variance * std::exp(p(empty_noise));
    const double slope = noise.variance_per_e * std::exp(p(light_noise));
    const double third0 = noise.empty_skewness * std::pow(v0, 1.5);
    Eigen::MatrixXd density(bins, 2 * classes + steps);
    const auto put = [&](Eigen::Index part, double electrons, const Surroundings& by = {}) {
      const double variance = v0 * by.variance_factor + slope * electrons;
      const Pearson law(
          p(empty) + by.shift_e + electrons, variance,
          (third0 * by.variance_factor + noise.third_per_e * electrons) / std::pow(variance, 1.5));
      if (law.steep()) {
        double before = law.below(edges.front());
        for (Eigen::Index n = 0; n < bins; ++n) {
          const double upto = law.below(ends(n));
          density(n, part) = upto - before;
          before = upto;
        }
      } else {
        for (Eigen::Index n = 0; n < bins; ++n) density(n, part) = law(middle(n)) * width(n);
      }
    };
    for (Eigen::Index c = 0; c < classes; ++c) {
      const Surroundings& by = noise.surroundings[static_cast<std::size_t>(c)];
      put(2 * c, 0, by);
      put(2 * c + 1, mu, by);
    }
    for (Eigen::Index k = 0; k < steps; ++k) put(2 * classes + k, mu * 0.5 * (lost_at(k) + lost_at(k + 1)));
    return density;
  };
  const auto shares = [&](const Eigen::VectorXd& p) {
    const double f = logistic(p(fill)), loss_probability = logistic(p(lost));
    const double rate = -std::log1p(-loss_probability);
    Eigen::VectorXd share(2 * classes + steps);
    for (Eigen::Index c = 0; c < classes; ++c) {
      share(2 * c) = (1 - f) * noise.surroundings[static_cast<std::size_t>(c)].share;
      share(2 * c + 1) = f * (1 - loss_probability) * noise.surroundings[static_cast<std::size_t>(c)].share;
    }
    for (Eigen::Index k = 0; k < steps; ++k)
      share(2 * classes + k) = f * (std::exp(-rate * lost_at(k)) - std::exp(-rate * lost_at(k + 1)));
    return share;
  };
  const auto law_of = [&](const Eigen::MatrixXd& density, const Eigen::VectorXd& share) {
    const Eigen::VectorXd law = density * share;
    // A few values may come from something else (a track, a neighbour far away). More of them would be taken
    // from the lost atoms, which lie between the peaks as well.
    constexpr double foreign = 1e-4;
    return Eigen::VectorXd((1 - foreign) / law.sum() * law + foreign * even);
  };
  Eigen::VectorXd from(static_cast<Eigen::Index>(parameters));
  if (like)
    from << logit(like->filling), logit(1 - like->survival), std::log(like->atom_e), like->empty_e,
        std::log(like->empty_variance_ratio), std::log(like->atom_variance_ratio);
  else
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
    const Eigen::MatrixXd density = densities(p);
    const Eigen::VectorXd law = law_of(density, shares(p));
    out.minus_log = -seen.dot(law.array().log().matrix());
    // Weak priors: the logits of filling and loss must not run away where the data say 0 or 1.
    for (const int k : {fill, lost}) out.minus_log += 0.5 * p(k) * p(k) / 100;
    if (!derivatives) return out;
    for (const int k : {fill, lost}) {
      out.gradient(k) += p(k) / 100;
      out.information(k, k) += 0.01;
    }
    Eigen::MatrixXd by(bins, static_cast<Eigen::Index>(parameters));
    for (int k = 0; k < parameters; ++k) {
      const double step = k == empty ? 0.02 * sigma0 : 2e-3;
      // Filling and loss change how much there is of each part, not the parts.
      const bool same_parts = k == fill || k == lost;
      const auto at = [&](double change) {
        Eigen::VectorXd moved = p;
        moved(k) += change;
        return law_of(same_parts ? density : densities(moved), shares(moved));
      };
      by.col(k) = (at(step) - at(-step)) / (2 * step);
    }
    const Eigen::MatrixXd relative = law.cwiseInverse().asDiagonal() * by;
    out.gradient -= relative.transpose() * seen;
    out.information += total * by.transpose() * relative;
    return out;
  };
  MaximumLikelihood found = maximise(from, evaluate, 1e-3, 80);
  if (!like) {
    // A skewed law ends where its mean and width say: from too narrow an empty peak there may be no way to
    // the values beyond that end.
    from(empty_noise) = 0.3;
    if (MaximumLikelihood wider = maximise(from, evaluate, 1e-3, 80); wider.minus_log < found.minus_log)
      found = std::move(wider);
  }
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
  const Eigen::VectorXd law = law_of(densities(found.values), shares(found.values));
  double due = 0, got = 0;
  for (Eigen::Index n = 0; n < bins; ++n) {
    due += total * law(n);
    got += seen(n);
    if (due < 10) continue;
    fit.chi_square += (got - due) * (got - due) / due;
    ++fit.bins;
    due = got = 0;
  }
  return fit;
}

}  // namespace atomcam
