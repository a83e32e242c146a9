// CPU time per GB of the stream's sender against a bare sendmmsg loop, on the loopback, to a receiver that
// only drains. Sender and bare loop alternate, so that both meet the same neighbours; the medians are
// printed. CPU time is the sending thread's own; the kernel's work on delivery runs in it, too.

#include <fmt/format.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <thread>
#include <vector>

#include "gige/streamer.hpp"

namespace atomcam {
namespace {

double cpu_seconds(clockid_t clock) {
  timespec time{};
  ::clock_gettime(clock, &time);
  return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
}
double process_cpu_seconds() {
  return cpu_seconds(CLOCK_PROCESS_CPUTIME_ID);
}

/// Takes datagrams out of the kernel and counts its own CPU time, so that it can be left out.
class Drain {
 public:
  Drain() {
    socket_.bind({0x7f000001, 0});
    const int buffer = 8 << 20;
    ::setsockopt(socket_.descriptor(), SOL_SOCKET, SO_RCVBUFFORCE, &buffer, sizeof buffer);
    const timeval patience{0, 20'000};
    ::setsockopt(socket_.descriptor(), SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience);
    thread_ = std::thread([this] { run(); });
    ::pthread_getcpuclockid(thread_.native_handle(), &clock_);
  }
  ~Drain() {
    stop_ = true;
    thread_.join();
  }
  gige::Endpoint endpoint() const { return socket_.local(); }
  double cpu() const { return cpu_seconds(clock_); }
  std::uint64_t packets() const { return packets_; }

 private:
  void run() {
    // One byte of each packet: what the receiver copies is not the question.
    constexpr std::size_t at_once = 64;
    std::array<std::uint8_t, at_once> bytes{};
    std::array<iovec, at_once> parts{};
    std::array<mmsghdr, at_once> messages{};
    for (std::size_t i = 0; i < at_once; ++i) {
      parts[i] = {&bytes[i], 1};
      messages[i].msg_hdr.msg_iov = &parts[i];
      messages[i].msg_hdr.msg_iovlen = 1;
    }
    while (!stop_) {
      const int got = ::recvmmsg(socket_.descriptor(), messages.data(), at_once, MSG_WAITFORONE, nullptr);
      if (got > 0) packets_ += static_cast<std::uint64_t>(got);
    }
  }

  gige::UdpSocket socket_;
  std::atomic<bool> stop_ = false;
  std::atomic<std::uint64_t> packets_ = 0;
  clockid_t clock_{};
  std::thread thread_;
};

struct Cost {
  double cpu_s = 0;
  double bytes = 0;  // of UDP payload
  double per_gb() const { return cpu_s / bytes * 1e9; }
};

constexpr std::size_t frame_bytes = std::size_t{2} * 4096 * 2304;

/// The least a sender can do: fixed headers, the same data, 32 packets a call; `paced`: 64 KiB a call and a
/// sleep until the next is due, at the rate of a stream that sends a single frame.
Cost bare_loop(const Drain& drain, const std::vector<std::uint8_t>& payload, std::uint32_t packet_bytes,
               int frames, bool paced) {
  gige::UdpSocket socket;
  socket.bind({0x7f000001, 0});
  const sockaddr_in to = gige::socket_address(drain.endpoint());
  ::connect(socket.descriptor(), reinterpret_cast<const sockaddr*>(&to), sizeof to);
  constexpr std::size_t at_once = 32;
  std::array<std::uint8_t, 8> header{};
  std::array<std::array<iovec, 2>, at_once> parts{};
  std::array<mmsghdr, at_once> messages{};
  const std::size_t data = packet_bytes - 36;
  const std::size_t most = paced ? std::min<std::size_t>(at_once, (64 << 10) / packet_bytes) : at_once;
  Cost cost;
  gige::Time due = gige::Clock::now();
  const double start = cpu_seconds(CLOCK_THREAD_CPUTIME_ID);
  for (int frame = 0; frame < frames; ++frame) {
    for (std::size_t at = 0; at < payload.size();) {
      unsigned count = 0;
      for (; count < most && at < payload.size(); ++count, at += data) {
        const std::size_t length = std::min(data, payload.size() - at);
        parts[count][0] = {header.data(), header.size()};
        parts[count][1] = {const_cast<std::uint8_t*>(payload.data() + at), length};
        messages[count].msg_hdr.msg_iov = parts[count].data();
        messages[count].msg_hdr.msg_iovlen = 2;
        cost.bytes += static_cast<double>(length + header.size());
      }
      ::sendmmsg(socket.descriptor(), messages.data(), count, 0);
      if (!paced) continue;
      due += std::chrono::nanoseconds(4 * count * packet_bytes);
      std::this_thread::sleep_until(due);
    }
  }
  cost.cpu_s = cpu_seconds(CLOCK_THREAD_CPUTIME_ID) - start;
  return cost;
}

class NoCamera final : public TransportCamera {
 public:
  Identity identity() const override { return {}; }
  void set_user_name(const std::string&) override {}
  RegisterStatus read(std::uint32_t, std::span<std::uint8_t>) override { return RegisterStatus::busy; }
  RegisterStatus write(std::uint32_t, std::span<const std::uint8_t>) override { return RegisterStatus::busy; }
  std::string genicam_xml(std::span<const FeatureDeclaration>) const override { return {}; }
  void attach(FrameSink*) override {}
  void stop_acquisition() override {}
  std::uint64_t timestamp_ns() const override { return 0; }
  void reset_timestamp() override {}
  void fire_action(int) override {}
  void report_lost(std::uint64_t) override {}
};

/// The stream's own sender, faults off; `paced`: with its pauses, as a single frame is sent.
Cost streamer(const Drain& drain, const std::vector<std::uint8_t>& payload, std::uint32_t packet_bytes,
              int frames, bool paced) {
  NoCamera camera;
  gige::StreamOptions options;
  options.pace = paced ? 0.8 : 0;
  options.queue_frames = static_cast<std::size_t>(frames);
  const double start = process_cpu_seconds(), drained = drain.cpu();
  const double here = cpu_seconds(CLOCK_THREAD_CPUTIME_ID);
  Cost cost;
  {
    auto image = std::make_shared<CameraFrame>();
    image->payload = payload;
    gige::Streamer sender(camera, 0x7f000001, options);
    sender.configure({drain.endpoint(), packet_bytes});
    for (int frame = 1; frame <= frames; ++frame) {
      sender.deliver(image);
      while (sender.statistics().frames < static_cast<std::uint64_t>(frame))
        std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
    cost.bytes = static_cast<double>(sender.statistics().bytes);
  }
  const double waiting = cpu_seconds(CLOCK_THREAD_CPUTIME_ID) - here;
  cost.cpu_s = process_cpu_seconds() - start - (drain.cpu() - drained) - waiting;
  return cost;
}

double median(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  return values[values.size() / 2];
}

void compare(std::uint32_t packet_bytes, int frames, int rounds) {
  const std::vector<std::uint8_t> payload(frame_bytes, 0x5a);
  Drain drain;
  std::vector<double> bare, ours, bare_paced, paced;
  for (int round = 0; round < rounds; ++round) {
    bare.push_back(bare_loop(drain, payload, packet_bytes, frames, false).per_gb());
    bare_paced.push_back(bare_loop(drain, payload, packet_bytes, frames, true).per_gb());
    ours.push_back(streamer(drain, payload, packet_bytes, frames, false).per_gb());
    paced.push_back(streamer(drain, payload, packet_bytes, frames, true).per_gb());
  }
  fmt::print("{:6d}   {:8.3f}   {:8.3f} ({:4.2f}x)   {:8.3f}   {:8.3f} ({:4.2f}x)\n", packet_bytes,
             median(bare), median(ours), median(ours) / median(bare), median(bare_paced), median(paced),
             median(paced) / median(bare_paced));
}

}  // namespace
}  // namespace atomcam

int main() {
  fmt::print("CPU seconds per GB sent on the loopback, 4096 x 2304 frames of 16 bits, medians of 7 rounds\n");
  fmt::print(
      "         without pauses                paced, 250 MB/s\n"
      "packet   sendmmsg   stream             sendmmsg   stream\n");
  atomcam::compare(1500, 5, 7);
  atomcam::compare(9000, 10, 7);
  atomcam::compare(16000, 10, 7);
}
