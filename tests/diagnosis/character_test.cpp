// What kind of thing a list of differences speaks for, on lists made by hand.
#include "diagnosis/character.hpp"

#include <gtest/gtest.h>

#include <map>

namespace atomcam {
namespace {

const std::vector<StatisticDeclaration> some = {
    {"light.static_offsets.columns.period_4", "column_means", "space", "columns", false},
    {"light.static_charge.gradient_x", "mean_map", "space", "whole frame", false},
    {"light.lines.rows.variance", "row_means", "time", "rows", false},
    {"light.sites.by_site.spread", "site_brightness", "site", "all sites", false},
    {"light.sites.common.variance", "brightness_series", "time", "occupied sites", false},
    {"light.frames.level.odd_frames", "frame_means", "time", "whole frame", false},
    {"dark.static_offsets.columns.period_4", "column_means", "space", "columns", true},
    {"dark.lines.rows.variance", "row_means", "time", "rows", true}};

Character character(const std::map<std::string, double>& odd) {
  Eigen::VectorXd z(some.size());
  for (std::size_t k = 0; k < some.size(); ++k) {
    const auto found = odd.find(some[k].name);
    z(static_cast<Eigen::Index>(k)) = found == odd.end() ? 0.5 : found->second;
  }
  return character_of(some, z);
}

TEST(Character, OfNothingIsNotTold) {
  const Character none = character({{"light.lines.rows.variance", 4}});
  EXPECT_EQ(none.axis + none.change + none.action + none.period, "");
  EXPECT_EQ(in_words(none), "");
}

TEST(Character, WhatTheShutterDoesNotChangeIsAdditive) {
  const Character noise = character({{"light.lines.rows.variance", 40}, {"dark.lines.rows.variance", -30}});
  EXPECT_EQ(noise.change, "changing");
  EXPECT_EQ(noise.action, "additive");
  EXPECT_EQ(noise.axis, "time");
  const Character pattern = character(
      {{"light.static_offsets.columns.period_4", 20}, {"dark.static_offsets.columns.period_4", 25}});
  EXPECT_EQ(pattern.change, "static");
  EXPECT_EQ(pattern.action, "additive");
  EXPECT_EQ(pattern.period, "4 columns");
  EXPECT_EQ(in_words(pattern), "static, additive, along space, period 4 columns");
}

TEST(Character, WhatFollowsTheAtomsIsMultiplicative) {
  const Character shares = character({{"light.sites.by_site.spread", 30}});
  EXPECT_EQ(shares.change, "static");
  EXPECT_EQ(shares.action, "multiplicative");
  const Character laser = character({{"light.sites.common.variance", 30}, {"dark.lines.rows.variance", 4}});
  EXPECT_EQ(laser.change, "changing");
  EXPECT_EQ(laser.action, "multiplicative");
  const Character both =
      character({{"light.sites.common.variance", 30}, {"light.sites.by_site.spread", -30}});
  EXPECT_EQ(both.change, "static and changing");
}

TEST(Character, LightWhereNoSiteIsAdds) {
  const Character stray =
      character({{"light.static_charge.gradient_x", 30}, {"light.sites.by_site.spread", 6}});
  EXPECT_EQ(stray.action, "additive");
  EXPECT_EQ(stray.period, "");
  const Character level = character({{"light.frames.level.odd_frames", -12}});
  EXPECT_EQ(level.period, "2 frames");
}

}  // namespace
}  // namespace atomcam
