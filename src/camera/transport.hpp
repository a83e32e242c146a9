#pragma once
// What a transport (GigE Vision, a vendor library, GenTL) needs of a camera, and what the camera tells it.

#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "base/feature.hpp"

namespace atomcam {

enum class RegisterStatus {
  ok,
  invalid_address,
  write_protect,
  bad_alignment,
  access_denied,  // locked while acquiring
  busy,
  invalid_parameter,  // out of range, not an entry
};

/// A frame as it leaves the camera: pixels packed in the pixel format, then chunks if they are on.
struct CameraFrame {
  std::uint64_t id = 0;            // frame number since the camera was opened
  std::uint64_t timestamp_ns = 0;  // start of exposure on the camera's clock
  std::uint32_t pixel_format = 0;  // PFNC code
  std::uint32_t width = 0, height = 0, offset_x = 0, offset_y = 0;
  bool chunks = false;  // payload ends with [data][id32][length32] records, image first
  std::size_t image_bytes = 0;
  std::vector<std::uint8_t> payload;
};

struct CameraEvent {
  enum class Kind { exposure_end, frame_lost } kind = Kind::exposure_end;
  std::uint64_t frame_id = 0;
  std::uint64_t timestamp_ns = 0;
};

/// What an event is called on the wire (device-specific events begin at 0x9000) and in the XML.
constexpr int event_id(CameraEvent::Kind kind) {
  return kind == CameraEvent::Kind::exposure_end ? 0x9001 : 0x9002;
}

/// Receives frames in order, from the camera's delivery thread. Must not block for long.
class FrameSink {
 public:
  virtual ~FrameSink() = default;
  virtual void deliver(std::shared_ptr<const CameraFrame> frame) = 0;
  virtual void notify(const CameraEvent&) {}
  virtual void acquisition_started() {}
  virtual void acquisition_stopped() {}
};

/// The side of a camera that a transport sees. Addresses below 0x10000 belong to the transport.
class TransportCamera {
 public:
  virtual ~TransportCamera() = default;

  struct Identity {
    std::string vendor, model, version, info, serial, user_name;
  };
  virtual Identity identity() const = 0;
  virtual void set_user_name(const std::string& name) = 0;

  static constexpr std::uint32_t first_address = 0x10000;
  /// Whole registers, big endian. Several adjacent ones may be read at once; a write hits exactly one.
  virtual RegisterStatus read(std::uint32_t address, std::span<std::uint8_t> bytes) = 0;
  virtual RegisterStatus write(std::uint32_t address, std::span<const std::uint8_t> bytes) = 0;

  /// The GenICam XML: the camera's features plus the transport's own, which carry their addresses; those
  /// without an address are constants (default_value, default_string).
  virtual std::string genicam_xml(std::span<const FeatureDeclaration> transport_features) const = 0;

  /// One sink at a time; nullptr detaches. Delivery to the old sink has ended on return.
  virtual void attach(FrameSink* sink) = 0;
  /// As if the client had executed AcquisitionStop (loss of control, channel closed), and TLParamsLocked = 0.
  virtual void stop_acquisition() = 0;
  /// Device clock, ns since the camera was opened (monotonic); `reset` sets it to zero.
  virtual std::uint64_t timestamp_ns() const = 0;
  virtual void reset_timestamp() = 0;
  /// An action command or hardware line: fires the trigger if its source is that line.
  virtual void fire_action(int signal) = 0;
  /// A frame that the transport had to drop before a client could have it.
  virtual void report_lost(std::uint64_t frame_id) = 0;
};

}  // namespace atomcam
