// The three components of a site's brightness, and what it costs to give lost atoms no shot noise of their
// own.
#include "calibration/atom_fit.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <numbers>

#include "base/samplers.hpp"

namespace atomcam {
namespace {

constexpr double filling = 0.607, survival = 0.4, atom_e = 175, empty_sigma = 20;

/// Brightness of sites as in the paper's example (section "Fitting Parameter Values"), in electrons before
/// the register: Poisson light amplified by its high-gain law, on a normal background.
std::vector<float> brightness(std::size_t sites, double kept, double light_e, double quiet_e) {
  RandomStream random(7, stream_id("test/atom_fit"), 0, 0);
  const auto uniform = [&] { return (static_cast<double>(random()) + 0.5) * 0x1p-32; };
  std::vector<float> values;
  while (values.size() < sites) {
    double light = 0;
    if (uniform() < filling) {
      const double lost_at = std::log(1 - uniform()) / std::log(kept);
      light = light_e * std::min(1.0, lost_at);
    }
    const double events = light > 0 ? static_cast<double>(sample_poisson(random, light)) : 0;
    const double amplified = events > 0 ? sample_gamma(random, events) : 0;
    values.push_back(static_cast<float>(amplified + quiet_e * sample_normal(random)));
  }
  return values;
}

/// What such values have by their light: cumulants of an electron's exponential output.
BrightnessNoise noise_of_register(double empty_variance) {
  BrightnessNoise noise;
  noise.empty_variance = empty_variance;
  noise.variance_per_e = 2;
  noise.third_per_e = 6;
  return noise;
}

/// The paper's law (section "Fitting Parameter Values"): normal peaks, lost atoms an exponential between them
/// smoothed by one normal law. Bin by bin, normalised.
struct PaperLaw {
  double low, width;
  int bins;
  Eigen::VectorXd operator()(const Eigen::VectorXd& p) const {
    const double filled = 1 / (1 + std::exp(-p(0))), stays = 1 / (1 + std::exp(-p(1)));
    const double mu0 = p(2), mu1 = p(3), sigma0 = std::exp(p(4)), sigma1 = std::exp(p(5)),
                 sigma = std::exp(p(6)), d = mu1 - mu0, log_p = std::log(stays);
    const auto normal = [](double x, double s) {
      return std::exp(-0.5 * x * x / (s * s)) / (s * std::sqrt(2 * std::numbers::pi));
    };
    Eigen::VectorXd out(bins);
    for (int k = 0; k < bins; ++k) {
      const double x = low + (k + 0.5) * width;
      const auto f = [&](double t) {
        return std::erf((x - t) / (std::numbers::sqrt2 * sigma) + sigma * log_p / (std::numbers::sqrt2 * d));
      };
      const double lost = log_p * std::pow(stays, (x - mu0) / d) *
                          std::exp(sigma * sigma * log_p * log_p / (2 * d * d)) * (f(mu0) - f(mu1)) /
                          (2 * d * (stays - 1));
      out(k) = (1 - filled) * normal(x - mu0, sigma0) +
               filled * (stays * normal(x - mu1, sigma1) + (1 - stays) * std::max(lost, 0.0));
    }
    return out / out.sum();
  }
};

struct PaperFit {
  double survival, survival_error, atom_e, atom_error;
};

PaperFit fit_as_the_paper(const std::vector<float>& values) {
  const PaperLaw law{-100, 4, 125};
  Eigen::VectorXd seen = Eigen::VectorXd::Zero(law.bins);
  for (const float value : values) {
    const double k = (value - law.low) / law.width;
    if (k >= 0 && k < law.bins) seen(static_cast<Eigen::Index>(k)) += 1;
  }
  const double total = seen.sum();
  const auto evaluate = [&](const Eigen::VectorXd& p, bool) {
    const Eigen::VectorXd share = law(p);
    Likelihood out;
    out.minus_log = -(seen.array() * share.array().max(1e-12).log()).sum();
    Eigen::MatrixXd slope(law.bins, p.size());
    for (Eigen::Index j = 0; j < p.size(); ++j) {
      Eigen::VectorXd up = p, down = p;
      up(j) += 1e-4, down(j) -= 1e-4;
      slope.col(j) = (law(up) - law(down)) / 2e-4;
    }
    const Eigen::VectorXd weight = share.array().max(1e-12).inverse();
    out.gradient = -slope.transpose() * seen.cwiseProduct(weight);
    out.information = total * slope.transpose() * weight.asDiagonal() * slope;
    return out;
  };
  Eigen::VectorXd start(7);
  start << 0.4, -0.2, 0, atom_e, std::log(empty_sigma), std::log(27.0), std::log(24.0);
  const MaximumLikelihood best = maximise(start, evaluate, 1e-4, 60);
  const Eigen::MatrixXd covariance = best.covariance();
  const double stays = 1 / (1 + std::exp(-best.values(1)));
  return {stays, stays * (1 - stays) * std::sqrt(covariance(1, 1)), best.values(3) - best.values(2),
          std::sqrt(covariance(2, 2) + covariance(3, 3) - 2 * covariance(2, 3))};
}

TEST(AtomFit, LostAtomsHaveShotNoiseOfTheirOwn) {
  // As many as the paper's figure is made of: 2,839 images of 306 sites.
  const std::vector<float> values = brightness(2839 * 306, survival, atom_e, empty_sigma);
  const BrightnessNoise noise = noise_of_register(empty_sigma * empty_sigma);
  const AtomFit ours = fit_atoms(values, noise, 0.5, 0.6, 150);
  const PaperFit theirs = fit_as_the_paper(values);
  std::printf("survival 0.4: %.5f +- %.5f; as the paper fits %.5f +- %.5f\n", ours.survival,
              ours.survival_error, theirs.survival, theirs.survival_error);
  std::printf("atom 175 e: %.3f +- %.3f; as the paper fits %.3f +- %.3f\n", ours.atom_e, ours.atom_error,
              theirs.atom_e, theirs.atom_error);
  EXPECT_NEAR(ours.survival, survival, 5 * ours.survival_error);
  EXPECT_NEAR(ours.atom_e, atom_e, 5 * ours.atom_error);
  EXPECT_NEAR(ours.filling, filling, 5 * ours.filling_error);
  EXPECT_LT(ours.survival_error, 0.003);
}

// A peak of empty sites that is a hundred times narrower than the occupied sites' place is seen in bins that
// are finer than it.
TEST(AtomFit, EmptySitesMayBeFarQuieter) {
  constexpr double kept = 0.92, light = 220, quiet = 0.4;
  const std::vector<float> values = brightness(300 * 30, kept, light, quiet);
  const BrightnessNoise noise = noise_of_register(quiet * quiet);
  const AtomFit fit = fit_atoms(values, noise, 0.5, 0.95, 225);
  EXPECT_TRUE(fit.converged);
  EXPECT_NEAR(fit.filling, filling, 5 * fit.filling_error);
  EXPECT_NEAR(fit.survival, kept, 5 * fit.survival_error);
  EXPECT_NEAR(fit.atom_e, light, 5 * fit.atom_error);
  EXPECT_NEAR(fit.empty_e, 0, 0.1 * quiet);
  EXPECT_NEAR(fit.empty_variance_ratio, 1, 0.15);
  // From a fit much like it, to the same.
  const AtomFit again = fit_atoms(values, noise, 0.5, 0.95, 225, &fit);
  EXPECT_TRUE(again.converged);
  EXPECT_NEAR(again.atom_e, fit.atom_e, 0.1 * fit.atom_error);
  EXPECT_NEAR(again.survival, fit.survival, 0.1 * fit.survival_error);
}

// A few electrons of background through the register: empty sites have a law so skewed that it ends near its
// peak. From wherever the fit starts it finds the same.
TEST(AtomFit, EmptySitesMayBeSkewed) {
  constexpr double kept = 0.91, light = 209, events = 0.52, event_e = 1.5;
  std::vector<float> values = brightness(300 * 30, kept, light, 0.3);
  RandomStream random(8, stream_id("test/atom_fit"), 0, 0);
  for (float& value : values) {
    const double seen = static_cast<double>(sample_poisson(random, events));
    value += static_cast<float>(event_e * ((seen > 0 ? sample_gamma(random, seen) : 0) - events));
  }
  BrightnessNoise noise = noise_of_register(2 * events * event_e * event_e + 0.3 * 0.3);
  noise.empty_skewness = 6 * events * std::pow(event_e, 3) / std::pow(noise.empty_variance, 1.5);
  for (const double from_survival : {0.6, 0.8, 0.95})
    for (const double from_filling : {0.45, 0.55, 0.7}) {
      const AtomFit fit = fit_atoms(values, noise, from_filling, from_survival, 225);
      EXPECT_NEAR(fit.filling, filling, 5 * 0.006) << from_survival << " " << from_filling;
      EXPECT_NEAR(fit.survival, kept, 5 * 0.006) << from_survival << " " << from_filling;
      EXPECT_NEAR(fit.atom_e, light, 5 * fit.atom_error) << from_survival << " " << from_filling;
    }
}

}  // namespace
}  // namespace atomcam
