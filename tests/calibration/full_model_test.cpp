// What the full model fits beyond the plain one, and what further stacks are good for.
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <limits>

#include "base/error.hpp"
#include "calibration/calibrate.hpp"
#include "calibration/stack_frames.hpp"
#include "data/npy.hpp"
#include "support/calibration_input.hpp"
#include "support/rendered.hpp"

namespace atomcam {
namespace {

Notes notes_of(CameraKind kind) {
  Notes notes;
  notes.place = "notes";
  notes.kind = kind;
  notes.shape = {48, 52};
  const bool emccd = kind == CameraKind::emccd;
  notes.em_gain = emccd ? 300 : 1;
  notes.electrons_per_count = emccd ? 4.85 : 0.107;
  notes.clock_induced_charge_e = emccd ? 0.02 : 0;
  notes.pixel_um = emccd ? 16 : 4.6;
  notes.magnification = emccd ? 78.125 : 30;
  notes.stray_e_per_s = 2;
  notes.grid = NotedGrid{.rows = 3, .columns = 3, .spacing_px = 11, .first_x_px = 14, .first_y_px = 12};
  return notes;
}

TEST(FullModel, FitsSerialChargeAndTheBrightnessOfSites) {
  const Notes notes = notes_of(CameraKind::emccd);
  Lab truth = lab_of_notes(notes);
  truth.effects["serial_cic"] = {0.05};
  std::vector<Site> sites = truth.scene.sites;
  double mean = 0;
  for (std::size_t s = 0; s < sites.size(); ++s)
    mean += sites[s].brightness = 0.8 + 0.05 * static_cast<double>(s);
  mean /= static_cast<double>(sites.size());
  truth.layout = sites;
  truth.place_sites();
  const FramesInMemory light(render(truth, 0, 200, true)), darks(render(truth, 100000, 150, false));
  CalibrationInput input = input_of(notes, light, &darks);
  input.full = true;
  const Calibration found = calibrate(input);
  EXPECT_NEAR(found.counts.law.serial_events, 0.05, 5 * found.counts.serial_error);
  EXPECT_LT(found.counts.serial_error, 0.025);
  ASSERT_TRUE(found.lab.effects.contains("serial_cic"));
  for (std::size_t s = 0; s < sites.size(); ++s) {
    EXPECT_NEAR(found.site_brightness[s], sites[s].brightness / mean, 5 * found.site_brightness_error[s])
        << s;
    EXPECT_LT(found.site_brightness_error[s], 0.05);
    EXPECT_EQ(found.lab.scene.sites[s].brightness, found.site_brightness[s]);
  }
  // The lab that comes out can be written and read.
  EXPECT_EQ(parse_lab(write_lab(found.lab), "text").scene.sites.size(), sites.size());
}

TEST(FullModel, MapsThePixelsOfAQcmos) {
  const Notes notes = notes_of(CameraKind::qcmos);
  Lab truth = lab_of_notes(notes);
  auto& sensor = std::get<QcmosDescription>(truth.sensor);
  sensor.offset_sigma_counts = 3;
  sensor.read_noise_log_sigma = 0.2;
  truth.effects["hot_pixels"] = {0.01, 2000, 1};
  const FramesInMemory light(render(truth, 0, 100, true)), darks(render(truth, 100000, 200, false)),
      again(render(truth, 200000, 200, false));
  CalibrationInput input = input_of(notes, light, &darks);
  input.full = true;
  const Calibration found = calibrate(input);
  // A second stack of the same sensor differs from the maps by the errors that they state.
  const StackSums second = sum_stack(again);
  double chi_square = 0, pixels = 0;
  for (std::size_t i = 0; i < found.maps.offset.pixels().size(); ++i) {
    const double off = second.mean(i) - found.maps.offset.pixels()[i];
    chi_square += off * off / (2 * std::pow(found.maps.offset_error.pixels()[i], 2));
    pixels += 1;
  }
  EXPECT_NEAR(chi_square, pixels, 5 * std::sqrt(2 * pixels) + 0.02 * pixels);  // errors known to n - 1 = 199
  EXPECT_GT(found.maps.hot.size(), 5u);
  EXPECT_LT(found.maps.hot.size(), 60u);
}

TEST(Background, TellsLightFromChargeByTwoExposures) {
  Notes notes = notes_of(CameraKind::emccd);
  Lab truth = lab_of_notes(notes);
  truth.settings.exposure_s = notes.exposure_s;
  truth.stray_light_photons_per_s = 4 / notes.quantum_efficiency;
  const FramesInMemory light(render(truth, 0, 250, true)), darks(render(truth, 100000, 100, false));
  Lab empty = truth;
  empty.scene.filling = 0;
  empty.settings.exposure_s = 4 * notes.exposure_s;
  const FramesInMemory background(render(empty, 300000, 100, true));
  CalibrationInput input = input_of(notes, light, &darks);
  input.background = &background;
  input.background_exposure_s = empty.settings.exposure_s;
  const Calibration found = calibrate(input);
  ASSERT_TRUE(found.exposures);
  const double gain = found.counts_per_electron_error / found.model.counts_per_electron;
  EXPECT_NEAR(found.exposures->offset_e, 0.02, 5 * std::hypot(found.exposures->offset_error, 0.02 * gain));
  EXPECT_NEAR(found.exposures->rate_e_per_s, 4,
              5 * std::hypot(found.exposures->rate_error_e_per_s, 4 * gain));
  EXPECT_LT(found.exposures->offset_error, 0.02);
}

TEST(Flats, GiveTheConversionOfAQcmos) {
  const Notes notes = notes_of(CameraKind::qcmos);
  Lab lab = lab_of_notes(notes);
  lab.layout = std::vector<Site>{};
  lab.place_sites();
  const FramesInMemory darks(render(lab, 0, 40, false));
  std::vector<FlatLevel> levels;
  for (const double electrons : {20.0, 60.0, 120.0, 240.0, 400.0}) {
    lab.stray_light_photons_per_s = electrons / notes.quantum_efficiency / notes.exposure_s;
    levels.push_back(flat_level(FramesInMemory(render(lab, 1000, 40, true)), darks, electrons));
  }
  const PhotonTransfer found = photon_transfer(levels);
  EXPECT_NEAR(found.slope, 1 / notes.electrons_per_count, 5 * found.slope_error);
  EXPECT_LT(found.slope_error, 0.01 * found.slope);
  EXPECT_LT(found.linearity_error, 0.005);
}

TEST(CalibrateRefuses, WhatCannotBeWhatTheNotesSay) {
  Notes notes = notes_of(CameraKind::emccd);
  Lab lab = lab_of_notes(notes);
  // Sites where there are no atoms, stray light or not.
  lab.scene.filling = 0;
  for (const auto& [stray, seed] : {std::pair{0.5, 2}, std::pair{2.0, 1}, std::pair{20.0, 1}}) {
    lab.stray_light_photons_per_s = stray;
    lab.seed = static_cast<std::uint64_t>(seed);
    const std::string said = problem_with(notes, FramesInMemory(render(lab, 0, 40, true)));
    EXPECT_TRUE(said.find("no light") != std::string::npos ||
                said.find("shape of sites") != std::string::npos)
        << stray << ' ' << seed << ": '" << said << "'";
  }
  // Saturated, and the notes of another camera.
  lab = lab_of_notes(notes);
  std::vector<CountImage> frames = render(lab, 0, 40, true);
  std::vector<CountImage> saturated = frames;
  for (CountImage& frame : saturated)
    for (int c = 0; c < 40; ++c)
      for (int r = 0; r < 20; ++r) frame(r, c) = 65535;
  EXPECT_NE(problem_with(notes, FramesInMemory(saturated)).find("saturated"), std::string::npos);
  Notes other = notes_of(CameraKind::qcmos);
  other.pixel_um = 16;
  other.magnification = 78.125;
  EXPECT_NE(problem_with(other, FramesInMemory(frames)).find("another camera"), std::string::npos);
  // Not a number in a stack of floats: file and frame are named.
  const auto file = std::filesystem::temp_directory_path() / "atomcam_calibrate_nan.npy";
  {
    NpyWriter writer(file, {48, 52}, "<f4");
    std::vector<float> pixels(48 * 52, 200.0f);
    writer.append(std::as_bytes(std::span(pixels)));
    pixels[77] = std::numeric_limits<float>::quiet_NaN();
    writer.append(std::as_bytes(std::span(pixels)));
    writer.close();
  }
  try {
    open_frames(file);
    ADD_FAILURE() << "read";
  } catch (const Error& error) {
    EXPECT_NE(std::string(error.what()).find("atomcam_calibrate_nan.npy"), std::string::npos) << error.what();
    EXPECT_NE(std::string(error.what()).find("nan"), std::string::npos) << error.what();
  }
  std::filesystem::remove(file);
}

}  // namespace
}  // namespace atomcam
