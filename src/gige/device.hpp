#pragma once
// A camera as a GVCP / GVSP device: it answers discovery and control on its own address and streams its
// frames. Compatible with GigE Vision 2.0 clients as far as docs/gige.md says.

#include <cstdint>
#include <memory>
#include <optional>
#include <string>

#include "camera/transport.hpp"
#include "gige/control.hpp"
#include "gige/stream.hpp"

namespace atomcam::gige {

struct DeviceOptions {
  std::string address = "127.0.0.1";  // IPv4 address of this host; loopback unless asked otherwise
  std::uint16_t port = control_port;  // of control; clients expect 3956
  std::uint32_t packet_bytes = 9000;  // of the IP packet, at power-up; never more than the interface's MTU
  StreamOptions stream;
  FaultConfiguration faults;
  std::string xml_file;  // served instead of the camera's own GenICam XML; empty: its own
};

class Device {
 public:
  struct Statistics {
    std::optional<Endpoint> client;  // the controlling application
    StreamStatistics stream;
  };

  /// Throws Error naming the address if it is no address of this host or its port is taken.
  Device(TransportCamera& camera, DeviceOptions options);
  ~Device();
  Device(const Device&) = delete;
  Device& operator=(const Device&) = delete;

  Statistics statistics() const;
  const std::string& address() const;

 private:
  class Body;
  std::unique_ptr<Body> body_;
};

/// "127.0.0.1" of an address in host order.
std::string to_text(std::uint32_t address);

}  // namespace atomcam::gige
