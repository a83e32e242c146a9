#include "gige/streamer.hpp"

#include <sys/prctl.h>
#include <sys/socket.h>

#include <algorithm>
#include <utility>

namespace atomcam::gige {

namespace {
constexpr std::size_t requests_waiting = 1024;
constexpr std::uint32_t refusals_per_request = 16;
constexpr int late_by_packets = 4;
}  // namespace

Streamer::Streamer(TransportCamera& camera, std::uint32_t address, StreamOptions options,
                   const FaultConfiguration& faults)
    : camera_(camera),
      options_(options),
      pacer_(options.pace),
      ring_(options.ring),
      batch_(options.segmentation_offload) {
  socket_.bind({address, 0});
  // A full interface holds the sender up, but not its end.
  const timeval patience{.tv_sec = 0, .tv_usec = 100'000};
  ::setsockopt(socket_.descriptor(), SOL_SOCKET, SO_SNDTIMEO, &patience, sizeof patience);
  const in_addr interface = socket_address({address, 0}).sin_addr;
  ::setsockopt(socket_.descriptor(), IPPROTO_IP, IP_MULTICAST_IF, &interface, sizeof interface);
  ::setsockopt(socket_.descriptor(), IPPROTO_IP, IP_MULTICAST_TTL, &options.multicast_hops,
               sizeof options.multicast_hops);
  if (faults.any()) faults_.emplace(faults);
  thread_ = std::thread([this] { run(); });
}

Streamer::~Streamer() {
  {
    const std::lock_guard lock(mutex_);
    closing_ = true;
  }
  wake_.notify_one();
  thread_.join();
}

// Orders

void Streamer::configure(const StreamSettings& settings) {
  {
    const std::lock_guard lock(mutex_);
    open_ = settings.open();
    if (!open_) {
      closed_ = true;
      frames_.clear();
      requests_.clear();
    }
    new_settings_ = settings;
  }
  wake_.notify_one();
}

void Streamer::deliver(std::shared_ptr<const CameraFrame> frame) {
  {
    const std::lock_guard lock(mutex_);
    if (!open_) return;
    if (frames_.size() >= options_.queue_frames) {
      ++statistics_.dropped_frames;
      lost_.push_back(frame->id);
    } else {
      frames_.push_back(std::move(frame));
    }
  }
  wake_.notify_one();
}

void Streamer::resend(const ResendRequest& request) {
  {
    const std::lock_guard lock(mutex_);
    ++statistics_.resend_requests;
    if (!open_ || requests_.size() >= requests_waiting) return;
    requests_.push_back(request);
  }
  wake_.notify_one();
}

void Streamer::fire_test(std::uint32_t packet_bytes) {
  {
    const std::lock_guard lock(mutex_);
    if (tests_.size() < requests_waiting) tests_.push_back(packet_bytes);
  }
  wake_.notify_one();
}

void Streamer::inject_faults(const FaultConfiguration& faults) {
  {
    const std::lock_guard lock(mutex_);
    new_faults_ = faults;
  }
  wake_.notify_one();
}

StreamStatistics Streamer::statistics() const {
  const std::lock_guard lock(mutex_);
  return statistics_;
}

// The thread

bool Streamer::has_orders() const {
  return closing_ || new_settings_ || new_faults_ || !tests_.empty() || !lost_.empty();
}

void Streamer::take_orders(std::unique_lock<std::mutex>& lock) {
  if (new_settings_) apply(*std::exchange(new_settings_, std::nullopt));
  if (new_faults_) {
    const FaultConfiguration faults = *std::exchange(new_faults_, std::nullopt);
    faults_.reset();
    if (faults.any()) faults_.emplace(faults);
  }
  const std::vector<std::uint32_t> tests = std::exchange(tests_, {});
  const std::vector<std::uint64_t> lost = std::exchange(lost_, {});
  if (tests.empty() && lost.empty()) return;
  lock.unlock();
  for (const std::uint32_t bytes : tests) send_test(bytes);
  for (const std::uint64_t frame : lost) camera_.report_lost(frame);
  lock.lock();
}

void Streamer::apply(const StreamSettings& settings) {
  if (std::exchange(closed_, false) || settings.destination != settings_.destination) {
    // A channel that opens counts its blocks from 1 and remembers none.
    current_.reset();
    ring_.clear();
    late_.clear();
    wanted_.clear();
    next_block_ = 1;
    previous_dropped_ = false;
    last_frame_id_.reset();
    if (settings.open()) {
      const sockaddr_in to = socket_address(settings.destination);
      ::connect(socket_.descriptor(), reinterpret_cast<const sockaddr*>(&to), sizeof to);
    }
  }
  settings_ = settings;
  fragment(!settings.do_not_fragment);
}

void Streamer::fragment(bool allowed) {
  const int discover = allowed ? IP_PMTUDISC_DONT : IP_PMTUDISC_DO;
  ::setsockopt(socket_.descriptor(), IPPROTO_IP, IP_MTU_DISCOVER, &discover, sizeof discover);
}

void Streamer::run() {
  // The kernel lets ordinary threads oversleep by 50 us, which is the time of a batch.
  ::prctl(PR_SET_TIMERSLACK, 1UL, 0UL, 0UL, 0UL);
  std::unique_lock lock(mutex_);
  while (!closing_) {
    if (has_orders()) {
      take_orders(lock);
      continue;
    }
    Time now = Clock::now();
    if (!current_ && !frames_.empty()) {
      auto frame = std::move(frames_.front());
      frames_.pop_front();
      begin(std::move(frame), frames_.size(), now);
      continue;
    }
    for (; !requests_.empty(); requests_.pop_front()) want(requests_.front());
    if (!batch_.empty()) {
      lock.unlock();
      flush();
      lock.lock();
      add_up();
      continue;
    }
    if (!current_ && wanted_.empty()) {
      wake_.wait(lock);
      continue;
    }
    const bool frame_due = current_ && pacer_.due(false) <= now;
    const bool resend_due = !wanted_.empty() && pacer_.due(true) <= now;
    if (!frame_due && !resend_due) {
      wake_.wait_until(lock, pacer_.due(!wanted_.empty()));
      continue;
    }
    lock.unlock();
    // What is missing first: a gap that stays open costs the client more the longer it does.
    if (resend_due)
      send_resend_batch(now);
    else
      send_frame_batch(now);
    lock.lock();
    add_up();
  }
}

void Streamer::add_up() {
  statistics_.frames += counted_.frames;
  statistics_.packets += counted_.packets;
  statistics_.bytes += counted_.bytes;
  statistics_.resent += counted_.resent;
  statistics_.unavailable += counted_.unavailable;
  statistics_.faulted_packets += counted_.faulted_packets;
  statistics_.send_errors += counted_.send_errors;
  counted_ = {};
}

void Streamer::begin(std::shared_ptr<const CameraFrame> frame, std::size_t backlog, Time now) {
  // Numbers of frames that never came leave a gap in those of the blocks: clients count what they missed.
  std::uint64_t step = 1, period_ns = 0;
  if (last_frame_id_) {
    constexpr std::uint64_t widest_gap = 10'000;
    if (frame->id > *last_frame_id_ && frame->id - *last_frame_id_ <= widest_gap)
      step = frame->id - *last_frame_id_;
    constexpr std::uint64_t second = 1'000'000'000;
    if (frame->timestamp_ns > last_timestamp_ns_ && frame->timestamp_ns - last_timestamp_ns_ < second)
      period_ns = (frame->timestamp_ns - last_timestamp_ns_) / step;
    next_block_ += step - 1;
  }
  last_frame_id_ = frame->id;
  last_timestamp_ns_ = frame->timestamp_ns;
  previous_dropped_ = previous_dropped_ || step > 1;
  const std::uint64_t id = next_block_++;

  Time start = now;
  if (faults_) {
    const FaultDice::Frame fault = faults_->frame();
    if (fault.dropped) {
      ++statistics_.faulted_frames;
      lost_.push_back(frame->id);
      previous_dropped_ = true;
      return;
    }
    if (fault.delayed) start += std::chrono::microseconds(faults_->faults().frame_delay_us);
  }
  current_ = std::make_shared<Block>(Block::cut(id, std::move(frame), settings_));
  // Every packet counts as a full one, also in send_frame_batch: leader and trailer of a small frame are most
  // of it.
  pacer_.begin_frame(start, current_->packets() * (current_->header_bytes() + current_->data_bytes),
                     period_ns, backlog, settings_.delay_ns);
  current_->previous_dropped = std::exchange(previous_dropped_, false);
  current_->finished = now;
  ring_.add(current_, now);
}

void Streamer::send_frame_batch(Time now) {
  const std::uint64_t packets = counted_.packets, bytes = counted_.bytes;
  const std::size_t most = pacer_.packets_at_once();
  const std::size_t packet_bytes = current_->header_bytes() + current_->data_bytes;
  std::size_t taken = 0, taken_bytes = 0;
  while (current_->sent < current_->packets() && taken < most && batch_.takes(packet_bytes)) {
    emit(current_, current_->sent++, false);
    ++taken;
    taken_bytes += packet_bytes;
  }
  const bool last = current_->sent == current_->packets();
  if (last) {
    current_->finished = now;
    for (const Late& one : std::exchange(late_, {})) put(one.block, one.packet, one.resent);
    current_.reset();
    ++counted_.frames;
  }
  flush();
  // What a fault took away still took its time.
  pacer_.sent(now, std::max<std::size_t>(counted_.packets - packets, taken),
              std::max<std::size_t>(counted_.bytes - bytes, taken_bytes), false);
}

void Streamer::send_resend_batch(Time now) {
  const std::uint64_t packets = counted_.packets, bytes = counted_.bytes;
  const std::size_t most = pacer_.packets_at_once();
  for (std::size_t taken = 0; taken < most && !wanted_.empty(); ++taken) {
    const Wanted next = wanted_.front();
    if (!batch_.takes(next.block->header_bytes() + next.block->data_bytes)) break;
    wanted_.pop_front();
    next.block->wanted[next.packet] = false;
    emit(next.block, next.packet, true);
    ++counted_.resent;
  }
  flush();
  pacer_.sent(now, counted_.packets - packets, counted_.bytes - bytes, true);
}

/// Lines up the packets of a request that do not wait already, and refuses those that cannot be had. Codes of
/// later versions are told to clients that know them.
void Streamer::want(const ResendRequest& request) {
  const BlockPointer block =
      request.extended_ids == settings_.extended_ids ? ring_.find(request.block) : nullptr;
  if (!block) {
    const Status status = settings_.status_1_1 ? Status::packet_removed : Status::packet_unavailable;
    const std::uint32_t count = std::min(request.last - request.first, refusals_per_request - 1) + 1;
    for (std::uint32_t i = 0; i < count; ++i) refuse(request.block, request.first + i, status);
    return;
  }
  if (block->wanted.empty()) block->wanted.resize(block->packets());
  const std::uint32_t end = std::min(request.last, block->packets() - 1) + 1;
  for (std::uint32_t packet = request.first; packet < end; ++packet) {
    if (packet >= block->sent) {
      // It will come by itself.
      if (settings_.status_1_1) refuse(request.block, packet, Status::packet_not_yet_available);
      return;
    }
    if (block->wanted[packet]) continue;
    if (block->resends_left == 0) {
      if (settings_.status_2_0) refuse(request.block, packet, Status::packet_temporarily_unavailable);
      return;
    }
    --block->resends_left;
    block->wanted[packet] = true;
    wanted_.push_back({block, packet});
  }
}

void Streamer::refuse(std::uint64_t wire_id, std::uint32_t packet, Status status) {
  if (!batch_.takes(20)) return;
  batch_.add_refusal(settings_.extended_ids, wire_id, packet, status);
  ++counted_.unavailable;
}

/// One packet through the faults, if any.
void Streamer::emit(const BlockPointer& block, std::uint32_t packet, bool resent) {
  if (!faults_) return put(block, packet, resent);
  const FaultDice::Packet fault = faults_->packet();
  if (fault.lost) {
    ++counted_.faulted_packets;
  } else if (fault.late) {
    late_.push_back({block, packet, resent, late_by_packets});
    return;
  } else {
    put(block, packet, resent);
    if (fault.twice) put(block, packet, resent);
  }
  for (std::size_t i = 0; i < late_.size();) {
    if (--late_[i].after > 0) {
      ++i;
      continue;
    }
    const Late one = late_[i];
    late_.erase(late_.begin() + static_cast<std::ptrdiff_t>(i));
    put(one.block, one.packet, one.resent);
  }
}

void Streamer::put(const BlockPointer& block, std::uint32_t packet, bool resent) {
  if (!batch_.takes(block->header_bytes() + block->data_bytes)) flush();
  batch_.add(*block, packet, resent);
  if (batch_blocks_.empty() || batch_blocks_.back() != block) batch_blocks_.push_back(block);
}

void Streamer::flush() {
  if (!batch_.empty()) {
    const PacketBatch::Outcome outcome = batch_.send(socket_.descriptor());
    counted_.packets += outcome.packets;
    counted_.bytes += outcome.bytes;
    counted_.send_errors += outcome.errors;
  }
  batch_blocks_.clear();
}

void Streamer::send_test(std::uint32_t packet_bytes) {
  if (!settings_.open()) return;
  std::vector<std::uint8_t> packet(packet_bytes - ip_udp_bytes);
  write_header(packet.data(), settings_.extended_ids, 0, 0, PacketFormat::payload, Status::success);
  fragment(false);
  // An error from an earlier packet is told instead of sending: hence twice.
  for (int attempt = 0; attempt < 2; ++attempt)
    if (::send(socket_.descriptor(), packet.data(), packet.size(), MSG_NOSIGNAL) >= 0) break;
  fragment(!settings_.do_not_fragment);
}

}  // namespace atomcam::gige
