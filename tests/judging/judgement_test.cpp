#include "judging/judgement.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "base/error.hpp"

namespace atomcam {
namespace {

double normal_law(double x) {
  return 0.5 * std::erfc(-x / std::sqrt(2.0));
}

struct Trial {
  SiteScores scores;
  std::vector<SiteTruth> truth;
};

/// Normal scores of width 1, filled ones higher by `distance`; `common` is the width of what a frame's sites
/// share.
Trial draw(std::mt19937_64& random, std::uint64_t frames, std::size_t sites, double distance, double common) {
  std::normal_distribution<double> normal;
  std::bernoulli_distribution half(0.5);
  Trial trial{{frames, sites, {}}, {}};
  for (std::uint64_t n = 0; n < frames; ++n) {
    const double shared = common * normal(random);
    for (std::size_t s = 0; s < sites; ++s) {
      SiteTruth site;
      site.filled = half(random);
      site.electrons = site.filled ? static_cast<float>(100 + 10 * normal(random)) : 0;
      site.lost = site.filled && half(random);
      site.loss_s =
          site.lost ? static_cast<float>(std::uniform_real_distribution<double>(0, 0.02)(random)) : 0;
      site.neighbours = static_cast<std::uint8_t>(random() % 5);
      trial.truth.push_back(site);
      trial.scores.values.push_back(
          static_cast<float>(shared + normal(random) + (site.filled ? distance : 0)));
    }
  }
  return trial;
}

/// Mean 0 and width 1, at five standard errors.
void expect_unit_pulls(const std::vector<double>& pulls) {
  const double n = static_cast<double>(pulls.size());
  double sum = 0, squares = 0;
  for (const double pull : pulls) sum += pull, squares += pull * pull;
  EXPECT_LT(std::fabs(sum / n), 5 / std::sqrt(n));
  EXPECT_LT(std::fabs(squares / n - 1), 5 * std::sqrt(2 / n)) << "width " << std::sqrt(squares / n);
}

TEST(Judgement, AreaOfNormalScoresIsKnownAndItsErrorCovers) {
  std::mt19937_64 random(7);
  for (const double distance : {0.0, 1.0, 2.0}) {
    std::vector<double> pulls;
    for (int i = 0; i < 400; ++i) {
      const Trial trial = draw(random, 100, 20, distance, 0);
      const Judgement judgement = judge(trial.scores, trial.truth, 0.5 * distance, 0.02);
      pulls.push_back((judgement.auc - normal_law(distance / std::sqrt(2.0))) / judgement.auc_error);
    }
    SCOPED_TRACE(distance);
    expect_unit_pulls(pulls);
  }
}

TEST(Judgement, ErrorsOfSharesCoverAlsoWhereFramesErrTogether) {
  std::mt19937_64 random(8);
  for (const double common : {0.0, 1.0}) {
    // A score is above half the distance with this chance; what frames share widens it.
    const double truth = normal_law(0.5 / std::sqrt(1 + common * common));
    std::vector<double> fidelity, found, false_alarms;
    double naive = 0;
    for (int i = 0; i < 400; ++i) {
      const Trial trial = draw(random, 200, 20, 1, common);
      const Judgement judgement = judge(trial.scores, trial.truth, 0.5, 0.02);
      fidelity.push_back((judgement.fidelity.value() - truth) / judgement.fidelity.error);
      found.push_back((judgement.found.value() - truth) / judgement.found.error);
      false_alarms.push_back((judgement.false_alarms.value() - (1 - truth)) / judgement.false_alarms.error);
      naive += std::pow(judgement.found.value() - truth, 2) * static_cast<double>(judgement.found.number) /
               (truth * (1 - truth));
    }
    SCOPED_TRACE(common);
    expect_unit_pulls(found);
    expect_unit_pulls(false_alarms);
    if (common == 0) expect_unit_pulls(fidelity);
    // The rig sees it: binomial errors alone would be far too small where frames err together.
    EXPECT_EQ(naive / 400 > 1 + 5 * std::sqrt(2 / 400.0), common > 0);
  }
}

TEST(Judgement, ExtremesAreExact) {
  SiteScores scores{2, 3, {0, 1, 1, 0, 0, 1}};
  std::vector<SiteTruth> truth(6);
  for (const std::size_t i : {1u, 2u, 5u}) truth[i].filled = true;
  const Judgement perfect = judge(scores, truth, 0.5, 1);
  EXPECT_EQ(perfect.auc, 1);
  EXPECT_GT(perfect.auc_error, 0);
  EXPECT_EQ(perfect.fidelity.value(), 1);
  EXPECT_GT(perfect.fidelity.error, 0);
  EXPECT_EQ(perfect.best_threshold, 0.5);
  EXPECT_EQ(perfect.roc.front().found, 0);
  EXPECT_EQ(perfect.roc.back().found, 1);
  EXPECT_EQ(perfect.roc.back().false_alarms, 1);
  for (float& value : scores.values) value = -value;
  EXPECT_EQ(judge(scores, truth, 0.5, 1).auc, 0);
  for (float& value : scores.values) value = 3;
  EXPECT_EQ(judge(scores, truth, 0.5, 1).auc, 0.5);
  scores.values[4] = NAN;
  EXPECT_THROW(judge(scores, truth, 0.5, 1), Error);
  scores.values[4] = 0;
  for (SiteTruth& site : truth) site.filled = true;
  EXPECT_THROW(judge(scores, truth, 0.5, 1), Error);
}

TEST(Judgement, EveryTablePartsTheSites) {
  std::mt19937_64 random(9);
  const Trial trial = draw(random, 50, 30, 2, 0);
  const Judgement judgement = judge(trial.scores, trial.truth, 1, 0.02);
  const auto totals = [](const std::vector<Confusion>& rows) {
    std::pair<std::uint64_t, std::uint64_t> sum{0, 0};
    for (const Confusion& row : rows) sum.first += row.found.number, sum.second += row.found.part;
    return sum;
  };
  const std::pair<std::uint64_t, std::uint64_t> all{judgement.found.number, judgement.found.part};
  EXPECT_EQ(totals(judgement.by_brightness), all);
  EXPECT_EQ(totals(judgement.by_loss), all);
  EXPECT_EQ(totals(judgement.by_neighbours), all);
  EXPECT_EQ(judgement.by_brightness.size(), 5u);
  EXPECT_EQ(judgement.by_loss.size(), 6u);
  EXPECT_EQ(judgement.by_neighbours.size(), 5u);
}

TEST(Judgement, BestThresholdIsTheBestOfAll) {
  std::mt19937_64 random(10);
  const Trial trial = draw(random, 10, 20, 2, 0);
  const Judgement best = judge(trial.scores, trial.truth, best_threshold(trial.scores, trial.truth), 1);
  EXPECT_EQ(best.fidelity.value(), best.best_fidelity);
  for (const float value : trial.scores.values)
    EXPECT_LE(judge(trial.scores, trial.truth, value, 1).fidelity.value(), best.best_fidelity);
}

}  // namespace
}  // namespace atomcam
