#pragma once
// The bootstrap registers: addresses, who may read and write them, their values. What a write means beyond
// its value is decided by ControlHandler.

#include <cstdint>
#include <string_view>
#include <vector>

#include "gige/gvcp.hpp"

namespace atomcam::gige {

namespace reg {
inline constexpr std::uint32_t version = 0x0000, device_mode = 0x0004, mac_high = 0x0008, mac_low = 0x000c,
                               ip_capability = 0x0010, ip_configuration = 0x0014, current_ip = 0x0024,
                               subnet_mask = 0x0034, gateway = 0x0044, manufacturer = 0x0048, model = 0x0068,
                               device_version = 0x0088, manufacturer_info = 0x00a8, serial_number = 0x00d8,
                               user_name = 0x00e8, discovery_end = 0x00f8, first_url = 0x0200,
                               second_url = 0x0400, interfaces = 0x0600, persistent_ip = 0x064c,
                               persistent_mask = 0x065c, persistent_gateway = 0x066c, link_speed = 0x0670,
                               message_channels = 0x0900, stream_channels = 0x0904, action_signals = 0x0908,
                               action_device_key = 0x090c, active_links = 0x0910, gvsp_capability = 0x092c,
                               message_capability = 0x0930, gvcp_capability = 0x0934,
                               heartbeat_timeout = 0x0938, tick_frequency_high = 0x093c,
                               tick_frequency_low = 0x0940, timestamp_control = 0x0944,
                               timestamp_high = 0x0948, timestamp_low = 0x094c, gvcp_configuration = 0x0954,
                               pending_timeout = 0x0958, switchover_key = 0x095c, gvsp_configuration = 0x0960,
                               link_capability = 0x0964, link_configuration = 0x0968, control = 0x0a00,
                               controller_port = 0x0a04, controller_ip = 0x0a14, message_port = 0x0b00,
                               message_address = 0x0b10, message_timeout = 0x0b14, message_retries = 0x0b18,
                               message_source_port = 0x0b1c, stream_port = 0x0d00,
                               stream_packet_size = 0x0d04, stream_delay = 0x0d08, stream_address = 0x0d18,
                               stream_source_port = 0x0d1c, stream_capability = 0x0d20,
                               stream_configuration = 0x0d24, action_group_key = 0x9800,
                               action_group_mask = 0x9804;
// The transport's own registers: faults to inject (in parts per million of packets or frames) and counters.
inline constexpr std::uint32_t fault_loss = 0xa000, fault_burst = 0xa004, fault_reorder = 0xa008,
                               fault_duplicate = 0xa00c, fault_delayed_frames = 0xa010,
                               fault_delay_us = 0xa014, fault_dropped_frames = 0xa018, fault_seed = 0xa01c,
                               resend_requests = 0xa040, resent_packets = 0xa044,
                               unavailable_packets = 0xa048, dropped_frames = 0xa04c;
inline constexpr std::uint32_t end = 0x10000;
}  // namespace reg

namespace bit {
inline constexpr std::uint32_t exclusive = 1, controlling = 2, switchover = 4;          // CCP
inline constexpr std::uint32_t heartbeat_disable = 1, pending_ack = 2, status_1_1 = 4,  // 0x954
    unconditional_action = 8, status_2_0 = 1u << 18;
inline constexpr std::uint32_t extended_ids = 1u << 30;                           // 0x960
inline constexpr std::uint32_t fire_test = 1u << 31, do_not_fragment = 1u << 30;  // SCPS
}  // namespace bit

inline constexpr int action_signals = 2;

class BootstrapRegisters {
 public:
  BootstrapRegisters() : words_(reg::end / 4) {}

  void declare(std::uint32_t address, std::uint32_t value, bool readable = true, bool writable = false) {
    words_[address / 4] = {value, readable, writable};
  }
  /// A read-only string, padded with zeros to `bytes` (a multiple of 4) and cut where it is longer.
  void declare_string(std::uint32_t address, std::size_t bytes, std::string_view text);

  std::uint32_t value(std::uint32_t address) const { return words_[address / 4].value; }
  void set(std::uint32_t address, std::uint32_t value) { words_[address / 4].value = value; }
  void set_string(std::uint32_t address, std::size_t bytes, std::string_view text);

  bool exists(std::uint32_t address) const { return readable(address) || writable(address); }
  bool readable(std::uint32_t address) const { return words_[address / 4].readable; }
  bool writable(std::uint32_t address) const { return words_[address / 4].writable; }

  /// One register, as READREG sees it; the address is aligned and below reg::end.
  Status read(std::uint32_t address, std::uint32_t& value) const;
  /// A range, as READMEM sees it: reserved and write-only words within it read as zero.
  Status read(std::uint32_t address, std::size_t bytes, std::vector<std::uint8_t>& out) const;

 private:
  struct Word {
    std::uint32_t value = 0;
    bool readable = false, writable = false;
  };
  std::vector<Word> words_;
};

}  // namespace atomcam::gige
