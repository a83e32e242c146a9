#include <gtest/gtest.h>

#include <cmath>
#include <map>

#include "calibration/site_model.hpp"
#include "diagnosis/population.hpp"

namespace atomcam {
namespace {

/// Dark pixels of an EMCCD with a register, 60 frames of 64 x 64.
Lab camera() {
  Lab lab = preset("ixon-ultra-897");
  lab.effects.clear();
  lab.scene.filling = 0;
  lab.layout = SiteGrid{.columns = 0, .rows = 0};
  lab.place_sites();
  lab.settings.region = {0, 0, 64, 64};
  lab.settings.binning_x = lab.settings.binning_y = 1;
  lab.settings.em_gain = 300;
  std::get<EmccdDescription>(lab.sensor).clock_induced_charge_e = 0.1;
  lab.stray_light_photons_per_s = 0;
  return lab;
}

std::map<std::string, double> law_of(const Lab& lab, std::uint64_t stack) {
  StackPlan plan;
  plan.model = stack_model(camera());
  plan.frames = 60;
  plan.seed = 5;
  const BatteryValues values = simulate_and_measure(lab, plan, stack);
  const auto declarations = battery(plan.model, false);
  std::map<std::string, double> law;
  for (std::size_t k = 0; k < declarations.size(); ++k)
    if (const std::string prefix = "light.pixel_histogram.law."; declarations[k].name.starts_with(prefix))
      law[declarations[k].name.substr(prefix.size())] = values.whole[k];
  return law;
}

TEST(LawBands, TheCalibratedCameraHasItsLaw) {
  std::map<std::string, double> squares;
  constexpr int stacks = 20;
  for (std::uint64_t stack = 0; stack < stacks; ++stack)
    for (const auto& [name, value] : law_of(camera(), stack)) {
      if (name == "misfit") {
        EXPECT_LT(std::fabs(value), 5 * std::sqrt(2.0 / 40)) << "stack " << stack;
        continue;
      }
      EXPECT_LT(std::fabs(value), 5) << name << ", stack " << stack;
      squares[name] += value * value / stacks;
    }
  ASSERT_EQ(squares.size(), 12u);
  // What calibration could take has been taken out of each: at most a Poisson deviation is left.
  for (const auto& [name, square] : squares) EXPECT_LT(square, 1 + 5 * std::sqrt(2.0 / stacks)) << name;
  EXPECT_GT(squares["to_0.7_gains"], 0.1);
}

TEST(LawBands, AnotherCalibrationIsNotAMisfit) {
  Lab lab = camera();
  auto& sensor = std::get<EmccdDescription>(lab.sensor);
  lab.settings.bias_counts += 0.1;
  lab.settings.em_gain *= 1.03;
  sensor.clock_induced_charge_e *= 1.1;
  for (ReadoutMode& mode : sensor.readout_modes) mode.read_noise_e *= 1.01;
  for (const auto& [name, value] : law_of(lab, 1)) EXPECT_LT(std::fabs(value), 5) << name;
}

TEST(LawBands, ChargeBornInTheRegisterShowsBetweenReadNoiseAndTail) {
  Lab lab = camera();
  lab.effects["serial_cic"] = {0.5};
  const auto law = law_of(lab, 1);
  EXPECT_GT(law.at("to_5_read_noises"), 8);
  EXPECT_GT(law.at("misfit"), 0.5);
}

}  // namespace
}  // namespace atomcam
