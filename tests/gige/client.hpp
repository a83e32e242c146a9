#pragma once
// A small client of raw sockets: commands one by one, and a receiver of blocks that asks for what is missing.

#include <arpa/inet.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <chrono>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "gige/bytes.hpp"
#include "gige/gvcp.hpp"

namespace atomcam::test {

using gige::Command;
using gige::Endpoint;
using gige::Status;

class TestSocket {
 public:
  explicit TestSocket(const std::string& address = "127.0.0.1", int receive_bytes = 0) {
    descriptor_ = ::socket(AF_INET, SOCK_DGRAM, 0);
    sockaddr_in local{};
    local.sin_family = AF_INET;
    ::inet_pton(AF_INET, address.c_str(), &local.sin_addr);
    if (receive_bytes > 0)
      ::setsockopt(descriptor_, SOL_SOCKET, SO_RCVBUF, &receive_bytes, sizeof receive_bytes);
    ::bind(descriptor_, reinterpret_cast<sockaddr*>(&local), sizeof local);
    const int on = 1;
    ::setsockopt(descriptor_, SOL_SOCKET, SO_BROADCAST, &on, sizeof on);
  }
  ~TestSocket() { ::close(descriptor_); }
  TestSocket(const TestSocket&) = delete;

  Endpoint local() const {
    sockaddr_in address{};
    socklen_t length = sizeof address;
    ::getsockname(descriptor_, reinterpret_cast<sockaddr*>(&address), &length);
    return {ntohl(address.sin_addr.s_addr), ntohs(address.sin_port)};
  }
  void send(std::span<const std::uint8_t> bytes, Endpoint to) {
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(to.address);
    address.sin_port = htons(to.port);
    ::sendto(descriptor_, bytes.data(), bytes.size(), 0, reinterpret_cast<sockaddr*>(&address),
             sizeof address);
  }
  std::optional<std::vector<std::uint8_t>> receive(int timeout_ms) {
    pollfd waits{descriptor_, POLLIN, 0};
    if (::poll(&waits, 1, timeout_ms) <= 0) return std::nullopt;
    std::vector<std::uint8_t> bytes(65536);
    sockaddr_in address{};
    socklen_t length = sizeof address;
    const auto size = ::recvfrom(descriptor_, bytes.data(), bytes.size(), 0,
                                 reinterpret_cast<sockaddr*>(&address), &length);
    if (size < 0) return std::nullopt;
    from = {ntohl(address.sin_addr.s_addr), ntohs(address.sin_port)};
    bytes.resize(static_cast<std::size_t>(size));
    return bytes;
  }

  Endpoint from;

 private:
  int descriptor_ = -1;
};

struct Answer {
  Status status{};
  std::uint16_t command = 0;
  std::uint16_t id = 0;
  std::vector<std::uint8_t> payload;
  std::uint32_t word(std::size_t i = 0) const { return gige::load32(payload, 4 * i); }
  std::uint16_t index() const { return gige::load16(payload, 2); }
};

inline std::vector<std::uint8_t> command_bytes(std::uint16_t command, std::span<const std::uint8_t> payload,
                                               std::uint16_t id, std::uint8_t flags = 1) {
  std::vector<std::uint8_t> bytes{gige::gvcp_key, flags};
  gige::append16(bytes, command);
  gige::append16(bytes, static_cast<std::uint32_t>(payload.size()));
  gige::append16(bytes, id);
  bytes.insert(bytes.end(), payload.begin(), payload.end());
  return bytes;
}

inline std::vector<std::uint8_t> words(std::initializer_list<std::uint32_t> values) {
  std::vector<std::uint8_t> bytes;
  for (const std::uint32_t value : values) gige::append32(bytes, value);
  return bytes;
}

class TestClient {
 public:
  explicit TestClient(Endpoint device, const std::string& address = "127.0.0.1")
      : socket(address), device_(device) {}

  void send(Command command, std::span<const std::uint8_t> payload, std::uint8_t flags = 1) {
    if (++id_ == 0) id_ = 1;
    socket.send(command_bytes(static_cast<std::uint16_t>(command), payload, id_, flags), device_);
  }
  std::optional<Answer> answer(int timeout_ms = 1000) {
    const auto bytes = socket.receive(timeout_ms);
    if (!bytes || bytes->size() < 8) return std::nullopt;
    return Answer{static_cast<Status>(gige::load16(*bytes, 0)),
                  gige::load16(*bytes, 2),
                  gige::load16(*bytes, 6),
                  {bytes->begin() + 8, bytes->end()}};
  }
  std::optional<Answer> ask(Command command, std::span<const std::uint8_t> payload, std::uint8_t flags = 1) {
    send(command, payload, flags);
    return answer();
  }
  Status write(std::uint32_t address, std::uint32_t value) {
    const auto reply = ask(Command::write_register, words({address, value}));
    return reply ? reply->status : static_cast<Status>(0xffff);
  }
  std::optional<std::uint32_t> read(std::uint32_t address) {
    const auto reply = ask(Command::read_register, words({address}));
    if (!reply || reply->status != Status::success || reply->payload.size() != 4) return std::nullopt;
    return reply->word();
  }
  Status read_status(std::uint32_t address) {
    const auto reply = ask(Command::read_register, words({address}));
    return reply ? reply->status : static_cast<Status>(0xffff);
  }

  TestSocket socket;

 private:
  Endpoint device_;
  std::uint16_t id_ = 0;
};

}  // namespace atomcam::test
