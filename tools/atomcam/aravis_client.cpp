#include "atomcam/aravis_client.hpp"

#include <arv.h>
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <memory>

#include "atomcam/run_command.hpp"
#include "base/error.hpp"
#include "camera/pixel_format.hpp"

namespace atomcam {
namespace {

template <class Object>
struct Unreference {
  void operator()(Object* object) const { g_object_unref(object); }
};
template <class Object>
using Owned = std::unique_ptr<Object, Unreference<Object>>;

/// The GError that a call may leave.
class Complaint {
 public:
  ~Complaint() { g_clear_error(&error_); }
  GError** operator&() { return &error_; }
  explicit operator bool() const { return error_ != nullptr; }
  std::string text() const {
    std::string message = error_ ? error_->message : "no reason given";
    std::ranges::replace(message, '\n', ' ');
    return message;
  }

 private:
  GError* error_ = nullptr;
};

constexpr std::uint64_t buffered_bytes = 400u << 20;

constexpr int unpack_shift(PixelFormat format) {
  switch (format) {
    case PixelFormat::mono8:
      return 8;
    case PixelFormat::mono12:
    case PixelFormat::mono12_packed:
    case PixelFormat::mono12p:
      return 4;
    case PixelFormat::mono16:
      return 0;
  }
  return 0;
}

/// Whether a GigE camera has taken away control (or died).
bool lost(ArvDevice* device) {
  return ARV_IS_GV_DEVICE(device) && !arv_gv_device_is_controller(ARV_GV_DEVICE(device));
}

CountImage image_of(ArvBuffer* buffer) {
  const auto format = static_cast<PixelFormat>(arv_buffer_get_image_pixel_format(buffer));
  constexpr std::array known = {PixelFormat::mono8, PixelFormat::mono12, PixelFormat::mono12_packed,
                                PixelFormat::mono12p, PixelFormat::mono16};
  if (std::ranges::find(known, format) == known.end())
    throw Failure(
        fmt::format("the camera sends pixel format {:#010x}; Mono8, Mono12, Mono12Packed, Mono12p and Mono16 "
                    "can be stored (--set PixelFormat=Mono16)",
                    static_cast<std::uint32_t>(format)));
  CountImage image({arv_buffer_get_image_height(buffer), arv_buffer_get_image_width(buffer)});
  std::size_t size = 0;
  const auto* data = static_cast<const std::uint8_t*>(arv_buffer_get_data(buffer, &size));
  const std::size_t needed = image_bytes(format, image.shape().pixels());
  if (size < needed) throw Failure("a frame is shorter than its width and height say");
  const std::vector<std::uint16_t> counts = unpack(format, std::span(data, needed), image.shape().pixels());
  std::ranges::transform(counts, image.pixels().begin(), [shift = unpack_shift(format)](std::uint16_t count) {
    return static_cast<std::uint16_t>(count >> shift);
  });
  return image;
}

}  // namespace

std::vector<FoundCamera> find_cameras() {
  arv_update_device_list();
  std::vector<FoundCamera> found;
  for (unsigned i = 0; i < arv_get_n_devices(); ++i) {
    const auto text = [](const char* value) { return std::string(value ? value : ""); };
    found.push_back(
        {text(arv_get_device_id(i)), text(arv_get_device_address(i)), text(arv_get_device_protocol(i))});
  }
  return found;
}

struct AravisClient::Body {
  Owned<ArvCamera> camera;

  ArvDevice* device() const { return arv_camera_get_device(camera.get()); }
  bool has(const char* feature) const {
    Complaint ignored;
    return arv_device_is_feature_available(device(), feature, &ignored);
  }
  double number(const char* feature, double otherwise) const {
    if (!has(feature)) return otherwise;
    Complaint complaint;
    ArvGcNode* node = arv_device_get_feature(device(), feature);
    const double value =
        ARV_IS_GC_FLOAT(node)
            ? arv_gc_float_get_value(ARV_GC_FLOAT(node), &complaint)
            : static_cast<double>(arv_gc_integer_get_value(ARV_GC_INTEGER(node), &complaint));
    return complaint ? otherwise : value;
  }
  std::string text(const char* feature) const {
    if (!has(feature)) return {};
    Complaint complaint;
    const char* value = arv_device_get_string_feature_value(device(), feature, &complaint);
    return complaint || !value ? std::string{} : value;
  }
};

AravisClient::AravisClient(const std::string& name) : body_(std::make_unique<Body>()) {
  Complaint complaint;
  body_->camera.reset(arv_camera_new(name.c_str(), &complaint));
  if (!body_->camera)
    throw Error("ADDRESS",
                "'" + name + "': " + complaint.text() + " (atomcam grab --list shows who is there)");
}

AravisClient::~AravisClient() = default;

void AravisClient::set(const std::string& feature, const std::string& value) {
  const std::string place = "--set " + feature;
  ArvGcNode* node = arv_device_get_feature(body_->device(), feature.c_str());
  if (!node || !ARV_IS_GC_FEATURE_NODE(node)) throw Error(place, "the camera has no such feature");
  Complaint complaint;
  if (ARV_IS_GC_COMMAND(node)) {
    arv_gc_command_execute(ARV_GC_COMMAND(node), &complaint);
  } else {
    arv_gc_feature_node_set_value_from_string(ARV_GC_FEATURE_NODE(node), value.c_str(), &complaint);
  }
  if (complaint) throw Error(place, "'" + value + "': " + complaint.text());
}

std::string AravisClient::model() {
  return body_->text("DeviceModelName");
}

StackSettings AravisClient::settings() {
  const Body& body = *body_;
  StackSettings settings;
  settings.command = "grab";
  settings.camera = model();
  settings.serial = body.text("DeviceSerialNumber");
  settings.seed = static_cast<std::uint64_t>(body.number("SimSeed", 0));
  settings.exposure_s = body.number("ExposureTime", 0) * 1e-6;
  settings.binning_x = static_cast<int>(body.number("BinningHorizontal", 1));
  settings.binning_y = static_cast<int>(body.number("BinningVertical", 1));
  settings.offset_x = static_cast<int>(body.number("OffsetX", 0)) * settings.binning_x;
  settings.offset_y = static_cast<int>(body.number("OffsetY", 0)) * settings.binning_y;
  if (body.text("Amplifier") != "Conventional") settings.em_gain = body.number("EMGain", 1);
  settings.electrons_per_count = body.number("ElectronsPerCount", 0);
  settings.bias_counts = body.number("BlackLevel", 0);
  settings.pixel_format = body.text("PixelFormat");
  return settings;
}

StreamReport AravisClient::grab(double timeout_s, const std::function<bool(const GrabbedFrame&)>& take,
                                const std::function<bool()>& stop) {
  ArvCamera* camera = body_->camera.get();
  const bool tells_truth =
      body_->has("ChunkModeActive") && arv_device_get_feature(body_->device(), "ChunkGroundTruth") != nullptr;
  const auto must = [](const Complaint& complaint, const char* what) {
    if (complaint) throw Failure(fmt::format("{}: {}", what, complaint.text()));
  };
  bool chunks_before = false;
  Owned<ArvChunkParser> parser;
  if (tells_truth) {
    Complaint complaint;
    chunks_before = arv_camera_get_chunk_mode(camera, nullptr);
    arv_camera_set_chunk_mode(camera, TRUE, &complaint);
    if (!complaint) arv_camera_set_chunk_state(camera, "GroundTruth", TRUE, &complaint);
    must(complaint, "the camera's ground truth cannot be switched on");
    parser.reset(arv_camera_create_chunk_parser(camera));
  }

  Complaint complaint;
  const auto payload = static_cast<std::uint64_t>(arv_camera_get_payload(camera, &complaint));
  must(complaint, "the camera's payload size cannot be read");
  Owned<ArvStream> stream(arv_camera_create_stream(camera, nullptr, nullptr, &complaint));
  must(complaint, "no stream from the camera");
  const std::uint64_t buffers =
      std::clamp<std::uint64_t>(buffered_bytes / std::max<std::uint64_t>(1, payload), 4, 64);
  for (std::uint64_t i = 0; i < buffers; ++i)
    arv_stream_push_buffer(stream.get(), arv_buffer_new(payload, nullptr));
  arv_camera_set_acquisition_mode(camera, ARV_ACQUISITION_MODE_CONTINUOUS, nullptr);
  arv_camera_start_acquisition(camera, &complaint);
  must(complaint, "the acquisition does not start");

  StreamReport report;
  const auto end_acquisition = [&] {
    arv_camera_stop_acquisition(camera, nullptr);
    const auto info = [&](const char* name) {
      return arv_stream_get_info_uint64_by_name(stream.get(), name);
    };
    arv_stream_get_statistics(stream.get(), &report.completed, &report.failed, &report.underrun);
    if (ARV_IS_GV_STREAM(stream.get())) {
      report.missing_packets = info("n_missing_packets");
      report.resend_requests = info("n_resend_requests");
      report.resent_packets = info("n_resent_packets");
    }
    stream.reset();
    if (tells_truth) arv_camera_set_chunk_mode(camera, chunks_before, nullptr);
  };
  try {
    using Clock = std::chrono::steady_clock;
    auto heard = Clock::now();
    const auto heard_nothing = [&] {
      if (lost(body_->device())) throw Failure("the camera is gone");
      if (Clock::now() - heard > std::chrono::duration<double>(timeout_s))
        throw Failure(fmt::format("no frame for {} s", timeout_s));
    };
    std::optional<std::uint64_t> last;
    for (bool more = true; more && !stop();) {
      ArvBuffer* buffer = arv_stream_timeout_pop_buffer(stream.get(), 100'000);
      if (!buffer) {
        heard_nothing();
        continue;
      }
      struct Return {
        ArvStream* stream;
        void operator()(ArvBuffer* one) const { arv_stream_push_buffer(stream, one); }
      };
      const std::unique_ptr<ArvBuffer, Return> returned(buffer, Return{stream.get()});
      if (arv_buffer_get_status(buffer) != ARV_BUFFER_STATUS_SUCCESS) {
        heard_nothing();
        continue;
      }
      heard = Clock::now();
      GrabbedFrame frame{arv_buffer_get_frame_id(buffer), image_of(buffer), {}};
      // Standard block numbers have 16 bits and go round.
      if (last && frame.id > *last + 1) report.skipped += frame.id - *last - 1;
      last = frame.id;
      if (parser && arv_buffer_has_chunks(buffer)) {
        Complaint unread;
        const char* text =
            arv_chunk_parser_get_string_value(parser.get(), buffer, "ChunkGroundTruth", &unread);
        if (!unread && text) frame.truth = text;
      }
      more = take(frame);
    }
  } catch (...) {
    end_acquisition();
    throw;
  }
  end_acquisition();
  return report;
}

}  // namespace atomcam
