#include "gige/stream.hpp"

#include <arpa/inet.h>
#include <fmt/format.h>
#include <netinet/in.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <utility>

#include "base/error.hpp"

namespace atomcam::gige {
namespace {

enum Format : std::uint8_t { leader = 1, trailer = 2, payload = 3 };

constexpr std::uint32_t ip_and_udp = 28;
constexpr std::uint32_t standard_header = 8, extended_header = 20;
constexpr std::size_t batch_packets = 16;
constexpr std::size_t batch_bytes = 64 * 1024;  // a third of the usual receive buffer
constexpr double unpaced_bytes_per_s = 500e6;   // while the frame period is not known yet
constexpr std::uint32_t image_payload = 0x0001, chunks_appended = 0x4000;

sockaddr_in socket_address(Endpoint endpoint) {
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_addr.s_addr = htonl(endpoint.address);
  address.sin_port = htons(endpoint.port);
  return address;
}

}  // namespace

/// Packets gathered for one system call; payload stays where it is.
class Streamer::Batch {
 public:
  Batch(int socket, Endpoint destination) : socket_(socket), address_(socket_address(destination)) {}

  bool full() const { return count_ == batch_packets || bytes_ >= batch_bytes; }
  bool empty() const { return count_ == 0; }

  void add(const Block& block, std::uint32_t packet, Status status) {
    std::array<std::uint8_t, 64>& head = heads_[count_];
    const std::uint8_t format = packet == 0 ? leader : packet <= block.packets ? payload : trailer;
    std::size_t size = 0;
    if (block.extended) {
      const std::uint32_t flags = (status == Status::packet_resend ? 1u : 0u) | (block.after_gap ? 2u : 0u);
      store16(head, 0, 0);
      store16(head, 2, flags);
      store32(head, 4, static_cast<std::uint32_t>(format | 0x80) << 24);
      store64(head, 8, block.id);
      store32(head, 16, packet);
      size = extended_header;
    } else {
      store16(head, 0, static_cast<std::uint16_t>(status));
      store16(head, 2, static_cast<std::uint16_t>(block.id));
      store32(head, 4, static_cast<std::uint32_t>(format) << 24 | (packet & 0xffffff));
      size = standard_header;
    }
    const CameraFrame& frame = *block.frame;
    const std::uint32_t type = image_payload | (frame.chunks ? chunks_appended : 0);
    const std::uint8_t* data = nullptr;
    std::size_t data_bytes = 0;
    if (format == leader) {
      store16(head, size, 0);
      store16(head, size + 2, type);
      store64(head, size + 4, frame.timestamp_ns);
      store32(head, size + 12, frame.pixel_format);
      store32(head, size + 16, frame.width);
      store32(head, size + 20, frame.height);
      store32(head, size + 24, frame.offset_x);
      store32(head, size + 28, frame.offset_y);
      store32(head, size + 32, 0);
      size += 36;
    } else if (format == trailer) {
      store16(head, size, 0);
      store16(head, size + 2, type);
      store32(head, size + 4, frame.height);
      size += 8;
      if (frame.chunks) {
        store32(head, size, static_cast<std::uint32_t>(frame.payload.size()));
        size += 4;
      }
    } else {
      const std::size_t offset = static_cast<std::size_t>(packet - 1) * block.packet_data;
      data = frame.payload.data() + offset;
      data_bytes = std::min<std::size_t>(block.packet_data, frame.payload.size() - offset);
    }
    parts_[count_] = {{{head.data(), size}, {const_cast<std::uint8_t*>(data), data_bytes}}};
    msghdr& message = messages_[count_].msg_hdr;
    message = {};
    message.msg_name = &address_;
    message.msg_namelen = sizeof address_;
    message.msg_iov = parts_[count_].data();
    message.msg_iovlen = data ? 2 : 1;
    ++count_;
    bytes_ += size + data_bytes;
  }

  /// The last packet once more, or before the one ahead of it.
  void repeat_last() {
    if (count_ == 0 || count_ == batch_packets) return;
    heads_[count_] = heads_[count_ - 1];
    parts_[count_] = parts_[count_ - 1];
    parts_[count_][0].iov_base = heads_[count_].data();
    messages_[count_] = messages_[count_ - 1];
    messages_[count_].msg_hdr.msg_iov = parts_[count_].data();
    ++count_;
  }
  void swap_last_two() {
    if (count_ < 2) return;
    std::swap(messages_[count_ - 1].msg_hdr.msg_iov, messages_[count_ - 2].msg_hdr.msg_iov);
    std::swap(messages_[count_ - 1].msg_hdr.msg_iovlen, messages_[count_ - 2].msg_hdr.msg_iovlen);
  }

  /// Hands the batch to the kernel; packets that it refuses (no receiver, no route) are lost like on any
  /// network.
  std::size_t send() {
    std::size_t done = 0;
    while (done < count_) {
      const int sent = sendmmsg(socket_, messages_.data() + done, static_cast<unsigned>(count_ - done), 0);
      if (sent > 0)
        done += static_cast<std::size_t>(sent);
      else if (errno != EINTR)
        ++done;
    }
    const std::size_t bytes = bytes_;
    count_ = 0;
    bytes_ = 0;
    return bytes;
  }
  std::size_t count() const { return count_; }

 private:
  int socket_;
  sockaddr_in address_;
  std::size_t count_ = 0, bytes_ = 0;
  std::array<std::array<std::uint8_t, 64>, batch_packets> heads_;
  std::array<std::array<iovec, 2>, batch_packets> parts_;
  std::array<mmsghdr, batch_packets> messages_;
};

Streamer::Streamer(TransportCamera& camera, std::uint32_t address, StreamOptions options)
    : camera_(camera), options_(options), fault_random_(1, stream_id("gige/faults"), 0, 0) {
  socket_ = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  sockaddr_in own = socket_address({address, 0});
  if (socket_ < 0 || bind(socket_, reinterpret_cast<sockaddr*>(&own), sizeof own) != 0) {
    const int cause = errno;
    if (socket_ >= 0) close(socket_);
    throw Error("stream socket", fmt::format("cannot bind: {}", std::strerror(cause)));
  }
  socklen_t length = sizeof own;
  getsockname(socket_, reinterpret_cast<sockaddr*>(&own), &length);
  source_port_ = ntohs(own.sin_port);
  const in_addr interface { htonl(address) };
  setsockopt(socket_, IPPROTO_IP, IP_MULTICAST_IF, &interface, sizeof interface);
  const int send_buffer = 1 << 20;
  setsockopt(socket_, SOL_SOCKET, SO_SNDBUF, &send_buffer, sizeof send_buffer);
  thread_ = std::thread([this] { run(); });
}

Streamer::~Streamer() {
  {
    const std::lock_guard lock(mutex_);
    closing_ = true;
  }
  changed_.notify_all();
  thread_.join();
  close(socket_);
}

void Streamer::configure(const StreamConfiguration& configuration) {
  const std::lock_guard lock(mutex_);
  configuration_ = configuration;
  const int discovery = configuration.do_not_fragment ? IP_PMTUDISC_DO : IP_PMTUDISC_DONT;
  setsockopt(socket_, IPPROTO_IP, IP_MTU_DISCOVER, &discovery, sizeof discovery);
  if (configuration.destination.port == 0) {
    waiting_.clear();
    resends_.clear();
    ring_.clear();
    next_block_ = 1;
    gap_ = false;
  }
}

void Streamer::set_faults(const FaultConfiguration& faults) {
  const std::lock_guard lock(mutex_);
  if (faults.seed != faults_.seed) fault_random_ = RandomStream(faults.seed, stream_id("gige/faults"), 0, 0);
  faults_ = faults;
}

void Streamer::send_test_packet(const StreamConfiguration& configuration) {
  if (configuration.destination.port == 0 || configuration.packet_bytes <= ip_and_udp) return;
  Bytes packet(configuration.packet_bytes - ip_and_udp);
  const sockaddr_in to = socket_address(configuration.destination);
  int before = 0, always = IP_PMTUDISC_DO;
  socklen_t length = sizeof before;
  getsockopt(socket_, IPPROTO_IP, IP_MTU_DISCOVER, &before, &length);
  setsockopt(socket_, IPPROTO_IP, IP_MTU_DISCOVER, &always, sizeof always);
  sendto(socket_, packet.data(), packet.size(), 0, reinterpret_cast<const sockaddr*>(&to), sizeof to);
  setsockopt(socket_, IPPROTO_IP, IP_MTU_DISCOVER, &before, sizeof before);
}

void Streamer::begin() {
  const std::lock_guard lock(mutex_);
  last_timestamp_ns_ = 0;
  period_s_ = 0;
}

void Streamer::deliver(std::shared_ptr<const CameraFrame> frame) {
  std::shared_ptr<const CameraFrame> dropped;
  {
    const std::lock_guard lock(mutex_);
    if (configuration_.destination.port == 0) return;
    if (waiting_.size() >= options_.queue_frames) {
      dropped = std::move(waiting_.front());
      waiting_.pop_front();
      ++statistics_.dropped_frames;
      ++next_block_;
      gap_ = true;
    }
    if (last_timestamp_ns_ != 0 && frame->timestamp_ns > last_timestamp_ns_)
      period_s_ = static_cast<double>(frame->timestamp_ns - last_timestamp_ns_) * 1e-9;
    last_timestamp_ns_ = frame->timestamp_ns;
    waiting_.push_back(std::move(frame));
  }
  changed_.notify_one();
  if (dropped) camera_.report_lost(dropped->id);
}

void Streamer::resend(const ResendRequest& request) {
  {
    const std::lock_guard lock(mutex_);
    ++statistics_.resend_requests;
    if (resends_.size() >= 4096) return;  // a client that asks faster than it can be served
    resends_.push_back(request);
  }
  changed_.notify_one();
}

StreamStatistics Streamer::statistics() const {
  const std::lock_guard lock(mutex_);
  return statistics_;
}

bool Streamer::lost_on_purpose() {
  if (burst_left_ > 0) {
    --burst_left_;
    return true;
  }
  if (faults_.packet_loss <= 0 || fault_random_.uniform() >= faults_.packet_loss) return false;
  burst_left_ = faults_.burst - 1;
  return true;
}

void Streamer::run() {
  prctl(PR_SET_TIMERSLACK, 1000, 0, 0, 0);  // pauses between batches are short
  std::unique_lock lock(mutex_);
  while (true) {
    changed_.wait(lock, [&] { return closing_ || !waiting_.empty() || !resends_.empty(); });
    if (closing_) return;
    if (!resends_.empty()) {
      serve_resends(lock);
      continue;
    }
    const StreamConfiguration configuration = configuration_;
    Block block;
    block.frame = std::move(waiting_.front());
    waiting_.pop_front();
    const std::uint32_t header = configuration.extended_ids ? extended_header : standard_header;
    if (configuration.destination.port == 0 || configuration.packet_bytes <= ip_and_udp + header) continue;
    block.extended = configuration.extended_ids;
    if (!block.extended) {
      next_block_ &= 0xffff;
      if (next_block_ == 0) next_block_ = 1;  // 0 is no block of the 16-bit kind
    }
    block.id = next_block_++;
    block.after_gap = std::exchange(gap_, false);
    block.packet_data = configuration.packet_bytes - ip_and_udp - header;
    block.packets =
        static_cast<std::uint32_t>((block.frame->payload.size() + block.packet_data - 1) / block.packet_data);
    if (faults_.frame_drop > 0 && fault_random_.uniform() < faults_.frame_drop) {
      ++statistics_.dropped_frames;
      const std::uint64_t id = block.frame->id;
      lock.unlock();
      camera_.report_lost(id);
      lock.lock();
      continue;
    }
    if (faults_.frame_delay > 0 && fault_random_.uniform() < faults_.frame_delay) {
      const auto delay = std::chrono::microseconds(faults_.frame_delay_us);
      changed_.wait_for(lock, delay, [&] { return closing_; });
      if (closing_) return;
    }
    keep(block);
    send_block(block, configuration, lock);
  }
}

void Streamer::keep(Block block) {
  const auto now = Clock::now();
  block.sent = now;
  ring_.push_back(std::move(block));
  std::size_t bytes = 0;
  for (const Block& kept : ring_) bytes += kept.frame->payload.size();
  while (ring_.size() > 1) {
    const Block& oldest = ring_.front();
    const bool old = now - oldest.sent > std::chrono::duration<double>(options_.ring_s);
    if (!(bytes > options_.ring_bytes || (old && ring_.size() > options_.ring_frames))) break;
    bytes -= oldest.frame->payload.size();
    ring_.pop_front();
  }
}

void Streamer::send_block(const Block& block, const StreamConfiguration& configuration,
                          std::unique_lock<std::mutex>& lock) {
  const std::size_t total = block.frame->payload.size() + 1;
  const double spread_s =
      period_s_ > 0 ? options_.pace * period_s_ : static_cast<double>(total) / unpaced_bytes_per_s;
  const bool late = !waiting_.empty();  // behind: no pauses beyond those that spare the receiver
  const auto began = Clock::now();
  Batch batch(socket_, configuration.destination);
  std::size_t sent_bytes = 0;
  const auto flush = [&] {
    const std::size_t packets = batch.count();
    lock.unlock();
    const std::size_t bytes = batch.send();
    sent_bytes += bytes;
    const double due_s =
        spread_s * (late ? 0.5 : 1) * static_cast<double>(sent_bytes) / static_cast<double>(total);
    const auto due = began + std::chrono::duration_cast<Clock::duration>(
                                 std::chrono::duration<double>(std::min(due_s, spread_s)));
    if (due > Clock::now()) {
      const auto ns = std::chrono::duration_cast<std::chrono::nanoseconds>(due.time_since_epoch()).count();
      const timespec until{ns / 1000000000, ns % 1000000000};
      while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &until, nullptr) == EINTR) {
      }
    }
    lock.lock();
    statistics_.packets += packets;
    statistics_.bytes += bytes;
    if (!resends_.empty()) serve_resends(lock);
  };
  const auto still_wanted = [&] {
    return !closing_ && configuration_.destination == configuration.destination;
  };
  bool swap_next = false;
  for (std::uint32_t packet = 0; packet <= block.packets + 1 && still_wanted(); ++packet) {
    if (lost_on_purpose()) {
      ++statistics_.faulted_packets;
      continue;
    }
    batch.add(block, packet, Status::success);
    if (std::exchange(swap_next, false)) batch.swap_last_two();
    if (faults_.reorder > 0 && fault_random_.uniform() < faults_.reorder) {
      ++statistics_.faulted_packets;
      swap_next = true;
    }
    if (faults_.duplicate > 0 && fault_random_.uniform() < faults_.duplicate) {
      ++statistics_.faulted_packets;
      batch.repeat_last();
    }
    if (configuration.packet_delay_ns > 0) {
      flush();
      lock.unlock();
      const timespec pause{static_cast<time_t>(configuration.packet_delay_ns / 1000000000),
                           static_cast<long>(configuration.packet_delay_ns % 1000000000)};
      nanosleep(&pause, nullptr);
      lock.lock();
    } else if (batch.full() && !swap_next) {
      flush();
    }
    if (batch.count() == batch_packets) flush();
  }
  if (!batch.empty()) flush();
  ++statistics_.frames;
}

void Streamer::serve_resends(std::unique_lock<std::mutex>& lock) {
  while (!resends_.empty() && !closing_) {
    const ResendRequest request = resends_.front();
    resends_.pop_front();
    answer(request, lock);
  }
}

void Streamer::answer(const ResendRequest& request, std::unique_lock<std::mutex>& lock) {
  const Endpoint destination = configuration_.destination;
  if (destination.port == 0) return;
  const auto found = std::find_if(ring_.begin(), ring_.end(), [&](const Block& block) {
    return block.extended == request.extended && block.id == request.block;
  });
  if (found == ring_.end() || request.first > request.last || request.first > found->packets + 1) {
    ++statistics_.unavailable;
    const Status status = request.extended_status ? Status::packet_removed : Status::packet_unavailable;
    std::array<std::uint8_t, extended_header> head{};
    const std::size_t size = request.extended ? extended_header : standard_header;
    store16(head, 0, static_cast<std::uint16_t>(status));
    if (request.extended) {
      store32(head, 4, static_cast<std::uint32_t>(payload | 0x80) << 24);
      store64(head, 8, request.block);
      store32(head, 16, request.first);
    } else {
      store16(head, 2, static_cast<std::uint16_t>(request.block));
      store32(head, 4, static_cast<std::uint32_t>(payload) << 24 | request.first);
    }
    const sockaddr_in to = socket_address(destination);
    sendto(socket_, head.data(), size, 0, reinterpret_cast<const sockaddr*>(&to), sizeof to);
    return;
  }
  const Block block = *found;  // keeps the frame while the lock is open
  const std::uint32_t last = std::min(request.last, block.packets + 1);
  Batch batch(socket_, destination);
  const auto flush = [&] {
    const std::size_t packets = batch.count();
    lock.unlock();
    const std::size_t bytes = batch.send();
    lock.lock();
    statistics_.packets += packets;
    statistics_.resent += packets;
    statistics_.bytes += bytes;
  };
  for (std::uint32_t packet = request.first; packet <= last && !closing_; ++packet) {
    if (lost_on_purpose()) {
      ++statistics_.faulted_packets;
      continue;
    }
    batch.add(block, packet, Status::packet_resend);
    if (batch.full()) flush();
  }
  if (!batch.empty()) flush();
}

}  // namespace atomcam::gige
