#pragma once
// The words of the control protocol (GVCP): commands, status codes, limits.

#include <cstdint>

#include "gige/bytes.hpp"

namespace atomcam::gige {

inline constexpr std::uint16_t gvcp_port = 3956;
inline constexpr std::size_t gvcp_header_bytes = 8;
inline constexpr std::uint8_t gvcp_key = 0x42;

// A control datagram fits into 576 bytes of IP.
inline constexpr std::size_t gvcp_payload_bytes = 540;
inline constexpr std::size_t memory_bytes = 536;
inline constexpr std::size_t read_registers = 135;
inline constexpr std::size_t write_registers = 67;

namespace flag {
inline constexpr std::uint8_t acknowledge = 0x01;
inline constexpr std::uint8_t extended_ids = 0x10;  // PACKETRESEND, EVENT
inline constexpr std::uint8_t scheduled = 0x80;     // ACTION
}  // namespace flag

enum class Command : std::uint16_t {
  discovery = 0x0002,
  force_ip = 0x0004,
  packet_resend = 0x0040,
  read_register = 0x0080,
  write_register = 0x0082,
  read_memory = 0x0084,
  write_memory = 0x0086,
  pending = 0x0088,  // only its acknowledge, 0x0089, travels
  event = 0x00c0,
  action = 0x0100,
};

enum class Status : std::uint16_t {
  success = 0x0000,
  packet_resent = 0x0100,
  not_implemented = 0x8001,
  invalid_parameter = 0x8002,
  invalid_address = 0x8003,
  write_protect = 0x8004,
  bad_alignment = 0x8005,
  access_denied = 0x8006,
  busy = 0x8007,
  packet_unavailable = 0x800c,
  invalid_header = 0x800e,
  packet_not_yet_available = 0x8010,
  packet_and_previous_removed = 0x8011,
  packet_removed = 0x8012,
  packet_temporarily_unavailable = 0x8014,
  error = 0x8fff,
};

/// Where a datagram came from or goes to; address as a number in host order.
struct Endpoint {
  std::uint32_t address = 0;
  std::uint16_t port = 0;
  bool operator==(const Endpoint&) const = default;
};

struct CommandHeader {
  std::uint8_t flags = 0;
  std::uint16_t command = 0;
  std::uint16_t length = 0;  // bytes after the header
  std::uint16_t id = 0;
  bool wants_acknowledge() const { return (flags & flag::acknowledge) != 0; }
};

}  // namespace atomcam::gige
