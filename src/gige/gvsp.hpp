#pragma once
// The packets of the stream protocol (GVSP): a frame as a block of leader, payload packets and trailer.

#include <chrono>
#include <cstdint>
#include <memory>
#include <vector>

#include "camera/transport.hpp"
#include "gige/gvcp.hpp"

namespace atomcam::gige {

using Clock = std::chrono::steady_clock;
using Time = Clock::time_point;

/// What a client has set on the stream channel.
struct StreamSettings {
  Endpoint destination = {};          // open when address and port are set
  std::uint32_t packet_bytes = 1500;  // of IP: headers of IP, UDP and GVSP included
  bool do_not_fragment = false;
  std::uint64_t delay_ns = 0;  // between packets
  bool extended_ids = false;
  bool status_1_1 = false, status_2_0 = false;  // codes that the client understands

  bool open() const { return destination.address != 0 && destination.port != 0; }
  bool operator==(const StreamSettings&) const = default;
};

inline constexpr std::uint32_t ip_udp_bytes = 28;
inline constexpr std::uint32_t largest_head = 20 + 36;  // extended header and leader

enum class PacketFormat : std::uint8_t { leader = 1, trailer = 2, payload = 3 };

/// A frame cut into packets. Packet 0 is the leader, the last one the trailer.
struct Block {
  std::uint64_t id = 0;  // counts from 1; see wire_id
  std::shared_ptr<const CameraFrame> frame;
  bool extended_ids = false;
  bool previous_dropped = false;
  std::uint32_t data_bytes = 0;  // of a full payload packet
  std::uint32_t payload_packets = 0;
  std::uint32_t sent = 0;          // packets sent so far, in order
  std::uint64_t resends_left = 0;  // packets that may still be sent again
  std::vector<bool> wanted;        // by packet: waits to be sent again; empty: none ever did
  Time finished{};                 // when the trailer went out

  static Block cut(std::uint64_t id, std::shared_ptr<const CameraFrame> frame,
                   const StreamSettings& settings);

  std::uint32_t packets() const { return payload_packets + 2; }
  /// The id as packets carry it: 1 to 65535 and again without extended ids.
  std::uint64_t wire_id() const { return extended_ids ? id : (id - 1) % 65535 + 1; }
  std::uint32_t header_bytes() const { return extended_ids ? 20 : 8; }

  /// Writes what precedes the frame's data in packet `packet` (all of a leader or trailer); returns its
  /// length, at most largest_head. `data` is set to the packet's part of the frame.
  std::uint32_t write_head(std::uint32_t packet, bool resent, std::uint8_t* out,
                           std::span<const std::uint8_t>& data) const;
};

/// Writes the header of a packet; returns its length.
std::uint32_t write_header(std::uint8_t* out, bool extended_ids, std::uint64_t wire_id, std::uint32_t packet,
                           PacketFormat format, Status status, std::uint16_t flags = 0);

}  // namespace atomcam::gige
