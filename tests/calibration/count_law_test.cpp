// The law of counts against the sensor that the simulation has.
#include "calibration/count_law.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <numeric>

#include "calibration/sensor_fit.hpp"
#include "sensor/register_law.hpp"
#include "simulation/simulation.hpp"

namespace atomcam {
namespace {

double sum(const std::vector<double>& values) {
  return std::accumulate(values.begin(), values.end(), 0.0);
}

double moment(const std::vector<double>& law, int first, double about, int power) {
  double total = 0;
  for (std::size_t k = 0; k < law.size(); ++k)
    total += law[k] * std::pow(first + static_cast<double>(k) - about, power);
  return total;
}

// Mean and variance follow from the law's ingredients: a geometric output of mean g has variance g (g - 1).
TEST(CountLaw, HasTheMomentsOfItsParts) {
  const CountLaw law{.bias_counts = 200.3,
                     .read_noise_counts = 4,
                     .electrons_per_count = 5,
                     .em_gain = 50,
                     .events_e = 0.4,
                     .events_spread = 0.3};
  const auto p = count_probabilities(law, 100, 4096);
  EXPECT_NEAR(sum(p), 1, 1e-9);
  const double mean = 200.3 + 0.4 * 50 / 5;
  EXPECT_NEAR(moment(p, 100, 0, 1), mean, 1e-6 * mean);
  const double square_of_one = 50.0 * 49 + 50 * 50;
  const double variance = 16 + 1.0 / 12 + (0.4 * square_of_one + 0.3 * 0.4 * 0.4 * 2500) / 25;
  EXPECT_NEAR(moment(p, 100, mean, 2), variance, 1e-6 * variance);
}

TEST(CountLaw, WithoutGainIsPoissonAndNormal) {
  const CountLaw law{
      .bias_counts = 100, .read_noise_counts = 1.5, .electrons_per_count = 0.05, .em_gain = 1, .events_e = 2};
  const auto p = count_probabilities(law, 50, 1024);
  double expected = std::exp(-2.0);
  for (int n = 0; n < 6; ++n) {
    double near = 0;
    for (int k = -9; k <= 9; ++k) near += p[static_cast<std::size_t>(50 + 20 * n + k)];
    EXPECT_NEAR(near, expected, 1e-6) << n;
    expected *= 2.0 / (n + 1);
  }
}

TEST(CountLaw, SerialChargeHasTheMeanOverStages) {
  CountLaw law{
      .bias_counts = 100, .read_noise_counts = 3, .electrons_per_count = 1, .em_gain = 100, .events_e = 0};
  law.serial_events = 0.5;
  const auto p = count_probabilities(law, 0, 8192);
  const double mean_of_one = (100 - 1) / std::log(100.0);
  EXPECT_NEAR(moment(p, 0, 100, 1), 0.5 * mean_of_one, 1e-5 * mean_of_one);
}

// One electron through the sensor's own cascade: a register of finitely many stages.
TEST(CountLaw, FollowsTheCascadeOfARegister) {
  constexpr int stages = 536;
  constexpr double gain = 300;
  const std::vector<double> extra = RegisterLaw::extra_law(gain, stages, 0);
  std::vector<double> exact(8192, 0.0);
  for (std::size_t k = 0; k < extra.size() && k + 1 < exact.size(); ++k) exact[k + 1] = extra[k];
  // Few events, so that all but 1e-6 of them are alone; bins of one electron.
  CountLaw law{.bias_counts = 0, .read_noise_counts = 2, .electrons_per_count = 1, .em_gain = gain};
  law.events_e = 1e-3;
  law.stages = stages;
  const auto worst = [&] {
    const auto p = count_probabilities(law, 0, 8192);
    double most = 0, seen = 0, due = 0;
    for (std::size_t k = 24; k < 3000; ++k) {  // beyond the peak of no event
      seen += p[k] / law.events_e;
      due += exact[k];
      most = std::max(most, std::fabs(seen - due));
    }
    return most;
  };
  const double finite = worst();
  law.stages = 0;
  const double endless = worst();
  EXPECT_LT(finite, 1.5e-3);  // two events in a pixel: 5e-4 of them, counted once
  EXPECT_GT(endless, 1.5 * finite);
  EXPECT_NEAR(excess_noise_factor(gain, stages), RegisterLaw(gain, stages).excess_noise_factor(), 1e-9);
}

Lab dark_lab(double serial) {
  Lab lab = preset("ixon-ultra-897");
  auto& sensor = std::get<EmccdDescription>(lab.sensor);
  sensor.shape = {128, 128};
  sensor.clock_induced_charge_e = 0.02;
  sensor.dark_rate_e_per_s = 0;
  lab.settings.region = {0, 0, 128, 128};
  lab.settings.binning_x = lab.settings.binning_y = 1;
  lab.settings.shutter_open = false;
  lab.settings.em_gain = 300;
  lab.layout = std::vector<Site>{};
  lab.effects.clear();
  if (serial > 0) lab.effects["serial_cic"] = {serial};
  return lab;
}

CountHistogram histogram_of(const Lab& lab, int frames) {
  const Simulation simulation(lab);
  CountHistogram histogram;
  histogram.first = 100;
  histogram.occurrences.assign(4000, 0);
  for (int n = 0; n < frames; ++n) {
    const auto frame = simulation.render(static_cast<std::uint64_t>(n));
    for (const std::uint16_t count : frame.counts.pixels())
      if (count >= 100 && count < 4100) ++histogram.occurrences[count - 100u];
  }
  return histogram;
}

// Every figure of a rendered dark stack comes back within 5 of its errors; without serial charges in the
// model, the histogram that has them does not fit.
TEST(CountFit, FindsTheFiguresOfADarkStack) {
  for (const double serial : {0.0, 0.05}) {
    SCOPED_TRACE(serial);
    const Lab lab = dark_lab(serial);
    const ReadoutMode& mode = std::get<EmccdDescription>(lab.sensor)
                                  .readout_modes[static_cast<std::size_t>(lab.settings.readout_mode)];
    const CountHistogram histogram = histogram_of(lab, 60);
    CountLaw start{.bias_counts = 201,
                   .read_noise_counts = 1.2 * mode.read_noise_e / mode.electrons_per_count,
                   .electrons_per_count = mode.electrons_per_count,
                   .em_gain = 220,
                   .events_e = 0.01,
                   .serial_events = serial > 0 ? 0.01 : 0,
                   .stages = std::get<EmccdDescription>(lab.sensor).register_stages};
    const CountFit fit = fit_counts({histogram}, true, start, {.gain = true, .serial = serial > 0});
    EXPECT_NEAR(fit.law.bias_counts, lab.settings.bias_counts, 5 * fit.bias_error);
    EXPECT_NEAR(fit.law.read_noise_counts, mode.read_noise_e / mode.electrons_per_count,
                5 * fit.read_noise_error);
    EXPECT_NEAR(fit.law.em_gain, 300, 5 * fit.em_gain_error);
    EXPECT_NEAR(fit.events_e[0], 0.02, 5 * fit.events_error[0]);
    EXPECT_LT(fit.chi_square, fit.bins + 5 * std::sqrt(2.0 * fit.bins));
    if (serial == 0) continue;
    EXPECT_NEAR(fit.law.serial_events, serial, 5 * fit.serial_error);
    start.serial_events = 0;
    const CountFit plain = fit_counts({histogram}, true, start);
    EXPECT_GT(plain.chi_square, plain.bins + 10 * std::sqrt(2.0 * plain.bins));
  }
}

}  // namespace
}  // namespace atomcam
