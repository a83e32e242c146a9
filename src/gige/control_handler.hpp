#pragma once
// The control side of the device as a function: datagrams in, datagrams out, and orders to the rest of the
// device. No sockets, threads or clocks: time is an argument. One thread at a time.

#include <deque>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "camera/transport.hpp"
#include "gige/bootstrap.hpp"
#include "gige/fault_injection.hpp"
#include "gige/gvsp.hpp"

namespace atomcam::gige {

struct ResendRequest {
  std::uint64_t block = 0;  // as packets carry it
  bool extended_ids = false;
  std::uint32_t first = 0, last = 0;
};

struct MessageChannel {
  Endpoint destination;          // open when address and port are set
  std::uint32_t timeout_ms = 0;  // 0: no acknowledge wanted
  std::uint32_t retries = 0;
  bool extended_ids = false;
  bool open() const { return destination.address != 0 && destination.port != 0; }
};

/// What the rest of the device does for the control side. Called from within ControlHandler; must not block.
class ControlActions {
 public:
  virtual ~ControlActions() = default;
  virtual void configure_stream(const StreamSettings&) = 0;
  virtual void fire_test_packet(std::uint32_t packet_bytes) = 0;
  virtual void resend(const ResendRequest&) = 0;
  virtual void inject_faults(const FaultConfiguration&) = 0;
  virtual void configure_messages(const MessageChannel&) = 0;
  /// On the message channel as it is at the call.
  virtual void send_message(int event_id) = 0;
  virtual void stop_acquisition() = 0;
  virtual bool acquiring() const = 0;

  struct Counters {
    std::uint64_t resend_requests = 0, resent_packets = 0, unavailable_packets = 0, dropped_frames = 0;
  };
  virtual Counters counters() const = 0;
};

/// What stays the same about a device while it lives.
struct DeviceFacts {
  std::uint32_t address = 0x7f000001, mask = 0xff000000;
  std::uint64_t mac = 0x020000000001;
  std::uint32_t link_mbps = 10000;
  std::uint32_t packet_bytes = 16000, smallest_packet_bytes = 220, largest_packet_bytes = 16000;
  std::uint16_t stream_source_port = 0, message_source_port = 0;
  std::string xml_name = "camera.xml";
  std::string xml;
  FaultConfiguration faults;
};

inline constexpr std::uint32_t packet_bytes_step = 4;
inline constexpr std::uint32_t largest_delay_ns = 100'000'000;
inline constexpr std::uint32_t shortest_heartbeat_ms = 500;

class ControlHandler {
 public:
  struct Outgoing {
    Endpoint to;
    std::vector<std::uint8_t> bytes;
  };
  using Answers = std::vector<Outgoing>;

  /// A write into the camera's registers, to be done by the owner, who then calls camera_wrote(). Commands
  /// that need the camera wait meanwhile; all others are answered.
  struct CameraWrite {
    std::uint32_t address = 0;
    std::vector<std::uint8_t> bytes;
  };

  ControlHandler(TransportCamera& camera, ControlActions& actions, DeviceFacts facts);

  /// Handles any datagram whatsoever.
  void receive(Bytes datagram, Endpoint from, Time now, Answers& out);
  /// To be called when next_deadline() has come (or earlier): heartbeat, PENDING_ACK.
  void tick(Time now, Answers& out);
  std::optional<Time> next_deadline() const;

  std::optional<CameraWrite> take_camera_write();
  void camera_wrote(RegisterStatus status, Time now, Answers& out);

  std::optional<Endpoint> controller() const { return controller_; }
  /// A request for discovery, FORCEIP or an action that came by broadcast is heeded from the device's own
  /// subnet.
  bool in_subnet(Endpoint from) const {
    return (from.address & facts_.mask) == (facts_.address & facts_.mask);
  }

 private:
  // One WRITEREG or WRITEMEM under way, step by step.
  struct Step {
    std::uint32_t address = 0;
    std::size_t at = 0, bytes = 0;  // of the datagram
  };
  struct Job {
    Endpoint from;
    CommandHeader header;
    std::vector<std::uint8_t> datagram;
    std::vector<Step> steps;
    std::size_t done = 0;
    enum class Wait { none, camera, stop } wait = Wait::none;
    Time since{};
    Time next_pending{}, next_look{};
    std::uint16_t index_on_success = 0;
  };

  void dispatch(Bytes datagram, const CommandHeader& header, Endpoint from, Time now, Answers& out);
  void discovery(const CommandHeader& header, Endpoint from, Answers& out);
  void force_ip(Bytes payload, const CommandHeader& header, Endpoint from, Answers& out);
  void packet_resend(Bytes payload, const CommandHeader& header, Endpoint from);
  void read_register(Bytes payload, const CommandHeader& header, Endpoint from, Answers& out);
  void read_memory(Bytes payload, const CommandHeader& header, Endpoint from, Answers& out);
  void write_command(Bytes datagram, const CommandHeader& header, Endpoint from, Time now, Answers& out);
  void action(Bytes payload, const CommandHeader& header, Endpoint from, Answers& out);

  void proceed(Time now, Answers& out);
  void finish(Status status, Time now, Answers& out);
  Status write_bootstrap(std::uint32_t address, std::uint32_t value, Endpoint from, Time now);
  Status write_control(std::uint32_t value, Endpoint from, Time now);
  Status write_packet_size(std::uint32_t value);
  Status write_destination(std::uint32_t address, std::uint32_t value);
  bool locked(const Step& step, Bytes datagram) const;
  Status read_word(std::uint32_t address, std::uint32_t& value);
  Status read_bytes(std::uint32_t address, std::size_t bytes, std::vector<std::uint8_t>& out);

  bool may_read(Endpoint from, std::uint32_t address) const;
  bool needs_camera(const CommandHeader& header, Bytes payload) const;
  bool touches_text(std::uint32_t address, std::size_t bytes) const;
  void refresh(std::uint32_t address, std::size_t bytes);
  void lose_control();
  void apply_stream();
  void apply_messages();
  void apply_faults();
  void acknowledge(const CommandHeader& header, Endpoint to, Status status, Bytes payload, Answers& out);

  TransportCamera& camera_;
  ControlActions& actions_;
  DeviceFacts facts_;
  BootstrapRegisters registers_;
  std::optional<Endpoint> controller_;
  Time last_heard_{};
  FaultConfiguration faults_;

  std::optional<Job> job_;
  std::optional<CameraWrite> camera_write_;
  struct Waiting {
    Endpoint from;
    std::vector<std::uint8_t> datagram;
  };
  std::deque<Waiting> waiting_;
  // The last completed write, to answer its repetition without doing it again.
  struct Completed {
    Endpoint from;
    std::vector<std::uint8_t> datagram, answer;
    Time at{};
  };
  std::optional<Completed> completed_;
};

}  // namespace atomcam::gige
