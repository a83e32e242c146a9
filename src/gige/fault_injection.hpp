#pragma once
// Faults on purpose, to try a client's nerves: what happens to a packet or a frame on its way out.

#include <cstdint>

#include "base/random.hpp"

namespace atomcam::gige {

struct FaultConfiguration {
  double packet_loss = 0;   // probability that a packet is lost, in the long run
  std::uint32_t burst = 1;  // packets lost in a row each time
  double reorder = 0;       // probability that a packet is sent after a few that follow it
  double duplicate = 0;     // probability that a packet is sent twice
  double frame_delay = 0;   // probability that a frame is held back
  std::uint32_t frame_delay_us = 50'000;
  double frame_drop = 0;  // probability that a frame is not sent at all
  std::uint64_t seed = 1;

  bool operator==(const FaultConfiguration&) const = default;
  bool any() const {
    return packet_loss > 0 || reorder > 0 || duplicate > 0 || frame_delay > 0 || frame_drop > 0;
  }
};

/// Decides. The decisions are a function of the seed and the count of packets and frames asked for so far.
class FaultDice {
 public:
  explicit FaultDice(const FaultConfiguration& faults)
      : faults_(faults),
        packets_(faults.seed, stream_id("gige/packet_faults"), 0, 0),
        frames_(faults.seed, stream_id("gige/frame_faults"), 0, 0) {}

  const FaultConfiguration& faults() const { return faults_; }

  struct Packet {
    bool lost = false, late = false, twice = false;
  };
  Packet packet() {
    const double loss = packets_.uniform(), late = packets_.uniform(), twice = packets_.uniform();
    if (burst_left_ > 0) {
      --burst_left_;
      return {.lost = true};
    }
    if (loss < start_of_burst()) {
      burst_left_ = faults_.burst - 1;
      return {.lost = true};
    }
    return {.late = late < faults_.reorder, .twice = twice < faults_.duplicate};
  }

  struct Frame {
    bool dropped = false, delayed = false;
  };
  Frame frame() {
    const double dropped = frames_.uniform(), delayed = frames_.uniform();
    return {dropped < faults_.frame_drop, delayed < faults_.frame_delay};
  }

 private:
  // Bursts of n packets that start with probability s at a packet outside a burst lose a share n s / (1 - s +
  // n s).
  double start_of_burst() const {
    const double share = faults_.packet_loss, n = faults_.burst;
    return share >= 1 ? 1 : share / (n - (n - 1) * share);
  }

  FaultConfiguration faults_;
  RandomStream packets_, frames_;
  int burst_left_ = 0;
};

}  // namespace atomcam::gige
