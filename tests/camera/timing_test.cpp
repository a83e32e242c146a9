// Readout times against the figures of the real cameras.

#include "camera/timing.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "fixtures.hpp"

namespace atomcam::test {
namespace {

double to_places(double value, int places) {
  return std::round(value * std::pow(10, places)) / std::pow(10, places);
}

CameraSettings ixon_settings() {
  return ixon_model().power_up;
}
constexpr Shape ixon_sensor{512, 512};

TEST(EmccdTiming, FullFrameAt17MHzIs56PerSecond) {
  EXPECT_EQ(to_places(1 / emccd_timing(ixon_sensor, ixon_settings(), 17e6).readout_s, 6), 56);
}

TEST(EmccdTiming, At17MHzIs60PercentFasterThanAt10MHz) {
  const double at_17 = emccd_timing(ixon_sensor, ixon_settings(), 17e6).readout_s;
  const double at_10 = emccd_timing(ixon_sensor, ixon_settings(), 10e6).readout_s;
  EXPECT_EQ(to_places(at_10 / at_17, 1), 1.6);
}

TEST(EmccdTiming, RowsOutsideTheRegionCostOneVerticalShift) {
  CameraSettings settings = ixon_settings();
  const double full = emccd_timing(ixon_sensor, settings, 17e6).readout_s;
  settings.region = {0, 100, 512, 511};
  const double less = emccd_timing(ixon_sensor, settings, 17e6).readout_s;
  const double row = (full - 512 * settings.vertical_shift_s) / 512;
  EXPECT_NEAR(full - less, row - settings.vertical_shift_s, 1e-15);
  settings.region = {0, 0, 512, 0};
  EXPECT_NEAR(emccd_timing(ixon_sensor, settings, 17e6).readout_s, 2 * 512 * settings.vertical_shift_s,
              1e-15);
}

TEST(EmccdTiming, NeitherWidthNorHorizontalBinningMatters) {
  CameraSettings settings = ixon_settings();
  const double full = emccd_timing(ixon_sensor, settings, 17e6).readout_s;
  settings.region.width = 64;
  EXPECT_EQ(emccd_timing(ixon_sensor, settings, 17e6).readout_s, full);
  settings.region.width = 512;
  settings.binning_x = 4;
  EXPECT_EQ(emccd_timing(ixon_sensor, settings, 17e6).readout_s, full);
}

TEST(EmccdTiming, VerticalBinningHalvesTheRowsButNotTheShifts) {
  CameraSettings settings = ixon_settings();
  const double full = emccd_timing(ixon_sensor, settings, 17e6).readout_s;
  settings.binning_y = 2;
  const double shifts = 2 * 512 * settings.vertical_shift_s;  // into storage, and out of it
  EXPECT_NEAR(emccd_timing(ixon_sensor, settings, 17e6).readout_s - shifts, (full - shifts) / 2, 1e-15);
}

TEST(EmccdTiming, FrameTransferOverlapsExposureAndReadout) {
  CameraSettings settings = ixon_settings();
  const FrameTiming overlapped = emccd_timing(ixon_sensor, settings, 17e6);
  EXPECT_EQ(overlapped.shortest_interval_s(0.08), 0.08);
  EXPECT_EQ(overlapped.shortest_interval_s(1e-3), overlapped.readout_s);
  settings.frame_transfer = false;
  const FrameTiming serial = emccd_timing(ixon_sensor, settings, 17e6);
  EXPECT_LT(serial.minimum_exposure_s, serial.readout_s);
  EXPECT_EQ(serial.shortest_interval_s(0.08), 0.08 + serial.readout_s);
}

TEST(QcmosTiming, FullFrameIsTheDataSheets) {
  const CameraSettings settings = orca_model().power_up;
  const FrameTiming standard = qcmos_timing(settings, ScanMode::standard);
  EXPECT_EQ(to_places(standard.readout_s, 9), 8.2944e-3);
  EXPECT_EQ(to_places(1 / standard.shortest_interval_s(1e-3), 2), 120.56);
  EXPECT_EQ(to_places(standard.minimum_exposure_s, 9), 7.2e-6);
  const FrameTiming quiet = qcmos_timing(settings, ScanMode::ultra_quiet);
  EXPECT_EQ(to_places(quiet.readout_s, 5), 0.19907);
  EXPECT_EQ(to_places(1 / quiet.shortest_interval_s(1e-3), 2), 5.02);
  EXPECT_EQ(to_places(quiet.minimum_exposure_s, 9), 172.8e-6);
}

TEST(QcmosTiming, OnlyTheHeightOfTheRegionMatters) {
  CameraSettings settings = orca_model().power_up;
  const double full = qcmos_timing(settings, ScanMode::standard).readout_s;
  settings.region.width = 256;
  settings.binning_x = settings.binning_y = 4;
  EXPECT_EQ(qcmos_timing(settings, ScanMode::standard).readout_s, full);
  settings.region.height = 2304 / 4;
  EXPECT_NEAR(qcmos_timing(settings, ScanMode::standard).readout_s, full / 4, 1e-15);
}

TEST(QcmosTiming, ExposuresAreWholeRowPairs) {
  const FrameTiming timing = qcmos_timing(orca_model().power_up, ScanMode::standard);
  for (const double asked : {1e-6, 7.2e-6, 10e-6, 11e-6, 1e-3, 0.5}) {
    const double made = timing.realised_exposure_s(asked);
    EXPECT_GE(made, timing.minimum_exposure_s);
    const double steps = made / timing.exposure_step_s;
    EXPECT_NEAR(steps, std::round(steps), 1e-9 * steps);
    if (asked >= timing.minimum_exposure_s) {
      EXPECT_LE(std::fabs(made - asked), timing.exposure_step_s / 2 * (1 + 1e-12));
    }
  }
}

}  // namespace
}  // namespace atomcam::test
