// What an independent client (Aravis) measures through the network: registers change the physics, frames are
// those of the simulation, loss is repaired.

#include <arv.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <chrono>
#include <cmath>
#include <memory>
#include <string>
#include <vector>

#include "virtual_camera/virtual_camera.hpp"

namespace atomcam {
namespace {

/// An address of this process's own, so that tests may run side by side.
std::string own_address() {
  static int next = 0;
  return "127.66." + std::to_string(getpid() % 250 + 1) + "." + std::to_string(++next);
}

struct Statistics {
  double mean = 0, mean_error = 0, variance = 0, variance_error = 0;
};

class Client {
 public:
  explicit Client(const std::string& address) {
    GError* error = nullptr;
    camera_ = arv_camera_new(address.c_str(), &error);
    if (!camera_) throw std::runtime_error(error->message);
    device_ = arv_camera_get_device(camera_);
  }
  ~Client() { g_object_unref(camera_); }

  void set(const char* feature, const char* value) {
    check(feature, [&](GError** e) {
      arv_device_set_features_from_string(device_, (std::string(feature) + "=" + value).c_str(), e);
    });
  }
  void set(const char* feature, double value) {
    check(feature, [&](GError** e) { arv_device_set_float_feature_value(device_, feature, value, e); });
  }
  void set_whole(const char* feature, std::int64_t value) {
    check(feature, [&](GError** e) { arv_device_set_integer_feature_value(device_, feature, value, e); });
  }
  double get(const char* feature) {
    double value = 0;
    check(feature, [&](GError** e) { value = arv_device_get_float_feature_value(device_, feature, e); });
    return value;
  }

  struct Image {
    std::uint64_t id;
    std::vector<std::uint16_t> pixels;
  };
  std::uint64_t failures = 0;

  std::vector<Image> grab(int frames) {
    GError* error = nullptr;
    ArvStream* stream = arv_camera_create_stream(camera_, nullptr, nullptr, &error);
    if (!stream) throw std::runtime_error(error->message);
    g_object_set(stream, "frame-retention", 1000000, nullptr);
    const auto payload = static_cast<std::size_t>(arv_camera_get_payload(camera_, nullptr));
    for (int i = 0; i < 64; ++i) arv_stream_push_buffer(stream, arv_buffer_new(payload, nullptr));
    arv_camera_set_acquisition_mode(camera_, ARV_ACQUISITION_MODE_CONTINUOUS, nullptr);
    arv_camera_start_acquisition(camera_, nullptr);
    std::vector<Image> images;
    while (static_cast<int>(images.size()) < frames) {
      ArvBuffer* buffer = arv_stream_timeout_pop_buffer(stream, 10'000'000);
      if (!buffer) break;
      if (arv_buffer_get_status(buffer) == ARV_BUFFER_STATUS_SUCCESS) {
        std::size_t size = 0;
        const auto* data = static_cast<const std::uint16_t*>(arv_buffer_get_data(buffer, &size));
        images.push_back({arv_buffer_get_frame_id(buffer), {data, data + size / 2}});
      } else {
        ++failures;
      }
      arv_stream_push_buffer(stream, buffer);
    }
    arv_camera_stop_acquisition(camera_, nullptr);
    g_object_unref(stream);
    EXPECT_EQ(static_cast<int>(images.size()), frames);
    return images;
  }

  /// Mean and variance of all pixels; errors from the scatter of the frames.
  Statistics measure(int frames) {
    const auto images = grab(frames);
    Statistics result;
    double mean2 = 0, variance2 = 0;
    for (const Image& image : images) {
      double sum = 0, sum2 = 0;
      for (const std::uint16_t counts : image.pixels) sum += counts;
      const double n = static_cast<double>(image.pixels.size()), mean = sum / n;
      for (const std::uint16_t counts : image.pixels) sum2 += (counts - mean) * (counts - mean);
      const double variance = sum2 / (n - 1);
      result.mean += mean / frames;
      mean2 += mean * mean / frames;
      result.variance += variance / frames;
      variance2 += variance * variance / frames;
    }
    result.mean_error = std::sqrt(std::max(0.0, mean2 - result.mean * result.mean) / (frames - 1));
    result.variance_error =
        std::sqrt(std::max(0.0, variance2 - result.variance * result.variance) / (frames - 1));
    return result;
  }

 private:
  template <class Call>
  void check(const char* feature, const Call& call) {
    GError* error = nullptr;
    call(&error);
    if (!error) return;
    const std::string message = error->message;
    g_error_free(error);
    throw std::runtime_error(std::string(feature) + ": " + message);
  }

  ArvCamera* camera_ = nullptr;
  ArvDevice* device_ = nullptr;
};

/// The iXon in front of even light: no atoms, no serial charge; a small region, read out fast.
Lab flat_lab() {
  Lab lab = preset("ixon-ultra-897");
  lab.effects.clear();
  lab.scene.filling = 0;
  lab.stray_light_photons_per_s = 1000;
  lab.settings.region = {128, 128, 64, 64};
  lab.settings.binning_x = lab.settings.binning_y = 1;
  lab.settings.exposure_s = 0.01;
  lab.settings.frame_interval_s = 0;
  const auto& modes = std::get<EmccdDescription>(lab.sensor).readout_modes;
  for (std::size_t i = 0; i < modes.size(); ++i)
    if (modes[i].pixel_rate_hz == 17e6 && modes[i].preamp == "3x")
      lab.settings.readout_mode = static_cast<int>(i);
  return lab;
}

class PhysicsThroughTheClient : public testing::Test {
 protected:
  PhysicsThroughTheClient() : camera_(flat_lab(), {.device = {.address = address_}}), client_(address_) {}

  const EmccdDescription& sensor() const { return std::get<EmccdDescription>(camera_.lab().sensor); }
  const ReadoutMode& mode(int index) const { return sensor().readout_modes[index]; }
  /// Electrons per pixel before the register.
  double electrons(double exposure_s, double stray_photons_per_s, int pixels = 1) const {
    return pixels * (stray_photons_per_s * sensor().quantum_efficiency * exposure_s +
                     sensor().dark_rate_e_per_s * exposure_s + sensor().clock_induced_charge_e);
  }

  std::string address_ = own_address();
  VirtualCamera camera_;
  Client client_;
};

TEST_F(PhysicsThroughTheClient, MeanIsBiasPlusGainTimesExposure) {
  const double per_count = mode(camera_.camera().settings().readout_mode).electrons_per_count;
  for (const double exposure_us : {2000.0, 5000.0, 10000.0, 20000.0}) {
    client_.set("ExposureTime", exposure_us);
    const double exposure_s = client_.get("ExposureTime") * 1e-6;
    const Statistics measured = client_.measure(30);
    EXPECT_NEAR(measured.mean, 200 + 300 / per_count * electrons(exposure_s, 1000), 5 * measured.mean_error)
        << exposure_us;
  }
}

TEST_F(PhysicsThroughTheClient, EmGainMultipliesWithTheExcessNoiseOfTheCascade) {
  const ReadoutMode& in_force = mode(camera_.camera().settings().readout_mode);
  const double per_count = in_force.electrons_per_count;
  const double read_variance = std::pow(in_force.read_noise_e / per_count, 2) + 1.0 / 12;
  for (const double gain : {1.0, 10.0, 100.0, 300.0}) {
    client_.set("Gain", gain);
    // With the gain off, light enough that its own noise stands above the read noise.
    const double stray = gain == 1 ? 2e6 : gain == 10 ? 1e5 : 1000, light_e = electrons(0.01, stray);
    client_.set("SimStrayLight", stray);
    const Statistics measured = client_.measure(60);
    EXPECT_NEAR(measured.mean, 200 + gain / per_count * light_e, 5 * measured.mean_error) << gain;
    // F^2 of N stages (Robbins and Hadwen, IEEE TED 50, 1227 (2003)).
    const int stages = sensor().register_stages;
    const double excess =
        gain == 1 ? 1 : 2 * (gain - 1) * std::pow(gain, -(stages + 1.0) / stages) + 1 / gain;
    const double scale = gain * gain / (per_count * per_count) * light_e;
    const double found = (measured.variance - read_variance) / scale;
    EXPECT_NEAR(found, excess, 5 * measured.variance_error / scale) << gain;
    std::printf("EM gain %g: F^2 = %.3f +- %.3f, the cascade has %.3f\n", gain, found,
                measured.variance_error / scale, excess);
  }
}

TEST_F(PhysicsThroughTheClient, PreampGainAndBiasScaleAndShift) {
  for (const char* preamp : {"Gain1x", "Gain2x", "Gain3x"}) {
    client_.set("PreampGain", preamp);
    const double per_count = mode(camera_.camera().settings().readout_mode).electrons_per_count;
    const Statistics measured = client_.measure(30);
    EXPECT_NEAR(measured.mean, 200 + 300 / per_count * electrons(0.01, 1000), 5 * measured.mean_error)
        << preamp;
  }
  const double per_count = mode(camera_.camera().settings().readout_mode).electrons_per_count;
  for (const double bias : {100.0, 500.0}) {
    client_.set("BlackLevel", bias);
    const Statistics measured = client_.measure(30);
    EXPECT_NEAR(measured.mean, bias + 300 / per_count * electrons(0.01, 1000), 5 * measured.mean_error)
        << bias;
  }
}

TEST_F(PhysicsThroughTheClient, BinningSumsChargeBeforeTheNoise) {
  const ReadoutMode& in_force = mode(camera_.camera().settings().readout_mode);
  client_.set("Gain", 1.0);
  for (const int binning : {1, 2, 4}) {
    client_.set_whole("BinningHorizontal", binning);
    client_.set_whole("BinningVertical", binning);
    client_.set_whole("Width", 64 / binning);
    client_.set_whole("Height", 64 / binning);
    const Statistics measured = client_.measure(60);
    const double light_e = electrons(0.01, 1000, binning * binning);
    EXPECT_NEAR(measured.mean, 200 + light_e / in_force.electrons_per_count, 5 * measured.mean_error)
        << binning;
    const double variance = (light_e + in_force.read_noise_e * in_force.read_noise_e) /
                                std::pow(in_force.electrons_per_count, 2) +
                            1.0 / 12;
    EXPECT_NEAR(measured.variance, variance, 5 * measured.variance_error) << binning;
  }
}

TEST_F(PhysicsThroughTheClient, PhotonTransferRecoversElectronsPerCountAndReadNoise) {
  client_.set("Gain", 1.0);
  const ReadoutMode& in_force = mode(camera_.camera().settings().readout_mode);
  // Light levels up to 20,000 e- per pixel; variance over mean of the differences to the dark frames.
  const auto at = [&](double stray) {
    client_.set("SimStrayLight", stray);
    return client_.measure(120);
  };
  const Statistics dark = at(0);
  double sum_xy = 0, sum_xx = 0;
  for (const double stray : {5e4, 2e5, 5e5, 1e6, 2e6}) {
    const Statistics light = at(stray);
    const double mean = light.mean - dark.mean, variance = light.variance - dark.variance;
    const double weight = 1 / (light.variance_error * light.variance_error);
    sum_xy += weight * mean * variance;
    sum_xx += weight * mean * mean;
  }
  const double electrons_per_count = sum_xx / sum_xy;
  const double read_noise_e = std::sqrt(dark.variance - 1.0 / 12) * electrons_per_count;
  std::printf("photon transfer: %.3f e-/count (set %.3f), read noise %.2f e- (set %.2f)\n",
              electrons_per_count, in_force.electrons_per_count, read_noise_e, in_force.read_noise_e);
  EXPECT_NEAR(electrons_per_count / in_force.electrons_per_count, 1, 0.02);
  EXPECT_NEAR(read_noise_e / in_force.read_noise_e, 1, 0.02);
}

TEST_F(PhysicsThroughTheClient, SmallFramesComeAtTheCamerasRate) {
  // Three packets a frame: pacing must not make them slower than the exposure.
  client_.set_whole("Width", 16);
  client_.set_whole("Height", 16);
  const double rate_hz = client_.get("AcquisitionFrameRate");
  const auto began = std::chrono::steady_clock::now();
  client_.grab(100);
  const std::chrono::duration<double> took = std::chrono::steady_clock::now() - began;
  EXPECT_LT(took.count(), 3 * 100 / rate_hz + 1);
}

class SameFrames : public testing::TestWithParam<const char*> {};
INSTANTIATE_TEST_SUITE_P(Presets, SameFrames, testing::Values("ixon-ultra-897", "orca-quest"));

TEST_P(SameFrames, ComeOverTheNetworkAsTheSimulationRendersThem) {
  Lab lab = preset(GetParam());
  lab.settings.region =
      lab.kind() == CameraKind::emccd ? Region{128, 128, 256, 256} : Region{1920, 1000, 256, 256};
  lab.settings.exposure_s = 0.01;
  const std::string address = own_address();
  VirtualCamera camera(lab, {.device = {.address = address}});
  Client client(address);
  const auto images = client.grab(8);
  const Simulation simulation(lab);
  const CameraSettings settings = camera.camera().settings();
  for (const Client::Image& image : images) {
    // Blocks count from one, frames from nought; none was lost.
    const Frame frame = simulation.render(image.id - 1, settings, 2);
    EXPECT_TRUE(std::equal(image.pixels.begin(), image.pixels.end(), frame.counts.pixels().begin(),
                           frame.counts.pixels().end()))
        << image.id;
  }
}

TEST(LostPackets, AreAskedForAgainAndNoFrameIsLost) {
  Lab lab = flat_lab();
  lab.settings.region = {0, 0, 128, 128};
  lab.settings.exposure_s = 0.001;
  lab.settings.frame_interval_s = 1.0 / 150;
  VirtualCameraOptions options;
  options.device.address = own_address();
  options.device.packet_bytes = 1500;
  options.device.faults.packet_loss = 0.02;
  VirtualCamera camera(lab, options);
  Client client(options.device.address);
  const auto images = client.grab(1000);
  ASSERT_EQ(images.size(), 1000u);
  for (std::size_t i = 0; i < images.size(); ++i) ASSERT_EQ(images[i].id, images[0].id + i);
  EXPECT_EQ(client.failures, 0u);
  const auto statistics = camera.device().statistics().stream;
  EXPECT_GT(statistics.resent, 100u);
  std::printf("1000 frames, %llu packets lost on purpose, %llu sent again\n",
              static_cast<unsigned long long>(statistics.faulted_packets),
              static_cast<unsigned long long>(statistics.resent));
}

}  // namespace
}  // namespace atomcam
