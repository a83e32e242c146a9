#include "diagnosis/naming.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <map>
#include <random>

#include "diagnosis/gap_closed.hpp"
#include "effects/effect.hpp"

namespace atomcam {
namespace {

constexpr Eigen::Index stacks = 90, statistics = 40, moved = 10;
constexpr double gap = 15;  // deviations

/// Statistics of no parameter that scatter alike in all models; the frames have some of them far off.
class Naming : public testing::Test {
 protected:
  Naming() : plain_(model({}, 0, 0)) {
    plain_.correlation = std::make_unique<Correlation>(plain_.standard->own());
    real_.whole.assign(plain_.z.data(), plain_.z.data() + plain_.z.size());
  }

  /// A model that takes so much of the gap away, and under which the frames are that odd.
  Model model(std::vector<std::string> effects, double closed, double p_value) {
    Model made;
    made.effects = std::move(effects);
    made.population.draws = noise(1);
    made.population.whole = made.from_plain = noise(statistics);
    if (!made.effects.empty()) made.from_plain.leftCols(moved).array() += gap;
    made.standard = std::make_unique<Standard>(made.population, Part::whole, std::vector<Eigen::Index>{},
                                               Eigen::VectorXd::Zero(statistics));
    made.p_value = p_value;
    made.oddest = p_value;
    made.log_likelihood = made.effects.empty() ? 0 : 1000;
    made.z = noise(statistics).row(0).transpose();
    made.z.head(moved).setConstant(gap * std::sqrt(1 - closed));
    made.gap = gap_of(made.z);
    return made;
  }
  bool passes(std::vector<std::string> effects, double closed, double p_value) {
    return naming().passes(model(std::move(effects), closed, p_value));
  }
  atomcam::Naming naming() const { return {plain_, real_, battery_}; }
  /// The model's own stacks have far off what the frames have.
  void move_stacks_of(Model& model) { model.population.whole.leftCols(moved).array() += gap; }
  /// A model that comes out differently in every stack: what the frames have far off is more or less far off
  /// in its stacks, too, half of it times `second`. Hardly likelier than the plain one.
  Model wide_model(double second) {
    Model wide = model({"row_noise"}, 0, 0.5);
    for (Eigen::Index n = 0; n < stacks; ++n) {
      const double by = gap * std::fabs(normal_(random_));
      wide.population.whole.row(n).head(moved / 2).array() += by;
      wide.population.whole.row(n).segment(moved / 2, moved / 2).array() += second * by;
    }
    wide.standard = std::make_unique<Standard>(wide.population, Part::whole);
    wide.z = wide.standard->judge(as_vector(real_.whole));
    wide.gap = gap_of(wide.z);
    wide.log_likelihood = 6;
    return wide;
  }
  /// A statistic of the rest is as far off with the plain model as with this one.
  void leave_as_it_was(const Model& model) {
    plain_.z(moved) =
        model.z(moved) * model.standard->deviation()(moved) / plain_.standard->deviation()(moved);
  }
  /// What the frames have far off is so far off.
  void push(double by) { plain_.z.head(moved).setConstant(by); }
  /// It is hardly off the way that effects go, and some of it to either side.
  void push_hardly(double along, double aside) {
    for (Eigen::Index k = 0; k < moved; ++k) plain_.z(k) = along + (k % 2 ? aside : -aside);
  }
  /// The frames are as usual in the rest.
  void calm_the_rest() { plain_.z.tail(statistics - moved).setConstant(1); }
  /// What the frames have far off is an observable.
  atomcam::Naming naming_by_observable(const std::string& of_these = "row_means",
                                       const std::string& of_the_rest = "pixel_histogram") {
    for (std::size_t k = 0; k < two_observables_.size(); ++k)
      two_observables_[k].observable = k < moved ? of_these : of_the_rest;
    return {plain_, real_, two_observables_};
  }

 private:
  Eigen::MatrixXd noise(Eigen::Index columns) {
    return Eigen::MatrixXd::NullaryExpr(stacks, columns, [&] { return normal_(random_); });
  }
  std::mt19937 random_{5};
  std::normal_distribution<double> normal_;
  Model plain_;
  BatteryValues real_;
  const std::vector<StatisticDeclaration> battery_ = std::vector<StatisticDeclaration>(statistics);
  std::vector<StatisticDeclaration> two_observables_ = std::vector<StatisticDeclaration>(statistics);
};

// The scale of a size's logarithm ends somewhere above zero; the interval does not.
TEST(FoundEffects, TheSmallestSizeThatIsLookedForIsAsGoodAsNone) {
  Model model;
  model.effects = {"bias_drift"};
  model.open = effect_prior(*find_effect("bias_drift"), 64, 150);
  model.estimate.resize(3);
  model.error = Eigen::VectorXd::Constant(3, 0.1);
  for (Eigen::Index k = 0; k < 3; ++k) model.estimate(k) = model.open[static_cast<std::size_t>(k)].centre;
  const auto parameters = [&] {
    return found_effects({.model = &model, .confusable_with = {}}).front().parameters;
  };
  for (const FoundParameter& one : parameters())
    EXPECT_NEAR(std::log(one.high / one.low), 0.2, 1e-12) << one.name;
  const Uncertain& frame_counts = model.open[2];
  model.estimate(2) = frame_counts.lowest + 0.05;
  const FoundParameter found = parameters()[2];
  EXPECT_EQ(found.name, "frame_counts");
  EXPECT_EQ(found.low, 0);
  EXPECT_DOUBLE_EQ(found.high, std::exp(frame_counts.lowest + 0.15));
  EXPECT_DOUBLE_EQ(found.error(), found.high / 2);
}

TEST_F(Naming, AnExplanationTakesTheGapAwayAndTheFramesAreNotOddUnderIt) {
  EXPECT_TRUE(passes({"row_noise"}, 1, 0.5));
  EXPECT_TRUE(passes({"row_noise"}, 0.88, 0.5));
  EXPECT_FALSE(passes({"row_noise"}, 0.8, 0.5));
  EXPECT_FALSE(passes({"row_noise"}, 1, 0.008));
}

TEST_F(Naming, OfALargeGapHardlyMoreMayBeLeftOnHeldOutFramesThanOwnStacksHave) {
  const Model found = model({"blinking"}, 0.9, 0.5), plain = model({}, 0, 0);
  const auto too_little = [&](double before, double after, double high_floor = 6) {
    GapClosed held_out;
    held_out.before = before, held_out.after = after, held_out.floor = 6;
    const auto closed = [&](double floor) { return 1 - (after - floor) / (before - floor); };
    held_out.closed = closed(6), held_out.closed_high = closed(high_floor);
    return closes_too_little(held_out, found, plain);
  };
  EXPECT_FALSE(too_little(20, 8));         // 86 %
  EXPECT_TRUE(too_little(20, 8.5));        // 82 %
  EXPECT_TRUE(too_little(225, 21));        // 93 %, with three times what stacks have
  EXPECT_FALSE(too_little(225, 11));       // 98 %
  EXPECT_FALSE(too_little(17000, 27));     // 99.9 %
  EXPECT_TRUE(too_little(130, 13.5));      // 94 %
  EXPECT_FALSE(too_little(130, 13.5, 9));  // and 96 % by one in twenty of its own stacks: a rare event
}

TEST_F(Naming, MoreIsAskedOfTwoAndOfOneThatTheFramesAreOddUnder) {
  EXPECT_FALSE(passes({"row_noise", "cti_tail"}, 0.92, 0.5));
  EXPECT_TRUE(passes({"row_noise", "cti_tail"}, 0.98, 0.5));
  EXPECT_FALSE(passes({"row_noise"}, 0.92, 0.03));
  EXPECT_TRUE(passes({"row_noise"}, 0.98, 0.03));
}

// A law of its own leaves something in what it explains; what is odd elsewhere may be the camera's.
TEST_F(Naming, WhereTheFramesAreOddIsNotWhatTheEffectExplains) {
  const atomcam::Naming naming = naming_by_observable();
  Model found = model({"row_noise"}, 1, 0.03);
  EXPECT_TRUE(naming.passes(found)) << naming.objection(found);
  found.z.tail(4).setConstant(4);
  EXPECT_TRUE(naming.passes(found)) << naming.objection(found);
  EXPECT_TRUE(naming.nearest({&found, 1}));
  found.z.tail(4).setZero();
  found.z.head(4).setConstant(4);
  EXPECT_EQ(naming.objection(found), "is not what row_means shows");
  EXPECT_FALSE(naming.nearest({&found, 1}));
  found.oddest = found.p_value = 0.2;  // as such stacks go
  EXPECT_TRUE(naming.passes(found)) << naming.objection(found);
}

TEST_F(Naming, OfASmallGapAPartMayBeChance) {
  const Model found = model({"row_noise"}, 1, 0.5);
  EXPECT_LT(chance_of(found, model({}, 0, 0)), 0.03);
  EXPECT_GT(chance_of(found, model({}, 0.95, 0)), 0.1);
  EXPECT_EQ(chance_of(found, model({}, 1, 0)), 1);
}

TEST_F(Naming, WhatMakesTheFramesNoLikelierExplainsNothing) {
  Model found = model({"row_noise"}, 1, 0.5);
  found.log_likelihood = 3;  // the plain model's is 0
  EXPECT_EQ(naming().objection(found), "the frames are no likelier with it");
  found.p_value = 0.0001;  // nor as the nearest
  EXPECT_FALSE(naming().nearest({&found, 1}));
  found.log_likelihood = 10;
  EXPECT_TRUE(naming().nearest({&found, 1}));
  found.p_value = 0.5;
  EXPECT_TRUE(naming().passes(found));
}

// Likelihoods of hundreds of statistics are not known to a few units: where the model's own stacks have the
// very difference that the frames have, these are likelier with it.
TEST_F(Naming, FramesOnTheWayToTheModelsStacksAreLikelierWithIt) {
  Model found = model({"row_noise"}, 1, 0.5);
  found.log_likelihood = -10;
  EXPECT_EQ(naming().objection(found), "the frames are no likelier with it");
  move_stacks_of(found);
  EXPECT_TRUE(naming().passes(found)) << naming().objection(found);
}

TEST_F(Naming, WhatComesOutDifferentlyInEveryStackClosesWhatLiesAmongThem) {
  const Model among = wide_model(1), elsewhere = wide_model(-1);
  EXPECT_TRUE(naming().passes(among)) << naming().objection(among);
  EXPECT_FALSE(naming().passes(elsewhere));
}

// It may be likelier than what passes: then there are two names, or what does not pass would be taken back as
// it closes too little, and the other be forgotten.
TEST_F(Naming, WhatDoesNotPassIsNotNamedBeforeWhatDoes) {
  std::vector<Model> models;
  models.push_back(model({"bias_drift"}, 1, 0.5));
  models.push_back(wide_model(0.5));
  for (Model& one : models) one.correlation = std::make_unique<Correlation>(one.standard->own());
  ASSERT_FALSE(naming().passes(models[1]));
  const std::optional<Named> named = naming().choose(models);
  ASSERT_TRUE(named);
  EXPECT_EQ(named->model, &models[0]);
  EXPECT_LT(named->probability, 0.5);
  EXPECT_EQ(named->verdict, Verdict::ambiguous);
  EXPECT_EQ(named->confusable_with, std::vector<std::string>{"row_noise"});
}

// A brightness that drifts scatters what the sites' histogram shows, and comes near to frames that blink.
TEST_F(Naming, WhatWouldShowAndDoesNotIsNotThere) {
  const atomcam::Naming naming = naming_by_observable();
  calm_the_rest();
  Model found = model({"bias_drift"}, 1, 0.5);  // what the frames have is in the means of rows
  EXPECT_TRUE(naming.passes(found)) << naming.objection(found);
  found.from_plain.rightCols(moved).array() += 5;  // the histogram
  EXPECT_EQ(naming.objection(found), "bias_drift would show in frame_means, pixel_histogram");
  found.p_value = 0.0001;  // nor is it the nearest
  EXPECT_FALSE(naming.nearest({&found, 1}));
  found.from_plain.topRightCorner(10, moved).array() -= 5;  // a tenth of its stacks does not show it
  found.p_value = 0.5;
  EXPECT_TRUE(naming.passes(found)) << naming.objection(found);
}

// Fringes pass for sites that differ, and would be seen between the sites.
TEST_F(Naming, NothingInOneOfItsObservablesIsEnoughIfAllItsStacksShowSomething) {
  const atomcam::Naming naming = naming_by_observable("site_brightness", "mean_map");
  calm_the_rest();
  Model found = model({"etaloning_fringes"}, 1, 0.5);
  EXPECT_TRUE(naming.passes(found)) << naming.objection(found);
  found.from_plain.rightCols(moved).array() += 5;
  EXPECT_EQ(naming.objection(found), "etaloning_fringes would show in mean_map");
  found.from_plain.topRightCorner(2, moved).array() -= 5;
  EXPECT_TRUE(naming.passes(found)) << naming.objection(found);
}

// Outliers in the dark frames of a few stacks, and frames with other outliers fit an effect of the optics.
TEST_F(Naming, NothingOddIsForeignToWhatExplainsIt) {
  Model found = model({"vignetting"}, 1, 0.5);
  EXPECT_TRUE(naming().passes(found)) << naming().objection(found);
  found.from_plain.col(3).array() -= gap;
  EXPECT_EQ(naming().objection(found), "does not touch ");  // the statistics here have no names
  found.p_value = 0.0001;
  EXPECT_FALSE(naming().nearest({&found, 1}));
  found.p_value = 0.5;
  found.from_plain.col(3).head(5).array() += gap;
  EXPECT_TRUE(naming().passes(found)) << naming().objection(found);
}

// Of a few rays one hits the image of an atom, or none does: by how much is chance.
TEST_F(Naming, WhatIsFarOffMayBeFartherOffThanInOwnStacks) {
  const Model found = model({"cosmic_rays"}, 1, 0.5);
  push(100 * gap);
  EXPECT_TRUE(naming().passes(found)) << naming().objection(found);
  push(-100 * gap);
  EXPECT_EQ(naming().objection(found), "does not touch ");
}

// An image that drifts is wider on the mean, which passes for defocus.
TEST_F(Naming, WhatTheFramesWereCalibratedToIsNotMissing) {
  const atomcam::Naming naming = naming_by_observable("centroid_series", "point_spread_width");
  calm_the_rest();
  Model found = model({"pointing_drift"}, 1, 0.5);
  found.from_plain.rightCols(moved).array() += 5;
  EXPECT_TRUE(naming.passes(found)) << naming.objection(found);
}

// A drift that passes for noise that forgets as slowly as it can shows more than such noise does.
TEST_F(Naming, AtTheEndOfItsLawAnEffectShowsAsMuchAsTheFramesDo) {
  const atomcam::Naming naming = naming_by_observable();
  const EffectDeclaration& stripes = *find_effect("emi_stripes");
  Model found = model({stripes.name}, 1, 0.5);
  found.open = effect_prior(stripes, 64, 300);
  found.estimate.setConstant(std::ssize(found.open), -1);
  found.error.setConstant(std::ssize(found.open), 1);
  EXPECT_TRUE(naming.passes(found)) << naming.objection(found);
  const Uncertain& period = found.open[1];
  found.estimate(1) = period.coordinate_of(stripes.parameters[1].maximum) + 0.1;
  found.from_plain.leftCols(moved).array() -= gap / 3;
  EXPECT_EQ(naming.objection(found), "the frames want more of " + period.name + " than it can be");
  found.from_plain.leftCols(moved).array() += gap / 3;
  EXPECT_TRUE(naming.passes(found)) << naming.objection(found);
}

TEST_F(Naming, HowMuchLikelierAnEffectMustBeIsPartOfWhatThePlainModelMisses) {
  Model plain = model({}, 0, 0), found = model({"row_noise"}, 1, 0.5);
  plain.usual_log_likelihood = 100;  // 100 more than the frames have under it
  found.log_likelihood = 20;
  EXPECT_FALSE(much_likelier(found, plain));
  found.log_likelihood = 30;
  EXPECT_TRUE(much_likelier(found, plain));
  plain.usual_log_likelihood = 400;
  EXPECT_FALSE(much_likelier(found, plain));
  found.log_likelihood = 70;
  EXPECT_TRUE(much_likelier(found, plain));
  found.p_value = 5e-4;
  EXPECT_FALSE(much_likelier(found, plain));
}

// Few hot pixels, many or large: each of such a model's own stacks is far off somewhere.
TEST(ClearDifference, IsLargerThanWhatOwnStacksHaveSomewhere) {
  Eigen::MatrixXd own = Eigen::MatrixXd::Constant(60, 200, 1);
  EXPECT_EQ(clear_difference_of(own), 5.5);
  for (Eigen::Index n = 0; n < 29; ++n) own(n, 2 * n) = -7;
  EXPECT_EQ(clear_difference_of(own), 5.5);
  for (Eigen::Index n = 29; n < 40; ++n) own(n, 2 * n) = 7;
  EXPECT_EQ(clear_difference_of(own), 7);
}

TEST_F(Naming, WhatDoesNotPassIsToldWhy) {
  const auto objection = [&](double closed, double p_value) {
    return naming().objection(model({"row_noise"}, closed, p_value));
  };
  EXPECT_EQ(objection(1, 0.5), "");
  EXPECT_TRUE(objection(0.83, 0.5).starts_with("closes 8")) << objection(0.83, 0.5);
  EXPECT_TRUE(objection(1, 0.008).starts_with("leaves ")) << objection(1, 0.008);
  EXPECT_TRUE(objection(0, 0.5).ends_with(" sigma, as it was")) << objection(0, 0.5);
  // Less is enough to speak against what the frames are a little odd under.
  Model found = model({"row_noise"}, 1, 0.03);
  EXPECT_EQ(naming().objection(found), "");
  found.z(moved) = 5;
  leave_as_it_was(found);
  EXPECT_TRUE(naming().objection(found).ends_with(" sigma, as it was")) << naming().objection(found);
  found.p_value = found.oddest = 0.3;
  EXPECT_EQ(naming().objection(found), "");
}

// Hot pixels of another camera have other sizes: fewer small ones than the catalogue's law, not more.
TEST_F(Naming, WhatTurnsRoundInItsOwnObservableIsAnotherLaw) {
  Model found = model({"row_noise"}, 1, 0.5);
  const auto as_it_was = [&](const atomcam::Naming& naming) {
    return naming.objection(found).ends_with("as it was");
  };
  found.z(0) = gap;
  EXPECT_TRUE(as_it_was(naming()));
  EXPECT_TRUE(as_it_was(naming_by_observable()));  // in the means of the rows, which are its own
  found.z(0) = -gap;
  EXPECT_TRUE(as_it_was(naming()));
  EXPECT_FALSE(as_it_was(naming_by_observable()));
}

// As what somebody's camera does may differ from the catalogue's model of it.
TEST_F(Naming, WhatClosesNearlyAllOfAGapIsNamedInPart) {
  std::vector<Model> models;
  models.push_back(model({"row_noise"}, 0.99, 1e-4));
  const auto nearest = naming().nearest(models);
  ASSERT_TRUE(nearest);
  EXPECT_EQ(nearest->verdict, Verdict::partly_explained);
  models[0] = model({"row_noise"}, 0.93, 1e-4);
  EXPECT_FALSE(naming().nearest(models));
  models[0] = model({"row_noise"}, 0.99, 5e-3);  // hardly odd: nothing is to be said of the rest
  EXPECT_EQ(naming().nearest(models)->verdict, Verdict::explained);
  models.push_back(model({"cti_tail"}, 0.99, 1e-4));  // likelier, and what it leaves is not nothing
  models[1].log_likelihood += 50;
  EXPECT_EQ(naming().nearest(models)->verdict, Verdict::partly_explained);
}

// What makes sites differ may be fringes that are nowhere else, or anything.
TEST_F(Naming, AnEffectIsNotNamedWhereWhatItIsKnownByShowsNothing) {
  const auto name = [&](const atomcam::Naming& naming, std::vector<std::string> also) {
    std::vector<Model> models;
    models.push_back(model({"etaloning_fringes"}, 1, 0.5));
    if (!also.empty()) models.push_back(model(std::move(also), 1, 0.5));
    for (Model& one : models) one.correlation = std::make_unique<Correlation>(one.standard->own());
    const auto named = naming.choose(models);
    return named ? named->model->effects.front() : "";
  };
  EXPECT_EQ(name(naming_by_observable("mean_map", "site_brightness"), {}), "etaloning_fringes");
  calm_the_rest();
  const atomcam::Naming unseen = naming_by_observable("site_brightness", "mean_map");
  EXPECT_EQ(name(unseen, {}), "");
  EXPECT_EQ(name(unseen, {"site_brightness_spread"}), "site_brightness_spread");
  EXPECT_NE(unseen.not_known(model({"etaloning_fringes"}, 1, 0.5)).find("mean_map"), std::string::npos);
  EXPECT_TRUE(unseen.not_known(model({"site_brightness_spread"}, 1, 0.5)).empty());
}

// Fringes as far apart as the frame is wide are any slope of the sites' brightness: the mean image is to show
// them clearly.
TEST_F(Naming, FringesThatTheFrameDoesNotHoldOnceAreKnownOnlyIfTheyShowClearly) {
  const atomcam::Naming naming = naming_by_observable("mean_map", "site_brightness");
  Model found = model({"etaloning_fringes"}, 1, 0.5);
  found.open = effect_prior(*find_effect("etaloning_fringes"), 96, 300);
  found.first_effect_parameter = 0;
  found.error = Eigen::Vector2d(0.1, 0.1);
  const auto known = [&](double period_px) {
    found.estimate = Eigen::Vector2d(found.open[0].centre, std::log(period_px));
    return naming.not_known(found).empty();
  };
  EXPECT_TRUE(known(20));
  EXPECT_TRUE(known(66));
  push_hardly(0.55, 1.3);
  EXPECT_TRUE(known(20));
  EXPECT_FALSE(known(66));
}

// A drift's own stacks scatter so widely that they have whatever images and counts do: what drifts is known
// by the series that it moves.
TEST_F(Naming, ADriftIsKnownByTheSeriesThatItMoves) {
  calm_the_rest();
  const std::map<std::string, std::pair<std::string, std::string>> series_and_other = {
      {"pointing_drift", {"centroid_series", "point_spread_width"}},
      {"fluorescence_drift", {"brightness_series", "site_correlation"}},
      {"bias_drift", {"frame_means", "pixel_histogram"}}};
  for (const auto& [effect, observables] : series_and_other) {
    const auto& [series, other] = observables;
    EXPECT_TRUE(naming_by_observable(series, other).not_known(model({effect}, 1, 0.5)).empty()) << effect;
    EXPECT_FALSE(naming_by_observable(other, series).not_known(model({effect}, 1, 0.5)).empty()) << effect;
  }
}

// Something is odd in the mean image, and other statistics than fringes would move.
TEST_F(Naming, WhatAnEffectIsKnownByIsOddTheWayThatTheEffectMovesIt) {
  const atomcam::Naming naming = naming_by_observable("mean_map", "site_brightness");
  Model found = model({"etaloning_fringes"}, 1, 0.5);
  found.from_plain.middleCols(1, moved - 1).array() -= gap;
  EXPECT_EQ(naming.not_known(found), "");
  found.from_plain.col(0).array() -= 2 * gap;
  EXPECT_NE(naming.not_known(found), "");
}

}  // namespace
}  // namespace atomcam
