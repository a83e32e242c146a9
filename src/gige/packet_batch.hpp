#pragma once
// Packets on their way into the kernel: heads in one array, data where it lies in the frame, one system call
// for all.

#include <sys/socket.h>

#include <array>
#include <cstdint>

#include "gige/gvsp.hpp"

namespace atomcam::gige {

class PacketBatch {
 public:
  // A receiver with the kernel's default buffer (208 KiB, of which memory management takes its part) holds a
  // batch beside what it has not read yet.
  static constexpr std::size_t most_bytes = 64 << 10;
  static constexpr std::size_t most_packets = 64;

  /// With `segmentation_offload` packets of one size go down the kernel's stack as one and are cut at its
  /// end. On the loopback they are never cut before a packet socket (a capture, a client that reads raw
  /// packets): such listeners see one huge packet instead.
  explicit PacketBatch(bool segmentation_offload = false);

  bool empty() const { return packets_ == 0; }
  std::size_t packets() const { return packets_; }
  std::size_t bytes() const { return bytes_; }
  /// Whether another packet of that many bytes may go along.
  bool takes(std::size_t bytes) const {
    return packets_ == 0 || (packets_ < most_packets && bytes_ + bytes <= most_bytes);
  }

  /// The block must live until the batch is sent.
  void add(const Block& block, std::uint32_t packet, bool resent);
  /// A packet without data that says why the one asked for does not come.
  void add_refusal(bool extended_ids, std::uint64_t wire_id, std::uint32_t packet, Status status);

  struct Outcome {
    std::uint64_t packets = 0, bytes = 0, errors = 0;
  };
  /// Sends everything on a connected socket and empties the batch.
  Outcome send(int descriptor);

 private:
  struct Head {
    std::array<std::uint8_t, largest_head> bytes;
  };
  int send_some(int descriptor, std::size_t first);
  void append(std::uint32_t head_bytes, std::span<const std::uint8_t> data);

  const bool segmentation_offload_;
  std::array<Head, most_packets> heads_;
  std::array<std::array<iovec, 2>, most_packets> parts_;
  std::array<mmsghdr, most_packets> messages_;
  std::size_t packets_ = 0, bytes_ = 0;
};

}  // namespace atomcam::gige
