#pragma once
// The stream side of the device: frames into GVSP packets, paced over the frame's period so that a receiver
// with a small socket buffer keeps up, and again from a ring when a client asks for what it missed. One
// thread, one socket.

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <memory>
#include <mutex>
#include <thread>

#include "base/random.hpp"
#include "camera/transport.hpp"
#include "gige/control.hpp"
#include "gige/protocol.hpp"

namespace atomcam::gige {

struct StreamOptions {
  double pace = 0.8;            // fraction of the frame period over which a frame's packets are spread
  std::size_t ring_frames = 4;  // sent frames kept for resends: at least so many,
  std::size_t ring_bytes = 256u << 20;  // at most so much,
  double ring_s = 0.25;                 // and at least for so long if the bytes allow
  std::size_t queue_frames = 4;         // frames that wait; one more and the oldest is dropped
};

struct StreamStatistics {
  std::uint64_t frames = 0, bytes = 0, packets = 0;
  std::uint64_t resend_requests = 0, resent = 0, unavailable = 0;
  std::uint64_t faulted_packets = 0, dropped_frames = 0;
};

class Streamer {
 public:
  /// Binds the stream's socket to `address` (host order), any port.
  Streamer(TransportCamera& camera, std::uint32_t address, StreamOptions options);
  ~Streamer();
  Streamer(const Streamer&) = delete;
  Streamer& operator=(const Streamer&) = delete;

  std::uint16_t source_port() const { return source_port_; }
  void configure(const StreamConfiguration& configuration);
  void set_faults(const FaultConfiguration& faults);
  void send_test_packet(const StreamConfiguration& configuration);
  void begin();  // block ids start again
  void deliver(std::shared_ptr<const CameraFrame> frame);
  void resend(const ResendRequest& request);
  StreamStatistics statistics() const;

 private:
  using Clock = std::chrono::steady_clock;
  struct Block {
    std::uint64_t id = 0;
    std::shared_ptr<const CameraFrame> frame;
    std::uint32_t packet_data = 0;  // bytes of payload in a full packet
    std::uint32_t packets = 0;      // of payload; leader is 0, trailer packets + 1
    bool extended = false;
    bool after_gap = false;
    Clock::time_point sent;
  };
  class Batch;

  void run();
  void send_block(const Block& block, const StreamConfiguration& configuration,
                  std::unique_lock<std::mutex>& lock);
  void serve_resends(std::unique_lock<std::mutex>& lock);
  void answer(const ResendRequest& request, std::unique_lock<std::mutex>& lock);
  void keep(Block block);
  bool lost_on_purpose();

  TransportCamera& camera_;
  StreamOptions options_;
  int socket_ = -1;
  std::uint16_t source_port_ = 0;

  mutable std::mutex mutex_;
  std::condition_variable changed_;
  bool closing_ = false;
  StreamConfiguration configuration_;
  FaultConfiguration faults_;
  RandomStream fault_random_;
  std::uint32_t burst_left_ = 0;
  std::deque<std::shared_ptr<const CameraFrame>> waiting_;
  std::deque<ResendRequest> resends_;
  std::deque<Block> ring_;
  std::uint64_t next_block_ = 1;
  bool gap_ = false;
  std::uint64_t last_timestamp_ns_ = 0;
  double period_s_ = 0;
  StreamStatistics statistics_;
  std::thread thread_;
};

}  // namespace atomcam::gige
