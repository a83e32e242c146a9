#include "gige/gvsp.hpp"

#include <algorithm>

namespace atomcam::gige {

namespace {
constexpr std::uint16_t image = 0x0001, with_chunks = 0x4000;
constexpr std::uint16_t flag_resent = 0x1, flag_previous_dropped = 0x2;
constexpr std::uint64_t resends_per_packet = 4;
}  // namespace

Block Block::cut(std::uint64_t id, std::shared_ptr<const CameraFrame> frame, const StreamSettings& settings) {
  Block block;
  block.id = id;
  block.extended_ids = settings.extended_ids;
  block.data_bytes = settings.packet_bytes - ip_udp_bytes - block.header_bytes();
  block.payload_packets =
      static_cast<std::uint32_t>((frame->payload.size() + block.data_bytes - 1) / block.data_bytes);
  block.resends_left = resends_per_packet * block.packets();
  block.frame = std::move(frame);
  return block;
}

std::uint32_t write_header(std::uint8_t* out, bool extended_ids, std::uint64_t wire_id, std::uint32_t packet,
                           PacketFormat format, Status status, std::uint16_t flags) {
  store16(out, static_cast<std::uint16_t>(status));
  if (!extended_ids) {
    store16(out + 2, static_cast<std::uint16_t>(wire_id));
    store32(out + 4, static_cast<std::uint32_t>(format) << 24 | (packet & 0xffffff));
    return 8;
  }
  store16(out + 2, flags);
  store32(out + 4, (0x80u | static_cast<std::uint32_t>(format)) << 24);
  store64(out + 8, wire_id);
  store32(out + 16, packet);
  return 20;
}

std::uint32_t Block::write_head(std::uint32_t packet, bool resent, std::uint8_t* out,
                                std::span<const std::uint8_t>& data) const {
  const bool leader = packet == 0, trailer = packet == payload_packets + 1;
  const auto format = leader ? PacketFormat::leader : trailer ? PacketFormat::trailer : PacketFormat::payload;
  const auto flags =
      static_cast<std::uint16_t>((resent ? flag_resent : 0) | (previous_dropped ? flag_previous_dropped : 0));
  // With extended ids a flag tells a packet sent again; without them the status does.
  const Status status = resent && !extended_ids ? Status::packet_resent : Status::success;
  const std::uint32_t header = write_header(out, extended_ids, wire_id(), packet, format, status, flags);
  out += header;
  data = {};
  const std::uint16_t type = frame->chunks ? image | with_chunks : image;
  if (leader) {
    store16(out, 0);  // no fields
    store16(out + 2, type);
    store64(out + 4, frame->timestamp_ns);
    store32(out + 12, frame->pixel_format);
    store32(out + 16, frame->width);
    store32(out + 20, frame->height);
    store32(out + 24, frame->offset_x);
    store32(out + 28, frame->offset_y);
    store32(out + 32, 0);  // no padding
    return header + 36;
  }
  if (trailer) {
    store16(out, 0);
    store16(out + 2, type);
    store32(out + 4, frame->height);
    if (!frame->chunks) return header + 8;
    store32(out + 8, static_cast<std::uint32_t>(frame->payload.size()));
    store32(out + 12, 0);  // chunk layout: one for all frames
    return header + 16;
  }
  const std::size_t first = std::size_t{packet - 1} * data_bytes;
  data = std::span(frame->payload)
             .subspan(first, std::min<std::size_t>(data_bytes, frame->payload.size() - first));
  return header;
}

}  // namespace atomcam::gige
