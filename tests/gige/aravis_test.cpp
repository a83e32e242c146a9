// An independent client against the device over a real camera: finds it by address, reads its description,
// negotiates the packet size, grabs frames.

#include <arv.h>
#include <gtest/gtest.h>

#include <thread>

#include "camera/camera.hpp"
#include "camera/fixtures.hpp"
#include "gige/addresses.hpp"
#include "gige/device.hpp"

namespace atomcam {
namespace {

struct Grabbed {
  int good = 0, failed = 0;
  std::uint64_t missing = 0, underruns = 0;
};

Grabbed grab(ArvCamera* camera, int frames) {
  GError* error = nullptr;
  Grabbed result;
  ArvStream* stream = arv_camera_create_stream(camera, nullptr, nullptr, &error);
  EXPECT_EQ(error, nullptr) << (error != nullptr ? error->message : "");
  if (stream == nullptr) return result;
  g_object_set(stream, "frame-retention", 500'000, nullptr);
  const auto payload = static_cast<std::size_t>(arv_camera_get_payload(camera, &error));
  for (int i = 0; i < 20; ++i) arv_stream_push_buffer(stream, arv_buffer_new(payload, nullptr));
  arv_camera_start_acquisition(camera, &error);
  EXPECT_EQ(error, nullptr) << (error != nullptr ? error->message : "");
  std::optional<std::uint64_t> last_frame;
  while (result.good + result.failed < frames) {
    ArvBuffer* buffer = arv_stream_timeout_pop_buffer(stream, 3'000'000);
    if (buffer == nullptr) break;
    bool good = arv_buffer_get_status(buffer) == ARV_BUFFER_STATUS_SUCCESS;
    if (good) {
      // The ramp's neighbours differ by one step everywhere, so a misplaced packet shows.
      std::size_t size = 0;
      const auto* data = static_cast<const std::uint16_t*>(arv_buffer_get_data(buffer, &size));
      const int width = arv_buffer_get_image_width(buffer), height = arv_buffer_get_image_height(buffer);
      EXPECT_EQ(size, std::size_t{2} * width * height);
      const std::uint16_t first = data[0];
      for (int row = 0; row < height; row += 7)
        for (int column = 0; column < width; column += 5) {
          const auto wanted = static_cast<std::uint16_t>(first + 16 * (row + column));
          if (data[std::size_t(row) * width + column] != wanted) good = false;
        }
      EXPECT_TRUE(good);
    }
    ++(good ? result.good : result.failed);
    arv_stream_push_buffer(stream, buffer);
  }
  arv_camera_stop_acquisition(camera, nullptr);
  guint64 missing = 0;
  guint64 completed = 0, failures = 0, underruns = 0;
  arv_stream_get_statistics(stream, &completed, &failures, &underruns);
  missing = arv_stream_get_info_uint64_by_name(stream, "n_missing_frames");
  result.missing = missing;
  result.underruns = underruns;
  g_object_unref(stream);
  return result;
}

TEST(Aravis, GrabsFromTwoCamerasAtOnce) {
  const auto source = std::make_shared<test::RampSource>();
  const auto ixon = Camera::open(test::ixon_model(), source);
  const auto orca = Camera::open(test::orca_model(), source);
  gige::Device first(*ixon, {.address = test::own_address(1)});
  gige::Device second(*orca, {.address = test::own_address(2)});

  GError* error = nullptr;
  ArvCamera* one = arv_camera_new(first.address().c_str(), &error);
  ASSERT_NE(one, nullptr) << error->message;
  ArvCamera* other = arv_camera_new(second.address().c_str(), &error);
  ASSERT_NE(other, nullptr) << error->message;
  EXPECT_STREQ(arv_camera_get_model_name(one, nullptr), "iXon Ultra 897");
  EXPECT_STREQ(arv_camera_get_model_name(other, nullptr), "ORCA-Quest C15550-20UP");
  arv_camera_set_exposure_time(one, 10'000, &error);
  ASSERT_EQ(error, nullptr) << error->message;
  arv_camera_set_region(other, 0, 0, 512, 256, &error);
  ASSERT_EQ(error, nullptr) << error->message;
  arv_camera_set_exposure_time(other, 10'000, &error);
  ASSERT_EQ(error, nullptr) << error->message;

  Grabbed from_one, from_other;
  std::thread thread([&] { from_one = grab(one, 20); });
  from_other = grab(other, 40);
  thread.join();
  EXPECT_EQ(from_one.good, 20);
  EXPECT_EQ(from_other.good, 40);
  EXPECT_EQ(from_one.missing + from_other.missing, 0u);
  g_object_unref(one);
  g_object_unref(other);
  EXPECT_FALSE(first.statistics().client);
}

}  // namespace
}  // namespace atomcam
