// What features do to each other, to the settings and to their ranges.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "base/error.hpp"
#include "camera/big_endian.hpp"
#include "fixtures.hpp"

namespace atomcam::test {
namespace {

FeatureDeclaration control(const char* name, FeatureType type, double minimum, double maximum, double value) {
  FeatureDeclaration d;
  d.name = name;
  d.category = "SimulationControl";
  d.type = type;
  d.minimum = minimum;
  d.maximum = maximum;
  d.default_value = value;
  return d;
}

FeatureDeclaration declaration(Camera& camera, const std::string& name) {
  for (const FeatureDeclaration& d : camera.features())
    if (d.name == name) return d;
  throw std::runtime_error(name);
}

RegisterStatus write_number(Camera& camera, const std::string& name, double value) {
  const FeatureDeclaration d = declaration(camera, name);
  std::uint8_t bytes[8];
  if (d.type == FeatureType::floating)
    store_big_endian(value, bytes);
  else if (d.type == FeatureType::integer)
    store_big_endian(static_cast<std::int64_t>(value), bytes);
  else
    store_big_endian(static_cast<std::int32_t>(value), bytes);
  return camera.write(static_cast<std::uint32_t>(d.address), {bytes, static_cast<std::size_t>(d.length)});
}

TEST(Features, UntouchedSettingsAreTheLabsToTheLastBit) {
  for (CameraModel model : {ixon_model(), orca_model()}) {
    model.power_up.exposure_s = 0.0812345678901;
    model.power_up.frame_interval_s = 0.1234567890123;
    model.power_up.sensor_temperature_c = model.kind == CameraKind::emccd ? -81.3 : -33.3;
    model.power_up.bias_counts = 203.7;
    Bench bench(model);
    EXPECT_TRUE(bench.camera->settings() == model.power_up);
  }
}

TEST(Features, IxonSettingsFollow) {
  Bench bench(ixon_model());
  bench.set("ExposureTime", 40000.0);
  bench.set("Gain", 120.0);
  bench.set("BlackLevel", 150.0);
  bench.set("PreampGain", "Gain3x");
  bench.set("ReadoutRate", "Rate10MHz");
  bench.set("VerticalShiftSpeed", "Shift1_7us");
  bench.set("FrameTransfer", false);
  bench.set("ShutterMode", "Closed");
  const CameraSettings settings = bench.camera->settings();
  EXPECT_EQ(settings.exposure_s, 0.04);
  EXPECT_EQ(settings.em_gain, 120);
  EXPECT_EQ(settings.bias_counts, 150);
  const ReadoutMode mode = ixon_model().readout_modes[static_cast<std::size_t>(settings.readout_mode)];
  EXPECT_EQ(mode.preamp, "3x");
  EXPECT_EQ(mode.pixel_rate_hz, 10e6);
  EXPECT_EQ(settings.vertical_shift_s, 1.7e-6);
  EXPECT_FALSE(settings.frame_transfer);
  EXPECT_FALSE(settings.shutter_open);
  EXPECT_EQ(bench.floating("ElectronsPerCount"), mode.electrons_per_count);
  EXPECT_EQ(bench.floating("EMGain"), 120);
  bench.set("EMGain", 7.0);
  EXPECT_EQ(bench.floating("Gain"), 7);
  EXPECT_EQ(bench.camera->settings().em_gain, 7);
}

TEST(Features, ConventionalAmplifierHasItsOwnRatesAndNoEmGain) {
  Bench bench(ixon_model());
  EXPECT_THROW(bench.set("ReadoutRate", "Rate3MHz"), Error);
  bench.set("Amplifier", "Conventional");
  EXPECT_EQ(bench.text("ReadoutRate"), "Rate3MHz");
  EXPECT_THROW(bench.set("ReadoutRate", "Rate17MHz"), Error);
  EXPECT_EQ(write_number(*bench.camera, "Gain", 10), RegisterStatus::access_denied);
  EXPECT_EQ(
      ixon_model().readout_modes[static_cast<std::size_t>(bench.camera->settings().readout_mode)].amplifier,
      Amplifier::conventional);
  bench.set("Amplifier", "ElectronMultiplying");
  EXPECT_EQ(bench.text("ReadoutRate"), "Rate17MHz");
  bench.set("Gain", 10.0);
}

TEST(Features, GainsAbove300NeedToBeAllowed) {
  Bench bench(ixon_model());
  EXPECT_THROW(bench.set("Gain", 301.0), Error);
  bench.set("EMAdvanced", true);
  bench.set("Gain", 1000.0);
  EXPECT_THROW(bench.set("Gain", 1001.0), Error);
  bench.set("EMAdvanced", false);
  EXPECT_EQ(bench.floating("Gain"), 300);
}

TEST(Features, FrameTransferOverlapsExposureAndReadout) {
  Bench bench(ixon_model());
  bench.set("AcquisitionFrameRateEnable", false);
  bench.set("ExposureTime", 1000.0);
  EXPECT_NEAR(bench.floating("AcquisitionResultingFrameRate"), 56, 1e-9);
  EXPECT_NEAR(bench.camera->settings().frame_interval_s, bench.floating("SensorReadoutTime") / 1e6, 1e-15);
  bench.set("FrameTransfer", false);
  EXPECT_NEAR(bench.camera->settings().frame_interval_s, 1e-3 + bench.floating("SensorReadoutTime") / 1e6,
              1e-15);
  const double full_us = bench.floating("SensorReadoutTime");
  bench.set("ReadoutRate", "Rate5MHz");
  EXPECT_GT(bench.floating("SensorReadoutTime"), 2 * full_us);
  bench.set("ReadoutRate", "Rate17MHz");
  bench.set("BinningVertical", 2);
  EXPECT_LT(bench.floating("SensorReadoutTime"), full_us);
}

TEST(Features, FrameRateIsBoundedByTheExposureAndComesBack) {
  Bench bench(ixon_model());
  EXPECT_EQ(bench.floating("AcquisitionFrameRate"), 10);
  EXPECT_EQ(bench.camera->settings().frame_interval_s, 0.1);
  bench.set("ExposureTime", 1e6);
  EXPECT_EQ(bench.floating("AcquisitionFrameRate"), 1);
  EXPECT_EQ(bench.camera->range("AcquisitionFrameRate").maximum, 1);
  bench.set("ExposureTime", 50000.0);
  EXPECT_EQ(bench.floating("AcquisitionFrameRate"), 10);
  bench.set("AcquisitionFrameRateEnable", false);
  EXPECT_EQ(bench.floating("AcquisitionResultingFrameRate"), 20);
}

TEST(Features, BinningKeepsThePlaceOnTheSensor) {
  Bench bench(ixon_model());
  bench.set("BinningHorizontal", 3);
  EXPECT_EQ(bench.integer("Width"), 170);
  EXPECT_EQ(bench.integer("WidthMax"), 170);
  EXPECT_EQ(bench.integer("Height"), 512);
  bench.set("BinningHorizontal", 1);
  EXPECT_EQ(bench.integer("Width"), 512);
  bench.set("Width", 200);
  bench.set("OffsetX", 100);
  bench.set("BinningHorizontal", 4);
  EXPECT_EQ(bench.integer("Width"), 50);
  EXPECT_EQ(bench.integer("OffsetX"), 25);
  const Region region = bench.camera->settings().region;
  EXPECT_EQ(region.offset_x, 100);
  EXPECT_EQ(region.width, 200);
  EXPECT_EQ(bench.integer("PayloadSize"), 50 * 512 * 2);
}

TEST(Features, OrcaBinsBothAxesInSteps) {
  Bench bench(orca_model());
  bench.set("BinningVertical", 4);
  EXPECT_EQ(bench.integer("BinningHorizontal"), 4);
  EXPECT_EQ(bench.integer("Width"), 1024);
  EXPECT_EQ(bench.integer("Height"), 576);
  EXPECT_EQ(write_number(*bench.camera, "BinningVertical", 3), RegisterStatus::invalid_parameter);
  bench.set("BinningVertical", 1);
  EXPECT_EQ(bench.integer("Width"), 4096);
  EXPECT_EQ(write_number(*bench.camera, "Height", 1002), RegisterStatus::invalid_parameter);
  bench.set("Height", 1000);
  EXPECT_EQ(bench.camera->range("OffsetY").maximum, 1304);
}

TEST(Features, OrcaScanModesAndPhotonNumbers) {
  Bench bench(orca_model());
  EXPECT_NEAR(bench.floating("AcquisitionResultingFrameRate"), 1 / 8.2944e-3, 1e-6);
  EXPECT_EQ(bench.camera->settings().readout_mode, 0);
  bench.set("ScanMode", "UltraQuiet");
  EXPECT_EQ(bench.camera->settings().readout_mode, 1);
  EXPECT_NEAR(bench.floating("SensorReadoutTime"), 199065.6, 1e-6);
  bench.set("ScanMode", "Standard");
  bench.set("ExposureTime", 100.0);
  bench.set("SensorMode", "PhotonNumberResolving");
  EXPECT_EQ(bench.text("ScanMode"), "UltraQuiet");
  EXPECT_NEAR(bench.floating("ExposureTime"), 172.8, 1e-9);
  EXPECT_FALSE(bench.on("DefectCorrection"));
  EXPECT_THROW(bench.set("DefectCorrection", true), Error);
  EXPECT_THROW(bench.set("ScanMode", "Standard"), Error);
  const CameraSettings settings = bench.camera->settings();
  EXPECT_TRUE(settings.photon_number_resolving);
  EXPECT_FALSE(settings.defect_correction);
  bench.set("SensorMode", "Area");
  EXPECT_TRUE(bench.on("DefectCorrection"));
  bench.set("HotPixelCorrectionLevel", "Aggressive");
  bench.set("PulsedLight", true);
  EXPECT_EQ(bench.camera->settings().hot_pixel_correction, HotPixelCorrection::aggressive);
  EXPECT_TRUE(bench.camera->settings().pulsed_light);
}

TEST(Features, PayloadSizeFollowsFormatAndChunks) {
  Bench bench(orca_model());
  const std::int64_t pixels = 4096 * 2304;
  EXPECT_EQ(bench.integer("PayloadSize"), 2 * pixels);
  bench.set("PixelFormat", "Mono12Packed");
  EXPECT_EQ(bench.integer("PayloadSize"), 3 * pixels / 2);
  EXPECT_EQ(bench.text("PixelSize"), "Bpp12");
  bench.set("PixelFormat", "Mono8");
  EXPECT_EQ(bench.integer("PayloadSize"), pixels);
  bench.set("ChunkModeActive", true);
  EXPECT_EQ(bench.integer("PayloadSize"), pixels + 8 + 4 * (8 + 8) + 1024 + 8);
  bench.set("ChunkSelector", "GroundTruth");
  bench.set("ChunkEnable", false);
  EXPECT_EQ(bench.integer("PayloadSize"), pixels + 8 + 4 * (8 + 8));
}

TEST(Features, ControlsBecomeOverridesWhenTheyDiffer) {
  FeatureDeclaration selector = control("SimZernikeSelector", FeatureType::enumeration, 0, 0, 0);
  selector.entries = {{"tilt", 0, ""}, {"defocus", 1, ""}};
  FeatureDeclaration zernike = control("SimZernike", FeatureType::floating, -1, 1, 0);
  zernike.selector = selector.name;
  Bench bench(ixon_model(), {{control("SimFilling", FeatureType::floating, 0, 1, 0.6), "atoms.filling", {}},
                             {selector, "", {}},
                             {zernike, "optics.zernike_um.*", {0, 0.02}},
                             {control("SimAtoms", FeatureType::integer, 0, 9, 4), "atoms.a", {}}});
  EXPECT_TRUE(bench.camera->settings().overrides.empty());
  bench.set("SimFilling", 0.7);
  bench.set("SimZernikeSelector", "defocus");
  EXPECT_EQ(bench.floating("SimZernike"), 0.02);
  bench.set("SimZernike", 0.5);
  bench.set("SimZernikeSelector", "tilt");
  EXPECT_EQ(bench.floating("SimZernike"), 0);
  bench.set("SimAtoms", 5);
  using Overrides = std::vector<std::pair<std::string, double>>;
  EXPECT_EQ(bench.camera->settings().overrides,
            (Overrides{{"atoms.a", 5}, {"atoms.filling", 0.7}, {"optics.zernike_um.defocus", 0.5}}));
  bench.set("SimFilling", 0.6);
  EXPECT_EQ(bench.camera->settings().overrides.size(), 2u);
  EXPECT_EQ(bench.integer("SimulationSeed"), static_cast<std::int64_t>(bench.source->seed()));
  EXPECT_THROW(bench.set("SimFilling", 1.1), Error);
}

TEST(Features, TheSeedMayBeAControl) {
  Bench bench(ixon_model(), {{control("SimSeed", FeatureType::integer, 0, 9e15, 12), "seed", {}}});
  EXPECT_EQ(bench.integer("SimulationSeed"), 12);
  bench.set("SimSeed", 13);
  EXPECT_EQ(bench.integer("SimulationSeed"), 13);
  EXPECT_EQ(bench.camera->settings().overrides[0].first, "seed");
}

TEST(Features, UserSetsKeepAndBringBack) {
  Bench bench(ixon_model());
  const CameraSettings initial = bench.camera->settings();
  bench.set("Gain", 50.0);
  bench.set("Width", 100);
  bench.set("OffsetX", 10);
  bench.set("LineSelector", "Line2");
  bench.set("LineInverter", true);
  bench.set("DeviceUserID", "mine");
  EXPECT_THROW(bench.camera->execute("UserSetSave"), Error);  // the default set is the factory's
  bench.set("UserSetSelector", "UserSet1");
  bench.camera->execute("UserSetSave");
  const CameraSettings saved = bench.camera->settings();
  bench.set("UserSetSelector", "Default");
  bench.camera->execute("UserSetLoad");
  EXPECT_TRUE(bench.camera->settings() == initial);
  EXPECT_FALSE(bench.on("LineInverter"));
  EXPECT_EQ(bench.text("DeviceUserID"), "mine");
  bench.set("UserSetSelector", "UserSet1");
  bench.camera->execute("UserSetLoad");
  EXPECT_TRUE(bench.camera->settings() == saved);
  EXPECT_TRUE(bench.on("LineInverter"));
}

TEST(Features, LockedWhileHeldOrAcquiring) {
  Bench bench(ixon_model());
  const char* held[] = {"Width",       "Height",          "OffsetX",     "OffsetY",    "BinningHorizontal",
                        "PixelFormat", "ChunkModeActive", "ReadoutRate", "TriggerMode"};
  const auto status = [&](const char* name) {
    const FeatureDeclaration d = declaration(*bench.camera, name);
    std::vector<std::uint8_t> bytes(static_cast<std::size_t>(d.length));
    EXPECT_EQ(bench.camera->read(static_cast<std::uint32_t>(d.address), bytes), RegisterStatus::ok);
    return bench.camera->write(static_cast<std::uint32_t>(d.address), bytes);  // what it is already
  };
  for (const char* name : held) EXPECT_EQ(status(name), RegisterStatus::ok) << name;
  bench.set("TLParamsLocked", 1);
  EXPECT_EQ(bench.integer("ParametersLocked"), 1);
  for (const char* name : held) EXPECT_EQ(status(name), RegisterStatus::access_denied) << name;
  for (const char* name : {"ExposureTime", "Gain", "BlackLevel", "PreampGain"})
    EXPECT_EQ(status(name), RegisterStatus::ok) << name;
  bench.set("TLParamsLocked", 0);
  EXPECT_EQ(status("Width"), RegisterStatus::ok);
  bench.camera->execute("AcquisitionStart");
  EXPECT_EQ(bench.integer("ParametersLocked"), 1);
  EXPECT_EQ(status("Width"), RegisterStatus::access_denied);
  EXPECT_EQ(status("Gain"), RegisterStatus::ok);
  bench.set("TLParamsLocked", 1);
  bench.camera->stop_acquisition();
  EXPECT_EQ(bench.integer("TLParamsLocked"), 0);
  EXPECT_EQ(status("Width"), RegisterStatus::ok);
}

TEST(Features, ErrorsNameFeatureValueAndRange) {
  Bench bench(ixon_model());
  const auto message = [&](auto action) -> std::string {
    try {
      action();
    } catch (const Error& error) {
      return error.what();
    }
    return "";
  };
  EXPECT_EQ(message([&] { bench.set("Gain", 400.0); }), "Gain: 400 is not allowed: 1 to 300");
  EXPECT_EQ(message([&] { bench.set("Width", 513); }),
            "Width: 513 is not allowed: 16 to 512 in steps of 1 px");
  EXPECT_NE(message([&] { bench.set("ExposreTime", 1.0); }).find("ExposureTime"), std::string::npos);
  EXPECT_NE(message([&] { bench.set("ReadoutRate", "Rate18MHz"); }).find("Rate17MHz"), std::string::npos);
  EXPECT_EQ(message([&] { bench.set("SensorWidth", 3); }), "SensorWidth: is read-only");
  EXPECT_NE(message([&] { bench.set("Gain", "high"); }), "");
  EXPECT_NE(message([&] { bench.set("Width", 10.5); }), "");
  EXPECT_NE(message([&] { bench.camera->execute("Width"); }), "");
  EXPECT_NE(message([&] { bench.camera->get("ChunkFrameID"); }), "");
}

TEST(Features, TheSensorCoolsWithItsTimeConstant) {
  Bench bench(ixon_model());
  EXPECT_EQ(bench.floating("DeviceTemperature"), -80);
  EXPECT_EQ(bench.text("SensorCoolingStatus"), "Stabilised");
  bench.set("SimCoolingTimeConstant", 0.05);
  bench.set("SensorTemperatureSetpoint", -60.0);
  EXPECT_EQ(bench.text("SensorCoolingStatus"), "NotReached");
  const double on_the_way = bench.floating("DeviceTemperature");
  EXPECT_LT(on_the_way, -60);
  std::this_thread::sleep_for(std::chrono::milliseconds(500));  // ten time constants: 20 degrees become 1e-3
  EXPECT_EQ(bench.floating("DeviceTemperature"), -60);
  EXPECT_EQ(bench.text("SensorCoolingStatus"), "Stabilised");
  EXPECT_EQ(bench.camera->settings().sensor_temperature_c, -60);
  bench.set("SensorCooling", "Off");
  std::this_thread::sleep_for(std::chrono::milliseconds(800));
  EXPECT_EQ(bench.floating("DeviceTemperature"), 20);
  EXPECT_EQ(bench.text("SensorCoolingStatus"), "Off");
}

TEST(Features, OrcaCoolingLevels) {
  Bench bench(orca_model());
  EXPECT_EQ(bench.floating("SensorTemperatureSetpoint"), -20);
  bench.set("SensorCooling", "Max");
  EXPECT_EQ(bench.floating("SensorTemperatureSetpoint"), -35);
}

// Whatever is written in whatever order: every number stays within its range, every enumeration on an entry
// that may be chosen, everything readable, the settings those of a frame that the camera can make.
TEST(Features, InvariantsHoldAfterRandomWrites) {
  for (const CameraModel& model : {ixon_model(), orca_model()}) {
    SCOPED_TRACE(model.model);
    Bench bench(model);
    Camera& camera = *bench.camera;
    const auto features = camera.features();
    std::mt19937_64 random(7);
    int accepted = 0, refused = 0;
    for (int step = 0; step < 3000; ++step) {
      const FeatureDeclaration& d = features[random() % features.size()];
      if (d.chunk_id != 0 || d.type == FeatureType::command || d.type == FeatureType::string) continue;
      if (d.name == "TLParamsLocked" || d.access != Access::read_write) continue;
      double value = 0;
      if (d.type == FeatureType::enumeration) {
        value = static_cast<double>(d.entries[random() % d.entries.size()].value);
      } else if (d.type == FeatureType::boolean) {
        value = static_cast<double>(random() % 2);
      } else {
        const FeatureRange range = camera.range(d.name);
        const double u = std::uniform_real_distribution(-0.1, 1.1)(random);
        value = d.logarithmic && range.minimum > 0 && u > 0
                    ? range.minimum * std::pow(range.maximum / range.minimum, u)
                    : range.minimum + u * (range.maximum - range.minimum);
        if (d.type == FeatureType::integer && range.increment > 0)
          value = range.minimum + std::round((value - range.minimum) / range.increment) * range.increment;
      }
      const RegisterStatus status = write_number(camera, d.name, value);
      (status == RegisterStatus::ok ? accepted : refused)++;
      if (step % 10 != 0) continue;
      for (const FeatureDeclaration& each : features) {
        if (each.chunk_id != 0 || each.type == FeatureType::command) continue;
        const FeatureValue now = camera.get(each.name);
        if (each.type == FeatureType::integer || each.type == FeatureType::floating) {
          const FeatureRange range = camera.range(each.name);
          const double number = each.type == FeatureType::integer
                                    ? static_cast<double>(std::get<std::int64_t>(now))
                                    : std::get<double>(now);
          ASSERT_LE(range.minimum, number) << each.name << " after " << d.name << " = " << value;
          ASSERT_LE(number, range.maximum) << each.name << " after " << d.name << " = " << value;
        }
      }
      const CameraSettings settings = camera.settings();
      const Region& region = settings.region;
      ASSERT_GE(region.offset_x, 0);
      ASSERT_GE(region.offset_y, 0);
      ASSERT_LE(region.offset_x + region.width, model.sensor.columns);
      ASSERT_LE(region.offset_y + region.height, model.sensor.rows);
      ASSERT_EQ(region.width % settings.binning_x, 0);
      ASSERT_EQ(region.height % settings.binning_y, 0);
      ASSERT_GE(settings.frame_interval_s, settings.exposure_s);
      ASSERT_LT(static_cast<std::size_t>(settings.readout_mode), model.readout_modes.size());
    }
    EXPECT_GT(accepted, 0);
    EXPECT_GT(refused, 0);
  }
}

TEST(Registers, RefuseWhatTheyMust) {
  Bench bench(ixon_model());
  Camera& camera = *bench.camera;
  std::vector<std::uint8_t> bytes(8);
  const auto width = static_cast<std::uint32_t>(declaration(camera, "Width").address);
  const auto sensor_width = static_cast<std::uint32_t>(declaration(camera, "SensorWidth").address);
  EXPECT_EQ(camera.read(width + 1, bytes), RegisterStatus::bad_alignment);
  EXPECT_EQ(camera.read(width, std::span(bytes).first(6)), RegisterStatus::bad_alignment);
  EXPECT_EQ(camera.read(0xfffc, bytes), RegisterStatus::invalid_address);
  EXPECT_EQ(camera.read(0xffff0, bytes), RegisterStatus::invalid_address);
  EXPECT_EQ(camera.read(0xfffffffc, bytes), RegisterStatus::invalid_address);
  EXPECT_EQ(camera.write(0xffff0, bytes), RegisterStatus::invalid_address);
  EXPECT_EQ(camera.write(width + 2, bytes), RegisterStatus::bad_alignment);
  EXPECT_EQ(camera.write(width, std::span(bytes).first(4)), RegisterStatus::invalid_parameter);
  EXPECT_EQ(camera.write(width + 8, bytes), RegisterStatus::write_protect);  // its minimum
  EXPECT_EQ(camera.write(sensor_width, bytes), RegisterStatus::write_protect);
  EXPECT_EQ(camera.write(width, bytes), RegisterStatus::invalid_parameter);  // zero columns
  // The value and its bounds are adjacent and can be read at once.
  std::vector<std::uint8_t> block(32);
  EXPECT_EQ(camera.read(width, block), RegisterStatus::ok);
  EXPECT_EQ(load_big_endian<std::int64_t>(block.data()), 512);
  EXPECT_EQ(load_big_endian<std::int64_t>(block.data() + 16), 512);
  // Not a number.
  store_big_endian(std::nan(""), bytes.data());
  EXPECT_EQ(camera.write(static_cast<std::uint32_t>(declaration(camera, "Gain").address), bytes),
            RegisterStatus::invalid_parameter);
}

// Any bytes anywhere: an answer, and a camera whose settings can still be told.
TEST(Registers, WithstandAnything) {
  for (const CameraModel& model : {ixon_model(), orca_model()}) {
    Bench bench(model);
    const auto features = bench.camera->features();
    std::mt19937_64 random(11);
    const std::uint8_t patterns[] = {0x00, 0x01, 0x7f, 0x80, 0xff};
    int accepted = 0;
    for (int step = 0; step < 20000; ++step) {
      const FeatureDeclaration& d = features[random() % features.size()];
      if (d.name == "AcquisitionStart") continue;
      const auto address = random() % 4 == 0 ? static_cast<std::uint32_t>(random())
                                             : static_cast<std::uint32_t>(d.address + random() % 3 * 4);
      std::vector<std::uint8_t> bytes(random() % 3 == 0 ? random() % 600
                                                        : static_cast<std::size_t>(std::min(d.length, 8)));
      if (random() % 2 == 0) {
        bench.camera->read(address, bytes);
        continue;
      }
      for (std::uint8_t& byte : bytes) byte = patterns[random() % 5];
      accepted += bench.camera->write(address, bytes) == RegisterStatus::ok;
    }
    EXPECT_GT(accepted, 0);
    const CameraSettings settings = bench.camera->settings();
    EXPECT_GT(settings.output_width(), 0);
    EXPECT_GT(settings.exposure_s, 0);
  }
}

TEST(Registers, UserNameMayBeWrittenInPart) {
  Bench bench(ixon_model());
  const auto address = static_cast<std::uint32_t>(declaration(*bench.camera, "DeviceUserID").address);
  EXPECT_EQ(bench.camera->identity().user_name, "atoms");
  const std::vector<std::uint8_t> name = {'c', 'a', 'm', 0};
  EXPECT_EQ(bench.camera->write(address, name), RegisterStatus::ok);
  EXPECT_EQ(bench.camera->identity().user_name, "cam");
  bench.camera->set_user_name("another one");
  EXPECT_EQ(bench.text("DeviceUserID"), "another one");
}

}  // namespace
}  // namespace atomcam::test
