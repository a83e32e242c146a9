// Frames of a real EMCCD in the dark, from a folder that ATOMCAM_DATA names.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>

#include "base/random.hpp"
#include "base/samplers.hpp"
#include "calibration/notes.hpp"
#include "calibration/stack_frames.hpp"
#include "diagnosis/diagnosis.hpp"

namespace atomcam {
namespace {

std::vector<CountImage> middle_of_the_dark_frames(const std::filesystem::path& data, int size = 160) {
  const auto whole = open_frames(data / "real" / "jqi-andor512-emccd" / "Background_*.tiff");
  std::vector<CountImage> middle;
  whole->visit([&](std::size_t, const CountImage& frame) {
    CountImage cut({size, size});
    for (int row = 0; row < size; ++row)
      for (int column = 0; column < size; ++column)
        cut(row, column) = frame(row + (frame.rows() - size) / 2, column + (frame.columns() - size) / 2);
    middle.push_back(std::move(cut));
  });
  return middle;
}

Notes notes_of_the_dark_frames(int size = 160) {
  return parse_notes(
      fmt::format(R"({{"camera": "iXon 897 EMCCD", "shape": [{0}, {0}], "settings": {{"em_gain": 100,
          "preamp_e_per_adu": 10, "bias_adu": 486, "read_noise_adu": 3, "cic_e": 0.3}}}})",
                  size),
      "notes");
}

TEST(RealFrames, ChargeBornInTheRegisterIsSeenAndNamed) {
  const char* data = std::getenv("ATOMCAM_DATA");
  if (!data) GTEST_SKIP() << "ATOMCAM_DATA is not set";
  const FramesInMemory frames(middle_of_the_dark_frames(data));
  const Notes notes = notes_of_the_dark_frames();
  DiagnosisOptions options;
  options.threads = 2;
  options.include = {"row_noise"};
  const Diagnosis withheld = diagnose(notes, frames, nullptr, options);
  EXPECT_EQ(withheld.verdict, Verdict::unexplained) << withheld.sentence;
  EXPECT_EQ(withheld.unexplained.stage, "sensor") << withheld.sentence;
  bool between = false;
  for (const Difference& one : withheld.where)
    between |= one.statistic == "light.pixel_histogram.law.to_3.5_read_noises" && one.z > 5;
  EXPECT_TRUE(between) << withheld.sentence;
  options.include = {"serial_cic"};
  const Diagnosis named = diagnose(notes, frames, nullptr, options);
  ASSERT_EQ(named.effects.size(), 1) << named.sentence;
  EXPECT_EQ(named.effects[0].name, "serial_cic");
  // One for a register of gain 91, as the likelihood of the histogram has it, too.
  EXPECT_NEAR(named.effects[0].parameters[0].value, 1, 0.2);
  EXPECT_GT(named.gap.part_closed, 0.75);
  EXPECT_TRUE(named.unexplained.present);
}

// The more pixels, the better the strength is told: draws that stay as wide as for few of them make the model
// scatter so much that it seems to explain less of more frames.
TEST(RealFrames, ManyPixelsTellAStrengthBetter) {
  const char* data = std::getenv("ATOMCAM_DATA");
  if (!data) GTEST_SKIP() << "ATOMCAM_DATA is not set";
  constexpr int size = 256;
  DiagnosisOptions options;
  options.threads = 2;
  options.include = {"serial_cic"};
  const Diagnosis named = diagnose(notes_of_the_dark_frames(size),
                                   FramesInMemory(middle_of_the_dark_frames(data, size)), nullptr, options);
  ASSERT_EQ(named.effects.size(), 1) << named.sentence;
  EXPECT_NEAR(named.effects[0].parameters[0].value, 1, 0.2);
  EXPECT_LT(named.effects[0].parameters[0].error(), 0.03);
  EXPECT_GT(named.gap.part_closed, 0.82);
}

// Its baseline jumps in spite of the clamp, its first columns stand high, and lines differ from frame to
// frame.
TEST(RealFrames, BaselineJumpsAndTheFirstColumnsOfAnotherCameraAreSeen) {
  const char* data = std::getenv("ATOMCAM_DATA");
  if (!data) GTEST_SKIP() << "ATOMCAM_DATA is not set";
  const auto frames =
      open_frames(std::filesystem::path(data) / "real" / "quickfit3-du860" / "LED_0mA_*_exp1000_000.tif");
  const Notes notes = parse_notes(
      R"({"camera": "iXon 860 EMCCD", "shape": [128, 128], "settings": {"em_gain": 10, "preamp_e_per_adu": 12,
          "bias_adu": 90, "read_noise_adu": 3.3}})",
      "notes");
  DiagnosisOptions options;
  options.threads = 2;
  options.where_only = true;
  const Diagnosis found = diagnose(notes, *frames, nullptr, options);
  EXPECT_EQ(found.verdict, Verdict::unexplained) << found.sentence;
  EXPECT_EQ(found.unexplained.stage, "sensor") << found.sentence;
  const auto z = [&](std::string_view statistic) {
    for (const Difference& one : found.where)
      if (one.statistic == statistic) return one.z;
    return 0.0;
  };
  EXPECT_GT(z("light.frames.level.variance"), 5);
  EXPECT_GT(z("light.static_offsets.columns.largest"), 5);
  EXPECT_GT(z("light.lines.rows.variance"), 5);
}

/// Of the dark frames, every row of each moved by another amount.
Diagnosis diagnose_with_noise_of_rows(const std::filesystem::path& data, double sigma_counts,
                                      const std::vector<std::string>& include) {
  std::vector<CountImage> frames = middle_of_the_dark_frames(data);
  RandomStream random(3, stream_id("planted"), 0, 0);
  for (CountImage& frame : frames)
    for (int row = 0; row < frame.rows(); ++row) {
      const double moved = sigma_counts * sample_normal(random);
      for (std::uint16_t& counts : frame.row(row))
        counts = static_cast<std::uint16_t>(
            std::lround(counts + moved + (static_cast<double>(random()) + 0.5) * 0x1p-32 - 0.5));
    }
  DiagnosisOptions options;
  options.threads = 2;
  options.include = include;
  return diagnose(notes_of_the_dark_frames(), FramesInMemory(std::move(frames)), nullptr, options);
}

// Whatever else the frames have: rows that are moved by a count are found, with what they were moved by.
TEST(RealFrames, NoiseOfRowsPlantedIntoThemIsNamed) {
  const char* data = std::getenv("ATOMCAM_DATA");
  if (!data) GTEST_SKIP() << "ATOMCAM_DATA is not set";
  constexpr double sigma_counts = 1;
  const Diagnosis found = diagnose_with_noise_of_rows(data, sigma_counts, {"row_noise", "emi_stripes"});
  EXPECT_EQ(found.verdict, Verdict::partly_explained) << found.sentence;
  ASSERT_EQ(found.effects.size(), 1) << found.sentence;
  EXPECT_EQ(found.effects[0].name, "row_noise");
  EXPECT_NEAR(found.effects[0].parameters[0].value, sigma_counts, 0.1);
}

// The camera's own effect is named beside a planted one, and neither makes the other another strength.
TEST(RealFrames, TwoEffectsAmongOthersAreNamedEachForItsOwnObservables) {
  const char* data = std::getenv("ATOMCAM_DATA");
  if (!data) GTEST_SKIP() << "ATOMCAM_DATA is not set";
  constexpr double sigma_counts = 0.75;
  const Diagnosis found = diagnose_with_noise_of_rows(data, sigma_counts, {"row_noise", "serial_cic"});
  EXPECT_EQ(found.verdict, Verdict::partly_explained) << found.sentence;
  ASSERT_EQ(found.effects.size(), 2) << found.sentence;
  const auto strength = [&](const char* name) {
    for (const FoundEffect& one : found.effects)
      if (one.name == name) return one.parameters[0].value;
    return 0.0;
  };
  EXPECT_NEAR(strength("row_noise"), sigma_counts, 0.1);
  EXPECT_NEAR(strength("serial_cic"), 1, 0.2);
  EXPECT_GT(found.gap.part_closed, 0.75);
  EXPECT_TRUE(found.unexplained.present);
}

// Hot pixels change the histogram that charge born in the register changes too: neither explains it alone.
TEST(RealFrames, HotPixelsPlantedIntoThemAreNamedBesideTheCamerasOwnEffect) {
  const char* data = std::getenv("ATOMCAM_DATA");
  if (!data) GTEST_SKIP() << "ATOMCAM_DATA is not set";
  constexpr double fraction = 0.003, electrons = 5, counts_per_electron = 10.3;
  std::vector<CountImage> frames = middle_of_the_dark_frames(data);
  RandomStream random(5, stream_id("planted"), 0, 0);
  const CountImage& any = frames.front();
  std::vector<std::pair<int, int>> hot;
  for (int row = 0; row < any.rows(); ++row)
    for (int column = 0; column < any.columns(); ++column)
      if (random.uniform() < fraction) hot.emplace_back(row, column);
  for (CountImage& frame : frames)
    for (const auto& [row, column] : hot) {
      const auto born = static_cast<double>(sample_poisson(random, electrons));
      if (born > 0) frame(row, column) += std::lround(counts_per_electron * sample_gamma(random, born));
    }
  DiagnosisOptions options;
  options.threads = 2;
  options.include = {"hot_pixels", "dual_adc_peaks", "serial_cic"};
  const Diagnosis found =
      diagnose(notes_of_the_dark_frames(), FramesInMemory(std::move(frames)), nullptr, options);
  EXPECT_EQ(found.verdict, Verdict::partly_explained) << found.sentence;
  ASSERT_EQ(found.effects.size(), 2) << found.sentence;
  for (const FoundEffect& one : found.effects) {
    ASSERT_TRUE(one.name == "serial_cic" || one.name == "hot_pixels") << found.sentence;
    if (one.name == "serial_cic")
      EXPECT_NEAR(one.parameters[0].value, 1, 0.2);
    else
      EXPECT_NEAR(std::log(one.parameters[0].value / fraction), 0, 1);
  }
}

}  // namespace
}  // namespace atomcam
