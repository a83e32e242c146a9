#include "calibration/notes.hpp"

#include <gtest/gtest.h>

#include "base/error.hpp"

namespace atomcam {
namespace {

constexpr const char* emccd_notes = R"({"camera": "iXon Ultra 897", "shape": [96, 80],
  "settings": {"exposure_s": 0.08, "em_gain": 300, "preamp_e_per_adu": 4.85, "bias_adu": 200, "read_noise_adu": 4,
               "magnification": 78.125, "stray_e_per_s": 2, "filling": 0.55},
  "site_grid": {"rows": 7, "cols": 5, "spacing_px": 10.95, "first_site_px": [15.2, 16.2]}, "remark": "prose"})";

std::string problem_of(const std::string& text, bool toml = false) {
  try {
    parse_notes(text, "notes", toml);
  } catch (const Error& error) {
    return error.what();
  }
  return "";
}

TEST(Notes, BecomeAPlainLab) {
  const Notes notes = parse_notes(emccd_notes, "notes");
  EXPECT_EQ(notes.kind, CameraKind::emccd);
  EXPECT_TRUE(notes.not_understood.empty());
  const Lab lab = lab_of_notes(notes);
  check_lab(lab, "notes");
  EXPECT_TRUE(lab.effects.empty());
  EXPECT_EQ(lab.sensor_shape(), (Shape{96, 80}));
  ASSERT_EQ(lab.scene.sites.size(), 35u);
  EXPECT_EQ(lab.scene.sites[1].x_px, 15.2 + 10.95);
  EXPECT_EQ(lab.settings.em_gain, 300);
  const ReadoutMode& mode = std::get<EmccdDescription>(lab.sensor).readout_modes[0];
  EXPECT_EQ(mode.read_noise_e, 4 * 4.85);
}

TEST(Notes, TomlSaysTheSame) {
  const Notes notes = parse_notes(
      "camera = 'ORCA-Quest'\nshape = [96, 96]\n[settings]\nbias_adu = 201\npreamp_e_per_adu = 0.11\n",
      "notes", true);
  EXPECT_EQ(notes.kind, CameraKind::qcmos);
  EXPECT_EQ(notes.bias_counts, 201);
  EXPECT_EQ(notes.electrons_per_count, 0.11);
  EXPECT_FALSE(notes.grid.has_value());
  EXPECT_TRUE(lab_of_notes(notes).scene.sites.empty());
}

TEST(Notes, TheLabOfEitherCameraCanBeWrittenAndRead) {
  for (const char* text :
       {emccd_notes, R"({"camera": "ORCA-Quest", "shape": [96, 96], "settings": {"bias_adu": 201}})"}) {
    const Lab lab = lab_of_notes(parse_notes(text, "notes"));
    EXPECT_NO_THROW(check_lab(lab, "notes"));
    EXPECT_EQ(write_lab(parse_lab(write_lab(lab), "lab")), write_lab(lab));
  }
}

TEST(Notes, AGainBeyondALabsIsSharedWithThePreamplifier) {
  Lab lab = lab_of_notes(parse_notes(emccd_notes, "notes"));
  ReadoutMode& mode = std::get<EmccdDescription>(lab.sensor).readout_modes[0];
  share_gain(lab);
  EXPECT_EQ(lab.settings.em_gain, 300);
  EXPECT_EQ(mode.electrons_per_count, 4.85);
  lab.settings.em_gain = 1250;
  share_gain(lab);
  EXPECT_NO_THROW(check_lab(lab, "notes"));
  EXPECT_DOUBLE_EQ(lab.settings.em_gain / mode.electrons_per_count, 1250 / 4.85);
  EXPECT_DOUBLE_EQ(mode.read_noise_e / mode.electrons_per_count, 4);
}

TEST(Notes, ErrorsNamePlaceAndValue) {
  EXPECT_NE(problem_of("{").find("notes"), std::string::npos);
  EXPECT_NE(problem_of("[1, 2").find("notes"), std::string::npos);
  EXPECT_NE(problem_of("a = [", true).find("line"), std::string::npos);
  EXPECT_NE(problem_of(R"({"settings": {"filling": 1.5}})").find("filling"), std::string::npos);
  EXPECT_NE(problem_of(R"({"settings": {"em_gain": "high"}})").find("em_gain"), std::string::npos);
  EXPECT_NE(problem_of(R"({"shape": [96]})").find("shape"), std::string::npos);
  EXPECT_NE(problem_of(R"({"site_grid": {"rows": 3, "cols": 3}})").find("spacing_px"), std::string::npos);
  EXPECT_THROW(read_notes("/nowhere/lab.json"), Error);
}

TEST(Notes, UnknownKeysAreTold) {
  const Notes notes =
      parse_notes(R"({"weather": "fine", "settings": {"bias_adu": 100, "colour": 3}})", "notes");
  EXPECT_EQ(notes.not_understood.size(), 2u);
}

}  // namespace
}  // namespace atomcam
