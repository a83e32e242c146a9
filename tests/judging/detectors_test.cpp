#include "judging/detectors.hpp"

#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <filesystem>
#include <fstream>

#include "base/error.hpp"
#include "data/stack.hpp"
#include "judging/scores_file.hpp"
#include "judging/stack_truth.hpp"
#include "simulation/simulation.hpp"

namespace atomcam {
namespace {

namespace fs = std::filesystem;

class Rendered : public testing::Test {
 protected:
  void SetUp() override {
    folder_ = fs::temp_directory_path() / ("atomcam-judging-" + std::to_string(getpid()));
    fs::create_directories(folder_);
  }
  void TearDown() override { fs::remove_all(folder_); }

  /// A small array, dim enough that detectors err.
  Lab render(std::uint64_t frames, const std::string& exposure_s) {
    Lab lab = preset("ixon-ultra-897");
    set_parameter(lab, "camera.exposure_s", exposure_s, "test");
    set_parameter(lab, "atoms.survival", "0.8", "test");
    const Simulation simulation(lab);
    const auto writer = StackWriter::create(
        file(), {lab.settings.output_height(), lab.settings.output_width()}, {write_lab(lab), "{}"}, frames);
    for (std::uint64_t n = 0; n < frames; ++n) {
      const Frame frame = simulation.render(n);
      writer->append(frame.counts, frame.truth.to_json());
    }
    writer->finish();
    return lab;
  }
  fs::path file() const { return folder_ / "frames.npy"; }
  fs::path write(const std::string& name, const std::string& text) const {
    std::ofstream(folder_ / name) << text;
    return folder_ / name;
  }

  fs::path folder_;
};

TEST_F(Rendered, MatchedFilterBeatsTheThresholdWhereLightIsScarce) {
  const Lab lab = render(60, "0.012");
  const auto stack = open_stack(file());
  const auto truth = stack_truth(*stack, lab.scene.sites, FilledAt::start);
  const StackPlace place{lab.settings.region.offset_x, lab.settings.region.offset_y, lab.settings.binning_x,
                         lab.settings.binning_y};
  const auto judged = [&](Detector detector) {
    const Detected detected = detect(*stack, lab, place, detector, truth);
    EXPECT_EQ(detected.scores.frames, 30u);
    return judge(detected.scores, detected.truth, detected.threshold, lab.settings.exposure_s);
  };
  const Judgement threshold = judged(Detector::threshold), matched = judged(Detector::matched);
  EXPECT_GT(threshold.auc, 0.5 + 5 * threshold.auc_error);
  EXPECT_GT(matched.auc - threshold.auc, 5 * std::hypot(matched.auc_error, threshold.auc_error));
  EXPECT_GT(matched.fidelity.value(), threshold.fidelity.value());
  // Taught by other frames, the threshold cannot beat the best with the truth in hand, and is near it.
  EXPECT_LE(matched.fidelity.value(), matched.best_fidelity);
  EXPECT_LT(matched.best_fidelity - matched.fidelity.value(), 5 * matched.fidelity.error);
  // An atom that is lost early shines less.
  const auto& lost = matched.by_loss;
  EXPECT_GT(lost[4].found.value() - lost[0].found.value(),
            5 * std::hypot(lost[4].found.error, lost[0].found.error));
  // A frame off its sites knows nothing.
  const Detected off = detect(*stack, lab, {place.offset_x_px - 500, place.offset_y_px - 500, 1, 1},
                              Detector::threshold, truth);
  const Judgement blind = judge(off.scores, off.truth, off.threshold, 1);
  EXPECT_LT(std::fabs(blind.auc - 0.5), 5 * blind.auc_error);
}

TEST_F(Rendered, TruthTellsLossesAndNeighbours) {
  const Lab lab = render(4, "0.05");
  const auto stack = open_stack(file());
  const std::size_t sites = lab.scene.sites.size();
  const auto start = stack_truth(*stack, lab.scene.sites, FilledAt::start),
             end = stack_truth(*stack, lab.scene.sites, FilledAt::end);
  const Simulation simulation(lab);
  std::size_t lost = 0;
  for (std::uint64_t n = 0; n < 4; ++n) {
    const FrameTruth truth = simulation.render(n).truth;
    for (std::size_t s = 0; s < sites; ++s) {
      const SiteTruth& site = start[n * sites + s];
      EXPECT_EQ(site.filled, truth.atoms[s].present_at_start);
      EXPECT_EQ(end[n * sites + s].filled, truth.atoms[s].present_at_end);
      EXPECT_EQ(site.electrons, static_cast<float>(truth.atoms[s].electrons_detected));
      EXPECT_LE(site.neighbours, 4);
      if (!site.lost) continue;
      ++lost;
      EXPECT_NEAR(site.loss_s, truth.atoms[s].loss_time_s, 1e-5 * truth.atoms[s].loss_time_s + 1e-9);
    }
  }
  EXPECT_GT(lost, 0u);
  EXPECT_THROW(stack_truth(*stack, std::span(lab.scene.sites).first(3), FilledAt::start), Error);
}

TEST_F(Rendered, ScoresComeInEveryFormat) {
  const std::vector<float> expected = {0, 1, 0.25f, 1, 0, 0.5f};
  EXPECT_EQ(read_scores(write("a.csv", "a,b,c\n# note\n0,1,0.25\n1, 0, 5e-1\n"), 2, 3).values, expected);
  EXPECT_EQ(read_scores(write("a.json", "[[0,true,0.25],[1,0,0.5]]"), 2, 3).values, expected);
  EXPECT_EQ(read_scores(write("b.json", R"({"occupancy":["011","100"]})"), 2, 3).values,
            (std::vector<float>{0, 1, 1, 1, 0, 0}));
  const auto npy = [&](const std::string& shape) {
    std::string header = "{'descr': '<f4', 'fortran_order': False, 'shape': (" + shape + "), }";
    header.resize(117, ' ');
    return write("a.npy", std::string("\x93NUMPY\x01\x00\x76\x00", 10) + header + "\n" +
                              std::string(reinterpret_cast<const char*>(expected.data()), 24));
  };
  EXPECT_EQ(read_scores(npy("2, 3"), 2, 3).values, expected);
  EXPECT_EQ(read_scores(npy("2, 1, 3"), 2, 3).values, expected);
  const auto complaint = [&](const std::string& name, const std::string& text) {
    try {
      read_scores(write(name, text), 2, 3);
    } catch (const Error& error) {
      return std::string(error.what());
    }
    return std::string();
  };
  EXPECT_NE(complaint("c.csv", "0,1,0\n1,1\n").find("frame 1: 2 values; the lab has 3 sites"),
            std::string::npos);
  EXPECT_NE(complaint("c.csv", "0,1,0\n").find("1 frames; the stack has 2"), std::string::npos);
  EXPECT_NE(complaint("c.csv", "0,1,0\n1,nan,0\n").find("frame 1: site 1 is nan"), std::string::npos);
  EXPECT_NE(complaint("c.csv", "0,1,0\n1,x,0\n").find("frame 1: not a line"), std::string::npos);
  EXPECT_NE(complaint("c.json", "{}").find("no JSON list"), std::string::npos);
  EXPECT_NE(complaint("c.npy", "junk").find("c.npy"), std::string::npos);
}

}  // namespace
}  // namespace atomcam
