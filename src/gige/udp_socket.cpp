#include "gige/udp_socket.hpp"

#include <arpa/inet.h>
#include <fmt/format.h>
#include <ifaddrs.h>
#include <net/if.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>

#include "base/error.hpp"

namespace atomcam::gige {

std::uint32_t parse_address(const std::string& place, const std::string& text) {
  in_addr address{};
  if (::inet_pton(AF_INET, text.c_str(), &address) != 1)
    throw Error(place, fmt::format("'{}' is not an IPv4 address such as 127.0.0.1", text));
  return ntohl(address.s_addr);
}

std::string to_text(std::uint32_t address) {
  return fmt::format("{}.{}.{}.{}", address >> 24, address >> 16 & 0xff, address >> 8 & 0xff, address & 0xff);
}

std::string to_text(Endpoint endpoint) {
  return fmt::format("{}:{}", to_text(endpoint.address), endpoint.port);
}

sockaddr_in socket_address(Endpoint endpoint) {
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_addr.s_addr = htonl(endpoint.address);
  address.sin_port = htons(endpoint.port);
  return address;
}

std::optional<Interface> find_interface(std::uint32_t address) {
  // The whole of 127/8 is this host's.
  if (is_loopback(address)) return Interface{0xff000000u, 65536, 10000};
  ifaddrs* all = nullptr;
  if (::getifaddrs(&all) != 0) return std::nullopt;
  std::optional<Interface> found;
  for (const ifaddrs* one = all; one != nullptr && !found; one = one->ifa_next) {
    if (one->ifa_addr == nullptr || one->ifa_addr->sa_family != AF_INET) continue;
    const auto number = [](const sockaddr* socket) {
      return ntohl(reinterpret_cast<const sockaddr_in*>(socket)->sin_addr.s_addr);
    };
    if (number(one->ifa_addr) != address) continue;
    found = Interface{};
    if (one->ifa_netmask != nullptr) found->mask = number(one->ifa_netmask);
    ifreq request{};
    std::strncpy(request.ifr_name, one->ifa_name, IFNAMSIZ - 1);
    const UdpSocket socket;
    if (::ioctl(socket.descriptor(), SIOCGIFMTU, &request) == 0)
      found->mtu = static_cast<std::uint32_t>(request.ifr_mtu);
  }
  ::freeifaddrs(all);
  return found;
}

UdpSocket::UdpSocket() : descriptor_(::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0)) {
  if (descriptor_ < 0) throw Error("socket", std::strerror(errno));
}

UdpSocket::~UdpSocket() {
  if (descriptor_ >= 0) ::close(descriptor_);
}

void UdpSocket::bind(Endpoint endpoint, bool shared) {
  const int on = 1;
  if (shared) ::setsockopt(descriptor_, SOL_SOCKET, SO_REUSEADDR, &on, sizeof on);
  const sockaddr_in address = socket_address(endpoint);
  if (::bind(descriptor_, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0) return;
  const int reason = errno;
  throw Error(to_text(endpoint),
              reason == EADDRINUSE      ? "the port is taken: another camera or program listens there"
              : reason == EADDRNOTAVAIL ? "not an address of this host"
                                        : std::string("cannot listen: ") + std::strerror(reason));
}

Endpoint UdpSocket::local() const {
  sockaddr_in address{};
  socklen_t length = sizeof address;
  ::getsockname(descriptor_, reinterpret_cast<sockaddr*>(&address), &length);
  return {ntohl(address.sin_addr.s_addr), ntohs(address.sin_port)};
}

void UdpSocket::send(Bytes bytes, Endpoint to) {
  const sockaddr_in address = socket_address(to);
  // An answer that cannot be sent is as good as lost on the way: the client asks again.
  [[maybe_unused]] const auto sent =
      ::sendto(descriptor_, bytes.data(), bytes.size(), MSG_DONTWAIT | MSG_NOSIGNAL,
               reinterpret_cast<const sockaddr*>(&address), sizeof address);
}

std::optional<std::size_t> UdpSocket::receive(std::span<std::uint8_t> buffer, Endpoint& from) {
  sockaddr_in address{};
  socklen_t length = sizeof address;
  for (;;) {
    const auto size = ::recvfrom(descriptor_, buffer.data(), buffer.size(), MSG_DONTWAIT,
                                 reinterpret_cast<sockaddr*>(&address), &length);
    if (size >= 0) {
      from = {ntohl(address.sin_addr.s_addr), ntohs(address.sin_port)};
      return static_cast<std::size_t>(size);
    }
    // ICMP errors of earlier answers surface here; what waits behind them still counts.
    if (errno != ECONNREFUSED && errno != EINTR) return std::nullopt;
  }
}

}  // namespace atomcam::gige
