#include "gige/device.hpp"

#include <arpa/inet.h>
#include <fmt/format.h>
#include <ifaddrs.h>
#include <net/if.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cerrno>
#include <chrono>
#include <cstring>
#include <fstream>
#include <iterator>
#include <map>
#include <mutex>
#include <thread>
#include <utility>

#include "base/error.hpp"
#include "base/random.hpp"

namespace atomcam::gige {
namespace {

constexpr int poll_ms = 20;  // how often the heartbeat and unanswered events are looked at

std::uint64_t now_ns() {
  return static_cast<std::uint64_t>(std::chrono::duration_cast<std::chrono::nanoseconds>(
                                        std::chrono::steady_clock::now().time_since_epoch())
                                        .count());
}

sockaddr_in socket_address(Endpoint endpoint) {
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_addr.s_addr = htonl(endpoint.address);
  address.sin_port = htons(endpoint.port);
  return address;
}

/// A UDP socket that closes itself.
class Socket {
 public:
  Socket() : descriptor_(socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0)) {
    if (descriptor_ < 0) throw Error("socket", std::strerror(errno));
  }
  ~Socket() { close(descriptor_); }
  Socket(const Socket&) = delete;
  Socket& operator=(const Socket&) = delete;
  int descriptor() const { return descriptor_; }
  bool bind_to(Endpoint endpoint) {
    const sockaddr_in address = socket_address(endpoint);
    return bind(descriptor_, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0;
  }
  std::uint16_t port() const {
    sockaddr_in address{};
    socklen_t length = sizeof address;
    getsockname(descriptor_, reinterpret_cast<sockaddr*>(&address), &length);
    return ntohs(address.sin_port);
  }
  void set(int level, int option, int value) { setsockopt(descriptor_, level, option, &value, sizeof value); }
  void send(Endpoint to, std::span<const std::uint8_t> datagram) const {
    const sockaddr_in address = socket_address(to);
    sendto(descriptor_, datagram.data(), datagram.size(), 0, reinterpret_cast<const sockaddr*>(&address),
           sizeof address);
  }

 private:
  int descriptor_;
};

std::uint32_t parse_address(const std::string& text) {
  in_addr address{};
  if (inet_pton(AF_INET, text.c_str(), &address) != 1)
    throw Error("address", fmt::format("'{}' is no IPv4 address, such as 127.0.0.1", text));
  return ntohl(address.s_addr);
}

/// Mask and MTU of the interface that has the address; 127.0.0.0/8 belongs to loopback as a whole.
InterfaceDescription describe_interface(std::uint32_t address, const std::string& serial) {
  InterfaceDescription description;
  description.address = address;
  std::string name;
  ifaddrs* list = nullptr;
  if (getifaddrs(&list) == 0) {
    for (const ifaddrs* entry = list; entry; entry = entry->ifa_next) {
      if (!entry->ifa_addr || entry->ifa_addr->sa_family != AF_INET || !entry->ifa_netmask) continue;
      const std::uint32_t own = ntohl(reinterpret_cast<const sockaddr_in*>(entry->ifa_addr)->sin_addr.s_addr);
      const std::uint32_t mask =
          ntohl(reinterpret_cast<const sockaddr_in*>(entry->ifa_netmask)->sin_addr.s_addr);
      const bool loopback = (entry->ifa_flags & IFF_LOOPBACK) != 0 && address >> 24 == 127;
      if (own != address && !loopback) continue;
      description.mask = mask;
      name = entry->ifa_name;
      break;
    }
    freeifaddrs(list);
  }
  if (name.empty()) description.mtu = 1500;
  if (!name.empty()) {
    const Socket probe;
    ifreq request{};
    std::strncpy(request.ifr_name, name.c_str(), sizeof request.ifr_name - 1);
    if (ioctl(probe.descriptor(), SIOCGIFMTU, &request) == 0)
      description.mtu = static_cast<std::uint32_t>(request.ifr_mtu);
  }
  // A locally administered MAC address out of the serial number.
  const std::uint64_t hash = stream_id(serial + "/mac");
  description.mac[0] = 0x02;
  for (int i = 1; i < 6; ++i) description.mac[i] = static_cast<std::uint8_t>(hash >> (8 * i));
  return description;
}

std::string xml_of(TransportCamera& camera, const DeviceOptions& options,
                   const InterfaceDescription& interface, std::uint32_t packet_bytes) {
  if (options.xml_file.empty()) return camera.genicam_xml(transport_features(interface, packet_bytes));
  std::ifstream file(options.xml_file, std::ios::binary);
  std::string text{std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
  if (!file || text.empty()) throw Error(options.xml_file, "cannot be read as a GenICam XML file");
  return text;
}

std::string file_name(std::string model) {
  for (char& letter : model)
    if (!std::isalnum(static_cast<unsigned char>(letter))) letter = '-';
  return "atomcam-" + model + ".xml";
}

}  // namespace

std::string to_text(std::uint32_t address) {
  return fmt::format("{}.{}.{}.{}", address >> 24, address >> 16 & 255, address >> 8 & 255, address & 255);
}

class Device::Body : public ControlledDevice, public FrameSink {
 public:
  Body(TransportCamera& camera, DeviceOptions options)
      : camera_(camera),
        options_(std::move(options)),
        interface_(describe_interface(parse_address(options_.address), camera.identity().serial)),
        packet_bytes_(std::min(options_.packet_bytes, interface_.mtu) / 4 * 4) {
    if (!control_socket_.bind_to({interface_.address, options_.port}))
      throw Error(fmt::format("{}:{}", options_.address, options_.port),
                  errno == EADDRINUSE ? "taken; another camera is served there, choose another address"
                                      : fmt::format("cannot be bound: {}", std::strerror(errno)));
    // Broadcast discovery reaches every socket that shares this address.
    broadcast_socket_.set(SOL_SOCKET, SO_REUSEADDR, 1);
    broadcast_socket_.bind_to({0xffffffff, options_.port});
    message_socket_.bind_to({interface_.address, 0});
    streamer_ = std::make_unique<Streamer>(camera_, interface_.address, options_.stream);
    streamer_->set_faults(options_.faults);
    control_ = std::make_unique<Control>(camera_, *this, interface_,
                                         xml_of(camera_, options_, interface_, packet_bytes_),
                                         file_name(camera_.identity().model), packet_bytes_, options_.faults);
    control_->set_source_ports(streamer_->source_port(), message_socket_.port());
    camera_.attach(this);
    thread_ = std::thread([this] { run(); });
  }

  ~Body() override {
    closing_ = true;
    thread_.join();
    camera_.stop_acquisition();
    camera_.attach(nullptr);
  }

  Statistics statistics() const {
    const std::lock_guard lock(client_mutex_);
    return {.client = client_, .stream = streamer_->statistics()};
  }
  const std::string& address() const { return options_.address; }

  // ControlledDevice, from the control thread.
  void stream_configured(const StreamConfiguration& stream) override { streamer_->configure(stream); }
  void faults_configured(const FaultConfiguration& faults) override { streamer_->set_faults(faults); }
  void messages_configured(const MessageChannel& messages) override {
    const std::lock_guard lock(message_mutex_);
    messages_ = messages;
    if (messages.destination.port == 0) unanswered_.clear();
  }
  void send_test_packet(const StreamConfiguration& stream) override { streamer_->send_test_packet(stream); }
  void resend(const ResendRequest& request) override { streamer_->resend(request); }
  void event_acknowledged(std::uint16_t request) override {
    const std::lock_guard lock(message_mutex_);
    unanswered_.erase(request);
  }
  void send_control(Endpoint to, std::span<const std::uint8_t> datagram) override {
    control_socket_.send(to, datagram);
  }

  // FrameSink, from the camera's delivery thread.
  void deliver(std::shared_ptr<const CameraFrame> frame) override { streamer_->deliver(std::move(frame)); }
  void acquisition_started() override { streamer_->begin(); }
  void notify(const CameraEvent& event) override {
    const std::lock_guard lock(message_mutex_);
    if (messages_.destination.port == 0) return;
    Bytes datagram(24);
    const bool acknowledged = messages_.timeout_ms > 0;
    if (++message_request_ == 0) message_request_ = 1;
    datagram[0] = command_key;
    datagram[1] = acknowledged ? flag_acknowledge : 0;
    store16(datagram, 2, static_cast<std::uint16_t>(Command::event));
    store16(datagram, 4, 16);
    store16(datagram, 6, message_request_);
    store16(datagram, 10, static_cast<std::uint32_t>(event_id(event.kind)));
    store16(datagram, 12, 0xffff);  // of no stream channel in particular
    store16(datagram, 14, static_cast<std::uint16_t>(event.frame_id));
    store64(datagram, 16, event.timestamp_ns);
    message_socket_.send(messages_.destination, datagram);
    if (acknowledged && unanswered_.size() < 64)
      unanswered_[message_request_] = {std::move(datagram), now_ns() + messages_.timeout_ms * 1000000ull,
                                       messages_.retries};
  }

 private:
  struct Unanswered {
    Bytes datagram;
    std::uint64_t due_ns;
    std::uint32_t retries;
  };

  void run() {
    std::array<pollfd, 3> sockets{{{control_socket_.descriptor(), POLLIN, 0},
                                   {broadcast_socket_.descriptor(), POLLIN, 0},
                                   {message_socket_.descriptor(), POLLIN, 0}}};
    while (!closing_) {
      poll(sockets.data(), sockets.size(), poll_ms);
      for (pollfd& ready : sockets)
        if (ready.revents != 0) receive(ready.fd, ready.fd == broadcast_socket_.descriptor());
      control_->check_heartbeat(now_ns());
      repeat_events();
      const std::lock_guard lock(client_mutex_);
      client_ = control_->controller();
    }
  }

  void receive(int descriptor, bool broadcast) {
    std::array<std::uint8_t, 2048> buffer;
    for (int packets = 0; packets < 64; ++packets) {
      sockaddr_in sender{};
      socklen_t length = sizeof sender;
      const ssize_t size = recvfrom(descriptor, buffer.data(), buffer.size(), 0,
                                    reinterpret_cast<sockaddr*>(&sender), &length);
      if (size < 0) return;
      const Endpoint from{ntohl(sender.sin_addr.s_addr), ntohs(sender.sin_port)};
      // Everyone on the cable hears a broadcast; only who can reach this address gets an answer.
      if (broadcast && (from.address & interface_.mask) != (interface_.address & interface_.mask)) continue;
      const auto datagram = std::span<const std::uint8_t>(buffer).first(static_cast<std::size_t>(size));
      if (broadcast && !for_everyone(datagram)) continue;
      const Bytes answer = control_->handle(datagram, from, now_ns());
      if (!answer.empty()) control_socket_.send(from, answer);
    }
  }

  static bool for_everyone(std::span<const std::uint8_t> datagram) {
    if (datagram.size() < 8) return false;
    const auto command = static_cast<Command>(load16(datagram, 2));
    return command == Command::discovery || command == Command::force_ip || command == Command::action;
  }

  void repeat_events() {
    const std::lock_guard lock(message_mutex_);
    const std::uint64_t now = now_ns();
    for (auto entry = unanswered_.begin(); entry != unanswered_.end();) {
      Unanswered& event = entry->second;
      if (now < event.due_ns) {
        ++entry;
      } else if (event.retries == 0) {
        entry = unanswered_.erase(entry);
      } else {
        --event.retries;
        event.due_ns = now + messages_.timeout_ms * 1000000ull;
        message_socket_.send(messages_.destination, event.datagram);
        ++entry;
      }
    }
  }

  TransportCamera& camera_;
  DeviceOptions options_;
  InterfaceDescription interface_;
  std::uint32_t packet_bytes_;
  Socket control_socket_, broadcast_socket_, message_socket_;
  std::unique_ptr<Streamer> streamer_;
  std::unique_ptr<Control> control_;
  mutable std::mutex client_mutex_;
  std::optional<Endpoint> client_;
  std::mutex message_mutex_;
  MessageChannel messages_;
  std::uint16_t message_request_ = 0;
  std::map<std::uint16_t, Unanswered> unanswered_;
  std::atomic<bool> closing_{false};
  std::thread thread_;
};

Device::Device(TransportCamera& camera, DeviceOptions options)
    : body_(std::make_unique<Body>(camera, std::move(options))) {}
Device::~Device() = default;
Device::Statistics Device::statistics() const {
  return body_->statistics();
}
const std::string& Device::address() const {
  return body_->address();
}

}  // namespace atomcam::gige
