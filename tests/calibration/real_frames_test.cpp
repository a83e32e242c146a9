// Figures of real cameras with their errors, beside what is known of them. The frames lie in the folder that
// ATOMCAM_DATA names.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <filesystem>

#include "calibration/photon_transfer.hpp"
#include "calibration/sensor_fit.hpp"
#include "calibration/stack_frames.hpp"
#include "data/stack_reader.hpp"

namespace atomcam {
namespace {

class RealFrames : public testing::Test {
 protected:
  void SetUp() override {
    const char* folder = std::getenv("ATOMCAM_DATA");
    if (!folder) GTEST_SKIP() << "ATOMCAM_DATA names no folder with real and practice stacks";
    folder_ = std::filesystem::path(folder) / "real";
  }
  static std::vector<double> image(const std::filesystem::path& file) {
    const auto reader = open_stack(file);
    std::vector<double> pixels(reader->shape().pixels());
    reader->read(0, std::span<double>(pixels));
    return pixels;
  }
  std::filesystem::path folder_;
};

// Constant light at five gains: the gain is the ratio of the signals, the conversion the photon transfer at
// gain 1, the excess noise what is left between the two.
TEST_F(RealFrames, LanlGainSeries) {
  const auto at = [&](const char* series, const std::string& name, const char* darks) {
    const auto folder = folder_ / "lanl-emccd-gain" / series;
    auto sigma = image(folder / (std::string(darks) + "_no-signal_sigma.tif"));
    for (double& s : sigma) s *= s;
    return flat_level(*open_frames(folder / (name + ".tif")),
                      image(folder / (std::string(darks) + "_no-signal_S0.tif")), sigma);
  };
  std::vector<FlatLevel> levels;
  for (int level = 1; level <= 6; ++level)
    levels.push_back(at("ADU", "1x-gain_level-0" + std::to_string(level), "1x-gain"));
  const PhotonTransfer conversion = photon_transfer(levels);
  const double electrons_per_count = 1 / conversion.slope,
               conversion_error = conversion.slope_error / (conversion.slope * conversion.slope);
  std::printf("lanl: electrons per count %.3f +- %.3f (authors' map: 3.859)\n", electrons_per_count,
              conversion_error);
  EXPECT_NEAR(electrons_per_count, 3.859, 0.05 * 3.859);
  const FlatLevel one = at("gain-GS", "1x-gain", "1x-gain");
  const auto signal_error = [](const FlatLevel& level) {
    return std::hypot(
        std::sqrt(level.variance_counts / (9.0 * static_cast<double>(level.frames))) / level.signal_counts,
        level.light_noise / std::sqrt(static_cast<double>(level.frames)));
  };
  double nominal_before = 1;
  struct Known {
    int nominal;
    double gain;
  };
  for (const auto& [nominal, known] : {Known{5, 4.79}, {25, 23.0}, {100, 90.1}, {300, 262}}) {
    const std::string name = std::to_string(nominal) + "x-gain";
    const FlatLevel level = at("gain-GS", name, name.c_str());
    const double gain = level.signal_counts / one.signal_counts,
                 error = gain * std::hypot(signal_error(level), signal_error(one));
    const double excess = level.variance_counts / level.signal_counts * electrons_per_count / gain;
    const double excess_error = excess * std::hypot(level.variance_error / level.variance_counts,
                                                    error / gain, conversion_error / electrons_per_count);
    std::printf("lanl: nominal %3d  gain %.3f +- %.3f (signal ratio noted %.4g)  excess noise %.3f +- %.3f\n",
                nominal, gain, error, known, excess, excess_error);
    EXPECT_NEAR(gain, known, 0.005 * known + 5 * error);  // the notes have three digits
    EXPECT_GT(gain, nominal_before);
    EXPECT_LT(excess, 2 + 5 * excess_error);
    nominal_before = gain;
  }
}

// Dark frames of an EMCCD with its gain on: the plain law, then with charges born in the register.
TEST_F(RealFrames, JqiGainTail) {
  std::vector<std::uint64_t> occurrences(65536, 0);
  const auto frames = open_frames(folder_ / "jqi-andor512-emccd" / "Background_*.tiff");
  ASSERT_EQ(frames->shape(), (Shape{512, 512}));
  frames->visit([&](std::size_t n, const CountImage& frame) {
    if (n < 2) return;  // the baseline has not settled
    for (int r = 128; r < 384; ++r)
      for (int c = 128; c < 384; ++c) ++occurrences[frame(r, c)];
  });
  CountHistogram histogram;
  histogram.first = 465;
  histogram.occurrences.assign(occurrences.begin() + 465, occurrences.begin() + 720);
  // The gain in counts per electron is all that shows: one electron per count and a register of 300 stand for
  // it.
  CountLaw start{
      .bias_counts = 487, .read_noise_counts = 3, .electrons_per_count = 30, .em_gain = 300, .events_e = 0.5};
  start.stages = 536;
  const CountFit plain = fit_counts({histogram}, true, start);
  start.serial_events = 0.3;
  const CountFit serial = fit_counts({histogram}, true, start, {.gain = true, .serial = true});
  for (const auto* fit : {&plain, &serial})
    std::printf(
        "jqi: bias %.3f +- %.3f  read noise %.3f +- %.3f counts  gain %.3f +- %.3f counts/e  events %.4f +- "
        "%.4f  "
        "serial %.4f +- %.4f  chi square %.1f per bin\n",
        fit->law.bias_counts, fit->bias_error, fit->law.read_noise_counts, fit->read_noise_error,
        fit->law.em_gain / 30, fit->em_gain_error / 30, fit->events_e[0], fit->events_error[0],
        fit->law.serial_events, fit->serial_error, fit->chi_square / fit->bins);
  EXPECT_LT(serial.chi_square, 0.5 * plain.chi_square);
  EXPECT_NEAR(serial.law.em_gain / 30, 10.34, 0.05 * 10.34);
  EXPECT_NEAR(serial.law.read_noise_counts, 2.44, 0.1);
  // The notes' fit began its register at one count: what both know is the events per e-fold of gain.
  const double per_fold = serial.law.serial_events / std::log(serial.law.em_gain);
  std::printf("jqi: serial events per e-fold of gain %.4f +- %.4f (noted 0.53 / ln 10.34 = %.4f)\n", per_fold,
              serial.serial_error / std::log(serial.law.em_gain), 0.53 / std::log(10.34));
  EXPECT_NEAR(per_fold, 0.53 / std::log(10.34), 0.1 * per_fold);
}

// Ten frames each at four gains without dark frames: slopes of variance over signal between pixels.
TEST_F(RealFrames, QuickFitGainSteps) {
  double before = 0;
  struct Known {
    const char* name;
    double slope;
  };
  for (const auto& [name, known] : {Known{"noEM", 0.064}, {"EM10", 1.19}, {"EM100", 11.6}, {"EM300", 33.7}}) {
    const auto frames =
        open_frames(folder_ / "quickfit3-du860" / (std::string("1ms_") + name + "_noFT_000.tif"));
    // Frame-to-frame light noise taken out by pairs: differences of neighbouring frames, scaled to one level.
    const StackSums sums = sum_stack(*frames);
    const std::size_t pixels = sums.sum.pixels().size();
    std::vector<double> zero(pixels, 0.0), variance(pixels, 0.0);
    double grand = 0;
    for (const double mean : sums.frame_mean) grand += mean / static_cast<double>(sums.frames);
    frames->visit([&](std::size_t n, const CountImage& frame) {
      const double scale = sums.frame_mean[n] / grand;
      for (std::size_t i = 0; i < pixels; ++i) {
        const double rest = frame.pixels()[i] - scale * sums.mean(i);
        variance[i] += rest * rest / static_cast<double>(sums.frames - 1);
      }
    });
    // Twenty groups of pixels by their mean, straight line of variance over mean; saturated pixels left out.
    std::vector<std::pair<double, double>> points;
    for (std::size_t i = 0; i < pixels; ++i)
      if (sums.mean(i) < 15000) points.push_back({sums.mean(i), variance[i]});
    double w = 0, x = 0, y = 0, xx = 0, xy = 0;
    for (const auto& [mean, v] : points) {
      const double weight = 1 / ((1 + mean) * (1 + mean));  // the error of a variance grows with it
      w += weight, x += weight * mean, y += weight * v, xx += weight * mean * mean, xy += weight * mean * v;
    }
    const double slope = (w * xy - x * y) / (w * xx - x * x);
    const double offset = (y - slope * x) / w;
    double chi = 0;
    for (const auto& [mean, v] : points) {
      const double off = (v - offset - slope * mean) / (1 + mean);
      chi += off * off / static_cast<double>(points.size() - 2);
    }
    const double error = std::sqrt(chi * w / (w * xx - x * x));
    std::printf("quickfit3: %-5s  variance over signal %.4f +- %.4f counts (noted %.3f)%s\n", name, slope,
                error, known, before > 0 ? "" : "  electrons per count = its inverse");
    EXPECT_NEAR(slope, known, 5 * error + 0.05 * known);
    if (before > 0) std::printf("quickfit3: step x %.2f\n", slope / before);
    before = slope;
  }
}

}  // namespace
}  // namespace atomcam
