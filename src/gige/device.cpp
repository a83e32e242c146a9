#include "gige/device.hpp"

#include <fmt/format.h>
#include <poll.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include <array>
#include <atomic>
#include <cctype>
#include <fstream>
#include <iterator>

#include "base/error.hpp"
#include "gige/camera_worker.hpp"
#include "gige/control_handler.hpp"
#include "gige/message_channel.hpp"
#include "gige/streamer.hpp"
#include "gige/transport_features.hpp"
#include "gige/udp_socket.hpp"

namespace atomcam::gige {

namespace {

constexpr std::uint32_t smallest_packet = 220;
constexpr std::size_t longest_datagram = 65536;

// "iXon Ultra 897" -> "ixon-ultra-897"
std::string file_name(std::string_view text) {
  std::string name;
  for (const char letter : text) {
    if (std::isalnum(static_cast<unsigned char>(letter)) != 0)
      name += static_cast<char>(std::tolower(static_cast<unsigned char>(letter)));
    else if (!name.empty() && name.back() != '-')
      name += '-';
  }
  while (!name.empty() && name.back() == '-') name.pop_back();
  return name;
}

std::string read_file(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  std::string text((std::istreambuf_iterator<char>(file)), {});
  if (!file || text.empty()) throw Error(path, "cannot be read as a GenICam description");
  return text;
}

// Locally administered, the same at every start.
std::uint64_t made_mac(const TransportCamera::Identity& identity, std::uint32_t address) {
  const std::uint64_t hash = stream_id(identity.model + "/" + identity.serial + "/" + to_text(address));
  return 0x020000000000 | (hash & 0x00ffffffffff);
}

DeviceFacts facts_of(const TransportCamera& camera, const DeviceOptions& options, std::uint32_t address) {
  const auto interface = find_interface(address);
  if (!interface) throw Error(options.address, "not an address of this host");
  const TransportCamera::Identity identity = camera.identity();
  DeviceFacts facts;
  facts.address = address;
  facts.mask = interface->mask;
  facts.link_mbps = interface->link_mbps;
  facts.mac = options.mac != 0 ? options.mac & 0xffffffffffff : made_mac(identity, address);

  // Two sizes just fit what the kernel allocates for a packet (8 KiB and 16 KiB with its own part): a
  // receiver's buffer holds as many bytes of them as can be.
  const bool local = is_loopback(address);
  const std::uint32_t most = local ? 16000 : interface->mtu;
  facts.smallest_packet_bytes = smallest_packet;
  const auto checked = [&](std::uint32_t bytes, std::uint32_t otherwise, std::uint32_t limit,
                           const char* what) {
    if (bytes == 0) return otherwise / packet_bytes_step * packet_bytes_step;
    if (bytes < smallest_packet || bytes > limit || bytes % packet_bytes_step != 0)
      throw Error(what, fmt::format("{} is not a multiple of {} from {} to {}", bytes, packet_bytes_step,
                                    smallest_packet, limit));
    return bytes;
  };
  facts.largest_packet_bytes =
      checked(options.largest_packet_bytes, most, std::min<std::uint32_t>(interface->mtu, 65532),
              "largest_packet_bytes");
  facts.packet_bytes =
      checked(options.packet_bytes, std::min<std::uint32_t>(local ? 16000 : 1500, facts.largest_packet_bytes),
              facts.largest_packet_bytes, "packet_bytes");
  facts.faults = options.faults;
  facts.xml_name = fmt::format("atomcam-{}.xml", file_name(identity.model));
  facts.xml =
      options.xml_file.empty()
          ? camera.genicam_xml(transport_features(facts.smallest_packet_bytes, facts.largest_packet_bytes))
          : read_file(options.xml_file);
  return facts;
}

}  // namespace

class Device::Impl final : public FrameSink, public ControlActions {
 public:
  Impl(TransportCamera& camera, const DeviceOptions& options)
      : camera_(camera),
        address_(parse_address("address", options.address)),
        address_text_(to_text(address_)) {
    DeviceFacts facts = facts_of(camera, options, address_);
    control_.bind({address_, options.port});
    messages_.bind({address_, 0});
    if (options.discovery) {
      const std::uint16_t port = control_.local().port;
      for (const std::uint32_t broadcast : {0xffffffffu, address_ | ~facts.mask}) {
        broadcasts_.emplace_back();
        broadcasts_.back().bind({broadcast, port}, true);
      }
    }
    streamer_ = std::make_unique<Streamer>(camera_, address_, options.stream, options.faults);
    facts.stream_source_port = streamer_->source_port();
    facts.message_source_port = messages_.local().port;
    handler_.emplace(camera_, *this, std::move(facts));
    wake_ = ::eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK);
    if (wake_ < 0) throw Error("eventfd", "the system grants no more");
    worker_ = std::make_unique<CameraWorker>();
    camera_.attach(this);
    thread_ = std::thread([this] { run(); });
  }

  ~Impl() override {
    closing_ = true;
    wake();
    thread_.join();
    worker_.reset();
    if (handler_->controller()) camera_.stop_acquisition();
    camera_.attach(nullptr);
    streamer_.reset();
    ::close(wake_);
  }

  const std::string& address() const { return address_text_; }
  std::uint16_t port() const { return control_.local().port; }

  Statistics statistics() const {
    Statistics all;
    all.stream = streamer_->statistics();
    const std::lock_guard lock(mutex_);
    all.client = client_;
    all.destination = stream_;
    return all;
  }

  // FrameSink
  void deliver(std::shared_ptr<const CameraFrame> frame) override { streamer_->deliver(std::move(frame)); }
  void notify(const CameraEvent& event) override {
    {
      const std::lock_guard lock(mutex_);
      if (!messages_open_ || events_.size() >= 1024) return;
      events_.push_back({event_id(event.kind), event.timestamp_ns});
    }
    wake();
  }
  void acquisition_started() override { acquiring_ = true; }
  void acquisition_stopped() override {
    acquiring_ = false;
    wake();
  }

 private:
  // ControlActions, on the control thread
  void configure_stream(const StreamSettings& settings) override {
    streamer_->configure(settings);
    const std::lock_guard lock(mutex_);
    stream_ = settings.open() ? std::optional(settings.destination) : std::nullopt;
  }
  void fire_test_packet(std::uint32_t packet_bytes) override { streamer_->fire_test(packet_bytes); }
  void resend(const ResendRequest& request) override { streamer_->resend(request); }
  void inject_faults(const FaultConfiguration& faults) override { streamer_->inject_faults(faults); }
  void configure_messages(const MessageChannel& channel) override {
    sender_.configure(channel);
    const std::lock_guard lock(mutex_);
    messages_open_ = channel.open();
  }
  void send_message(int event) override {
    ControlHandler::Answers out;
    sender_.queue(event, camera_.timestamp_ns(), Clock::now(), out);
    send(messages_, out);
  }
  void stop_acquisition() override {
    worker_->post([this] { camera_.stop_acquisition(); });
  }
  bool acquiring() const override { return acquiring_; }
  Counters counters() const override {
    const StreamStatistics stream = streamer_->statistics();
    return {stream.resend_requests, stream.resent, stream.unavailable, stream.dropped_frames};
  }

  // The control thread: it answers, and waits for nothing but datagrams.
  void run() {
    std::vector<pollfd> polled{
        {wake_, POLLIN, 0}, {control_.descriptor(), POLLIN, 0}, {messages_.descriptor(), POLLIN, 0}};
    for (const UdpSocket& socket : broadcasts_) polled.push_back({socket.descriptor(), POLLIN, 0});
    std::vector<std::uint8_t> buffer(longest_datagram);
    while (!closing_) {
      ::poll(polled.data(), polled.size(), timeout_ms());
      std::uint64_t woken = 0;
      [[maybe_unused]] const auto got = ::read(wake_, &woken, sizeof woken);
      ControlHandler::Answers answers, messages;
      take_results(answers, messages);
      // A flood on one socket must not starve the rest.
      constexpr int at_once = 64;
      Endpoint from;
      for (int i = 0; i < at_once; ++i) {
        const auto size = control_.receive(buffer, from);
        if (!size) break;
        handler_->receive(Bytes(buffer).first(*size), from, Clock::now(), answers);
        start_camera_write();
      }
      for (int i = 0; i < at_once; ++i) {
        const auto size = messages_.receive(buffer, from);
        if (!size) break;
        sender_.receive(Bytes(buffer).first(*size), Clock::now(), messages);
      }
      for (UdpSocket& socket : broadcasts_) {
        for (int i = 0; i < at_once; ++i) {
          const auto size = socket.receive(buffer, from);
          if (!size) break;
          const Bytes datagram = Bytes(buffer).first(*size);
          if (for_everybody(datagram) && handler_->in_subnet(from))
            handler_->receive(datagram, from, Clock::now(), answers);
        }
      }
      handler_->tick(Clock::now(), answers);
      sender_.tick(Clock::now(), messages);
      start_camera_write();
      send(control_, answers);
      send(messages_, messages);
      const std::lock_guard lock(mutex_);
      client_ = handler_->controller();
    }
  }

  static bool for_everybody(Bytes datagram) {
    if (datagram.size() < gvcp_header_bytes) return false;
    const auto command = static_cast<Command>(load16(datagram, 2));
    return command == Command::discovery || command == Command::force_ip || command == Command::action;
  }

  int timeout_ms() const {
    std::optional<Time> soonest = handler_->next_deadline();
    if (const auto other = sender_.next_deadline(); other && (!soonest || *other < *soonest)) soonest = other;
    if (!soonest) return -1;
    const auto left = std::chrono::ceil<std::chrono::milliseconds>(*soonest - Clock::now()).count();
    return static_cast<int>(std::clamp<std::int64_t>(left, 0, 60'000));
  }

  void start_camera_write() {
    auto write = handler_->take_camera_write();
    if (!write) return;
    worker_->post([this, order = std::move(*write)] {
      const RegisterStatus status = camera_.write(order.address, order.bytes);
      {
        const std::lock_guard lock(mutex_);
        written_ = status;
      }
      wake();
    });
  }

  void take_results(ControlHandler::Answers& answers, ControlHandler::Answers& messages) {
    std::optional<RegisterStatus> written;
    std::vector<Event> events;
    {
      const std::lock_guard lock(mutex_);
      written.swap(written_);
      events.swap(events_);
    }
    if (written) {
      handler_->camera_wrote(*written, Clock::now(), answers);
      start_camera_write();
    }
    for (const Event& event : events) sender_.queue(event.id, event.timestamp_ns, Clock::now(), messages);
  }

  static void send(UdpSocket& socket, const ControlHandler::Answers& answers) {
    for (const ControlHandler::Outgoing& answer : answers) socket.send(answer.bytes, answer.to);
  }

  void wake() {
    const std::uint64_t one = 1;
    [[maybe_unused]] const auto done = ::write(wake_, &one, sizeof one);
  }

  struct Event {
    int id = 0;
    std::uint64_t timestamp_ns = 0;
  };

  TransportCamera& camera_;
  const std::uint32_t address_;
  const std::string address_text_;
  UdpSocket control_, messages_;
  std::vector<UdpSocket> broadcasts_;
  std::unique_ptr<Streamer> streamer_;
  std::optional<ControlHandler> handler_;
  MessageSender sender_;
  std::unique_ptr<CameraWorker> worker_;
  int wake_ = -1;
  std::atomic<bool> closing_ = false, acquiring_ = false;

  mutable std::mutex mutex_;
  std::optional<Endpoint> client_, stream_;
  std::optional<RegisterStatus> written_;
  std::vector<Event> events_;
  bool messages_open_ = false;
  std::thread thread_;
};

Device::Device(TransportCamera& camera, const DeviceOptions& options)
    : impl_(std::make_unique<Impl>(camera, options)) {}
Device::~Device() = default;

const std::string& Device::address() const {
  return impl_->address();
}
std::uint16_t Device::port() const {
  return impl_->port();
}
Device::Statistics Device::statistics() const {
  return impl_->statistics();
}

}  // namespace atomcam::gige
