#pragma once
// The control side of the device without sockets: a datagram and its sender in, the answer out. Trusts
// nothing it is given; every length, address, alignment and access is checked here.

#include <array>
#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "camera/transport.hpp"
#include "gige/protocol.hpp"

namespace atomcam::gige {

/// Where and how a stream goes, as the registers of channel 0 say.
struct StreamConfiguration {
  Endpoint destination;            // port 0: closed
  std::uint32_t packet_bytes = 0;  // of the IP packet
  bool do_not_fragment = false;
  std::uint64_t packet_delay_ns = 0;
  bool extended_ids = false;
  bool operator==(const StreamConfiguration&) const = default;
};

struct FaultConfiguration {
  double packet_loss = 0;   // probability per packet, 0 to 1
  std::uint32_t burst = 1;  // packets lost in a row each time
  double reorder = 0;       // probability that a packet changes places with the next
  double duplicate = 0;     // probability that a packet is sent twice
  double frame_delay = 0;   // probability that a frame is held back
  std::uint32_t frame_delay_us = 0;
  double frame_drop = 0;  // probability that a frame is not sent at all
  std::uint64_t seed = 1;
  bool operator==(const FaultConfiguration&) const = default;
};

struct ResendRequest {
  Endpoint from;
  std::uint64_t block = 0;
  std::uint32_t first = 0, last = 0;
  bool extended = false;
  bool extended_status = false;  // the client understands the codes of version 1.1 and later
};

struct MessageChannel {
  Endpoint destination;          // port 0: closed
  std::uint32_t timeout_ms = 0;  // 0: no acknowledge is asked for
  std::uint32_t retries = 0;
};

/// What the control side makes the rest of the device do.
class ControlledDevice {
 public:
  virtual ~ControlledDevice() = default;
  virtual void stream_configured(const StreamConfiguration& stream) = 0;
  virtual void faults_configured(const FaultConfiguration& faults) = 0;
  virtual void messages_configured(const MessageChannel& messages) = 0;
  virtual void send_test_packet(const StreamConfiguration& stream) = 0;
  virtual void resend(const ResendRequest& request) = 0;
  virtual void event_acknowledged(std::uint16_t request) = 0;
  /// Sent before the answer where a command takes long.
  virtual void send_control(Endpoint to, std::span<const std::uint8_t> datagram) = 0;
};

struct InterfaceDescription {
  std::uint32_t address = 0x7f000001, mask = 0xff000000, gateway = 0;
  std::array<std::uint8_t, 6> mac{};
  std::uint32_t mtu = 65536;
  std::uint32_t link_speed_mbit_s = 10000;
};

class Control {
 public:
  Control(TransportCamera& camera, ControlledDevice& device, InterfaceDescription interface, std::string xml,
          std::string xml_name, std::uint32_t default_packet_bytes, FaultConfiguration faults);

  /// The answer to one datagram, empty if there is none. `now_ns`: monotonic.
  Bytes handle(std::span<const std::uint8_t> datagram, Endpoint from, std::uint64_t now_ns);
  /// Frees the camera if its controller has been silent for longer than the heartbeat.
  void check_heartbeat(std::uint64_t now_ns);

  std::optional<Endpoint> controller() const { return controller_; }
  /// The port that answers come from (register SCSP of the stream, MCSP of the messages).
  void set_source_ports(std::uint16_t stream, std::uint16_t messages);

 private:
  enum class Use : std::uint8_t { none = 0, read = 1, write = 2, both = 3 };
  struct Result {
    Status status = Status::success;
    Bytes payload;
  };

  Result discovery() const;
  Result force_ip(std::span<const std::uint8_t> payload) const;
  Result read_registers(std::span<const std::uint8_t> payload, Endpoint from);
  Result write_registers(std::span<const std::uint8_t> payload, Endpoint from, std::uint64_t now_ns,
                         std::uint16_t request);
  Result read_memory(std::span<const std::uint8_t> payload, Endpoint from);
  Result write_memory(std::span<const std::uint8_t> payload, Endpoint from, std::uint64_t now_ns,
                      std::uint16_t request);
  Result action(std::span<const std::uint8_t> payload, std::uint8_t flags, bool& answer);
  void packet_resend(std::span<const std::uint8_t> payload, std::uint8_t flags, Endpoint from);

  Status read(std::uint32_t address, std::span<std::uint8_t> bytes, Endpoint from);
  Status write(std::uint32_t address, std::span<const std::uint8_t> bytes, Endpoint from,
               std::uint64_t now_ns, std::uint16_t request);
  Status write_camera(std::uint32_t address, std::span<const std::uint8_t> bytes, Endpoint from,
                      std::uint16_t request);
  Status write_word(std::uint32_t address, std::uint32_t value, Endpoint from, std::uint64_t now_ns);
  Status write_privilege(std::uint32_t value, Endpoint from, std::uint64_t now_ns);
  void release();
  bool may_read(Endpoint from) const;

  std::uint32_t word(std::uint32_t address) const { return load32(registers_, address); }
  void set_word(std::uint32_t address, std::uint32_t value) { store32(registers_, address, value); }
  void allow(std::uint32_t begin, std::uint32_t end, Use use);
  void allow_word(std::uint32_t address, Use use) { allow(address, address + 4, use); }
  void set_text(std::uint32_t address, std::size_t capacity, const std::string& text);
  StreamConfiguration stream() const;
  FaultConfiguration faults() const;
  MessageChannel messages() const;

  TransportCamera& camera_;
  ControlledDevice& device_;
  InterfaceDescription interface_;
  Bytes registers_;       // 0 to transport_end
  std::vector<Use> use_;  // of every word of it
  Bytes xml_;             // padded to four bytes
  std::optional<Endpoint> controller_;
  std::uint64_t heard_ns_ = 0;  // from the controller
};

/// The transport's own features: registers of the bootstrap space and fault injection, for the camera's XML.
std::vector<FeatureDeclaration> transport_features(const InterfaceDescription& interface,
                                                   std::uint32_t default_packet_bytes);

}  // namespace atomcam::gige
