// Each effect against its own model: sizes at five standard errors, conservation of atoms and charge, and
// what every declaration must hold.

#include "effects/effect.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <numeric>
#include <set>
#include <string>
#include <vector>

#include "base/observable.hpp"
#include "effects/patterns.hpp"

namespace atomcam {
namespace {

/// A small EMCCD, a grid of sites and settings: all that a hook may ask for.
struct Stage {
  Stage() {
    EmccdDescription description;
    description.shape = {128, 128};
    ReadoutMode mode;
    mode.electrons_per_count = 5;
    mode.read_noise_e = 1;
    description.readout_modes.push_back(mode);
    sensor = make_emccd(description, "test");
    settings.region = {0, 0, 128, 128};
    settings.exposure_s = 0.1;
    for (int j = 0; j < 12; ++j)
      for (int i = 0; i < 12; ++i) scene.sites.push_back({10.0 * i + 5, 10.0 * j + 5, 1});
    scene.filling = 1;
    scene.survival = 1;
  }
  FrameContext context(std::string_view effect, std::uint64_t frame) const {
    return {.seed = 7,
            .frame = frame,
            .effect = effect,
            .serial = "test",
            .settings = &settings,
            .scene = &scene,
            .optics = &optics,
            .sensor = sensor.get(),
            .electrons_of = &electrons_of};
  }
  SceneFrame atoms(std::uint64_t frame) const { return draw_scene(scene, settings.exposure_s, 7, frame); }

  CameraSettings settings;
  SceneDescription scene;
  OpticsDescription optics;
  std::shared_ptr<const Sensor> sensor;
  std::function<ElectronImage(std::uint64_t)> electrons_of = [](std::uint64_t) {
    return ElectronImage({128, 128}, 100);
  };
};

std::unique_ptr<Effect> make(std::string_view name, ParameterValues first) {
  const EffectDeclaration* declaration = find_effect(name);
  EXPECT_NE(declaration, nullptr) << name;
  for (std::size_t i = first.size(); i < declaration->parameters.size(); ++i)
    first.push_back(declaration->parameters[i].default_value);
  return declaration->make(first);
}

struct Moments {
  double sum = 0, sum2 = 0, count = 0;
  void add(double value) {
    sum += value;
    sum2 += value * value;
    ++count;
  }
  double mean() const { return sum / count; }
  double variance() const { return sum2 / count - mean() * mean(); }
  double mean_error() const { return std::sqrt(variance() / count); }
  /// Of the variance of a normal sample.
  double variance_error() const { return variance() * std::sqrt(2 / count); }
};

TEST(Catalogue, DeclaresWhatEveryoneNeeds) {
  const std::set<std::string_view> known(observables.begin(), observables.end());
  std::set<std::string> names;
  for (const EffectDeclaration& effect : effect_catalogue()) {
    EXPECT_TRUE(names.insert(effect.name).second) << effect.name;
    EXPECT_FALSE(effect.summary.empty() || effect.reference.empty() || effect.observables.empty())
        << effect.name;
    EXPECT_TRUE(effect.emccd || effect.qcmos) << effect.name;
    ASSERT_FALSE(effect.parameters.empty()) << effect.name;
    EXPECT_EQ(effect.parameters.front().minimum, 0) << effect.name << ": its strength must reach zero";
    for (const std::string& observable : effect.known_by)
      EXPECT_NE(std::find(effect.observables.begin(), effect.observables.end(), observable),
                effect.observables.end())
          << effect.name;
    for (const std::string& observable : effect.observables)
      EXPECT_TRUE(known.contains(observable)) << observable;
    std::set<std::string> keys;
    for (const ParameterDeclaration& parameter : effect.parameters) {
      EXPECT_TRUE(keys.insert(parameter.key).second) << effect.name << "." << parameter.key;
      EXPECT_LE(parameter.minimum, parameter.default_value) << effect.name << "." << parameter.key;
      EXPECT_GE(parameter.maximum, parameter.default_value) << effect.name << "." << parameter.key;
      EXPECT_FALSE(parameter.meaning.empty()) << effect.name << "." << parameter.key;
    }
  }
  EXPECT_EQ(names.size(), 28u);
}

TEST(Noise, ThatWandersHasUnitVarianceAtAnyFrame) {
  const Stage stage;
  for (const std::uint64_t phase : {0u, 3u, 7u}) {
    Moments moments;
    for (std::uint64_t k = 0; k < 4000; ++k)
      moments.add(wandering(stage.context("x", 40 * k + phase), "w", 10));
    EXPECT_NEAR(moments.mean(), 0, 5 * moments.mean_error());
    EXPECT_NEAR(moments.variance(), 1, 5 * moments.variance_error());
  }
}

TEST(Noise, AutoregressiveHasItsVarianceAndCorrelation) {
  const Stage stage;
  const double rho = 0.6;
  Moments moments, products;
  for (std::uint64_t k = 0; k < 4000; ++k) {
    const double a = autoregressive(stage.context("x", 50 * k), "w", rho);
    moments.add(a);
    products.add(a * autoregressive(stage.context("x", 50 * k + 1), "w", rho));
  }
  EXPECT_NEAR(moments.variance(), 1, 5 * moments.variance_error());
  EXPECT_NEAR(products.mean(), rho, 5 * products.mean_error());
}

TEST(SceneEffects, IntensityNoiseIsCommonAndBrightnessSpreadIsFixed) {
  const Stage stage;
  const auto noise = make("frame_intensity_noise", {0.05, 0});
  const auto spread = make("site_brightness_spread", {0.1});
  Moments common;
  for (std::uint64_t frame = 0; frame < 3000; ++frame) {
    SceneFrame scene = stage.atoms(frame);
    const double before = scene.emitters[0].rate_hz;
    noise->apply_to_scene(scene, stage.context("frame_intensity_noise", frame));
    common.add(scene.emitters[0].rate_hz / before);
    EXPECT_EQ(scene.emitters[0].rate_hz, scene.emitters[7].rate_hz);
  }
  EXPECT_NEAR(common.variance(), 0.0025, 5 * common.variance_error());
  SceneFrame first = stage.atoms(0), later = stage.atoms(9);
  const double before = first.emitters[0].rate_hz;
  spread->apply_to_scene(first, stage.context("site_brightness_spread", 0));
  spread->apply_to_scene(later, stage.context("site_brightness_spread", 9));
  Moments sites;
  for (std::size_t i = 0; i < first.emitters.size(); ++i) {
    sites.add(first.emitters[i].rate_hz / before);
    EXPECT_EQ(first.emitters[i].rate_hz, later.emitters[i].rate_hz);
  }
  EXPECT_NEAR(sites.variance(), 0.01, 5 * sites.variance_error());
}

TEST(SceneEffects, PositionScatterIsFixedAndTheSameAlongBothAxes) {
  const Stage stage;
  const auto scatter = make("site_position_scatter", {0.3});
  Moments along[2];
  for (std::uint64_t seed = 0; seed < 40; ++seed) {
    const SceneFrame before = stage.atoms(0);
    SceneFrame first = before, later = before;
    FrameContext context = stage.context("site_position_scatter", 0);
    context.seed = seed;
    scatter->apply_to_scene(first, context);
    context.frame = 9;
    scatter->apply_to_scene(later, context);
    for (std::size_t i = 0; i < before.emitters.size(); ++i) {
      along[0].add(first.emitters[i].x_px - before.emitters[i].x_px);
      along[1].add(first.emitters[i].y_px - before.emitters[i].y_px);
      EXPECT_EQ(first.emitters[i].x_px, later.emitters[i].x_px);
      EXPECT_EQ(first.emitters[i].y_px, later.emitters[i].y_px);
    }
  }
  for (const Moments& axis : along) {
    EXPECT_NEAR(axis.mean(), 0, 5 * axis.mean_error());
    EXPECT_NEAR(axis.variance(), 0.09, 5 * axis.variance_error());
  }
}

TEST(SceneEffects, HoppingMovesAtomsOrLosesPairs) {
  Stage stage;
  stage.scene.filling = 0.3;
  const auto hopping = make("atom_hopping", {0.2});
  double hops = 0, atoms = 0;
  for (std::uint64_t frame = 0; frame < 300; ++frame) {
    SceneFrame scene = stage.atoms(frame);
    const std::size_t before = scene.emitters.size();
    hopping->apply_to_scene(scene, stage.context("atom_hopping", frame));
    atoms += static_cast<double>(before);
    std::size_t at_end = 0, stopped = 0;
    for (const Atom& atom : scene.atoms) at_end += atom.present_at_end;
    for (std::size_t e = 0; e < before; ++e) stopped += scene.emitters[e].end_s < stage.settings.exposure_s;
    EXPECT_LE(at_end, before);  // atoms are never made
    hops += static_cast<double>(stopped);
    for (const Emitter& emitter : scene.emitters) EXPECT_LE(emitter.start_s, emitter.end_s);
  }
  // Every hop ends one light; a collision ends a second one, so the fraction lies between p and 2 p.
  EXPECT_GT(hops / atoms, 0.2 - 5 * std::sqrt(0.2 / atoms));
  EXPECT_LT(hops / atoms, 0.4);
}

TEST(SceneEffects, BlinkingTakesItsShareOfTheLight) {
  const Stage stage;
  const auto blinking = make("blinking", {0.3, 0.005});
  Moments share;
  for (std::uint64_t frame = 0; frame < 60; ++frame) {
    SceneFrame scene = stage.atoms(frame);
    std::vector<double> lit(stage.scene.sites.size());
    blinking->apply_to_scene(scene, stage.context("blinking", frame));
    for (const Emitter& emitter : scene.emitters) lit[emitter.site] += emitter.end_s - emitter.start_s;
    for (const double time : lit) share.add(time / stage.settings.exposure_s);
  }
  EXPECT_NEAR(share.mean(), 0.7, 5 * share.mean_error());
}

// The spread of the response is that of sensitivity and of gain together, whatever the share.
TEST(CountEffects, ResponseSpreadsInSensitivityAndGain) {
  const Stage stage;
  for (const double share : {0.0, 0.3, 1.0}) {
    const auto effect = make("pixel_response_nonuniformity", {0.05, share});
    const FrameContext context = stage.context("pixel_response_nonuniformity", 0);
    LightField light;
    effect->apply_to_light(light, context);
    EXPECT_EQ(light.response_ratio == nullptr, share == 1);
    Moments sensitivity, gain, both;
    for (int row = 0; row < 128; ++row) {
      std::vector<float> counts(128, static_cast<float>(stage.settings.bias_counts) + 1000);
      effect->apply_to_counts(row, counts, context);
      for (int c = 0; c < 128; ++c) {
        const double seen = light.response_ratio ? static_cast<double>((*light.response_ratio)(row, c)) : 1;
        const double read = (static_cast<double>(counts[c]) - stage.settings.bias_counts) / 1000;
        sensitivity.add(seen), gain.add(read), both.add(seen * read);
      }
    }
    const double error = 5 / std::sqrt(2 * 128.0 * 128);
    EXPECT_NEAR(std::sqrt(both.variance()), 0.05, 0.05 * (error + 0.002)) << share;
    EXPECT_NEAR(std::sqrt(gain.variance()), 0.05 * std::sqrt(share), 0.05 * error) << share;
    EXPECT_NEAR(std::sqrt(sensitivity.variance()), 0.05 * std::sqrt(1 - share), 0.05 * error) << share;
  }
}

TEST(ElectronEffects, CrosstalkKeepsEveryElectron) {
  const Stage stage;
  ElectronImage image({128, 128});
  image(64, 64) = 100000;
  make("pixel_crosstalk", {0.1})->apply_to_electrons(image, stage.context("pixel_crosstalk", 0));
  std::int64_t total = 0;
  for (const std::int32_t electrons : image.pixels()) total += electrons;
  EXPECT_EQ(total, 100000);
  EXPECT_NEAR(image(64, 64), 90000, 5 * std::sqrt(100000 * 0.1 * 0.9));
  EXPECT_NEAR(image(63, 64), 2500, 5 * std::sqrt(2500.0));
}

std::shared_ptr<const Sensor> small_qcmos() {
  QcmosDescription description;
  description.shape = {128, 128};
  ReadoutMode mode;
  mode.electrons_per_count = 0.1;
  mode.read_noise_e = 0.4;
  description.readout_modes.push_back(mode);
  return make_qcmos(description, "test");
}

// Coupled voltages keep the light and correlate the noise: of k in four neighbours, 2 k / 4 (1 - k) of the
// variance.
TEST(ElectronEffects, CoupledPixelsOfAQcmosCorrelate) {
  Stage stage;
  const auto ccd = stage.sensor;
  stage.sensor = small_qcmos();
  ElectronImage held({128, 128});
  RandomStream random(3, stream_id("held"), 0, 0);
  for (std::int32_t& electrons : held.pixels()) electrons = static_cast<std::int32_t>(random() % 1000);
  constexpr double k = 0.2, variance = 1000.0 * 1000 / 12, pixels = 128 * 128;
  const auto effect = make("pixel_crosstalk", {k, 1});
  const FrameContext context = stage.context("pixel_crosstalk", 0);
  const SensorLight dark;
  const auto readout = stage.sensor->begin(stage.settings, dark, 7, 0);
  ElectronImage image = held;
  effect->apply_to_electrons(image, context);
  double product = 0, sum = 0, before = 0;
  for (int row = 0; row < 128; ++row) {
    std::vector<float> output(image.row(row).begin(), image.row(row).end());
    effect->apply_to_voltages(row, output, image, *readout, context);
    for (int c = 0; c + 1 < 128; ++c)
      product += (static_cast<double>(output[c]) - 499.5) * (static_cast<double>(output[c + 1]) - 499.5);
    for (int c = 0; c < 128; ++c) sum += static_cast<double>(output[c]), before += held(row, c);
  }
  EXPECT_NEAR(sum, before, 1);
  const double error = variance / std::sqrt(pixels);
  EXPECT_NEAR(product / (127 * 128), 2 * k / 4 * (1 - k) * variance, 5 * error);
  stage.sensor = ccd;  // its register is behind: nothing couples, all diffuses
  std::vector<float> output(128, 7);
  effect->apply_to_voltages(5, output, held, *readout, stage.context("pixel_crosstalk", 0));
  EXPECT_EQ(output, std::vector<float>(128, 7));
}

// Behind the amplifiers the read noise couples as well: along rows and columns.
TEST(ElectronEffects, CoupledReadNoiseOfAQcmosCorrelates) {
  Stage stage;
  stage.sensor = small_qcmos();
  const SensorLight dark;
  const ElectronImage nothing({128, 128});
  constexpr double k = 0.2;
  for (const double share : {0.0, 0.5, 1.0}) {
    const auto effect = make("pixel_crosstalk", {k, 1, share});
    double across = 0, down = 0, square = 0, alone = 0;
    for (std::uint64_t frame = 0; frame < 10; ++frame) {
      const FrameContext context = stage.context("pixel_crosstalk", frame);
      const auto readout = stage.sensor->begin(stage.settings, dark, 7, frame);
      std::vector<float> above(128), noise(128), output(128);
      for (int row = 0; row < 128; ++row) {
        std::swap(above, output);
        readout->read_noise(row, noise);
        output = noise;
        effect->apply_to_voltages(row, output, nothing, *readout, context);
        for (std::size_t c = 0; c < 127; ++c) {
          across += static_cast<double>(output[c]) * static_cast<double>(output[c + 1]);
          if (row > 0) down += static_cast<double>(output[c]) * static_cast<double>(above[c]);
          square += static_cast<double>(output[c]) * static_cast<double>(output[c]);
          alone += static_cast<double>(noise[c]) * static_cast<double>(noise[c]);
        }
      }
    }
    const double part = k * share, own = (1 - part) * (1 - part) + part * part / 4;
    const double neighbours = 2 * part / 4 * (1 - part), error = 5 / std::sqrt(10.0 * 128 * 127);
    EXPECT_NEAR(across / alone, neighbours, error) << share;
    EXPECT_NEAR(down / alone, neighbours, error) << share;
    EXPECT_NEAR(square / alone, own, error) << share;
  }
}

TEST(ElectronEffects, HotPixelsCosmicRaysAndLagHaveTheirMeans) {
  const Stage stage;
  const double pixels = 128 * 128;
  double hot = 0, expected_hot = 0.01 * pixels * 50 * stage.settings.exposure_s;
  Moments cosmic, lag;
  const auto hot_pixels = make("hot_pixels", {0.01, 50});
  const auto cosmic_rays = make("cosmic_rays", {50, 1000, 4});
  const auto image_lag = make("image_lag", {0.05, 1});
  for (std::uint64_t frame = 1; frame <= 200; ++frame) {
    ElectronImage image({128, 128});
    hot_pixels->apply_to_electrons(image, stage.context("hot_pixels", frame));
    for (const std::int32_t e : image.pixels()) hot += e / 200.0;
    ElectronImage rays({128, 128});
    cosmic_rays->apply_to_electrons(rays, stage.context("cosmic_rays", frame));
    double charge = 0;
    for (const std::int32_t e : rays.pixels()) charge += e;
    cosmic.add(charge);
    ElectronImage after({128, 128});
    image_lag->apply_to_electrons(after, stage.context("image_lag", frame));
    double left = 0;
    for (const std::int32_t e : after.pixels()) left += e / pixels;
    lag.add(left);
  }
  // Which pixels are hot, and how hot, is drawn once: their number has the scatter of a Poisson law, their
  // rates that of an exponential one.
  EXPECT_NEAR(hot, expected_hot, 5 * expected_hot * std::sqrt(2 / (0.01 * pixels)));
  EXPECT_GT(cosmic.mean(), 0);
  EXPECT_NEAR(lag.mean(), 5, 5 * lag.mean_error() + 1e-9);
}

TEST(LightEffects, SmearIsTheShareOfTheExposureThatTheShiftTakes) {
  Stage stage;
  stage.settings.binning_y = 2;
  const auto smear = [&](double asymmetry) {
    LightField light;
    make("frame_transfer_smear", {100, asymmetry})
        ->apply_to_light(light, stage.context("frame_transfer_smear", 0));
    return light;
  };
  const double share = 100 * 2 * stage.settings.vertical_shift_s / stage.settings.exposure_s;
  EXPECT_DOUBLE_EQ(smear(0).smear_from_above, share);
  EXPECT_DOUBLE_EQ(smear(0).smear_from_below, share);
  // To one side only.
  EXPECT_EQ(smear(1).smear_from_above, 0);
  EXPECT_DOUBLE_EQ(smear(1).smear_from_below, share);
  EXPECT_DOUBLE_EQ(smear(-0.5).smear_from_below, share / 2);
  // No light while the frame is shifted, no smear.
  stage.settings.pulsed_light = true;
  EXPECT_FALSE(smear(0).smears());
  stage.settings.pulsed_light = false;
  stage.settings.frame_transfer = false;
  EXPECT_FALSE(smear(0).smears());
}

TEST(RegisterEffects, TheTailHoldsWhatIsLeftBehind) {
  Stage stage;
  const auto readout = stage.sensor->begin(stage.settings, {}, 7, 0);
  std::vector<float> row(128);
  row[20] = 10000;
  make("cti_tail", {0.1, 2})->apply_to_register(0, row, *readout, stage.context("cti_tail", 0));
  EXPECT_FLOAT_EQ(row[20], 9000);
  // Released with 1 / (1 + 2) of what is trapped at every pixel, and left behind again by a tenth.
  EXPECT_NEAR(row[21], 10000 * 0.1 / 3, 1e-3 * 10000 * 0.1 / 3);
  const double total = std::accumulate(row.begin(), row.end(), 0.0);
  EXPECT_NEAR(total, 10000, 0.01);  // single precision of a sum of 128
  for (int c = 0; c < 20; ++c) EXPECT_EQ(row[c], 0);
}

TEST(CountEffects, HaveTheirSizes) {
  const Stage stage;
  const auto rows = make("row_noise", {3});
  const auto stripes = make("emi_stripes", {4, 37.3, 60, 0.5});
  const auto drift = make("bias_drift", {2, 10, 0});
  const auto dual = make("dual_adc_peaks", {1, 10, 0, 0});
  Moments row_offsets, stripe, drifts;
  double dual_pixels = 0;
  for (std::uint64_t frame = 0; frame < 200; ++frame) {
    std::vector<float> row(128, 200);
    rows->apply_to_counts(static_cast<int>(frame % 128), row, stage.context("row_noise", frame));
    row_offsets.add(static_cast<double>(row[0]) - 200);
    EXPECT_EQ(row[0], row[127]);
    std::fill(row.begin(), row.end(), 200.0f);
    stripes->apply_to_counts(5, row, stage.context("emi_stripes", frame));
    for (const float counts : row) stripe.add(static_cast<double>(counts) - 200);
    std::fill(row.begin(), row.end(), 200.0f);
    drift->apply_to_counts(5, row, stage.context("bias_drift", 40 * frame));
    drifts.add(static_cast<double>(row[3]) - 200);
    std::fill(row.begin(), row.end(), 200.0f);
    dual->apply_to_counts(5, row, stage.context("dual_adc_peaks", frame));
    for (const float counts : row) dual_pixels += counts != 200;
  }
  EXPECT_NEAR(row_offsets.variance(), 9, 5 * row_offsets.variance_error());
  EXPECT_NEAR(stripe.variance(), 8, 5 * 8 / std::sqrt(200.0));  // A^2 / 2; frames are independent
  EXPECT_NEAR(drifts.variance(), 4, 5 * drifts.variance_error());
  EXPECT_GT(dual_pixels, 0);
  std::vector<float> row(128, 20200);
  make("nonlinearity", {0.0025})->apply_to_counts(0, row, stage.context("nonlinearity", 0));
  EXPECT_FLOAT_EQ(row[0], 200 + 20000 * 0.95f);
}

// Amplitude and phase of a sine of known period, by projection.
TEST(CountEffects, StripesLeanByTheirRowPhaseAndDriftFromFrameToFrame) {
  const Stage stage;
  constexpr double drift = 0.04;
  const auto stripes = make("emi_stripes", {4, 16, -50, drift});
  const auto turns = [&](int row, std::uint64_t frame) {
    std::vector<float> counts(128, 200);
    stripes->apply_to_counts(row, counts, stage.context("emi_stripes", frame));
    double s = 0, c = 0;
    for (int k = 0; k < 128; ++k) {
      s += counts[static_cast<std::size_t>(k)] * math::cos_turns(k / 16.0);
      c += counts[static_cast<std::size_t>(k)] * math::sin_turns(k / 16.0);
    }
    EXPECT_NEAR(std::hypot(s, c) / 64, 4, 1e-3);
    return std::atan2(s, c) / (2 * std::numbers::pi);
  };
  const auto apart = [](double one, double other) { return one - other - std::round(one - other); };
  EXPECT_NEAR(apart(turns(8, 3), turns(7, 3)), -50.0 / 360, 1e-4);
  Moments steps, far;
  double last = turns(0, 0);
  for (std::uint64_t frame = 1; frame < 1000; ++frame) {
    const double now = turns(0, frame);
    steps.add(apart(now, last));
    last = now;
  }
  EXPECT_NEAR(steps.mean(), 0, 5 * steps.mean_error());
  EXPECT_NEAR(steps.variance(), drift * drift, 5 * steps.variance_error());
  for (std::uint64_t block = 1; block < 400; ++block)
    far.add(apart(turns(0, 1024 * block + 9), turns(0, 1024 * block)));
  EXPECT_NEAR(far.variance(), 9 * drift * drift, 5 * far.variance_error());
}

TEST(CountEffects, NoPixelCarriesADefectTwice) {
  const Stage stage;
  const auto dual = make("dual_adc_peaks", {0.5, 10, 0, 0});
  double pixels = 0;
  for (int r = 0; r < 128; ++r) {
    std::vector<float> row(128, 200);
    dual->apply_to_counts(r, row, stage.context("dual_adc_peaks", 3));
    for (const float counts : row) {
      EXPECT_TRUE(counts == 195 || counts == 200 || counts == 205) << counts;
      pixels += counts != 200;
    }
  }
  EXPECT_NEAR(pixels, 8192, 5 * 64);  // binomial
}

TEST(CountEffects, APixelsLowerPeakMayBeAtItsOffset) {
  const Stage stage;
  const auto dual = make("dual_adc_peaks", {1, 10, 0, 1});
  double low = 0, high = 0;
  for (int r = 0; r < 128; ++r) {
    std::vector<float> row(128, 200);
    dual->apply_to_counts(r, row, stage.context("dual_adc_peaks", 3));
    for (const float counts : row) {
      EXPECT_TRUE(counts == 200 || counts == 210) << counts;
      (counts == 200 ? low : high) += 1;
    }
  }
  EXPECT_NEAR(low, 8192, 5 * 64);  // binomial
  EXPECT_NEAR(high, 8192, 5 * 64);
}

TEST(CountEffects, SizesOfDefectsSpreadAsAsked) {
  RandomStream random(1, stream_id("test/sizes"), 0, 0);
  for (const double spread : {0.0, 0.3, 1.0}) {
    Moments sizes;
    for (int n = 0; n < 20000; ++n) sizes.add(relative_size(random, spread));
    EXPECT_NEAR(sizes.mean(), 1, 5 * spread / std::sqrt(20000.0) + 1e-12);
    EXPECT_NEAR(sizes.variance(), spread * spread, 5 * sizes.variance_error() + 1e-12);
  }
}

TEST(CountEffects, TelegraphPixelsSpendHalfTheirTimeInEachLevelAndDwell) {
  const Stage stage;
  const auto telegraph = make("random_telegraph_noise", {0.05, 20, 5});
  std::vector<std::vector<float>> series;
  for (std::uint64_t frame = 0; frame < 2000; ++frame) {
    std::vector<float> row(128);
    telegraph->apply_to_counts(9, row, stage.context("random_telegraph_noise", frame));
    series.push_back(row);
  }
  double high = 0, changes = 0, pixels = 0;
  for (int column = 0; column < 128; ++column) {
    if (series[0][column] == 0) continue;
    std::set<float> levels;
    for (std::size_t frame = 0; frame < series.size(); ++frame) levels.insert(series[frame][column]);
    if (levels.size() != 2) continue;  // two traps in one pixel
    ++pixels;
    for (std::size_t frame = 1; frame < series.size(); ++frame) {
      high += series[frame][column] > 0;
      changes += series[frame][column] != series[frame - 1][column];
    }
  }
  ASSERT_GT(pixels, 1);
  const double samples = pixels * 1999;
  // Correlated over the dwell time of five frames: ten times fewer independent samples.
  EXPECT_NEAR(high / samples, 0.5, 5 * 0.5 / std::sqrt(samples / 10));
  // Every 40 frames the chain starts anew, which adds changes with probability one half.
  const double expected = (39 * 0.2 + 0.5) / 40;
  EXPECT_NEAR(changes / samples, expected, 5 * std::sqrt(expected / samples));
}

TEST(LightEffects, MapsFollowTheSensorThroughRegionAndBinning) {
  Stage whole, part;
  part.settings.region = {32, 64, 64, 32};
  part.settings.binning_x = part.settings.binning_y = 2;
  for (const char* name : {"vignetting", "etaloning_fringes"}) {
    const auto effect_of_whole = make(name, {0.2}), effect_of_part = make(name, {0.2});
    std::vector<Emitter> none;
    LightField a, b;
    a.emitters = b.emitters = &none;
    effect_of_whole->apply_to_light(a, whole.context(name, 0));
    effect_of_part->apply_to_light(b, part.context(name, 0));
    ASSERT_TRUE(a.response_ratio && b.response_ratio);
    ASSERT_EQ(b.response_ratio->shape(), (Shape{16, 32}));
    for (int row = 0; row < 16; ++row)
      for (int column = 0; column < 32; ++column) {
        float smallest = 10, largest = 0;
        for (int y = 0; y < 2; ++y)
          for (int x = 0; x < 2; ++x) {
            const float pixel = (*a.response_ratio)(64 + 2 * row + y, 32 + 2 * column + x);
            smallest = std::min(smallest, pixel);
            largest = std::max(largest, pixel);
          }
        // The binned pixel's value is taken at its centre, between those of its four pixels (up to
        // curvature).
        EXPECT_GE((*b.response_ratio)(row, column), smallest - 0.002f) << name;
        EXPECT_LE((*b.response_ratio)(row, column), largest + 0.002f) << name;
      }
  }
}

TEST(Hooks, ArePureInTheFrame) {
  const Stage stage;
  for (const EffectDeclaration& declaration : effect_catalogue()) {
    ParameterValues values;
    for (const ParameterDeclaration& parameter : declaration.parameters)
      values.push_back(parameter.default_value);
    const auto one = declaration.make(values), other = declaration.make(values);
    std::vector<float> a(128, 300), b(128, 300), between(128, 300);
    one->apply_to_counts(3, a, stage.context(declaration.name, 17));
    other->apply_to_counts(3, between, stage.context(declaration.name, 4));  // another frame in between
    other->apply_to_counts(3, b, stage.context(declaration.name, 17));
    EXPECT_EQ(a, b) << declaration.name;
    ElectronImage c({128, 128}, 50), d({128, 128}, 50);
    one->apply_to_electrons(c, stage.context(declaration.name, 17));
    other->apply_to_electrons(d, stage.context(declaration.name, 17));
    EXPECT_TRUE(c == d) << declaration.name;
  }
}

}  // namespace
}  // namespace atomcam
