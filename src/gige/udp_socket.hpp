#pragma once
// A UDP socket that closes itself, and addresses as text.

#include <netinet/in.h>

#include <optional>
#include <string>
#include <vector>

#include "gige/gvcp.hpp"

namespace atomcam::gige {

/// "127.0.0.1" -> host-order number; throws an Error that names the place where it is not an address.
std::uint32_t parse_address(const std::string& place, const std::string& text);
std::string to_text(std::uint32_t address);
std::string to_text(Endpoint endpoint);
sockaddr_in socket_address(Endpoint endpoint);

inline bool is_loopback(std::uint32_t address) {
  return address >> 24 == 127;
}
inline bool is_multicast(std::uint32_t address) {
  return address >> 28 == 0xe;
}

/// A network interface of this host: its mask and the largest packet it carries.
struct Interface {
  std::uint32_t mask = 0xffffff00u;
  std::uint32_t mtu = 1500;
  std::uint32_t link_mbps = 1000;
};
/// The interface that `address` belongs to; nothing if the host has no such address.
std::optional<Interface> find_interface(std::uint32_t address);

class UdpSocket {
 public:
  UdpSocket();
  ~UdpSocket();
  UdpSocket(UdpSocket&& other) noexcept : descriptor_(other.descriptor_) { other.descriptor_ = -1; }
  UdpSocket& operator=(UdpSocket&&) = delete;

  /// Throws an Error naming address:port where it is taken or not ours. `shared`: others may bind it as well.
  void bind(Endpoint endpoint, bool shared = false);
  Endpoint local() const;
  int descriptor() const { return descriptor_; }

  void send(Bytes bytes, Endpoint to);
  /// A waiting datagram, or nothing. Cut where it is longer than `buffer`.
  std::optional<std::size_t> receive(std::span<std::uint8_t> buffer, Endpoint& from);

 private:
  int descriptor_ = -1;
};

}  // namespace atomcam::gige
