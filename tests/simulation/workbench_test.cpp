#include "simulation/workbench.hpp"

#include <gtest/gtest.h>

#include <atomic>
#include <filesystem>
#include <thread>

#include "base/error.hpp"
#include "simulation/frame_range.hpp"

namespace atomcam {
namespace {

Lab small_lab(std::string_view name) {
  Lab lab = preset(name);
  if (auto* qcmos = std::get_if<QcmosDescription>(&lab.sensor)) qcmos->shape = {512, 512};
  lab.settings.region = {128, 96, 64, 48};
  lab.layout = std::vector<Site>{{140.25, 110, 1}, {160, 120.5, 0.8}, {180, 130, 1.2}};
  lab.scene.filling = 0.6;
  lab.scene.survival = 0.7;
  lab.place_sites();
  return lab;
}

struct Stack {
  Stack(std::size_t frames, std::size_t pixels, std::size_t sites)
      : counts(frames * pixels),
        initial(frames * sites, 9),
        final(frames * sites, 9),
        x(frames * sites),
        y(frames * sites),
        loss(frames * sites),
        emitted(frames * sites),
        expected(frames * sites),
        detected(frames * sites, -1),
        shift_x(frames, -1),
        shift_y(frames, -1),
        background(frames, -1) {}
  TruthArrays arrays() {
    return {initial.data(), final.data(),   x.data(),         y.data(),
            loss.data(),    emitted.data(), expected.data(),  detected.data(),
            shift_x.data(), shift_y.data(), background.data()};
  }
  std::vector<std::uint16_t> counts;
  std::vector<std::uint8_t> initial, final;
  std::vector<double> x, y, loss, emitted, expected;
  std::vector<std::int64_t> detected;
  std::vector<double> shift_x, shift_y, background;
};

class Ranges : public testing::TestWithParam<std::string> {};
INSTANTIATE_TEST_SUITE_P(Presets, Ranges, testing::Values("ixon-ultra-897", "orca-quest"),
                         [](const auto& param) { return param.param == "orca-quest" ? "orca" : "ixon"; });

TEST_P(Ranges, AreTheFramesOneByOneOnAnyNumberOfThreads) {
  Lab lab = small_lab(GetParam());
  set_parameter(lab, "effects.pointing_drift", "0.3");
  const Simulation simulation(lab);
  const std::size_t frames = 7, sites = 3;
  const std::size_t pixels = static_cast<std::size_t>(lab.settings.output_width()) *
                             static_cast<std::size_t>(lab.settings.output_height());
  for (const int threads : {1, 3, 16}) {
    Stack stack(frames, pixels, sites);
    render_frames(simulation, lab.settings, {11, frames}, stack.counts, stack.arrays(), threads);
    for (std::size_t n = 0; n < frames; ++n) {
      const Frame frame = simulation.render(11 + n);
      EXPECT_TRUE(
          std::ranges::equal(frame.counts.pixels(), std::span(stack.counts).subspan(n * pixels, pixels)));
      EXPECT_EQ(stack.shift_x[n], frame.truth.shift_x_px);
      EXPECT_EQ(stack.shift_y[n], frame.truth.shift_y_px);
      EXPECT_EQ(stack.background[n], frame.truth.background_e);
      for (std::size_t s = 0; s < sites; ++s) {
        const AtomTruth& atom = frame.truth.atoms[s];
        const std::size_t at = n * sites + s;
        EXPECT_EQ(stack.initial[at], atom.present_at_start);
        EXPECT_EQ(stack.final[at], atom.present_at_end);
        EXPECT_EQ(stack.x[at], atom.x_px);
        EXPECT_EQ(stack.y[at], atom.y_px);
        EXPECT_EQ(stack.loss[at], atom.loss_time_s);
        EXPECT_EQ(stack.emitted[at], atom.photons_emitted);
        EXPECT_EQ(stack.expected[at], atom.electrons_expected);
        EXPECT_EQ(stack.detected[at], atom.electrons_detected);
      }
    }
  }
}

TEST(Ranges, TruthThatIsNotWantedIsLeftOut) {
  const Lab lab = small_lab("ixon-ultra-897");
  const Simulation simulation(lab);
  std::vector<std::uint16_t> counts(2 * lab.settings.output_width() * lab.settings.output_height());
  render_frames(simulation, lab.settings, {0, 2}, counts, {}, 1);
  EXPECT_NE(counts.back(), 0);
}

TEST(Ranges, RefuseWhatDoesNotFit) {
  const Lab lab = small_lab("ixon-ultra-897");
  const Simulation simulation(lab);
  std::vector<std::uint16_t> counts(100);
  EXPECT_THROW(render_frames(simulation, lab.settings, {0, 2}, counts, {}, 1), Error);
  EXPECT_THROW(render_frames(simulation, lab.settings, {0, 0}, {}, {}, -1), Error);
  EXPECT_THROW(render_frames(simulation, lab.settings, {~std::uint64_t{0}, 2}, counts, {}, 1), Error);
  EXPECT_THROW(simulation.render_into(counts, 0, lab.settings), Error);
}

TEST(Ranges, ThePollEndsTheWork) {
  const Lab lab = small_lab("ixon-ultra-897");
  const Simulation simulation(lab);
  const std::size_t pixels = static_cast<std::size_t>(lab.settings.output_width()) *
                             static_cast<std::size_t>(lab.settings.output_height());
  std::vector<std::uint16_t> counts(100000 * pixels);
  struct Stop {};
  const auto stop = [] { throw Stop{}; };
  EXPECT_THROW(render_frames(simulation, lab.settings, {0, 100000}, counts, {}, 2, stop), Stop);
  EXPECT_EQ(counts.back(), 0);
}

TEST(Workbench, EveryKeyReadsBackWhatWasSet) {
  for (const std::string& name : preset_names()) {
    Workbench bench(preset(name));
    const std::string before = write_lab(bench.lab());
    for (const KeyInfo& key : list_keys(bench.lab())) {
      const KeyValue value = bench.get(key.key);
      bench.set(key.key, value);
      EXPECT_EQ(bench.get(key.key), value) << key.key;
      if (!key.text && !key.boolean && key.unit != "") {
        bench.set(key.key, key.maximum);
        EXPECT_EQ(bench.get(key.key),
                  key.integer ? KeyValue(static_cast<std::int64_t>(key.maximum)) : KeyValue(key.maximum))
            << key.key;
        EXPECT_THROW(bench.set(key.key, key.maximum * 2 + 1), Error) << key.key;
        bench.set(key.key, value);
      }
    }
    // Effects that were set and are off again.
    bench.change([](Lab& lab) {
      std::erase_if(lab.effects, [](const auto& effect) { return effect.second.at(0) == 0; });
    });
    EXPECT_TRUE(write_lab(bench.lab()) == before);
  }
}

TEST(Workbench, AKeyOfTheWrongKindIsRefused) {
  Workbench bench(preset("ixon-ultra-897"));
  EXPECT_THROW(bench.set("camera.em_gain", true), Error);
  EXPECT_THROW(bench.set("camera.em_gain", std::string("much")), Error);
  EXPECT_THROW(bench.set("camera.em_gain", std::numeric_limits<double>::quiet_NaN()), Error);
  EXPECT_THROW(bench.set("camera.binning_x", 1.5), Error);
  EXPECT_THROW(bench.set("sensor.em_gain", 300.0), Error);
  EXPECT_THROW(bench.get("camera.no_such_key"), Error);
  bench.set("camera.readout_rate_hz", 1.7e7);
  EXPECT_EQ(bench.get("camera.readout_rate_hz"), KeyValue(1.7e7));
  bench.set("effects.row_noise", 0.5);
  EXPECT_EQ(bench.get("effects.row_noise"), KeyValue(0.5));
}

TEST(Workbench, ARefusedChangeChangesNothing) {
  Workbench bench(preset("ixon-ultra-897"));
  const std::string before = write_lab(bench.lab());
  EXPECT_THROW(bench.change([](Lab& lab) {
    lab.seed = 77;
    throw Error("here", "no");
  }),
               Error);
  EXPECT_EQ(write_lab(bench.lab()), before);
}

TEST(Workbench, ASimulationIsKeptUntilTheLabChanges) {
  Workbench bench(small_lab("ixon-ultra-897"));
  const auto first = bench.simulation();
  EXPECT_EQ(bench.simulation(), first);
  bench.set("seed", std::int64_t{99});
  EXPECT_NE(bench.simulation(), first);
  EXPECT_EQ(first->lab().seed, 1u);
  EXPECT_EQ(bench.simulation()->lab().seed, 99u);
}

TEST(Workbench, WhatASimulationInheritsChangesNoBit) {
  for (const std::string& name : preset_names()) {
    Workbench bench(small_lab(name));
    bench.simulation()->render(0);
    for (const auto& [key, value] :
         std::vector<std::pair<std::string, KeyValue>>{{"seed", std::int64_t{8}},
                                                       {"atoms.filling", 1.0},
                                                       {"camera.serial", std::string("ANOTHER")},
                                                       {"optics.zernike.defocus_um", 0.03},
                                                       {"atoms.atom_extent_um", 0.2},
                                                       {"sensor.quantum_efficiency", 0.5}}) {
      bench.set(key, value);
      EXPECT_EQ(bench.simulation()->render(3).counts, Simulation(bench.lab()).render(3).counts) << key;
    }
  }
}

TEST(Workbench, ThreadsMayChangeAndRenderAtOnce) {
  Workbench bench(small_lab("ixon-ultra-897"));
  bench.set("camera.em_gain", 300.0);
  const CountImage high = bench.simulation()->render(0).counts;
  bench.set("camera.em_gain", 20.0);
  const CountImage low = bench.simulation()->render(0).counts;
  ASSERT_FALSE(high == low);
  std::atomic<int> strange = 0;
  {
    std::jthread changing([&] {
      for (int i = 0; i < 30; ++i) bench.set("camera.em_gain", i % 2 ? 300.0 : 20.0);
    });
    std::vector<std::jthread> rendering;
    for (int t = 0; t < 2; ++t)
      rendering.emplace_back([&] {
        for (int i = 0; i < 30; ++i) {
          const CountImage counts = bench.simulation()->render(0).counts;
          if (!(counts == high) && !(counts == low)) ++strange;
        }
      });
  }
  EXPECT_EQ(strange, 0);
}

TEST(Workbench, ALabAtOddsWithItselfGivesNoSimulation) {
  Workbench bench(small_lab("ixon-ultra-897"));
  bench.set("camera.width_px", std::int64_t{512});
  EXPECT_THROW(bench.simulation(), Error);
  bench.set("camera.offset_x_px", std::int64_t{0});
  EXPECT_EQ(bench.simulation()->lab().settings.region.width, 512);
}

TEST(WithCameraOf, TakesTheCameraAndLeavesTheScene) {
  Lab lab = preset("ixon-ultra-897");
  lab.seed = 5;
  lab.scene.filling = 0.25;
  lab.effects["blinking"] = {0.1, 0.2};
  Lab camera = preset("orca-quest");
  camera.settings.exposure_s = 0.02;
  camera.effects["row_noise"] = {0.5};
  const Lab joined = with_camera_of(lab, camera);
  EXPECT_EQ(joined.kind(), CameraKind::qcmos);
  EXPECT_EQ(joined.serial, camera.serial);
  EXPECT_EQ(joined.settings.exposure_s, 0.02);
  EXPECT_EQ(joined.seed, 5u);
  EXPECT_EQ(joined.scene.filling, 0.25);
  EXPECT_TRUE(joined.effects.contains("blinking"));
  EXPECT_TRUE(joined.effects.contains("row_noise"));
  EXPECT_FALSE(joined.effects.contains("serial_cic"));  // it belonged to the other camera
  EXPECT_EQ(joined.optics.magnification, lab.optics.magnification);
  EXPECT_EQ(joined.optics.pixel_um, 4.6);
}

TEST(LoadLab, PresetsFilesAndNeither) {
  EXPECT_EQ(load_lab("orca-quest").kind(), CameraKind::qcmos);
  const auto file = std::filesystem::temp_directory_path() / "atomcam_workbench_test.json";
  Lab lab = small_lab("orca-quest");
  lab.seed = 4711;
  save_lab(lab, file);
  EXPECT_EQ(write_lab(load_lab(file.string())), write_lab(lab));
  std::filesystem::remove(file);
  EXPECT_THROW(load_lab("orca-quets"), Error);
  EXPECT_THROW(load_lab("no/such.toml"), Error);
  EXPECT_THROW(save_lab(lab, "lab.yaml"), Error);
  EXPECT_THROW(save_lab(lab, "no/such/folder/lab.toml"), Error);
}

}  // namespace
}  // namespace atomcam
