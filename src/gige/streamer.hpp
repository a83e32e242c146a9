#pragma once
// The stream channel: one thread that sends frames, packets asked for again, and test packets.

#include <atomic>
#include <condition_variable>
#include <deque>
#include <memory>
#include <mutex>
#include <optional>
#include <thread>
#include <vector>

#include "gige/block_ring.hpp"
#include "gige/control_handler.hpp"
#include "gige/fault_injection.hpp"
#include "gige/pacer.hpp"
#include "gige/packet_batch.hpp"
#include "gige/udp_socket.hpp"

namespace atomcam::gige {

struct StreamOptions {
  double pace = 0.8;  // part of the frame period over which a frame's packets are spread; 0: no pauses
  RingLimits ring = {};
  std::size_t queue_frames = 8;  // more than these that wait for the sender are dropped whole
  int multicast_hops = 1;
  bool segmentation_offload = false;  // fewer system calls; see PacketBatch for who cannot bear it
};

struct StreamStatistics {
  std::uint64_t frames = 0;              // sent whole
  std::uint64_t packets = 0, bytes = 0;  // sent, those sent again included; bytes of UDP payload
  std::uint64_t resend_requests = 0, resent = 0, unavailable = 0;
  std::uint64_t dropped_frames = 0;                       // the sender could not keep up
  std::uint64_t faulted_packets = 0, faulted_frames = 0;  // lost on purpose
  std::uint64_t send_errors = 0;
};

class Streamer {
 public:
  Streamer(TransportCamera& camera, std::uint32_t address, StreamOptions options,
           const FaultConfiguration& faults = {});
  ~Streamer();

  std::uint16_t source_port() const { return socket_.local().port; }

  // From any thread; none of them waits for the network.
  void configure(const StreamSettings& settings);
  void deliver(std::shared_ptr<const CameraFrame> frame);
  void resend(const ResendRequest& request);
  void fire_test(std::uint32_t packet_bytes);
  void inject_faults(const FaultConfiguration& faults);

  StreamStatistics statistics() const;

 private:
  using BlockPointer = std::shared_ptr<Block>;

  void run();
  bool has_orders() const;
  void take_orders(std::unique_lock<std::mutex>& lock);
  void apply(const StreamSettings& settings);
  void begin(std::shared_ptr<const CameraFrame> frame, std::size_t backlog, Time now);
  void send_frame_batch(Time now);
  void send_resend_batch(Time now);
  void emit(const BlockPointer& block, std::uint32_t packet, bool resent);
  void put(const BlockPointer& block, std::uint32_t packet, bool resent);
  void want(const ResendRequest& request);
  void refuse(std::uint64_t wire_id, std::uint32_t packet, Status status);
  void flush();
  void add_up();
  void send_test(std::uint32_t packet_bytes);
  void fragment(bool allowed);

  TransportCamera& camera_;
  const StreamOptions options_;
  UdpSocket socket_;

  mutable std::mutex mutex_;
  std::condition_variable wake_;
  // Orders, under the mutex.
  bool closing_ = false;
  std::optional<StreamSettings> new_settings_;
  std::optional<FaultConfiguration> new_faults_;
  std::vector<std::uint32_t> tests_;
  std::deque<std::shared_ptr<const CameraFrame>> frames_;
  std::vector<std::uint64_t> lost_;
  std::deque<ResendRequest> requests_;
  bool open_ = false, closed_ = false;  // as told last; closed meanwhile
  StreamStatistics statistics_;

  // The thread's own.
  StreamSettings settings_;
  std::optional<FaultDice> faults_;
  Pacer pacer_;
  BlockRing ring_;
  PacketBatch batch_;
  std::vector<BlockPointer> batch_blocks_;  // keeps alive what the batch points into
  BlockPointer current_;
  std::uint64_t next_block_ = 1;
  bool previous_dropped_ = false;
  std::optional<std::uint64_t> last_frame_id_;
  std::uint64_t last_timestamp_ns_ = 0;
  struct Wanted {
    BlockPointer block;
    std::uint32_t packet = 0;
  };
  std::deque<Wanted> wanted_;  // each packet once
  struct Late {
    BlockPointer block;
    std::uint32_t packet = 0;
    bool resent = false;
    int after = 0;
  };
  std::vector<Late> late_;
  StreamStatistics counted_;  // since the last time they were added up
  std::thread thread_;
};

}  // namespace atomcam::gige
