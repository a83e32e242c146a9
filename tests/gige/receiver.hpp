#pragma once
// Puts blocks together from packets and asks for what is missing.

#include <map>
#include <set>

#include "gige/client.hpp"

namespace atomcam::test {

struct ReceivedBlock {
  std::uint16_t payload_type = 0;
  std::uint64_t timestamp = 0;
  std::uint32_t pixel_format = 0, width = 0, height = 0, offset_x = 0, offset_y = 0;
  bool leader = false;
  std::optional<std::uint32_t> trailer;  // its packet id
  std::vector<std::uint8_t> trailer_bytes;
  std::map<std::uint32_t, std::vector<std::uint8_t>> data;
  std::uint16_t flags = 0;  // extended ids
  int duplicates = 0, resent = 0, out_of_order = 0;

  bool complete() const { return leader && trailer && data.size() == *trailer - 1; }
  std::vector<std::uint8_t> payload() const {
    std::vector<std::uint8_t> all;
    for (const auto& [id, bytes] : data) all.insert(all.end(), bytes.begin(), bytes.end());
    return all;
  }
  /// Packets not there, up to the trailer or the last one that is.
  std::vector<std::uint32_t> missing() const {
    std::vector<std::uint32_t> ids;
    if (!leader) ids.push_back(0);
    const std::uint32_t end = trailer ? *trailer : data.empty() ? 1 : data.rbegin()->first + 1;
    for (std::uint32_t id = 1; id < end; ++id)
      if (!data.contains(id)) ids.push_back(id);
    if (!trailer) ids.push_back(end);
    return ids;
  }
};

class Receiver {
 public:
  explicit Receiver(int receive_bytes = 4 << 20) : socket("127.0.0.1", receive_bytes) {}

  /// Takes packets until none comes for `quiet_ms`, or `enough` says so.
  template <class Enough>
  void receive(int quiet_ms, Enough enough) {
    while (!enough()) {
      const auto packet = socket.receive(quiet_ms);
      if (!packet) return;
      take(*packet);
    }
  }
  void receive(int quiet_ms) {
    receive(quiet_ms, [] { return false; });
  }

  void take(const std::vector<std::uint8_t>& packet) {
    sizes.insert(packet.size() + 28);
    const auto status = static_cast<Status>(gige::load16(packet, 0));
    const bool wide = (packet[4] & 0x80) != 0;
    const std::size_t header = wide ? 20 : 8;
    const std::uint64_t id = wide ? gige::load64(packet, 8) : gige::load16(packet, 2);
    const std::uint32_t number = wide ? gige::load32(packet, 16) : gige::load32(packet, 4) & 0xffffff;
    if (status != Status::success && status != Status::packet_resent) {
      refusals[status].insert({id, number});
      return;
    }
    ReceivedBlock& block = blocks[id];
    if (wide) block.flags = static_cast<std::uint16_t>(block.flags | gige::load16(packet, 2));
    if (status == Status::packet_resent || (wide && (gige::load16(packet, 2) & 1))) ++block.resent;
    const gige::Bytes body = gige::Bytes(packet).subspan(header);
    switch (packet[4] & 0x7f) {
      case 1:
        if (block.leader) ++block.duplicates;
        block.leader = true;
        block.payload_type = gige::load16(body, 2);
        block.timestamp = gige::load64(body, 4);
        block.pixel_format = gige::load32(body, 12);
        block.width = gige::load32(body, 16);
        block.height = gige::load32(body, 20);
        block.offset_x = gige::load32(body, 24);
        block.offset_y = gige::load32(body, 28);
        break;
      case 2:
        if (block.trailer) ++block.duplicates;
        block.trailer = number;
        block.trailer_bytes.assign(body.begin(), body.end());
        break;
      default:
        if (!block.data.empty() && number < block.data.rbegin()->first) ++block.out_of_order;
        if (!block.data.emplace(number, std::vector<std::uint8_t>(body.begin(), body.end())).second)
          ++block.duplicates;
    }
  }

  TestSocket socket;
  std::map<std::uint64_t, ReceivedBlock> blocks;
  std::map<Status, std::set<std::pair<std::uint64_t, std::uint32_t>>> refusals;
  std::set<std::size_t> sizes;  // of IP packets
};

}  // namespace atomcam::test
