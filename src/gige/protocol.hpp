#pragma once
// Numbers of the GigE Vision control (GVCP) and stream (GVSP) protocols. All fields on the wire are big
// endian.

#include <cstdint>
#include <span>
#include <vector>

namespace atomcam::gige {

inline constexpr std::uint16_t control_port = 3956;
inline constexpr std::size_t control_payload_limit = 540;  // of a GVCP datagram of 576 bytes IP

enum class Command : std::uint16_t {
  discovery = 0x0002,
  force_ip = 0x0004,
  packet_resend = 0x0040,
  read_register = 0x0080,
  write_register = 0x0082,
  read_memory = 0x0084,
  write_memory = 0x0086,
  pending_acknowledge = 0x0089,
  event = 0x00c0,
  event_data = 0x00c2,
  action = 0x0100,
};

enum class Status : std::uint16_t {
  success = 0x0000,
  packet_resend = 0x0100,
  not_implemented = 0x8001,
  invalid_parameter = 0x8002,
  invalid_address = 0x8003,
  write_protect = 0x8004,
  bad_alignment = 0x8005,
  access_denied = 0x8006,
  busy = 0x8007,
  packet_unavailable = 0x800c,
  data_overrun = 0x800d,
  invalid_header = 0x800e,
  packet_not_yet_available = 0x8010,
  packet_and_previous_removed = 0x8011,
  packet_removed = 0x8012,
  packet_temporarily_unavailable = 0x8014,
  generic_error = 0x8fff,
};

inline constexpr std::uint8_t command_key = 0x42;
inline constexpr std::uint8_t flag_acknowledge = 0x01;
inline constexpr std::uint8_t flag_broadcast_or_extended = 0x10;
inline constexpr std::uint8_t flag_scheduled = 0x80;

/// An address of IPv4 and a port, in host order.
struct Endpoint {
  std::uint32_t address = 0;
  std::uint16_t port = 0;
  bool operator==(const Endpoint&) const = default;
};

using Bytes = std::vector<std::uint8_t>;

inline std::uint16_t load16(std::span<const std::uint8_t> bytes, std::size_t at) {
  return static_cast<std::uint16_t>(bytes[at] << 8 | bytes[at + 1]);
}
inline std::uint32_t load32(std::span<const std::uint8_t> bytes, std::size_t at) {
  return static_cast<std::uint32_t>(load16(bytes, at)) << 16 | load16(bytes, at + 2);
}
inline std::uint64_t load64(std::span<const std::uint8_t> bytes, std::size_t at) {
  return static_cast<std::uint64_t>(load32(bytes, at)) << 32 | load32(bytes, at + 4);
}
inline void store16(std::span<std::uint8_t> bytes, std::size_t at, std::uint32_t value) {
  bytes[at] = static_cast<std::uint8_t>(value >> 8);
  bytes[at + 1] = static_cast<std::uint8_t>(value);
}
inline void store32(std::span<std::uint8_t> bytes, std::size_t at, std::uint32_t value) {
  store16(bytes, at, value >> 16);
  store16(bytes, at + 2, value & 0xffffu);
}
inline void store64(std::span<std::uint8_t> bytes, std::size_t at, std::uint64_t value) {
  store32(bytes, at, static_cast<std::uint32_t>(value >> 32));
  store32(bytes, at + 4, static_cast<std::uint32_t>(value));
}

/// Registers of the bootstrap space and of the transport's own space above it.
namespace reg {
inline constexpr std::uint32_t version = 0x0000, device_mode = 0x0004, mac_high = 0x0008, mac_low = 0x000c,
                               ip_capability = 0x0010, ip_configuration = 0x0014, current_ip = 0x0024,
                               current_mask = 0x0034, current_gateway = 0x0044, manufacturer = 0x0048,
                               model = 0x0068, device_version = 0x0088, information = 0x00a8, serial = 0x00d8,
                               user_name = 0x00e8, discovery_end = 0x00f8, first_url = 0x0200,
                               second_url = 0x0400, interfaces = 0x0600, persistent_ip = 0x064c,
                               persistent_mask = 0x065c, persistent_gateway = 0x066c, link_speed = 0x0670,
                               message_channels = 0x0900, stream_channels = 0x0904, action_signals = 0x0908,
                               action_device_key = 0x090c, active_links = 0x0910, stream_capability = 0x092c,
                               message_capability = 0x0930, control_capability = 0x0934, heartbeat = 0x0938,
                               tick_high = 0x093c, tick_low = 0x0940, timestamp_control = 0x0944,
                               timestamp_high = 0x0948, timestamp_low = 0x094c,
                               control_configuration = 0x0954, pending_timeout = 0x0958,
                               switchover_key = 0x095c, stream_configuration = 0x0960,
                               link_capability = 0x0964, link_configuration = 0x0968,
                               control_privilege = 0x0a00, primary_port = 0x0a04, primary_ip = 0x0a14,
                               message_port = 0x0b00, message_address = 0x0b10, message_timeout = 0x0b14,
                               message_retries = 0x0b18, message_source = 0x0b1c, stream_port = 0x0d00,
                               packet_size = 0x0d04, packet_delay = 0x0d08, stream_address = 0x0d18,
                               stream_source = 0x0d1c, channel_capability = 0x0d20,
                               channel_configuration = 0x0d24, action_group = 0x9800;
inline constexpr std::uint32_t bootstrap_end = 0xa000;
inline constexpr std::uint32_t fault_loss_ppm = 0xa000, fault_burst = 0xa004, fault_reorder_ppm = 0xa008,
                               fault_duplicate_ppm = 0xa00c, fault_delay_ppm = 0xa010,
                               fault_delay_us = 0xa014, fault_drop_frames_ppm = 0xa018, fault_seed = 0xa01c;
inline constexpr std::uint32_t transport_end = 0x10000;
inline constexpr std::uint32_t xml = 0x100000;
}  // namespace reg

inline constexpr int action_signal_count = 4;

}  // namespace atomcam::gige
