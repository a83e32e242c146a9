#include "diagnosis/against.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>

#include "base/error.hpp"
#include "calibration/notes.hpp"
#include "calibration/stack_frames.hpp"
#include "diagnosis/population.hpp"

namespace atomcam {
namespace {

/// Stacks of one sensor without atoms.
class Stacks {
 public:
  Stacks() : lab_(lab_of_notes(notes_)) {}
  std::unique_ptr<FrameSequence> stack(std::uint64_t number, const std::function<void(Lab&)>& change = {},
                                       std::size_t frames = 48) const {
    Lab lab = lab_;
    if (change) change(lab);
    StackPlan plan;
    plan.frames = frames;
    return simulate_stack(lab, plan, number, true, 1);
  }
  Diagnosis compare(const FrameSequence& frames, const FrameSequence& against) const {
    DiagnosisOptions options;
    options.threads = 2;
    return diagnose_against(notes_, frames, against, nullptr, options);
  }

 private:
  Notes notes_ = parse_notes(
      R"({"camera": "iXon", "shape": [40, 40], "settings": {"em_gain": 300, "preamp_e_per_adu": 4.5,
          "read_noise_adu": 4, "cic_e": 0.01, "stray_e_per_s": 1}})",
      "notes");
  Lab lab_;
};

TEST(Against, StacksOfOneLabDoNotDiffer) {
  const Stacks it;
  const Diagnosis found = it.compare(*it.stack(1), *it.stack(2, {}, 64));
  EXPECT_EQ(found.verdict, Verdict::no_gap) << found.sentence;
  EXPECT_TRUE(found.against);
  EXPECT_FALSE(found.unexplained.present);
}

TEST(Against, WhatBothHaveIsNoGapAndWhatOneHasIs) {
  const Stacks it;
  const auto rows = [](Lab& lab) { lab.effects["row_noise"] = {2.0}; };
  const auto noisy = it.stack(1, rows);
  const Diagnosis both = it.compare(*noisy, *it.stack(2, rows));
  EXPECT_EQ(both.verdict, Verdict::no_gap) << both.sentence;
  const Diagnosis one = it.compare(*noisy, *it.stack(2));
  EXPECT_EQ(one.verdict, Verdict::unexplained) << one.sentence;
  EXPECT_EQ(one.unexplained.stage, "sensor");
  ASSERT_FALSE(one.where.empty());
  EXPECT_EQ(one.where.front().observable, "row_means") << one.sentence;
  EXPECT_GT(one.where.front().z, 0);  // the frames have more of it
}

TEST(Against, OneRareEventIsNoGap) {
  const Stacks it;
  std::vector<CountImage> frames;
  it.stack(2)->visit([&](std::size_t, const CountImage& frame) { frames.push_back(frame); });
  for (const int column : {10, 11, 12}) frames[20](15, column) = 9000;
  const Diagnosis found = it.compare(*it.stack(1), FramesInMemory(std::move(frames)));
  EXPECT_EQ(found.verdict, Verdict::no_gap) << found.sentence;
}

TEST(Against, AChangedParameterIsNamed) {
  const Stacks it;
  const Diagnosis found =
      it.compare(*it.stack(1, [](Lab& lab) { lab.settings.bias_counts += 1; }), *it.stack(2));
  EXPECT_EQ(found.verdict, Verdict::unexplained) << found.sentence;
  EXPECT_NE(found.sentence.find("in the frames bias were"), std::string::npos) << found.sentence;
  EXPECT_NE(found.sentence.find("counts higher"), std::string::npos) << found.sentence;
}

constexpr Shape corner{40, 40};

/// The corner of every other frame, from the fourth on.
std::unique_ptr<FrameSequence> every_other(const FrameSequence& all, std::size_t first) {
  std::vector<CountImage> frames;
  all.visit([&](std::size_t n, const CountImage& frame) {
    if (n < 4 || n % 2 != first) return;
    CountImage cut(corner);
    for (int r = 0; r < corner.rows; ++r)
      std::copy_n(frame.row(r).begin(), corner.columns, cut.row(r).begin());
    frames.push_back(std::move(cut));
  });
  return std::make_unique<FramesInMemory>(std::move(frames));
}

TEST(Against, HalvesOfDarksDoNotDiffer) {
  const char* data = std::getenv("ATOMCAM_DATA");
  if (!data) GTEST_SKIP() << "ATOMCAM_DATA is not set";
  // One EMCCD and one qCMOS of the practice stacks.
  for (const char* name : {"p01", "p07"}) {
    const std::filesystem::path folder = std::filesystem::path(data) / "practice" / name;
    const auto darks = open_frames(folder / "darks.tif");
    Notes notes = read_notes(folder / "lab.json");
    notes.grid.reset();
    notes.shape = corner;
    DiagnosisOptions options;
    options.threads = 2;
    const auto even = every_other(*darks, 0), odd = every_other(*darks, 1);
    const Diagnosis found = diagnose_against(notes, *even, *odd, nullptr, options);
    EXPECT_EQ(found.verdict, Verdict::no_gap) << name << ": " << found.sentence;
  }
}

TEST(Against, RefusesStacksThatCannotBeCompared) {
  const Stacks it;
  const auto frames = it.stack(1);
  EXPECT_THROW(it.compare(*frames, *it.stack(2, {}, 15)), Error);
  const auto other = it.stack(2, [](Lab& lab) { lab.settings.region.height = 20; });
  EXPECT_THROW(it.compare(*frames, *other), Error);
}

}  // namespace
}  // namespace atomcam
