// The stage that a list of differences speaks for, on lists made by hand.
#include "diagnosis/stages.hpp"

#include <gtest/gtest.h>

#include <string>

namespace atomcam {
namespace {

const std::vector<StatisticDeclaration> battery_of_four = {
    {"light.lines.rows.variance", "row_statistics", "time", "rows", false},
    {"light.neighbours.dark.right_1", "pixel_correlation", "space", "dark pixels", false},
    {"light.sites.peak.variance", "site_histogram", "intensity", "occupied sites", false},
    {"dark.lines.rows.variance", "row_statistics", "time", "rows", true}};

std::string stage_at(double rows, double neighbours, double sites, double dark_rows,
                     const std::vector<Hypothesis>& hypotheses = {}) {
  Eigen::VectorXd z(4);
  z << rows, neighbours, sites, dark_rows;
  return stage_of_differences(battery_of_four, z, hypotheses);
}

TEST(Stages, RowsThatChangeInLightOnlyAreTheLights) {
  EXPECT_EQ(stage_at(40, 20, 0, 0.5), "optics");
  EXPECT_EQ(stage_at(40, 20, 0, 35), "sensor");  // the read-out: also with the shutter closed
  EXPECT_EQ(stage_at(5, 20, 0, 0.5), "sensor");  // hardly any rows in it
  EXPECT_EQ(stage_at(0, 0, 30, 0), "scene");
}

TEST(Stages, NoiseThatSlopesWithTheMeanInLightOnlyIsTheLights) {
  const std::vector<StatisticDeclaration> slopes = {
      {"light.temporal_maps.gradient_y", "variance_map", "space", "whole frame", false},
      {"light.temporal_maps.noisiest", "variance_map", "space", "whole frame", false},
      {"light.static_charge.gradient_y", "mean_map", "space", "whole frame", false},
      {"dark.temporal_maps.gradient_y", "variance_map", "space", "whole frame", true},
      {"light.temporal_maps.columns", "variance_map", "space", "columns", false},
      {"light.sites.partial", "site_histogram", "intensity", "all sites", false}};
  const auto stage = [&](double noise, double noisiest, double mean, double darks, double columns = 0,
                         double sites = 0) {
    Eigen::VectorXd z(6);
    z << noise, noisiest, mean, darks, columns, sites;
    return stage_of_differences(slopes, z, {});
  };
  EXPECT_EQ(stage(50, 70, 10, 1), "optics");
  EXPECT_EQ(stage(50, 70, 10, 6), "sensor");
  EXPECT_EQ(stage(50, 70, 4, 1), "sensor");
  EXPECT_EQ(stage(20, 70, 10, 1), "sensor");
  EXPECT_EQ(stage(50, 70, 10, 1, 20), "optics");
  EXPECT_EQ(stage(50, 70, 10, 1, 60), "sensor");  // some columns that are dead
  EXPECT_EQ(stage(35, 0, 6, 1, 0, 60), "optics");
  EXPECT_EQ(stage(35, 0, 6, 1, 0, 75), "scene");  // the atoms' own light
}

TEST(Stages, NoiseThatSlopesWhereOffsetsHideTheMeanIsTheLights) {
  const std::vector<StatisticDeclaration> slopes = {
      {"light.temporal_maps.gradient_y", "variance_map", "space", "whole frame", false},
      {"light.temporal_maps.top_bottom", "variance_map", "space", "whole frame", false},
      {"light.temporal_maps.radial", "variance_map", "space", "whole frame", false},
      {"light.static_offsets.gradient_y", "mean_map", "space", "whole frame", false},
      {"light.sites.by_site.few_waves", "site_brightness", "site", "occupied sites", false},
      {"light.sites.by_site.gradient_y", "site_brightness", "site", "occupied sites", false},
      {"light.sites.by_site.top_bottom", "site_brightness", "site", "occupied sites", false},
      {"dark.temporal_maps.radial", "variance_map", "space", "whole frame", true}};
  const auto stage = [&](double gradient, double halves, double radial, double sites, double mean = 0,
                         double sites_slope = 0, double sites_step = 0) {
    Eigen::VectorXd z(8);
    z << gradient, halves, radial, mean, sites, sites_slope, sites_step, 0;
    return stage_of_differences(slopes, z, {});
  };
  EXPECT_EQ(stage(28, -18, 0, 3), "optics");
  EXPECT_EQ(stage(14, -13, 0, 19), "scene");      // the atoms' own light, beyond what sites differ by
  EXPECT_EQ(stage(14, -13, 0, 19, 6), "optics");  // and that of the mean
  EXPECT_EQ(stage(0, 0, -14, 3), "optics");       // falls off from the middle
  EXPECT_EQ(stage(-31, 34, 0, 8), "sensor");      // steps in the middle: two amplifiers
  EXPECT_EQ(stage(-17, 17.4, 0, 25, 0, 11, -10), "scene");  // the atoms' own light slopes
  EXPECT_EQ(stage(-17, 17.4, 0, 25, 0, 10, -11), "sensor");
}

TEST(Stages, FramesWithMoreLightThanOthersAreTheLights) {
  const std::vector<StatisticDeclaration> frames = {
      {"light.frames.level.variance", "frame_means", "time", "dark pixels", false},
      {"light.frames.noise.variance", "frame_means", "time", "dark pixels", false},
      {"light.neighbours.all.down_2", "vertical_correlation", "space", "all pixels", false},
      {"dark.frames.level.variance", "frame_means", "time", "dark pixels", true},
      {"light.frames.level.steps", "frame_means", "time", "dark pixels", false},
      {"light.frames.level.largest", "frame_means", "time", "dark pixels", false}};
  const auto stage = [&](double level, double noise, double neighbours, double darks, double steps = 0,
                         double highest = 0) {
    Eigen::VectorXd z(6);
    z << level, noise, neighbours, darks, steps, highest;
    return stage_of_differences(frames, z, {});
  };
  EXPECT_EQ(stage(50, 40, 80, 1), "optics");
  EXPECT_EQ(stage(50, 1, 80, 1), "sensor");    // an offset has no shot noise
  EXPECT_EQ(stage(50, 40, 80, 30), "sensor");  // also with the shutter closed
  EXPECT_EQ(stage(9, 9, 80, 1), "sensor");     // the least part of it
  // Light on the ground of so much that its own noise hardly changes.
  EXPECT_EQ(stage(20, 3, 4, 1, 15), "optics");
  EXPECT_EQ(stage(20, 3, 4, 1, 2), "sensor");       // it wanders: the dark frames had their own time
  EXPECT_EQ(stage(20, 3, 4, 1, 15, 12), "sensor");  // some frames only
  EXPECT_EQ(stage(20, 3, 4, 12, 15), "sensor");
}

TEST(Stages, AllLightThatChangesAlikeIsTheSensors) {
  const std::vector<StatisticDeclaration> frames = {
      {"light.frames.level.variance", "frame_means", "time", "dark pixels", false},
      {"light.frames.noise.variance", "frame_means", "time", "whole frame", false},
      {"light.sites.common.variance", "brightness_series", "time", "occupied sites", false},
      {"dark.frames.level.variance", "frame_means", "time", "dark pixels", true}};
  const auto stage = [&](double level, double noise, double sites) {
    return stage_of_differences(frames, Eigen::Vector4d(level, noise, sites, 1), {});
  };
  EXPECT_EQ(stage(42, 19, 23), "sensor");
  EXPECT_EQ(stage(42, 19, 4), "optics");   // the light behind the sites
  EXPECT_NE(stage(42, 19, 80), "sensor");  // the atoms' own, which reaches far
}

TEST(Stages, LittleLightThatDriftsAsTheSitesDoIsTheSensors) {
  const std::vector<StatisticDeclaration> series = {
      {"light.sites.common.trend", "brightness_series", "time", "occupied sites", false},
      {"light.frames.linear_level.trend", "frame_means", "time", "dark pixels", false},
      {"light.sites.common.variance", "brightness_series", "time", "occupied sites", false},
      {"light.frames.linear_level.variance", "frame_means", "time", "dark pixels", false},
      {"dark.frames.level.trend", "frame_means", "time", "dark pixels", true},
      {"light.sites.peak.variance", "site_histogram", "intensity", "occupied sites", false},
      {"light.sites.common.peak", "brightness_series", "time", "occupied sites", false}};
  const auto stage = [&](double sites, double level, double sites_vary, double level_varies, double darks = 0,
                         double histogram = 0) {
    Eigen::VectorXd z(7);
    z << sites, level, sites_vary, level_varies, darks, histogram, std::fabs(sites);
    return stage_of_differences(series, z, {});
  };
  EXPECT_EQ(stage(7.6, 6.1, 0, 0), "sensor");
  EXPECT_EQ(stage(-7.6, -6.1, 0, 0), "sensor");
  EXPECT_EQ(stage(7.6, -6.1, 0, 0), "scene");
  EXPECT_EQ(stage(20, 6.1, 0, 0), "scene");  // what of the sites' light falls between them
  EXPECT_EQ(stage(7.6, 0, 9.1, 10.8), "sensor");
  EXPECT_EQ(stage(7.6, 0, 20, 10.8), "scene");
  EXPECT_EQ(stage(7.6, 6.1, 0, 0, 0, 30), "scene");
}

TEST(Stages, NoiseThatVariesWithTheSitesLightAndNoLevelIsOfTheGain) {
  const std::vector<StatisticDeclaration> frames = {
      {"light.sites.common.variance", "brightness_series", "time", "occupied sites", false},
      {"light.frames.noise.variance", "frame_means", "time", "dark pixels", false},
      {"light.frames.level.variance", "frame_means", "time", "dark pixels", false}};
  const auto stage = [&](double sites, double noise, double level) {
    return stage_of_differences(frames, Eigen::Vector3d(sites, noise, level), {});
  };
  EXPECT_EQ(stage(24, 7, 0.6), "sensor");
  EXPECT_EQ(stage(9, 4.8, 0.6), "sensor");
  EXPECT_EQ(stage(24, 2, 0.6), "scene");
}

TEST(Stages, ALevelThatDriftsWithItsNoiseIsTheLights) {
  const std::vector<StatisticDeclaration> frames = {
      {"light.frames.level.trend", "frame_means", "time", "dark pixels", false},
      {"light.frames.noise.trend", "frame_means", "time", "whole frame", false},
      {"dark.frames.level.trend", "frame_means", "time", "dark pixels", true}};
  const auto stage = [&](double level, double noise, double darks) {
    return stage_of_differences(frames, Eigen::Vector3d(level, noise, darks), {});
  };
  EXPECT_EQ(stage(11, 4.4, 1), "optics");
  EXPECT_EQ(stage(-11, -4.4, 1), "optics");
  EXPECT_EQ(stage(11, -4.4, 1), "sensor");  // more counts with less noise
  EXPECT_EQ(stage(11, 2, 1), "sensor");
  EXPECT_EQ(stage(11, 4.4, 6), "sensor");
}

TEST(Stages, SitesThatFlickerAlongTheirRowsSayThatTheLightDoes) {
  const std::vector<StatisticDeclaration> rows = {
      {"light.lines.rows.next", "row_means", "time", "rows", false},
      {"light.sites.pairs.light_rows", "site_correlation", "site", "occupied sites", false},
      {"light.readout_spectrum.peak_along_columns", "row_spectrum", "frequency", "whole frame", false},
      {"dark.lines.rows.next", "row_means", "time", "rows", true}};
  const auto stage = [&](double lines, double sites, double darks) {
    return stage_of_differences(rows, Eigen::Vector4d(lines, sites, 7, darks), {});
  };
  EXPECT_EQ(stage(6.5, 7.4, 1), "optics");
  EXPECT_EQ(stage(6.5, 2, 1), "sensor");
  EXPECT_EQ(stage(6.5, 7.4, 5), "sensor");
}

TEST(Stages, NoiseBelowTheLightsOwnIsTheSensors) {
  const std::vector<StatisticDeclaration> calm = {
      {"light.image_noise.occupied.core", "mean_variance_curve", "intensity", "occupied sites", false},
      {"light.sites.peak.variance_within_sites", "site_histogram", "intensity", "occupied sites", false},
      {"light.sites.peak.variance", "site_histogram", "intensity", "occupied sites", false}};
  const auto stage = [&](double images, double sums) {
    return stage_of_differences(calm, Eigen::Vector3d(images, sums, -19), {});
  };
  EXPECT_EQ(stage(-12, -19), "sensor");
  EXPECT_EQ(stage(-8, -19), "scene");  // hardly so in the images
  EXPECT_EQ(stage(-12, 19), "scene");
}

TEST(Stages, OnePixelThatAnswersOtherwiseIsTheSensors) {
  const std::vector<StatisticDeclaration> sites = {
      {"light.point_spread.pixels.loneliest", "mean_variance_curve", "space", "around sites", false},
      {"light.sites.by_site.lowest", "site_brightness", "site", "occupied sites", false},
      {"light.sites.by_site.spread", "site_brightness", "site", "occupied sites", false}};
  const auto stage = [&](double pixel) {
    return stage_of_differences(sites, Eigen::Vector3d(pixel, -19, 15), {});
  };
  EXPECT_EQ(stage(9), "sensor");
  EXPECT_EQ(stage(5), "scene");
}

TEST(Stages, PixelsThatDoNotSeeTheLightAreTheSensors) {
  const std::vector<StatisticDeclaration> pixels = {
      {"light.temporal_maps.quiet", "variance_map", "space", "whole frame", false},
      {"light.static_offsets.lowest", "mean_map", "space", "whole frame", false}};
  const auto stage = [&](double quiet, double lowest) {
    return stage_of_differences(pixels, Eigen::Vector2d(quiet, lowest), {});
  };
  EXPECT_EQ(stage(15, 12), "sensor");
  EXPECT_EQ(stage(15, 40), "optics");  // something far darker than that
  EXPECT_EQ(stage(5, 8), "optics");    // hardly any
}

TEST(Stages, ColumnsOfOtherNoiseAreTheSensors) {
  const std::vector<StatisticDeclaration> columns = {
      {"light.temporal_maps.columns", "variance_map", "space", "columns", false},
      {"light.temporal_maps.gradient_x", "variance_map", "space", "whole frame", false},
      {"light.sites.by_site.spread", "site_brightness", "site", "occupied sites", false},
      {"light.sites.by_site.few_waves", "site_brightness", "site", "occupied sites", false}};
  const auto stage = [&](double noise, double slope, double sites) {
    return stage_of_differences(columns, Eigen::Vector4d(noise, slope, sites, sites), {});
  };
  EXPECT_EQ(stage(18, 3, 17), "sensor");
  EXPECT_EQ(stage(18, 3, 21), "sensor");
  EXPECT_EQ(stage(18, 14, 17), "scene");  // the light slopes
  EXPECT_EQ(stage(18, 3, 25), "scene");   // as sites differ
}

TEST(Stages, AMeanThatIsUnevenInLightOnlyIsOfTheOptics) {
  const std::vector<StatisticDeclaration> mean = {
      {"light.static_offsets.saddle", "mean_map", "space", "whole frame", false},
      {"light.readout_spectrum.peak_along_rows", "row_spectrum", "frequency", "whole frame", false},
      {"light.readout_spectrum.peak_along_columns", "row_spectrum", "frequency", "whole frame", false},
      {"dark.static_offsets.saddle", "mean_map", "space", "whole frame", true}};
  const auto stage = [&](double saddle, double lines, double darks) {
    return stage_of_differences(mean, Eigen::Vector4d(saddle, lines, lines, darks), {});
  };
  EXPECT_EQ(stage(-73, 17, 1), "optics");
  EXPECT_EQ(stage(-12, 17, 1), "sensor");
  EXPECT_EQ(stage(-73, 17, -60), "sensor");
}

TEST(Stages, ACommonPositionThatVariesMostIsOfTheOptics) {
  const std::vector<StatisticDeclaration> moving = {
      {"light.position.x.variance", "centroid_series", "time", "all sites", false},
      {"light.image_noise.occupied.core", "mean_variance_curve", "intensity", "occupied sites", false},
      {"light.neighbours.all.right_1", "horizontal_correlation", "space", "whole frame", false},
      {"light.neighbours.all.down_1", "vertical_correlation", "space", "whole frame", false}};
  const auto stage = [&](double position, double noise) {
    return stage_of_differences(moving, Eigen::Vector4d(position, noise, 13, 16), {});
  };
  EXPECT_EQ(stage(63, 50), "optics");
  EXPECT_EQ(stage(40, 50), "sensor");  // noise that pixels have by themselves
}

TEST(Stages, ImagesThatMoveAreTheAtomsOrTheOptics) {
  const std::vector<StatisticDeclaration> images = {
      {"light.image_noise.occupied.core", "mean_variance_curve", "intensity", "occupied sites", false},
      {"light.neighbours.all.right_1", "horizontal_correlation", "space", "all pixels", false},
      {"light.neighbours.all.down_1", "vertical_correlation", "space", "all pixels", false},
      {"light.neighbours.dark.right_1", "horizontal_correlation", "space", "dark pixels", false},
      {"light.position.x.variance", "centroid_series", "time", "all sites", false}};
  const auto stage = [&](double noise, double neighbours, double dark, double position) {
    return stage_of_differences(images,
                                Eigen::Vector<double, 5>(noise, neighbours, -neighbours, dark, position), {});
  };
  EXPECT_EQ(stage(50, 51, 13, 28), "scene");    // each atom on its own
  EXPECT_EQ(stage(65, 11.7, 3, 17), "scene");   // slowly: few pixels go together, the mean moves along
  EXPECT_EQ(stage(65, 11.7, 3, 5), "sensor");   // or stays
  EXPECT_EQ(stage(50, 51, 13, 80), "optics");   // all together
  EXPECT_EQ(stage(50, 51, 13, 5), "optics");    // about their middle
  EXPECT_EQ(stage(50, 51, 40, 28), "sensor");   // where no light is, too
  EXPECT_EQ(stage(-50, 51, 13, 28), "sensor");  // charge that spreads: less noise
}

TEST(Stages, LightFarFromTheSitesIsOfTheOptics) {
  const std::vector<StatisticDeclaration> halo = {
      {"light.far_light.halo.far", "point_spread_halo", "space", "far from sites", false},
      {"light.temporal_maps.largest", "variance_map", "space", "whole frame", false},
      {"light.temporal_maps.noisy", "variance_map", "space", "whole frame", false}};
  const auto stage = [&](double far) { return stage_of_differences(halo, Eigen::Vector3d(far, 40, 40), {}); };
  EXPECT_EQ(stage(-87), "optics");
  EXPECT_EQ(stage(-30), "sensor");
}

TEST(Stages, PatternsThatMoveInLightOnlyAreOfTheLight) {
  const std::vector<StatisticDeclaration> waves = {
      {"light.neighbours.dark.right_1", "horizontal_correlation", "space", "dark pixels", false},
      {"light.neighbours.dark.right_3", "horizontal_correlation", "space", "dark pixels", false},
      {"light.neighbours.dark.down_3", "vertical_correlation", "space", "dark pixels", false},
      {"dark.neighbours.dark.right_3", "horizontal_correlation", "space", "dark pixels", true}};
  const auto stage = [&](double near, double right, double down, double darks) {
    return stage_of_differences(waves, Eigen::Vector4d(near, right, down, darks), {});
  };
  EXPECT_EQ(stage(100, 90, 95, 1), "optics");
  EXPECT_EQ(stage(100, 90, 95, 90), "sensor");  // also with the shutter closed
  EXPECT_EQ(stage(100, 10, 10, 1), "sensor");   // charge that leaks
  EXPECT_EQ(stage(100, 90, 10, 1), "sensor");   // and trails
}

TEST(Stages, ChargeThatGathersInLightOnlyIsAtoms) {
  const std::vector<StatisticDeclaration> charge = {
      {"light.clusters.charge", "bright_clusters", "space", "whole frame", false},
      {"light.neighbours.all.down_2", "vertical_correlation", "space", "all pixels", false},
      {"dark.clusters.charge", "bright_clusters", "space", "whole frame", true},
      {"light.position.x.variance", "centroid_series", "time", "all sites", false}};
  const auto stage = [&](double light, double neighbours, double darks, double position = 0) {
    return stage_of_differences(charge, Eigen::Vector4d(light, neighbours, darks, position), {});
  };
  EXPECT_EQ(stage(90, 40, 1), "scene");
  EXPECT_EQ(stage(90, 40, 30), "sensor");  // radiation
  EXPECT_EQ(stage(20, 60, 1), "sensor");
  EXPECT_NE(stage(90, 40, 1, 50), "scene");  // an image that moves
}

TEST(Stages, LightThatComesAndGoesBetweenTheSitesIsAtoms) {
  const std::vector<StatisticDeclaration> between = {
      {"light.temporal_maps.by_light.2", "mean_variance_curve", "intensity", "whole frame", false},
      {"light.neighbours.dark.right_1", "horizontal_correlation", "space", "dark pixels", false},
      {"light.neighbours.dark.down_1", "vertical_correlation", "space", "dark pixels", false},
      {"dark.neighbours.dark.down_1", "vertical_correlation", "space", "dark pixels", true}};
  const auto stage = [&](double noise, double right, double down, double darks) {
    return stage_of_differences(between, Eigen::Vector4d(noise, right, down, darks), {});
  };
  EXPECT_EQ(stage(37, 21, 20, 1), "scene");
  EXPECT_EQ(stage(-37, 21, 20, 1), "sensor");
  EXPECT_EQ(stage(37, 21, 4, 1), "sensor");  // a trail
  EXPECT_EQ(stage(37, 21, 20, 15), "sensor");
  EXPECT_EQ(stage(18, 21, 20, 1), "sensor");
}

TEST(Stages, SitesThatLoadUnevenlyAreTheScenes) {
  const std::vector<StatisticDeclaration> filling = {
      {"light.sites.filling_by_site.spread", "site_histogram", "site", "all sites", false},
      {"light.temporal_maps.gradient_y", "variance_map", "space", "whole frame", false},
      {"light.temporal_maps.quiet", "variance_map", "space", "whole frame", false},
      {"light.temporal_maps.variance_spread", "variance_map", "space", "whole frame", false}};
  const auto stage = [&](double spread, double noise) {
    return stage_of_differences(filling, Eigen::Vector4d(spread, noise, noise, noise), {});
  };
  EXPECT_EQ(stage(15, 13), "scene");
  EXPECT_EQ(stage(15, 20), "sensor");  // not the foremost
  EXPECT_EQ(stage(7, 7.5), "sensor");
}

TEST(Stages, SitesThatLoadTogetherAreTheScenesThoughTheNoiseSlopesWithThem) {
  const std::vector<StatisticDeclaration> loading = {
      {"light.sites.pairs.occupancy_near", "neighbour_exchange", "site", "all sites", false},
      {"light.temporal_maps.radial", "variance_map", "space", "whole frame", false},
      {"dark.temporal_maps.radial", "variance_map", "space", "whole frame", true}};
  EXPECT_EQ(stage_of_differences(loading, Eigen::Vector3d(16, -15, 1), {}), "scene");
  EXPECT_EQ(stage_of_differences(loading, Eigen::Vector3d(9.1, -10.4, 1), {}), "scene");
  EXPECT_EQ(stage_of_differences(loading, Eigen::Vector3d(12, -15, 1), {}), "optics");
}

TEST(Stages, SitesThatLoadLessThanOthersAreTheScenesThoughTheNoiseDiffersWithThem) {
  const std::vector<StatisticDeclaration> loading = {
      {"light.sites.filling_by_site.spread", "site_histogram", "site", "all sites", false},
      {"light.temporal_maps.gradient_y", "variance_map", "space", "whole frame", false},
      {"light.temporal_maps.left_right", "variance_map", "space", "whole frame", false},
      {"light.static_charge.left_right", "mean_map", "space", "whole frame", false}};
  const auto stage = [&](double filling, double slope, double halves, double mean) {
    return stage_of_differences(loading, Eigen::Vector4d(filling, slope, halves, mean), {});
  };
  EXPECT_EQ(stage(8.6, 11.3, -9.9, 3), "scene");
  EXPECT_EQ(stage(8.6, 6, -19, 3), "sensor");
  EXPECT_EQ(stage(7, 6, -19, 3), "sensor");
  EXPECT_EQ(stage(8.6, 11.3, -9.9, 20), "sensor");
}

TEST(Stages, SitesThatLoadEverLessAreTheScenes) {
  const std::vector<StatisticDeclaration> frames = {
      {"light.sites.loading.trend", "site_histogram", "time", "all sites", false},
      {"light.frames.level.trend", "frame_means", "time", "dark pixels", false},
      {"light.frames.noise.trend", "frame_means", "time", "whole frame", false}};
  const auto stage = [&](double loading, double level, double noise) {
    Eigen::VectorXd z(3);
    z << loading, level, noise;
    return stage_of_differences(frames, z, {});
  };
  EXPECT_EQ(stage(-4.9, -4.8, -4.6), "scene");  // and with them the light beside the sites
  EXPECT_EQ(stage(-3.6, -4.8, -4.6), "sensor");
}

TEST(Stages, EmptySitesThatGlowAndNothingElseAreOfTheOptics) {
  const std::vector<StatisticDeclaration> sites = {
      {"light.sites.empty.mean", "site_brightness", "intensity", "all sites", false},
      {"light.sites.histogram.p00", "site_histogram", "intensity", "all sites", false},
      {"light.sites.partial", "site_histogram", "intensity", "all sites", false},
      {"light.sites.memory.afterglow", "lag_correlation", "time", "all sites", false},
      {"light.pixel_histogram.tail_fill", "pixel_histogram", "intensity", "dark pixels", false},
      {"light.image_noise.empty.core", "mean_variance_curve", "intensity", "empty sites", false},
      {"light.frames.level.first_frames", "frame_means", "time", "dark pixels", false},
      {"light.sites.memory.foreglow", "lag_correlation", "time", "all sites", false},
      {"light.frames.alike", "lag_correlation", "time", "whole frame", false},
      {"light.sites.common.first_frames", "brightness_series", "time", "occupied sites", false},
      {"light.sites.memory.persistence", "lag_correlation", "time", "all sites", false},
      {"light.sites.empty.variance", "site_histogram", "intensity", "all sites", false}};
  const auto stage = [&](double empty, double partial, double afterglow = 0, double first_frames = 0,
                         double foreglow = 0, double alike = 0, double sites_first = 0,
                         double persistence = 0, double empty_variance = 0) {
    Eigen::VectorXd z(12);
    z << empty, 15, partial, afterglow, 3, 8, first_frames, foreglow, alike, sites_first, persistence,
        empty_variance;
    return stage_of_differences(sites, z, {});
  };
  EXPECT_EQ(stage(11, -3.5), "optics");
  EXPECT_EQ(stage(30, -3.5, 8), "sensor");      // that remembers where atoms were
  EXPECT_EQ(stage(21, -3.5, 0, -4), "sensor");  // for so long that the stack begins darker
  EXPECT_EQ(stage(48, -11, 0, 0, 0, 0, -4), "sensor");
  EXPECT_EQ(stage(48, -11, 0, 0, 0, 0, 4), "optics");
  EXPECT_EQ(stage(30, -3.5, 0, 0, 8, 13), "sensor");           // or has not read where they are next
  EXPECT_EQ(stage(17, -3.5, 0, 0, 0, 0, 0, 9, 11), "sensor");  // or remembers where they were for long
  EXPECT_EQ(stage(17, -3.5, 0, 0, 0, 0, 0, 3, 11), "scene");
  EXPECT_EQ(stage(11, 6), "scene");  // atoms that leave before the end
  EXPECT_EQ(stage(-11, 1), "scene");
  EXPECT_EQ(stage(7, 1), "scene");
}

TEST(Stages, PixelsThatGoTogetherWithTheShutterClosedAreTheSensors) {
  const std::vector<StatisticDeclaration> pixels = {
      {"light.neighbours.dark.right_1", "horizontal_correlation", "space", "dark pixels", false},
      {"dark.neighbours.dark.right_1", "horizontal_correlation", "space", "dark pixels", true},
      {"light.point_spread.misfit.wing", "point_spread_width", "shape", "all sites", false},
      {"light.point_spread.width_x.spread", "point_spread_field", "shape", "all sites", false},
      {"light.point_spread.width_y.spread", "point_spread_field", "shape", "all sites", false}};
  const auto stage = [&](double light, double dark) {
    Eigen::VectorXd z(5);
    z << light, dark, 25, 20, 20;
    return stage_of_differences(pixels, z, {});
  };
  EXPECT_EQ(stage(22, 12), "sensor");
  EXPECT_EQ(stage(-22, -12), "sensor");
  EXPECT_EQ(stage(22, 3), "optics");
  EXPECT_EQ(stage(22, -12), "optics");  // calibration makes up for something
}

TEST(Stages, LightAboveAndBelowSitesIsTheSensors) {
  const std::vector<StatisticDeclaration> columns = {
      {"light.far_light.down", "column_smear", "space", "columns", false},
      {"light.static_offsets.peak_oblique", "mean_map", "frequency", "whole frame", false},
      {"light.static_offsets.saddle", "mean_map", "space", "whole frame", false},
      {"light.far_light.ghost.shifted", "point_spread_halo", "space", "whole frame", false}};
  const auto stage = [&](double smear, double pattern) {
    return stage_of_differences(columns, Eigen::Vector4d(smear, pattern, -pattern, pattern), {});
  };
  EXPECT_EQ(stage(9, 8), "sensor");
  EXPECT_EQ(stage(9, 12), "optics");  // not the foremost
  EXPECT_EQ(stage(7, 6), "optics");
}

TEST(Stages, LightBesideImagesAndNoneBeyondIsASecondImage) {
  std::vector<StatisticDeclaration> sides;
  for (const char* distance : {"2", "3", "4"})
    sides.push_back({std::string("light.point_spread.down_against_up.") + distance, "trailing_charge",
                     "shape", "around sites", false});
  EXPECT_EQ(stage_of_differences(sides, Eigen::Vector3d(17, -4.5, -5.5), {}), "optics");
  EXPECT_EQ(stage_of_differences(sides, Eigen::Vector3d(-17, 4.5, 5.5), {}), "optics");
  EXPECT_EQ(stage_of_differences(sides, Eigen::Vector3d(17, 4.5, -5.5), {}), "sensor");
  EXPECT_EQ(stage_of_differences(sides, Eigen::Vector3d(11, 3, 4), {}), "sensor");  // a trail
}

TEST(Stages, AWaveAcrossTheMeanInLightOnlyIsOfTheOptics) {
  const std::vector<StatisticDeclaration> waves = {
      {"light.sites.by_site.highest", "site_brightness", "site", "occupied sites", false},
      {"light.sites.by_site.spread", "site_brightness", "site", "occupied sites", false},
      {"light.static_offsets.peak_oblique", "mean_map", "frequency", "whole frame", false},
      {"dark.static_offsets.peak_oblique", "mean_map", "frequency", "whole frame", true}};
  const auto stage = [&](double sites, double wave, double darks) {
    return stage_of_differences(waves, Eigen::Vector4d(sites, sites, wave, darks), {});
  };
  EXPECT_EQ(stage(9, 8, 2), "optics");
  EXPECT_EQ(stage(20, 8, 2), "optics");
  EXPECT_EQ(stage(30, 8, 2), "scene");  // the sites' brightness is far odder
  EXPECT_EQ(stage(7, 5.8, 2), "scene");
  EXPECT_EQ(stage(9, 8, 8), "sensor");  // also with the shutter closed
}

TEST(Stages, PixelsThatDifferFromTheirNeighboursInLightOnlyAreTheSensors) {
  const std::vector<StatisticDeclaration> pixels = {
      {"light.static_charge.spread", "mean_map", "space", "whole frame", false},
      {"light.point_spread.misfit.wing", "point_spread_width", "shape", "all sites", false},
      {"light.static_offsets.neighbours.down_1", "mean_map", "space", "whole frame", false},
      {"dark.static_charge.spread", "mean_map", "space", "whole frame", true},
      {"light.static_offsets.high", "mean_map", "frequency", "whole frame", false}};
  const auto stage = [&](double spread, double images, double neighbours, double darks, double high = 1) {
    return stage_of_differences(pixels, Eigen::Vector<double, 5>(spread, images, neighbours, darks, high),
                                {});
  };
  EXPECT_EQ(stage(15, 20, 1, -4), "sensor");
  EXPECT_EQ(stage(27, 29, -7, 0), "sensor");
  EXPECT_EQ(stage(27, 29, 15, 0), "optics");       // a pattern of light
  EXPECT_EQ(stage(27, 29, -7, 0, -14), "optics");  // with no waves as fine as pixels
  EXPECT_EQ(stage(27, 48, 1, 0), "optics");        // images of another shape fall on them
  EXPECT_EQ(stage(9, 29, 1, 0), "optics");         // the images are far odder
}

// What varies in the light is taken for offsets of pixels: of too few then with the shutter open, of too many
// with it closed.
TEST(Stages, DarkFramesThatMakeUpForTheLightSayNothing) {
  const std::vector<StatisticDeclaration> maps = {
      {"light.static_offsets.spread", "mean_map", "space", "whole frame", false},
      {"light.static_offsets.peak_oblique", "mean_map", "frequency", "whole frame", false},
      {"dark.static_offsets.spread", "mean_map", "space", "whole frame", true}};
  const auto stage = [&](double light, double darks) {
    return stage_of_differences(maps, Eigen::Vector3d(light, 31, darks), {});
  };
  EXPECT_EQ(stage(7, -9), "optics");
  EXPECT_EQ(stage(7, 9), "sensor");
  EXPECT_EQ(stage(2, -9), "sensor");
}

TEST(Stages, ImagesThatStrongSmearWidensAreTheSensors) {
  const std::vector<StatisticDeclaration> columns = {
      {"light.point_spread.width_y.mean", "point_spread_width", "shape", "all sites", false},
      {"light.far_light.up", "column_smear", "space", "columns", false},
      {"light.far_light.down", "column_smear", "space", "columns", false},
      {"light.far_light.left", "trailing_charge", "space", "rows", false},
      {"light.static_offsets.saddle", "mean_map", "space", "whole frame", false}};
  const auto stage = [&](double up, double down, double left) {
    return stage_of_differences(columns, Eigen::Vector<double, 5>(57, up, down, left, 18), {});
  };
  EXPECT_EQ(stage(20, 17, 1), "sensor");
  EXPECT_EQ(stage(20, 1, 1), "optics");    // on one side only
  EXPECT_EQ(stage(20, 17, 15), "optics");  // a halo
  EXPECT_EQ(stage(12, 11, 1), "optics");   // the images' shape is far odder
}

TEST(Stages, LightThatLeavesTheImagesForWhatIsAroundThemIsOfTheOptics) {
  const std::vector<StatisticDeclaration> series = {
      {"light.sites.common.trend", "brightness_series", "time", "occupied sites", false},
      {"light.frames.level_against_light", "point_spread_halo", "intensity", "dark pixels", false},
      {"light.temporal_maps.by_light.4", "variance_map", "intensity", "whole frame", false}};
  const auto stage = [&](double sites, double level_against_light, double noise) {
    return stage_of_differences(series, Eigen::Vector3d(sites, level_against_light, noise), {});
  };
  EXPECT_EQ(stage(-12, -5.2, 18), "optics");
  EXPECT_EQ(stage(-12, 5.2, 5), "scene");    // the atoms shine less, all around
  EXPECT_EQ(stage(-12, -3, 5), "scene");     // chance
  EXPECT_EQ(stage(-5, -5.2, 60), "sensor");  // hardly any of it is the sites' light
}

TEST(Stages, ALevelThatRisesWhileTheSitesFadeIsOfTheOptics) {
  const std::vector<StatisticDeclaration> series = {
      {"light.sites.common.trend", "brightness_series", "time", "occupied sites", false},
      {"light.frames.level.trend", "frame_means", "time", "dark pixels", false},
      {"light.frames.noise.trend", "frame_means", "time", "dark pixels", false},
      {"dark.frames.level.trend", "frame_means", "time", "dark pixels", true}};
  const auto stage = [&](double sites, double level, double noise) {
    return stage_of_differences(series, Eigen::Vector4d(sites, level, noise, 0), {});
  };
  EXPECT_EQ(stage(-10, 9.6, 5.6), "optics");
  EXPECT_EQ(stage(10, 9.6, 5.6), "sensor");  // all light alike: what turns it into counts
}

TEST(Stages, ImagesThatAreDisplacedButNoWiderAreOfAtomsElsewhere) {
  const std::vector<StatisticDeclaration> images = {
      {"light.point_spread.x.spread", "point_spread_field", "shape", "all sites", false},
      {"light.point_spread.width_x.spread", "point_spread_field", "shape", "all sites", false},
      {"light.position.x.variance", "centroid_series", "time", "all sites", false},
      {"light.point_spread.y.smooth", "point_spread_field", "shape", "all sites", false}};
  const auto stage = [&](double displaced, double wider, double moving, double together = 0) {
    return stage_of_differences(images, Eigen::Vector4d(displaced, wider, moving, together), {});
  };
  EXPECT_EQ(stage(10, 4.5, 2), "scene");
  EXPECT_EQ(stage(7, 4, 2), "scene");
  EXPECT_EQ(stage(10, 9, 2), "optics");
  EXPECT_EQ(stage(10, 4.5, 20), "optics");    // an image that moves
  EXPECT_EQ(stage(10, 4.5, 2, 5), "optics");  // a lens that distorts
}

TEST(Stages, ImagesOfAnotherShapeAreOfTheOptics) {
  const std::vector<StatisticDeclaration> images = {
      {"light.point_spread.ring.4", "point_spread_halo", "shape", "around sites", false},
      {"light.image_noise.empty.core", "mean_variance_curve", "intensity", "empty sites", false},
      {"light.image_noise.empty.wing", "mean_variance_curve", "intensity", "empty sites", false},
      {"light.point_spread.right_against_left.2", "trailing_charge", "shape", "around sites", false}};
  const auto stage = [&](double shape, double noise, double trail) {
    return stage_of_differences(images, Eigen::Vector4d(shape, noise, noise, trail), {});
  };
  EXPECT_EQ(stage(60, 35, 1), "optics");
  EXPECT_EQ(stage(60, 35, 50), "sensor");  // charge that trails
  EXPECT_EQ(stage(12, 7, 1), "sensor");    // crosstalk also does so much
  EXPECT_EQ(stage(60, 140, 1), "optics");  // much light that far out: its noise comes with it
  EXPECT_EQ(stage(60, 160, 1), "sensor");
  EXPECT_EQ(stage(-60, 140, 1), "sensor");  // none is missing where hardly any is
}

TEST(Stages, ImagesThatChangeTogetherFromFrameToFrameAreOfTheOptics) {
  const std::vector<StatisticDeclaration> images = {
      {"light.point_spread.misfit.wing", "point_spread_width", "shape", "all sites", false},
      {"light.neighbours.all.right_1", "horizontal_correlation", "space", "whole frame", false},
      {"light.neighbours.all.right_2", "horizontal_correlation", "space", "whole frame", false},
      {"light.neighbours.all.down_1", "vertical_correlation", "space", "whole frame", false},
      {"light.neighbours.all.down_2", "vertical_correlation", "space", "whole frame", false},
      {"light.neighbours.dark.right_1", "horizontal_correlation", "space", "dark pixels", false},
      {"light.sites.common.variance", "brightness_series", "time", "occupied sites", false}};
  const auto stage = [&](double shape, double next, double far, double dark, double common) {
    Eigen::VectorXd z(7);
    z << shape, next, far, next, far, dark, common;
    return stage_of_differences(images, z, {});
  };
  EXPECT_EQ(stage(130, 110, 90, 4, 35), "optics");
  EXPECT_EQ(stage(130, 110, 30, 4, 35), "sensor");  // charge that goes to the next pixel
  EXPECT_EQ(stage(130, 110, 90, 60, 35), "sensor");
  EXPECT_EQ(stage(130, 110, 90, 4, 2), "sensor");  // not all at once
}

TEST(Stages, BrightnessFollowsAShapeThatIsOdderStill) {
  const std::vector<StatisticDeclaration> images = {
      {"light.point_spread.ring.2", "point_spread_halo", "shape", "around sites", false},
      {"light.sites.common.variance", "brightness_series", "time", "occupied sites", false},
      {"light.sites.common.steps", "brightness_series", "time", "occupied sites", false},
      {"light.sites.peak.variance", "site_histogram", "intensity", "occupied sites", false},
      {"light.point_spread.columns.response_variance", "column_means", "space", "columns", false},
      {"light.neighbours.all.right_1", "horizontal_correlation", "space", "all pixels", false}};
  const auto stage = [&](double shape, double brightness, double lines, double neighbours) {
    return stage_of_differences(
        images, Eigen::Vector<double, 6>(shape, brightness, brightness, brightness, lines, neighbours), {});
  };
  EXPECT_EQ(stage(-32, 27, 26, 10), "optics");
  EXPECT_EQ(stage(-32, 40, 26, 10), "scene");
  EXPECT_NE(stage(-32, 27, 26, 30), "optics");  // charge that spreads
}

TEST(Stages, BrightnessThatSlopesWithTheWidthOfImagesIsOfTheOptics) {
  const std::vector<StatisticDeclaration> field = {
      {"light.sites.by_site.gradient_y", "site_brightness", "site", "occupied sites", false},
      {"light.point_spread.width_y.along_y", "point_spread_field", "shape", "all sites", false}};
  EXPECT_EQ(stage_of_differences(field, Eigen::Vector2d(7, -5), {}), "optics");
  EXPECT_EQ(stage_of_differences(field, Eigen::Vector2d(7, -4), {}), "scene");
}

TEST(Stages, NoiseThatLightBringsAlongCountsLessThanTheLight) {
  const std::vector<StatisticDeclaration> noise = {
      {"light.temporal_maps.variance", "variance_map", "space", "whole frame", false},
      {"light.far_light.halo.near", "point_spread_halo", "shape", "around sites", false},
      {"dark.temporal_maps.variance", "variance_map", "space", "whole frame", true}};
  EXPECT_EQ(stage_of_differences(noise, Eigen::Vector3d(7, 6, 1), {}), "optics");
  EXPECT_EQ(stage_of_differences(noise, Eigen::Vector3d(7, 6, 6), {}), "sensor");
}

TEST(Stages, AnEffectSpeaksForItsStageAsFarAsItExplains) {
  Hypothesis one;
  one.effects = {"site_brightness_spread"};
  one.log_evidence = 50;
  one.share = 0.09;
  EXPECT_EQ(stage_at(0, 20, 0, 0, {one}), "sensor");
  one.share = 0.9;
  EXPECT_EQ(stage_at(0, 20, 0, 0, {one}), "scene");
  Hypothesis judged = one;
  judged.not_seen = true;
  EXPECT_EQ(stage_at(0, 20, 0, 0, {one, judged}), "sensor");
}

TEST(Stages, ManyEffectsThatComeAsCloseSpeakNoLouder) {
  std::vector<Hypothesis> list;
  for (const char* name : {"pixel_response_nonuniformity", "etaloning_fringes", "stray_light_gradient",
                           "vignetting", "field_tilt_defocus", "etaloning_fringes"}) {
    Hypothesis one;
    one.effects = {name};
    one.log_evidence = 80;
    one.share = 0.3;
    list.push_back(one);
  }
  EXPECT_EQ(stage_at(0, 20, 0, 0, list), "sensor");
}

TEST(Stages, ImagesThatGetWiderButHaveTooLittleNoiseAreTheSensors) {
  const std::vector<StatisticDeclaration> images = {
      {"light.point_spread.ring.1", "point_spread_halo", "shape", "around sites", false},
      {"light.image_noise.occupied.core", "mean_variance_curve", "intensity", "occupied sites", false},
      {"light.temporal_maps.by_light.5", "mean_variance_curve", "intensity", "whole frame", false}};
  const auto stage = [&](double ring, double core, double pixels) {
    return stage_of_differences(images, Eigen::Vector3d(ring, core, pixels), {});
  };
  EXPECT_EQ(stage(25, -6.8, -7.0), "sensor");
  EXPECT_EQ(stage(25, -6.8, 0), "optics");
  EXPECT_EQ(stage(200, -6.8, -7.0), "optics");
}

TEST(Stages, NoiseAroundEmptySitesThatReachesAsFarAsImagesIsOfAtomsThere) {
  const std::vector<StatisticDeclaration> pixels = {
      {"light.neighbours.all.right_2", "horizontal_correlation", "space", "whole frame", false},
      {"light.neighbours.all.down_2", "vertical_correlation", "space", "whole frame", false},
      {"light.image_noise.empty.wing", "mean_variance_curve", "intensity", "occupied sites", false},
      {"light.image_noise.occupied.wing", "mean_variance_curve", "intensity", "occupied sites", false},
      {"dark.neighbours.dark.right_1", "horizontal_correlation", "space", "dark pixels", true}};
  const auto stage = [&](double empty, double occupied, double down = 60, double darks = 1) {
    Eigen::VectorXd z(5);
    z << 64, down, empty, occupied, darks;
    return stage_of_differences(pixels, z, {});
  };
  EXPECT_EQ(stage(35, 21), "scene");
  EXPECT_EQ(stage(21, 35), "sensor");
  EXPECT_EQ(stage(35, 21, 5), "sensor");
  EXPECT_EQ(stage(35, 21, 60, 6), "sensor");
}

}  // namespace
}  // namespace atomcam
