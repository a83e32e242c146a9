#include "sensor/register_law.hpp"

#include <gtest/gtest.h>

#include <boost/math/distributions/gamma.hpp>
#include <cmath>
#include <vector>

#include "base/error.hpp"
#include "base/samplers.hpp"
#include "support/statistics.hpp"

namespace atomcam {
namespace {

using statistics::chi_square_p;
using statistics::level;
using statistics::moments;
using statistics::sigmas;

constexpr int stages = 536;

/// The register as it is: every stage, every electron.
std::int64_t cascade(RandomStream& random, std::int64_t electrons, double p, int stages_left) {
  for (int stage = 0; stage < stages_left; ++stage) electrons += sample_binomial(random, electrons, p);
  return electrons;
}

std::vector<std::int64_t> draws(const RegisterLaw& law, std::int32_t electrons, int count) {
  RandomStream words(3, stream_id("test/register"), 0, static_cast<std::uint32_t>(electrons));
  RandomStream large(3, stream_id("test/register/large"), 0, static_cast<std::uint32_t>(electrons));
  std::vector<std::int64_t> result;
  for (int i = 0; i < count; ++i)
    result.push_back(static_cast<std::int64_t>(law.draw(electrons, words, large)));
  return result;
}

class RegisterAtGain : public testing::TestWithParam<double> {};

TEST_P(RegisterAtGain, HasTheMomentsOfTheCascade) {
  const double gain = GetParam();
  const RegisterLaw law(gain, stages);
  const double expected_f2 = 2 * (gain - 1) * std::pow(gain, -(stages + 1.0) / stages) + 1 / gain;
  EXPECT_NEAR(law.excess_noise_factor(), expected_f2, 1e-9 * expected_f2);
  for (const std::int32_t n : {1, 2, 3, 7, 31, 32, 63, 100, 1000, 20000}) {
    const auto m = moments(draws(law, n, 100000));
    if (gain == 1) {
      EXPECT_EQ(m.mean, n);
      EXPECT_EQ(m.variance(), 0);
      continue;
    }
    const double c2 = law.cumulants()[1] * n;
    EXPECT_LT(sigmas(m.mean, gain * n, std::sqrt(c2 / m.count)), 5)
        << "gain " << gain << ", " << n << " electrons";
    EXPECT_LT(sigmas(m.variance(), c2, m.variance_error()), 5)
        << "gain " << gain << ", " << n << " electrons";
    const double third_error = std::sqrt(15 * std::pow(m.m2, 3) / m.count) * (1 + 10.0 / std::sqrt(n));
    EXPECT_LT(sigmas(m.m3, law.cumulants()[2] * n, third_error), 5)
        << "gain " << gain << ", " << n << " electrons";
  }
}

TEST_P(RegisterAtGain, NeverGivesFewerElectronsThanItGot) {
  const RegisterLaw law(GetParam(), stages);
  for (const std::int32_t n : {0, 1, 5, 31, 32, 64, 1000})
    for (const std::int64_t output : draws(law, n, 20000)) ASSERT_GE(output, n);
}

TEST_P(RegisterAtGain, SingleElectronFollowsTheExactLaw) {
  const double gain = GetParam();
  if (gain == 1) return;
  const RegisterLaw law(gain, stages);
  for (int power = 0; power < 5; ++power) {
    const std::int32_t n = 1 << power;
    EXPECT_GT(chi_square_p(draws(law, n, 200000), n, RegisterLaw::extra_law(gain, stages, power)), level)
        << "gain " << gain << ", " << n << " electrons";
  }
}

TEST_P(RegisterAtGain, AgreesWithTheCascadeStageByStage) {
  // The exact law itself against electrons sent through every stage.
  const double gain = GetParam(), p = std::pow(gain, 1.0 / stages) - 1;
  RandomStream random(5, stream_id("test/cascade"), 0, 0);
  for (const int power : {0, 2}) {
    const std::int64_t n = std::int64_t{1} << power;
    std::vector<std::int64_t> outputs;
    for (int i = 0; i < 4000; ++i) outputs.push_back(cascade(random, n, p, stages));
    if (gain == 1) {
      for (const std::int64_t output : outputs) ASSERT_EQ(output, n);
    } else {
      EXPECT_GT(chi_square_p(outputs, n, RegisterLaw::extra_law(gain, stages, power)), level)
          << "gain " << gain;
    }
  }
}

TEST_P(RegisterAtGain, SerialChargesHaveThePartialGainOfTheirStage) {
  const double gain = GetParam(), p = std::pow(gain, 1.0 / stages) - 1;
  const RegisterLaw law(gain, stages);
  RandomStream random(6, stream_id("test/serial"), 0, 0);
  std::vector<double> drawn, simulated;
  for (int i = 0; i < 200000; ++i) drawn.push_back(law.draw_serial(random()));
  for (int i = 0; i < 20000; ++i) {
    const int stage = 1 + static_cast<int>(random() % stages);
    simulated.push_back(static_cast<double>(cascade(random, 1, p, stages - stage)));
  }
  // Two samples, one law: chi-square of the small sample against the large one's frequencies in cells of
  // equal content.
  std::vector<double> sorted = drawn;
  std::sort(sorted.begin(), sorted.end());
  std::vector<double> edges;
  for (std::size_t i = 1; i < 20; ++i) edges.push_back(sorted[i * sorted.size() / 20]);
  edges.erase(std::unique(edges.begin(), edges.end()), edges.end());
  const auto histogram = [&](const std::vector<double>& values) {
    std::vector<double> cells(edges.size() + 1, 0.0);
    for (const double v : values) ++cells[std::upper_bound(edges.begin(), edges.end(), v) - edges.begin()];
    return cells;
  };
  const std::vector<double> a = histogram(drawn), b = histogram(simulated);
  double chi = 0;
  const double na = static_cast<double>(drawn.size()), nb = static_cast<double>(simulated.size());
  int used = 0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    if (a[i] + b[i] == 0) continue;
    const double d = a[i] * std::sqrt(nb / na) - b[i] * std::sqrt(na / nb);
    chi += d * d / (a[i] + b[i]);
    ++used;
  }
  if (used > 1) {
    EXPECT_GT(boost::math::gamma_q((used - 1) / 2.0, chi / 2), level) << "gain " << gain;
  }
  const auto m = moments(drawn);
  if (gain > 1) {
    EXPECT_LT(sigmas(m.mean, (gain - 1) / (stages * p), m.mean_error()), 5) << "gain " << gain;
  }
}

INSTANTIATE_TEST_SUITE_P(Gains, RegisterAtGain, testing::Values(1.0, 1.02, 2.0, 10.0, 300.0, 1000.0));

TEST(RegisterLaw, ReachesTheGammaLawOfThePaperAtHighGain) {
  // Erlang law of shape n and scale g: the cascade's variance is lower by 2 - F^2, about 2 %, and nothing
  // else shows.
  const RegisterLaw law(300, stages);
  EXPECT_GT(law.excess_noise_factor(), 1.97);
  EXPECT_LT(law.excess_noise_factor(), 1.98);
  const boost::math::gamma_distribution<double> paper(8, 300);
  const auto outputs = draws(law, 8, 200000);
  for (const double quantile : {0.1, 0.5, 0.9}) {
    const double edge = boost::math::quantile(paper, quantile);
    const double below = static_cast<double>(
        std::count_if(outputs.begin(), outputs.end(), [&](std::int64_t o) { return o < edge; }));
    EXPECT_NEAR(below / 200000, quantile, 0.005);
  }
}

TEST(RegisterLaw, RejectsTheGammaLawAtLowGain) {
  // The rig must see a known defect of a predecessor: gamma numbers cut to integers, whatever the gain.
  RandomStream random(7, stream_id("test/wrong"), 0, 0);
  std::vector<std::int64_t> outputs;
  for (int i = 0; i < 20000; ++i) outputs.push_back(static_cast<std::int64_t>(10 * sample_gamma(random, 1)));
  std::vector<double> mass = RegisterLaw::extra_law(10, stages, 0);
  mass.insert(mass.begin(), 0.0);  // no electron comes out as none
  EXPECT_LT(chi_square_p(outputs, 0, mass), level);
}

TEST(RegisterLaw, JoinsItsTwoMethodsWithoutAStep) {
  // The largest exact number against the gamma law that takes over behind it: all of the law, not only
  // moments.
  for (const double gain : {2.0, 10.0, 300.0}) {
    const RegisterLaw law(gain, stages);
    int power = 0;
    while ((2 << power) <= law.largest_exact()) ++power;
    const std::int32_t n = 2 << power;  // the first power of two that is drawn from the gamma law
    EXPECT_GT(n, law.largest_exact());
    EXPECT_GT(chi_square_p(draws(law, n, 100000), n, RegisterLaw::extra_law(gain, stages, power + 1)), level)
        << "gain " << gain;
  }
}

TEST(RegisterLaw, RefusesAGainItCannotHave) {
  EXPECT_THROW(RegisterLaw(0.5, stages), Error);
  EXPECT_THROW(RegisterLaw(std::nan(""), stages), Error);
  EXPECT_THROW(RegisterLaw(300, 3), Error);
  EXPECT_THROW(RegisterLaw(2, 0), Error);
}

}  // namespace
}  // namespace atomcam
