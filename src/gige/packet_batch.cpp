#include "gige/packet_batch.hpp"

#include <netinet/udp.h>

#include <cerrno>
#include <cstring>

namespace atomcam::gige {

PacketBatch::PacketBatch(bool segmentation_offload)
    : segmentation_offload_(segmentation_offload), messages_{} {
  for (std::size_t i = 0; i < most_packets; ++i) {
    parts_[i] = {};
    parts_[i][0].iov_base = heads_[i].bytes.data();
    messages_[i].msg_hdr.msg_iov = parts_[i].data();
  }
}

void PacketBatch::append(std::uint32_t head_bytes, std::span<const std::uint8_t> data) {
  auto& parts = parts_[packets_];
  parts[0].iov_len = head_bytes;
  parts[1].iov_base = const_cast<std::uint8_t*>(data.data());
  parts[1].iov_len = data.size();
  messages_[packets_].msg_hdr.msg_iovlen = data.empty() ? 1 : 2;
  ++packets_;
  bytes_ += head_bytes + data.size();
}

void PacketBatch::add(const Block& block, std::uint32_t packet, bool resent) {
  std::span<const std::uint8_t> data;
  const std::uint32_t head = block.write_head(packet, resent, heads_[packets_].bytes.data(), data);
  append(head, data);
}

void PacketBatch::add_refusal(bool extended_ids, std::uint64_t wire_id, std::uint32_t packet, Status status) {
  append(write_header(heads_[packets_].bytes.data(), extended_ids, wire_id, packet, PacketFormat::payload,
                      status),
         {});
}

/// Sends packets from `first` on; returns how many, or less than 1 and errno.
int PacketBatch::send_some(int descriptor, std::size_t first) {
  const auto size = [this](std::size_t i) { return parts_[i][0].iov_len + parts_[i][1].iov_len; };
  if (segmentation_offload_) {
    constexpr std::size_t largest_datagram = 65507;
    std::size_t end = first + 1, total = size(first);
    // All of one size but the last, which may be shorter.
    while (end < packets_ && size(end - 1) == size(first) && size(end) <= size(first) &&
           total + size(end) <= largest_datagram)
      total += size(end++);
    if (end - first > 1) {
      alignas(cmsghdr) std::array<char, CMSG_SPACE(sizeof(std::uint16_t))> control{};
      msghdr message{};
      message.msg_iov = parts_[first].data();
      message.msg_iovlen = 2 * (end - first);
      message.msg_control = control.data();
      message.msg_controllen = control.size();
      cmsghdr* segment = CMSG_FIRSTHDR(&message);
      segment->cmsg_level = SOL_UDP;
      segment->cmsg_type = UDP_SEGMENT;
      segment->cmsg_len = CMSG_LEN(sizeof(std::uint16_t));
      const auto bytes = static_cast<std::uint16_t>(size(first));
      std::memcpy(CMSG_DATA(segment), &bytes, sizeof bytes);
      if (::sendmsg(descriptor, &message, MSG_NOSIGNAL) >= 0) return static_cast<int>(end - first);
      if (errno != EINVAL && errno != EIO) return -1;
      // An interface without offload: fall through.
    }
  }
  return ::sendmmsg(descriptor, messages_.data() + first, static_cast<unsigned>(packets_ - first),
                    MSG_NOSIGNAL);
}

PacketBatch::Outcome PacketBatch::send(int descriptor) {
  Outcome outcome;
  std::size_t done = 0;
  bool tried_again = false;
  while (done < packets_) {
    const int sent = send_some(descriptor, done);
    if (sent > 0) {
      for (int i = 0; i < sent; ++i) {
        const auto& parts = parts_[done + static_cast<std::size_t>(i)];
        outcome.bytes += parts[0].iov_len + parts[1].iov_len;
      }
      outcome.packets += static_cast<std::uint64_t>(sent);
      done += static_cast<std::size_t>(sent);
      tried_again = false;
      continue;
    }
    if (errno == EINTR) continue;
    // An earlier packet that nobody received is told at the next one, which was not sent for that.
    if (errno == ECONNREFUSED && !tried_again) {
      tried_again = true;
      continue;
    }
    ++outcome.errors;
    ++done;
    tried_again = false;
  }
  packets_ = 0;
  bytes_ = 0;
  return outcome;
}

}  // namespace atomcam::gige
