#include "simulation/simulation.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <numeric>

#include "base/error.hpp"

namespace atomcam {
namespace {

/// The preset's camera in front of a small field with a few atoms, no effects.
Lab small_lab(std::string_view name) {
  Lab lab = preset(name);
  lab.effects.clear();
  lab.settings.region = {100, 140, 64, 48};
  lab.settings.binning_x = lab.settings.binning_y = 1;
  lab.layout =
      std::vector<Site>{{110.3, 150.6, 1}, {131.5, 163.25, 1.5}, {150.1, 178.9, 1}, {151.6, 160.2, 1}};
  lab.scene.filling = 1;
  lab.scene.survival = 1;
  // A smaller sensor: its maps are drawn anew for every simulation.
  if (auto* qcmos = std::get_if<QcmosDescription>(&lab.sensor)) qcmos->shape = {1280, 512};
  lab.place_sites();
  return lab;
}

class BothCameras : public testing::TestWithParam<std::string> {};
INSTANTIATE_TEST_SUITE_P(Presets, BothCameras, testing::Values("ixon-ultra-897", "orca-quest"),
                         [](const auto& param) { return param.param == "orca-quest" ? "orca" : "ixon"; });

TEST_P(BothCameras, SameBitsOnAnyNumberOfThreadsAndInAnyOrder) {
  Lab lab = preset(GetParam());
  lab.settings.region = {128, 96, 256, 128};
  const Simulation simulation(lab);
  const Frame third = simulation.render(3, lab.settings, 1);
  const Frame first = simulation.render(1, lab.settings, 3);
  EXPECT_EQ(simulation.render(1, lab.settings, 1).counts, first.counts);
  EXPECT_EQ(simulation.render(3, lab.settings, 4).counts, third.counts);
  EXPECT_FALSE(first.counts == third.counts);
  EXPECT_EQ(Simulation(lab).render(3, lab.settings, 2).counts, third.counts);
  EXPECT_EQ(Simulation(lab).render(3, lab.settings, 2).truth.to_json(), third.truth.to_json());
  lab.seed += 1;
  EXPECT_FALSE(Simulation(lab).render(3, lab.settings).counts == third.counts);
}

TEST_P(BothCameras, WhatIsLeftOfEarlierFramesIsTheSameInAnyOrder) {
  Lab lab = small_lab(GetParam());
  lab.effects["image_lag"] = {0.3, 4};
  const Simulation forward(lab), backward(lab);
  CameraSettings brighter = lab.settings;
  brighter.exposure_s *= 2;
  std::vector<Frame> frames;
  for (std::uint64_t n = 0; n < 12; ++n) frames.push_back(forward.render(n, lab.settings, 1));
  const Frame other = forward.render(11, brighter, 1);
  EXPECT_FALSE(other.counts == frames[11].counts);
  EXPECT_EQ(Simulation(lab).render(11, brighter, 1).counts, other.counts);
  for (std::uint64_t n = 12; n-- > 0;)
    EXPECT_EQ(backward.render(n, lab.settings, 2).counts, frames[n].counts) << n;
}

TEST_P(BothCameras, AnEffectOfZeroStrengthChangesNoBit) {
  const Lab lab = small_lab(GetParam());
  const Frame plain = Simulation(lab).render(5);
  for (const EffectDeclaration& declaration : effect_catalogue()) {
    if (!(lab.kind() == CameraKind::emccd ? declaration.emccd : declaration.qcmos)) continue;
    Lab with = lab;
    ParameterValues values;
    for (const ParameterDeclaration& parameter : declaration.parameters)
      values.push_back(parameter.default_value);
    values.front() = 0;
    with.effects[declaration.name] = values;
    EXPECT_EQ(Simulation(with).render(5).counts, plain.counts) << declaration.name;
  }
}

TEST_P(BothCameras, PlanesAndRowsGiveTheSameBits) {
  // An effect of the electrons plane that does nothing visible forces the plane-by-plane path.
  Lab lab = small_lab(GetParam());
  const Frame rows = Simulation(lab).render(2);
  if (!find_effect("cosmic_rays")) GTEST_SKIP() << "no such effect in the catalogue";
  lab.effects["cosmic_rays"] = ParameterValues{};
  for (const ParameterDeclaration& parameter : find_effect("cosmic_rays")->parameters)
    lab.effects["cosmic_rays"].push_back(parameter.default_value);
  lab.effects["cosmic_rays"].front() = 1e-12;
  EXPECT_EQ(Simulation(lab).render(2).counts, rows.counts);
}

TEST_P(BothCameras, MeanElectronsAreTheExpectedOnes) {
  // Counts summed over frames against the expected image, pixel by pixel, as a chi-square-like sum of pulls.
  Lab lab = small_lab(GetParam());
  lab.stray_light_photons_per_s = 20;
  const Simulation simulation(lab);
  const PhotonImage expected = simulation.expected_electrons(0, lab.settings);
  const auto mode = simulation.sensor().readout_modes()[lab.settings.readout_mode];
  const double gain = lab.kind() == CameraKind::emccd ? lab.settings.em_gain : 1;
  const int frames = 400;
  std::vector<double> sum(expected.pixels().size());
  double expected_total = 0;
  for (const float e : expected.pixels()) expected_total += static_cast<double>(e);
  double total = 0, total2 = 0;
  for (int n = 0; n < frames; ++n) {
    const Frame frame = simulation.render(n, lab.settings);
    double frame_total = 0;
    for (const std::uint16_t counts : frame.counts.pixels()) frame_total += counts - lab.settings.bias_counts;
    frame_total *= mode.electrons_per_count / gain;
    total += frame_total;
    total2 += frame_total * frame_total;
  }
  const double mean = total / frames, error = std::sqrt((total2 / frames - mean * mean) / frames);
  double dark_e = 0;
  if (const auto* emccd = std::get_if<EmccdDescription>(&lab.sensor))
    dark_e = static_cast<double>(expected.pixels().size()) * emccd->clock_induced_charge_e;
  // A qCMOS has fixed offsets, whose sum over this field is measured with the light off.
  if (lab.kind() == CameraKind::qcmos) {
    CameraSettings closed = lab.settings;
    closed.shutter_open = false;
    double dark = 0, dark2 = 0;
    for (int n = 0; n < frames; ++n) {
      double frame_total = 0;
      const Frame shut = simulation.render(n, closed);
      for (const std::uint16_t counts : shut.counts.pixels())
        frame_total += counts - lab.settings.bias_counts;
      dark += frame_total * mode.electrons_per_count;
      dark2 += frame_total * frame_total * mode.electrons_per_count * mode.electrons_per_count;
    }
    dark_e = dark / frames;
    const double dark_error = std::sqrt((dark2 / frames - dark_e * dark_e) / frames);
    EXPECT_NEAR(mean - dark_e, expected_total, 5 * std::hypot(error, dark_error));
    return;
  }
  EXPECT_NEAR(mean - dark_e, expected_total, 5 * error);
}

TEST_P(BothCameras, DetectedElectronsFollowThePhotons) {
  Lab lab = small_lab(GetParam());
  const Simulation simulation(lab);
  for (std::size_t site = 0; site < lab.scene.sites.size(); ++site) {
    double detected = 0, expected = 0;
    for (int n = 0; n < 200; ++n) {
      const FrameTruth truth = simulation.render(n).truth;
      detected += static_cast<double>(truth.atoms[site].electrons_detected);
      expected += truth.atoms[site].electrons_expected;
    }
    // Light that falls beyond the region is not detected; the point-spread function of the presets keeps 90 %
    // of it within ten pixels.
    EXPECT_LT(detected, expected + 5 * std::sqrt(expected)) << site;
    EXPECT_GT(detected, 0.8 * expected) << site;
  }
}

TEST_P(BothCameras, AClosedShutterLeavesNoLight) {
  Lab lab = small_lab(GetParam());
  lab.stray_light_photons_per_s = 1000;
  CameraSettings closed = lab.settings;
  closed.shutter_open = false;
  const Frame frame = Simulation(lab).render(0, closed);
  for (const AtomTruth& atom : frame.truth.atoms) EXPECT_EQ(atom.electrons_detected, 0);
  EXPECT_EQ(frame.truth.background_e, 0);
}

TEST_P(BothCameras, LightOfAtomsOutsideTheFrameCounts) {
  Lab lab = small_lab(GetParam());
  lab.layout = std::vector<Site>{{98.5, 160, 1}};  // 1.5 pixels left of the region's first column
  lab.scene.scattering_rate_hz = 1e6;
  lab.place_sites();
  const Simulation simulation(lab);
  const Frame frame = simulation.render(0);
  const PhotonImage expected = simulation.expected_electrons(0, lab.settings);
  double inside = 0;
  for (const float e : expected.pixels()) inside += static_cast<double>(e);
  inside -= static_cast<double>(expected.pixels().size()) * frame.truth.background_e;
  ASSERT_GT(inside, 100);
  EXPECT_NEAR(static_cast<double>(frame.truth.atoms[0].electrons_detected), inside, 5 * std::sqrt(inside));
}

TEST_P(BothCameras, OverridesChangeThePhysics) {
  Lab lab = small_lab(GetParam());
  const Simulation simulation(lab);
  CameraSettings settings = lab.settings;
  settings.overrides = {{"atoms.filling", 0.0}};
  const FrameTruth empty = simulation.render(0, settings).truth;
  for (const AtomTruth& atom : empty.atoms) EXPECT_FALSE(atom.present_at_start);
  settings.overrides = {{"atoms.filing", 0.0}};
  try {
    simulation.render(0, settings);
    FAIL() << "an unknown key must be an error";
  } catch (const Error& error) {
    EXPECT_NE(std::string(error.what()).find("atoms.filling"), std::string::npos) << error.what();
  }
}

TEST_P(BothCameras, SettingsTheSensorCannotHaveAreErrors) {
  const Lab lab = small_lab(GetParam());
  const Simulation simulation(lab);
  const auto refused = [&](auto change) {
    CameraSettings settings = lab.settings;
    change(settings);
    EXPECT_THROW(simulation.render(0, settings), Error);
  };
  refused([](CameraSettings& s) { s.region.offset_x = 100000; });
  refused([](CameraSettings& s) { s.region.width = 0; });
  refused([](CameraSettings& s) { s.region.height = -4; });
  refused([](CameraSettings& s) { s.binning_x = 0; });
  refused([](CameraSettings& s) { s.binning_y = 5; });
  refused([](CameraSettings& s) { s.readout_mode = 99; });
  refused([](CameraSettings& s) { s.exposure_s = -1; });
}

TEST(RollingShutter, ContinuousLightReachesEveryRowForTheExposure) {
  Lab lab = small_lab("orca-quest");
  lab.settings.region = {100, 140, 64, 1000};
  lab.settings.exposure_s = 0.01;
  lab.layout = std::vector<Site>{{130, 150, 1}, {130, 1100, 1}};
  lab.scene.scattering_rate_hz = 1e6;
  lab.place_sites();
  const Simulation simulation(lab);
  for (const bool pulsed : {false, true}) {
    CameraSettings settings = lab.settings;
    settings.pulsed_light = pulsed;
    const FrameTruth truth = simulation.render(0, settings).truth;
    const double lit_s = pulsed ? 0.01 - 999 * std::get<QcmosDescription>(lab.sensor).line_time_s : 0.01;
    for (const AtomTruth& atom : truth.atoms) {
      const double expected = 1e6 * lit_s * collected_fraction(lab.optics.numerical_aperture) *
                              lab.optics.transmission * simulation.sensor().quantum_efficiency();
      EXPECT_NEAR(atom.electrons_expected, expected, 1e-9 * expected);
      // Light beyond the region's sides is lost; the rest must be there.
      EXPECT_GT(static_cast<double>(atom.electrons_detected), 0.8 * expected);
      EXPECT_LT(static_cast<double>(atom.electrons_detected), expected + 5 * std::sqrt(expected));
    }
  }
}

TEST(RollingShutter, PulsedLightShorterThanTheRollIsDark) {
  Lab lab = small_lab("orca-quest");
  lab.settings.region = {100, 140, 64, 1000};
  lab.settings.exposure_s = 0.002;
  lab.settings.pulsed_light = true;
  const FrameTruth truth = Simulation(lab).render(0).truth;
  EXPECT_EQ(truth.background_e, 0);
  for (const AtomTruth& atom : truth.atoms) EXPECT_EQ(atom.electrons_detected, 0);
}

TEST(RollingShutter, AnAtomLostEarlyIsDimmerInLateRows) {
  // Lost after 2 ms: rows that open later than that see nothing of it.
  Lab lab = small_lab("orca-quest");
  lab.settings.region = {100, 140, 64, 1000};
  lab.settings.exposure_s = 0.01;
  lab.scene.survival = 1e-6;
  lab.scene.reference_exposure_s = 0.01;
  lab.layout = std::vector<Site>{{130, 150, 1}, {130, 1100, 1}};
  lab.scene.scattering_rate_hz = 1e6;
  lab.place_sites();
  const Simulation simulation(lab);
  const double line_s = std::get<QcmosDescription>(lab.sensor).line_time_s;
  for (int n = 0; n < 20; ++n) {
    const FrameTruth truth = simulation.render(n).truth;
    for (const AtomTruth& atom : truth.atoms) {
      const double opens = line_s * (std::lround(atom.y_px) - 140);
      if (atom.loss_time_s < opens - 20 * line_s) {
        EXPECT_EQ(atom.electrons_detected, 0);
      }
    }
  }
}

TEST(Truth, JsonHoldsOccupancyAndAtoms) {
  FrameTruth truth;
  truth.frame = 7;
  truth.atoms = {{.site = 0, .present_at_start = true, .present_at_end = false, .loss_time_s = 0.01},
                 {.site = 1}};
  const std::string json = truth.to_json();
  EXPECT_NE(json.find(R"("initial":"10","final":"00")"), std::string::npos) << json;
  EXPECT_NE(json.find(R"("loss_s":0.01)"), std::string::npos) << json;
}

TEST(GivenOccupancies, AreFedShotByShot) {
  Lab lab = small_lab("ixon-ultra-897");
  lab.scene.images_per_shot = 2;
  lab.given_occupancies = {{1, 0, 0, 1}, {0, 1, 0, 0}};
  const Simulation simulation(lab);
  for (const std::uint64_t n : {0u, 1u, 4u, 5u}) {
    const FrameTruth truth = simulation.render(n).truth;
    EXPECT_TRUE(truth.atoms[0].present_at_start && truth.atoms[3].present_at_start);
    EXPECT_FALSE(truth.atoms[1].present_at_start || truth.atoms[2].present_at_start);
  }
  EXPECT_TRUE(simulation.render(2).truth.atoms[1].present_at_start);
}

TEST(Simulation, AnEffectMustHaveAllItsParameters) {
  Lab lab = small_lab("ixon-ultra-897");
  lab.effects["hot_pixels"] = {0.01, 2000};
  EXPECT_THROW(Simulation{lab}, Error);
  lab.effects["hot_pixels"].push_back(1);
  EXPECT_NO_THROW(Simulation{lab});
}

}  // namespace
}  // namespace atomcam
