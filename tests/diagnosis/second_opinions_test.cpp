// Metrics that no fit has seen: at their floor for a right model, above it for a wrong one.

#include "diagnosis/second_opinions.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "base/random.hpp"
#include "calibration/site_model.hpp"
#include "diagnosis/blind.hpp"
#include "diagnosis/classifier.hpp"
#include "diagnosis/distances.hpp"
#include "diagnosis/model.hpp"
#include "diagnosis/site_detectors.hpp"

namespace atomcam {
namespace {

/// Normal numbers.
class Draws {
 public:
  explicit Draws(std::uint64_t seed) : random_(seed, stream_id("test/second_opinions"), 0, 0) {}
  double normal() {
    const double u = random_.uniform53(), v = random_.uniform53();
    return std::sqrt(-2 * std::log(u)) * std::cos(2 * std::numbers::pi * v);
  }
  double uniform() { return random_.uniform53(); }

 private:
  RandomStream random_;
};

double phi(double z) {
  return 0.5 * std::erfc(-z / std::sqrt(2.0));
}

/// Frames of 12 normal features, the last of which is `shift` larger.
LabelledFrames labelled(Draws& draws, int frames, double shift) {
  LabelledFrames some;
  some.features.resize(frames, 12);
  for (int n = 0; n < frames; ++n) {
    for (Eigen::Index k = 0; k < 12; ++k) some.features(n, k) = 40 + 3 * draws.normal();
    some.features(n, 11) += 3 * shift;
    some.fold.push_back(n / 10 % 5);
  }
  return some;
}

TEST(TwoSampleTest, KnowsNothingOfFramesThatAreAlike) {
  Draws draws(1);
  const LabelledFrames high = labelled(draws, 300, 0), low = labelled(draws, 1200, 0);
  const TwoSampleTest test = two_sample_test(high, {&low});
  // Each fold's area of n against m like frames has the variance (n + m + 1) / (12 n m).
  const double deviation = std::sqrt((60 + 240 + 1) / (12.0 * 60 * 240) / 5);
  EXPECT_NEAR(test.auc, 0.5, 5 * deviation);
}

TEST(TwoSampleTest, OneFeatureThatDiffersIsTheAreaThatItAllows) {
  Draws draws(2);
  constexpr double shift = 1.5;
  const LabelledFrames high = labelled(draws, 1000, shift), low = labelled(draws, 2000, 0);
  const TwoSampleTest test = two_sample_test(high, {&low});
  // No rule does better than that feature alone, phi(shift / sqrt(2)); learning costs a little of it.
  const double best = phi(shift / std::sqrt(2.0));
  const double deviation = std::sqrt(best * (1 - best) / 1000);
  EXPECT_LT(test.auc, best + 5 * deviation);
  EXPECT_GT(test.auc, best - 5 * deviation);
}

TEST(TwoSampleTest, NeedsTwoFolds) {
  Draws draws(3);
  LabelledFrames high = labelled(draws, 8, 0);
  const LabelledFrames low = labelled(draws, 50, 0);
  EXPECT_TRUE(std::isnan(two_sample_test(high, {&low}).auc));
}

TEST(AreaUnderCurve, CountsPairsAndTies) {
  EXPECT_EQ(area_under_curve({3, 4}, {1, 2}), 1);
  EXPECT_EQ(area_under_curve({1, 2}, {3, 4}), 0);
  EXPECT_EQ(area_under_curve({1, 1}, {1}), 0.5);
  EXPECT_EQ(area_under_curve({2, 0}, {1}), 0.5);
}

TEST(Wasserstein, IsHowFarTheMassMoves) {
  using Histogram = std::vector<std::uint64_t>;
  EXPECT_EQ(wasserstein(Histogram{4, 0, 0, 0}, Histogram{0, 0, 0, 2}), 3);
  EXPECT_EQ(wasserstein(Histogram{1, 1, 0}, Histogram{0, 5, 5}), 1);
  EXPECT_EQ(wasserstein(Histogram{2, 3}, Histogram{4, 6}), 0);
  EXPECT_TRUE(std::isnan(wasserstein(Histogram{0, 0}, Histogram{1, 0})));
  EXPECT_EQ(wasserstein_of_samples({1, 5, 3}, {6, 4, 2}), 1);
  EXPECT_EQ(wasserstein_of_samples({0, 1}, {10}), 9.5);
  EXPECT_TRUE(std::isnan(wasserstein_of_samples({}, {1})));
}

TEST(Divergence, OfTwoNormalLawsIsTheirSeparation) {
  // Half the sum of both divergences of two normal laws is (shift / sigma)^2 / 2; bins take a little away, at
  // most the variance within one in units of sigma.
  constexpr double shift = 8, sigma = 40;
  Draws draws(4);
  std::vector<std::uint64_t> one(65536, 0), two(65536, 0), pool(65536, 0);
  constexpr int number = 4000000;
  for (int n = 0; n < number; ++n) {
    const auto a = static_cast<std::size_t>(std::lround(500 + sigma * draws.normal())),
               b = static_cast<std::size_t>(std::lround(500 + shift + sigma * draws.normal()));
    ++one[a], ++two[b], ++pool[a], ++pool[b];
  }
  const auto bins = count_bins(pool);
  ASSERT_GT(bins.size(), 60);
  const double found = divergence(binned(one, bins), binned(two, bins)), expected = 0.5 * 0.04;
  // Samples of n: a scatter of about 2 sqrt(expected / n), an excess of one over n for each bin.
  const double scatter = 2 * std::sqrt(expected / number), excess = static_cast<double>(bins.size()) / number;
  EXPECT_LT(found, expected + excess + 5 * scatter);
  EXPECT_GT(found, expected * (1 - 1.0 / 100) - 5 * scatter);
  EXPECT_EQ(divergence(binned(one, bins), binned(one, bins)), 0);
}

TEST(CountBins, HoldEnoughAndCoverAll) {
  std::vector<std::uint64_t> pool(65536, 0);
  Draws draws(5);
  for (int n = 0; n < 100000; ++n) ++pool[static_cast<std::size_t>(200 - 100 * std::log(draws.uniform()))];
  const auto bins = count_bins(pool);
  EXPECT_EQ(bins.front(), 0);
  std::uint64_t sum = 0;
  for (const std::uint64_t number : binned(pool, bins)) {
    EXPECT_GE(number, 50);
    sum += number;
  }
  EXPECT_EQ(sum, 100000);
}

TEST(TwoPeaks, FindsTheFidelityOfTheLawItWasMadeOf) {
  Draws draws(6);
  constexpr int number = 60000;
  constexpr double filled = 0.5, lost = 0.04, upper = 100, lower_width = 8, upper_width = 14;
  std::vector<float> scores;
  std::vector<bool> atom;
  for (int n = 0; n < number; ++n) {
    const double lot = draws.uniform(), t = draws.uniform();
    atom.push_back(lot < filled + lost);
    const double at = lot < filled ? 1 : lot < filled + lost ? t : 0;
    const double width = std::sqrt((1 - at) * lower_width * lower_width + at * upper_width * upper_width);
    scores.push_back(static_cast<float>(at * upper + width * draws.normal()));
  }
  const TwoPeaks peaks = two_peaks(scores);
  EXPECT_NEAR(peaks.upper, upper, 5 * upper_width / std::sqrt(0.5 * number));
  double right = 0;
  for (std::size_t n = 0; n < scores.size(); ++n) right += (scores[n] >= peaks.threshold) == atom[n];
  right /= number;
  EXPECT_LT(right, 0.999);  // there is something to estimate
  // The estimate and the count both scatter as a count of mistakes does.
  EXPECT_NEAR(peaks.fidelity(), right, 5 * std::sqrt(2 * (1 - right) / number));
}

TEST(TwoPeaks, SaysSoWhereThereIsOne) {
  Draws draws(7);
  std::vector<float> scores;
  for (int n = 0; n < 20000; ++n) scores.push_back(static_cast<float>(draws.normal()));
  EXPECT_TRUE(std::isnan(two_peaks(scores).fidelity()));
  scores.resize(20);
  EXPECT_TRUE(std::isnan(two_peaks(scores).fidelity()));
}

/// A lab, the same with an effect, and what second opinions say of frames of the latter.
struct Case {
  Lab plain, with;
  StackPlan plan;
  SecondOpinions said;
  explicit Case(const std::string& effect, ParameterValues values, std::size_t frames = 200,
                int threads = 2) {
    BlindOptions options;
    options.rows = options.columns = 64;
    options.none_share = 1;
    plain = make_blind_stack(options, 3).lab;
    with = plain;
    if (!effect.empty()) with.effects[effect] = std::move(values);
    plan.model = stack_model(plain);
    plan.frames = frames;
    plan.threads = threads;
    const auto real = simulate_stack(with, plan, 77, true);
    const OpinionModel before{plain, std::vector<Lab>(8, plain)}, after{with, std::vector<Lab>(8, with)};
    said = second_opinions(*real, plan, before, effect.empty() ? nullptr : &after, 1000);
  }
  const SecondOpinion& metric(std::string_view name) const {
    for (const SecondOpinion& one : said.metrics)
      if (one.metric == name) return one;
    throw std::runtime_error("no such metric");
  }
};

/// By how many of the floor's errors a distance is above the floor.
double above(const Figure& figure, const Figure& floor) {
  return (figure.value - floor.value) / floor.error;
}
/// Quantile of Student's law with 7 degrees of freedom at 1e-6 (a floor is known from 8 stacks), for a value
/// that scatters as they do.
const double by_chance = 15.8 * std::sqrt(1 + 1.0 / 8);
/// Standard deviation of the area of 100 frames against 400 like them, in five nearly independent folds. An
/// area goes no higher than 1, which is not that many of the scatter of eight.
const double area_deviation = std::sqrt((20 + 80 + 1) / (12.0 * 20 * 80) / 5);

void expect_above_chance(const SecondOpinion& one) {
  if (one.metric == "classifier_auc")
    EXPECT_GT(one.before.value - one.floor.value, 5 * area_deviation * std::sqrt(1 + 1.0 / 8));
  else
    EXPECT_GT(above(one.before, one.floor), by_chance) << one.metric;
}

TEST(SecondOpinions, APlainStackIsAtTheFloorOfAllOfThem) {
  const Case it("", {});
  ASSERT_EQ(it.said.metrics.size(), 5);
  EXPECT_EQ(it.said.frames, 100);
  for (const SecondOpinion& one : it.said.metrics) {
    EXPECT_LT(std::fabs(above(one.before, one.floor)), by_chance) << one.metric;
    EXPECT_TRUE(std::isnan(one.after.value)) << one.metric;
    EXPECT_TRUE(std::isnan(one.closed)) << one.metric;
  }
  EXPECT_NEAR(it.metric("classifier_auc").floor.value, 0.5, 5 * area_deviation);
}

TEST(SecondOpinions, AStrongEffectIsAboveTheFloorAndAtItOnceAdded) {
  const Case it("blinking", [] {
    ParameterValues values;
    for (const ParameterDeclaration& p : find_effect("blinking")->parameters)
      values.push_back(p.default_value);
    values[0] = std::min(3 * values[0], find_effect("blinking")->parameters[0].maximum);
    return values;
  }());
  for (const SecondOpinion& one : it.said.metrics) {
    expect_above_chance(one);
    EXPECT_LT(std::fabs(above(one.after, one.floor)), by_chance) << one.metric;
    EXPECT_GT(one.before.value - 5 * one.before.error, one.after.value) << one.metric;
    EXPECT_EQ(one.closed, 1 - (one.after.value - one.floor.value) / (one.before.value - one.floor.value));
  }
  ASSERT_EQ(it.said.detectors.size(), 2);
  for (const DetectorOpinion& one : it.said.detectors) {
    // An atom that is dark for a while is missed: fewer are found than the plain model promises.
    EXPECT_GT((one.before.separation.value - one.real.separation.value) / one.real.separation.error,
              by_chance)
        << one.detector;
    EXPECT_LT(std::fabs(one.after.separation.value - one.real.separation.value) / one.real.separation.error,
              by_chance)
        << one.detector;
    EXPECT_LT(one.after.truly.value, one.before.truly.value) << one.detector;
    EXPECT_TRUE(std::isnan(one.real.truly.value));
  }
}

TEST(SecondOpinions, RowNoiseIsSeenByPixelsAndNotByDetectors) {
  const Case it("row_noise", {6});
  for (const char* metric : {"histogram_divergence", "classifier_auc"})
    expect_above_chance(it.metric(metric));
  EXPECT_LT(above(it.metric("threshold_scores").before, it.metric("threshold_scores").floor), by_chance);
}

TEST(SecondOpinions, ThreadsDoNotChangeThem) {
  const Case one("row_noise", {3}, 60, 1), two("row_noise", {3}, 60, 2);
  for (std::size_t k = 0; k < one.said.metrics.size(); ++k) {
    EXPECT_EQ(one.said.metrics[k].before.value, two.said.metrics[k].before.value);
    EXPECT_EQ(one.said.metrics[k].after.value, two.said.metrics[k].after.value);
    EXPECT_EQ(one.said.metrics[k].floor.value, two.said.metrics[k].floor.value);
  }
}

TEST(SecondOpinions, FramesWithoutSitesHaveNoDetectors) {
  BlindOptions options;
  options.rows = options.columns = 64;
  options.none_share = 1;
  Lab lab = make_blind_stack(options, 3).lab;
  lab.layout = std::vector<Site>{};
  lab.place_sites();
  StackPlan plan;
  plan.model = stack_model(lab);
  plan.frames = 60;
  const SecondOpinions said =
      second_opinions(*simulate_stack(lab, plan, 5, true), plan, {lab, {lab, lab}}, nullptr, 10);
  EXPECT_EQ(said.metrics.size(), 3);
  EXPECT_TRUE(said.detectors.empty());
}

/// A model with one open parameter of the lab and two effects, and stacks drawn from it.
struct PairModel {
  StackPlan plan;
  Model model;
  PairModel() {
    BlindOptions options;
    options.rows = options.columns = 64;
    options.none_share = 1;
    model.lab = make_blind_stack(options, 3).lab;
    plan.model = stack_model(model.lab);
    plan.frames = 60;
    plan.threads = 2;
    Uncertain bias;
    bias.name = "bias";
    bias.width = 0.5;
    bias.apply = [](Lab& lab, double by) { lab.settings.bias_counts += by; };
    model.open.push_back(std::move(bias));
    model.first_effect_parameter = 1;
    for (const char* name : {"row_noise", "stray_light_gradient"}) {
      model.effects.push_back(name);
      for (Uncertain& one : effect_prior(*find_effect(name), 96, 300)) {
        one.width *= 0.1;
        model.open.push_back(std::move(one));
      }
    }
  }
};

TEST(OpinionModel, LabsAlikeAreAsFarOffAsFitsAre) {
  PairModel it;
  it.model.effects.clear();
  it.model.open.resize(1);
  it.model.population = simulate_population(it.model.lab, it.model.open, 40, it.plan, 100);
  Lab truth = it.model.lab;
  truth.settings.bias_counts += 0.4;
  const OpinionModel opinion = opinion_model(it.model, simulate_and_measure(truth, it.plan, 999));
  const Standard standard(it.model.population, Part::fitting);
  const double error = standard.estimate_error()(0);
  ASSERT_GT(error, 0);
  EXPECT_NEAR(opinion.lab.settings.bias_counts, truth.settings.bias_counts, 5 * error);
  ASSERT_EQ(opinion.alike.size(), 8);
  double squares = 0;
  for (const Lab& one : opinion.alike)
    squares += std::pow(one.settings.bias_counts - opinion.lab.settings.bias_counts, 2);
  // Eight of the forty misses that the error is of, as a part of them all: a beta law of 4 and 16, 1e-6 on
  // either side.
  EXPECT_GT(squares / (40 * error * error), 0.00406);
  EXPECT_LT(squares / (40 * error * error), 0.709);
}

TEST(Model, WithItsFirstEffectHasNothingOfTheSecond) {
  const PairModel it;
  Eigen::VectorXd at(static_cast<Eigen::Index>(it.model.open.size()));
  for (std::size_t k = 0; k < it.model.open.size(); ++k)
    at(static_cast<Eigen::Index>(k)) = 0.5 * (it.model.open[k].centre + it.model.open[k].lowest);
  at(0) = 0.25;
  const Model first = it.model.with_first_effects(1, at);
  EXPECT_EQ(first.effects, std::vector<std::string>{"row_noise"});
  ASSERT_EQ(first.open.size(), 2);
  EXPECT_EQ(first.open[0].width, it.model.open[0].width);  // calibration is free to follow
  EXPECT_EQ(first.open[0].centre, it.model.open[0].centre);
  EXPECT_EQ(first.open[1].width, 0);
  const Lab lab = first.fitted_lab(), pair = it.model.lab_at(at);
  ASSERT_EQ(lab.effects.size(), 1);
  EXPECT_EQ(lab.effects.at("row_noise"), pair.effects.at("row_noise"));
  EXPECT_EQ(it.model.with_first_effects(2, at).fitted_lab().effects, pair.effects);
}

}  // namespace
}  // namespace atomcam
