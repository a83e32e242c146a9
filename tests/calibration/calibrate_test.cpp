// Rendered stacks are calibrated: every figure comes back.
#include "calibration/calibrate.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "base/error.hpp"
#include "support/calibration_input.hpp"
#include "support/rendered.hpp"

namespace atomcam {
namespace {

Notes rough_notes(bool emccd) {
  Notes notes;
  notes.place = "notes";
  notes.kind = emccd ? CameraKind::emccd : CameraKind::qcmos;
  notes.shape = {64, 72};
  notes.em_gain = emccd ? 300 : 1;
  notes.electrons_per_count = emccd ? 4.85 : 0.107;
  notes.read_noise_counts = 4;
  notes.quantum_efficiency = 0.85;
  notes.clock_induced_charge_e = emccd ? 0.002 : 0;
  notes.pixel_um = emccd ? 16 : 4.6;
  notes.magnification = emccd ? 78.125 : 30;
  notes.stray_e_per_s = 2;
  notes.grid = NotedGrid{.rows = 5, .columns = 5, .spacing_px = 10.5, .first_x_px = 12, .first_y_px = 11};
  return notes;
}

/// The lab behind the frames: what was noted, some tens of percent off.
Lab true_lab(const Notes& notes) {
  Lab lab = lab_of_notes(notes);
  lab.seed = 77;
  lab.settings.bias_counts += 1.7;
  lab.scene.scattering_rate_hz *= 1.13;
  lab.scene.filling = 0.6;
  lab.scene.survival = 0.94;
  lab.stray_light_photons_per_s *= 1.4;
  auto& grid = std::get<SiteGrid>(lab.layout);
  grid.offset_x += 0.7;
  grid.offset_y -= 0.6;
  grid.spacing_x = 10.62;
  grid.spacing_y = 10.47;
  grid.angle_x_deg = 0.4;
  grid.angle_y_deg = 0.2;
  lab.optics.zernike_um[3] = 0.05;
  lab.optics.zernike_um[5] = -0.01;
  lab.optics.zernike_um[7] = 0.012;   // coma
  lab.optics.zernike_um[8] = -0.009;  // trefoil
  lab.optics.zernike_um[10] = 0.018;
  if (lab.kind() == CameraKind::emccd) {
    lab.settings.em_gain *= 1.1;
  } else {
    auto& qcmos = std::get<QcmosDescription>(lab.sensor);
    qcmos.readout_modes[0].electrons_per_count *= 1.08;
    qcmos.offset_sigma_counts = 0.6;
    qcmos.read_noise_log_sigma = 0.06;
  }
  lab.place_sites();
  return lab;
}

double counts_per_electron(const Lab& lab) {
  return std::visit(
      [&](const auto& s) { return lab.settings.em_gain / s.readout_modes[0].electrons_per_count; },
      lab.sensor);
}

class Calibrate : public testing::TestWithParam<bool> {};

TEST_P(Calibrate, FindsTheLabBehindTheFrames) {
  const Notes notes = rough_notes(GetParam());
  const Lab truth = true_lab(notes);
  const FramesInMemory light(render(truth, 0, 250, true)), darks(render(truth, 1000000, 100, false));
  const Calibration found = calibrate(input_of(notes, light, &darks));
  ASSERT_TRUE(found.optics.converged);
  EXPECT_LT(found.optics.chi_square, found.optics.degrees_of_freedom * 1.15);
  // Sites to 0.02 px, the corners included.
  ASSERT_EQ(found.lab.scene.sites.size(), truth.scene.sites.size());
  for (std::size_t s = 0; s < truth.scene.sites.size(); ++s) {
    EXPECT_NEAR(found.lab.scene.sites[s].x_px, truth.scene.sites[s].x_px, 0.02);
    EXPECT_NEAR(found.lab.scene.sites[s].y_px, truth.scene.sites[s].y_px, 0.02);
  }
  for (int term = 3; term < zernike_terms; ++term) {
    const double error = std::sqrt(found.optics.covariance(3 + term, 3 + term));
    EXPECT_NEAR(found.lab.optics.zernike_um[term], truth.optics.zernike_um[term], 5 * error + 3e-4) << term;
  }
  EXPECT_NEAR(found.lab.settings.bias_counts, truth.settings.bias_counts,
              5 * (GetParam() ? found.counts.bias_error : found.dark_maps.bias_error));
  EXPECT_NEAR(found.lab.scene.filling, 0.6, 5 * found.atoms.filling_error);
  EXPECT_NEAR(found.lab.scene.survival, 0.94, 5 * found.atoms.survival_error);
  EXPECT_NEAR(found.model.counts_per_electron / counts_per_electron(truth), 1, 0.04);
  // What the data know of the light is the product with the gain.
  EXPECT_NEAR(found.lab.scene.scattering_rate_hz * counts_per_electron(found.lab) /
                  (truth.scene.scattering_rate_hz * counts_per_electron(truth)),
              1, 0.01);
}

INSTANTIATE_TEST_SUITE_P(Cameras, Calibrate, testing::Bool(),
                         [](const auto& which) { return which.param ? "emccd" : "qcmos"; });

// A few tracks of thousands of electrons have more variance than all the light.
TEST(Calibrate, TracksOfCosmicRaysAreNoOtherGain) {
  const Notes notes = rough_notes(true);
  Lab truth = true_lab(notes);
  truth.effects["cosmic_rays"] = {50, 1200, 4};
  const FramesInMemory light(render(truth, 0, 250, true)), darks(render(truth, 1000000, 100, false));
  const Calibration found = calibrate(input_of(notes, light, &darks));
  EXPECT_NEAR(found.model.counts_per_electron / counts_per_electron(truth), 1, 0.04);
}

// Nor have tracks that cross a site, whose fit of the light then goes wrong in all of its pixels.
TEST(Calibrate, TracksAcrossSitesAreNoOtherGain) {
  const Notes notes = rough_notes(false);
  Lab truth = true_lab(notes);
  truth.effects["cosmic_rays"] = {3000, 350, 12};
  const FramesInMemory light(render(truth, 0, 250, true)), darks(render(truth, 1000000, 100, false));
  const Calibration found = calibrate(input_of(notes, light, &darks));
  EXPECT_NEAR(found.model.counts_per_electron / counts_per_electron(truth), 1, 0.05);
}

// Images that are not what the mean one is taken for leave light of their atoms over: no noise of electrons.
TEST(Calibrate, ImagesThatDifferFromSiteToSiteAreNoOtherGain) {
  const Notes notes = rough_notes(false);
  Lab truth = true_lab(notes);
  truth.effects["field_tilt_defocus"] = {0.15, 212, 0};
  const FramesInMemory light(render(truth, 0, 250, true)), darks(render(truth, 1000000, 100, false));
  const Calibration found = calibrate(input_of(notes, light, &darks));
  EXPECT_GT(found.counts_per_electron_error, 0);
  EXPECT_NEAR(found.model.counts_per_electron / counts_per_electron(truth), 1, 0.08);
}

// What whole frames have in common is no noise of single electrons.
TEST(Calibrate, LevelsThatWanderAreNoOtherGain) {
  const Notes notes = rough_notes(false);
  Lab truth = true_lab(notes);
  const FramesInMemory darks(render(truth, 1000000, 100, false));
  truth.effects["bias_drift"] = {0.01, 100, 3};
  const FramesInMemory light(render(truth, 0, 250, true));
  const Calibration found = calibrate(input_of(notes, light, &darks));
  EXPECT_NEAR(found.model.counts_per_electron / counts_per_electron(truth), 1, 0.05);
}

// Rows that are lost on the way read zero: noise many times that of all light, which says nothing of the
// camera.
TEST(Calibrate, LostRowsAreNoOtherCamera) {
  const Notes notes = rough_notes(false);
  const Lab truth = true_lab(notes);
  const auto lose_rows = [](std::vector<CountImage> frames, std::size_t every) {
    for (std::size_t n = 0, row = 3; n < frames.size(); n += every, row = (row + 17) % 60)
      for (int r = 0; r < 4; ++r)
        for (int c = 0; c < frames[n].columns(); ++c) frames[n](static_cast<int>(row) + r, c) = 0;
    return frames;
  };
  const FramesInMemory light(lose_rows(render(truth, 0, 250, true), 3)),
      darks(lose_rows(render(truth, 1000000, 100, false), 6));
  const Calibration found = calibrate(input_of(notes, light, &darks));
  ASSERT_EQ(found.warnings.size(), 3);
  EXPECT_NE(found.warnings[0].find("frames: 336 of 16000 rows"), std::string::npos) << found.warnings[0];
  EXPECT_NE(found.warnings[1].find("darks: 68 of 6400 rows"), std::string::npos) << found.warnings[1];
  EXPECT_NE(found.warnings[2].find("light varies"), std::string::npos) << found.warnings[2];
}

// Where they wander slowly, the dark frames' level is not that of the frames: no other gain either.
TEST(Calibrate, DarksOfAnotherLevelAreNoOtherGain) {
  const Notes notes = rough_notes(false);
  Lab truth = true_lab(notes);
  const auto by_a_count = [](std::vector<CountImage> frames, double sign) {
    for (std::size_t n = 0; n < frames.size(); ++n)
      for (std::uint16_t& count : frames[n].pixels())
        count =
            static_cast<std::uint16_t>(count + sign * (1 + std::sin(0.03 * static_cast<double>(n))) + 0.5);
    return frames;
  };
  const FramesInMemory light(by_a_count(render(truth, 0, 250, true), 1)),
      darks(by_a_count(render(truth, 1000000, 100, false), -1));
  const Calibration found = calibrate(input_of(notes, light, &darks));
  EXPECT_NEAR(found.model.counts_per_electron / counts_per_electron(truth), 1, 0.05);
}

/// What is done to every row of frames after the camera.
template <class Change>
std::vector<CountImage> changed(std::vector<CountImage> frames, const Change& change) {
  for (CountImage& frame : frames)
    for (int row = 0; row < frame.rows(); ++row) change(frame.row(row));
  return frames;
}

// Cameras that no catalogue knows must still calibrate, for the diagnosis to tell what they do. Counts that
// end at the black level, or that overshoot behind bright pixels, follow no law of dark counts: the fit of
// their tail leaves for gains beyond belief.
TEST(Calibrate, LawsBeyondBeliefLeaveTheGainToTheLight) {
  const Notes notes = rough_notes(true);
  const Lab truth = true_lab(notes);
  const double bias = truth.settings.bias_counts;
  const auto clamped = [&](std::span<std::uint16_t> row) {
    for (std::uint16_t& counts : row)
      counts = std::max<std::uint16_t>(counts, static_cast<std::uint16_t>(bias));
  };
  const auto undershoot = [&](std::span<std::uint16_t> row) {
    double behind = 0;
    for (std::uint16_t& counts : row) {
      const double own = counts - bias;
      counts = static_cast<std::uint16_t>(std::clamp(bias + own - behind, 0.0, 65535.0));
      behind = 0.6 * behind + 0.15 * std::max(0.0, own);
    }
  };
  const auto light = render(truth, 0, 250, true), darks = render(truth, 1000000, 100, false);
  const auto gain_of = [&](const auto& change) {
    const FramesInMemory changed_light(changed(light, change)), changed_darks(changed(darks, change));
    const Calibration found = calibrate(input_of(notes, changed_light, &changed_darks));
    EXPECT_FALSE(found.warnings.empty());
    EXPECT_GT(found.lab.scene.scattering_rate_hz, 0.3 * truth.scene.scattering_rate_hz);
    return found.model.counts_per_electron / counts_per_electron(truth);
  };
  EXPECT_NEAR(gain_of(clamped), 1, 0.2);
  const double with_undershoot = gain_of(undershoot);
  EXPECT_GT(with_undershoot, 0.4);
  EXPECT_LT(with_undershoot, 2.5);
}

// Second peaks of some pixels look like the tail of a gain that is a fraction of the noted one, where dark
// electrons are few.
TEST(Calibrate, SecondPeaksAreNoTailOfElectrons) {
  const Notes notes = rough_notes(true);
  Lab truth = true_lab(notes);
  std::get<EmccdDescription>(truth.sensor).clock_induced_charge_e = 0.002;
  truth.effects["dual_adc_peaks"] = {0.03, 0.45 * counts_per_electron(truth), 0, 1};
  const FramesInMemory light(render(truth, 0, 250, true)), darks(render(truth, 1000000, 100, false));
  const Calibration found = calibrate(input_of(notes, light, &darks));
  ASSERT_FALSE(found.warnings.empty());
  EXPECT_NE(found.warnings[0].find("not taken for the gain"), std::string::npos) << found.warnings[0];
  EXPECT_NEAR(found.model.counts_per_electron / counts_per_electron(truth), 1, 0.1);
}

// Lines that settle over many counts stand still: what they are apart is no read noise, nor the slope of
// their settling a tail of electrons.
TEST(Calibrate, LinesThatSettleAreNoReadNoise) {
  Notes notes = rough_notes(true);
  const Lab truth = true_lab(notes);
  const auto settling = [&](std::span<std::uint16_t> row) {
    for (std::size_t x = 0; x < row.size(); ++x)
      row[x] = static_cast<std::uint16_t>(row[x] + 60 * std::exp(-static_cast<double>(x) / 8) + 0.5);
  };
  notes.grid.reset();
  const auto darks = render(truth, 1000000, 100, false);
  const FramesInMemory plain(darks), settled(changed(darks, settling));
  const Calibration expected = calibrate(input_of(notes, plain)), found = calibrate(input_of(notes, settled));
  EXPECT_TRUE(expected.warnings.empty());
  ASSERT_EQ(found.warnings.size(), 1);
  EXPECT_NE(found.warnings[0].find("rows and columns"), std::string::npos) << found.warnings[0];
  EXPECT_NEAR(found.counts.law.read_noise_counts, expected.counts.law.read_noise_counts, 0.1);
  EXPECT_NEAR(found.counts.law.em_gain / expected.counts.law.em_gain, 1, 0.1);
}

TEST(Calibrate, ASpacingFarFromTheNotesIsToldOf) {
  Notes notes = rough_notes(true);
  const FramesInMemory light(render(true_lab(notes), 0, 100, true));
  EXPECT_TRUE(calibrate(input_of(notes, light)).warnings.empty());
  notes.grid->spacing_px *= 1.13;
  notes.grid->first_x_px -= 2;  // the middle of the lattice stays
  notes.grid->first_y_px -= 2;
  const Calibration found = calibrate(input_of(notes, light));
  EXPECT_NEAR(found.lab.scene.sites.back().x_px - found.lab.scene.sites.front().x_px, 4 * 10.5, 0.5);
  ASSERT_EQ(found.warnings.size(), 1);
  EXPECT_NE(found.warnings[0].find("11.86 is noted"), std::string::npos) << found.warnings[0];
}

TEST(CalibrateErrors, SayWhatIsWrong) {
  const Notes notes = rough_notes(true);
  Lab lab = true_lab(notes);
  const FramesInMemory few(render(lab, 0, 5, true));
  EXPECT_NE(problem_with(notes, few).find("too few"), std::string::npos);
  const FramesInMemory enough(render(lab, 0, 40, true));
  Notes other = notes;
  other.shape = {64, 64};
  EXPECT_NE(problem_with(other, enough).find("shape"), std::string::npos);
  other = notes;
  other.grid->first_x_px = 500;
  EXPECT_NE(problem_with(other, enough).find("site_grid"), std::string::npos);
  // Lit all over, and no darks.
  other = notes;
  other.grid.reset();
  Lab bright = lab;
  bright.scene.filling = 0;
  bright.stray_light_photons_per_s = 3e3;
  const FramesInMemory lit(render(bright, 0, 40, true));
  EXPECT_NE(problem_with(other, lit).find("darks are needed"), std::string::npos);
  lab.scene.filling = 0;
  const FramesInMemory empty(render(lab, 0, 40, true));
  EXPECT_NE(problem_with(notes, empty).find("no light"), std::string::npos);
}

}  // namespace
}  // namespace atomcam
