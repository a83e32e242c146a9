#pragma once
// A camera on the network: control (GVCP) and stream (GVSP) over a TransportCamera. Compatible with GigE
// Vision 2.0 clients; not a certified device.

#include <cstdint>
#include <memory>
#include <optional>
#include <string>

#include "camera/transport.hpp"
#include "gige/fault_injection.hpp"
#include "gige/streamer.hpp"
#include "gige/udp_socket.hpp"

namespace atomcam::gige {

struct DeviceOptions {
  /// The device's own address. Any of 127.0.0.0/8 needs no set-up and stays on this host; another one must be
  /// an address of this host.
  std::string address = "127.0.0.1";
  std::uint16_t port = gvcp_port;  // of control, where clients look; 0 takes any free one
  bool discovery = true;           // answer broadcasts from the own subnet
  std::uint64_t mac = 0;           // 0: made from model, serial number and address

  /// Bytes of an IP packet that carries a piece of a frame, at power-up and at most; 0: what the interface
  /// suits.
  std::uint32_t packet_bytes = 0;
  std::uint32_t largest_packet_bytes = 0;

  StreamOptions stream = {};
  FaultConfiguration faults = {};
  std::string xml_file = {};  // serve this description instead of the camera's own
};

class Device {
 public:
  /// Listens from here on. Throws an Error that names address:port where it cannot.
  Device(TransportCamera& camera, const DeviceOptions& options);
  ~Device();
  Device(const Device&) = delete;
  Device& operator=(const Device&) = delete;

  const std::string& address() const;
  std::uint16_t port() const;

  struct Statistics {
    std::optional<Endpoint> client;       // in control
    std::optional<Endpoint> destination;  // where frames go; nothing: channel closed
    StreamStatistics stream;
  };
  Statistics statistics() const;

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace atomcam::gige
