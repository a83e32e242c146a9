#include "gige/control.hpp"

#include <algorithm>
#include <chrono>
#include <future>
#include <utility>

namespace atomcam::gige {
namespace {

constexpr std::uint32_t privilege_exclusive = 1, privilege_control = 2, privilege_switchover = 4;
constexpr std::uint32_t configuration_heartbeat_off = 1u << 0, configuration_pending = 1u << 1,
                        configuration_status_1_1 = 1u << 2, configuration_unconditional_action = 1u << 3,
                        configuration_status_2_0 = 1u << 18;
constexpr std::uint32_t fire_test_packet = 1u << 31, do_not_fragment = 1u << 30;
constexpr std::uint32_t extended_block_ids = 1u << 30;
constexpr std::uint32_t smallest_packet = 220, largest_packet = 65532;
constexpr std::uint32_t shortest_heartbeat_ms = 500;
constexpr std::uint64_t long_command_ms = 50;  // a camera write that takes longer announces itself

/// Concatenation, WRITEMEM, resend, EVENT, PENDING_ACK, ACTION, status codes of 1.1 and 2.0, unconditional
/// action, switchover, test data, primary application port and address, link speed, heartbeat switch, serial,
/// user name.
constexpr std::uint32_t control_capabilities = 1u << 0 | 1u << 1 | 1u << 2 | 1u << 3 | 1u << 5 | 1u << 6 |
                                               1u << 18 | 1u << 20 | 1u << 21 | 1u << 22 | 1u << 25 |
                                               1u << 27 | 1u << 28 | 1u << 29 | 1u << 30 | 1u << 31;

std::uint32_t ppm(double probability) {
  return static_cast<std::uint32_t>(probability * 1e6 + 0.5);
}

Status status_of(RegisterStatus status) {
  switch (status) {
    case RegisterStatus::ok:
      return Status::success;
    case RegisterStatus::invalid_address:
      return Status::invalid_address;
    case RegisterStatus::write_protect:
      return Status::write_protect;
    case RegisterStatus::bad_alignment:
      return Status::bad_alignment;
    case RegisterStatus::access_denied:
      return Status::access_denied;
    case RegisterStatus::busy:
      return Status::busy;
    case RegisterStatus::invalid_parameter:
      return Status::invalid_parameter;
  }
  return Status::generic_error;
}

Bytes datagram(std::uint16_t first, std::uint16_t command, std::uint16_t request,
               std::span<const std::uint8_t> payload) {
  Bytes bytes(8 + payload.size());
  store16(bytes, 0, first);
  store16(bytes, 2, command);
  store16(bytes, 4, static_cast<std::uint16_t>(payload.size()));
  store16(bytes, 6, request);
  std::copy(payload.begin(), payload.end(), bytes.begin() + 8);
  return bytes;
}

std::uint32_t channel_zero(std::uint32_t value) {
  return value >> 16;
}

}  // namespace

Control::Control(TransportCamera& camera, ControlledDevice& device, InterfaceDescription interface,
                 std::string xml, std::string xml_name, std::uint32_t default_packet_bytes,
                 FaultConfiguration faults)
    : camera_(camera),
      device_(device),
      interface_(interface),
      registers_(reg::transport_end),
      use_(reg::transport_end / 4, Use::none),
      xml_(xml.begin(), xml.end()) {
  const std::size_t xml_bytes = xml_.size();
  xml_.resize((xml_bytes + 3) / 4 * 4 + 512);  // clients read whole blocks

  allow(0, reg::discovery_end, Use::read);
  allow(reg::first_url, reg::interfaces + 4, Use::read);
  for (const std::uint32_t address :
       {reg::link_speed, reg::message_channels, reg::stream_channels, reg::action_signals, reg::active_links,
        reg::stream_capability, reg::message_capability, reg::control_capability, reg::tick_high,
        reg::tick_low, reg::timestamp_high, reg::timestamp_low, reg::pending_timeout, reg::link_capability,
        reg::primary_port, reg::primary_ip, reg::message_source, reg::stream_source, reg::channel_capability})
    allow_word(address, Use::read);
  for (const std::uint32_t address :
       {reg::ip_configuration, reg::persistent_ip, reg::persistent_mask, reg::persistent_gateway,
        reg::heartbeat, reg::control_configuration, reg::stream_configuration, reg::link_configuration,
        reg::control_privilege, reg::message_port, reg::message_address, reg::message_timeout,
        reg::message_retries, reg::stream_port, reg::packet_size, reg::packet_delay, reg::stream_address,
        reg::channel_configuration})
    allow_word(address, Use::both);
  for (const std::uint32_t address : {reg::action_device_key, reg::timestamp_control, reg::switchover_key})
    allow_word(address, Use::write);
  allow(reg::user_name, reg::discovery_end, Use::both);
  for (int signal = 0; signal < action_signal_count; ++signal) {
    allow_word(reg::action_group + 16 * signal, Use::both);
    allow_word(reg::action_group + 16 * signal + 4, Use::both);
  }
  allow(reg::fault_loss_ppm, reg::fault_seed + 4, Use::both);

  set_word(reg::version, 0x00020000);
  set_word(reg::device_mode, 0x80000001);  // big endian, transmitter, single link, UTF-8
  set_word(reg::mac_high, static_cast<std::uint32_t>(interface.mac[0] << 8 | interface.mac[1]));
  set_word(reg::mac_low, load32(interface.mac, 2));
  set_word(reg::ip_capability, 5);  // persistent address and link-local
  set_word(reg::ip_configuration, 5);
  set_word(reg::current_ip, interface.address);
  set_word(reg::current_mask, interface.mask);
  set_word(reg::current_gateway, interface.gateway);
  set_word(reg::persistent_ip, interface.address);
  set_word(reg::persistent_mask, interface.mask);
  const TransportCamera::Identity identity = camera.identity();
  set_text(reg::manufacturer, 32, identity.vendor);
  set_text(reg::model, 32, identity.model);
  set_text(reg::device_version, 32, identity.version);
  set_text(reg::information, 48, identity.info);
  set_text(reg::serial, 16, identity.serial);
  set_text(reg::user_name, 16, identity.user_name);
  char url[512];
  std::snprintf(url, sizeof url, "Local:%s;%X;%zX", xml_name.c_str(), reg::xml, xml_bytes);
  set_text(reg::first_url, 512, url);
  set_word(reg::interfaces, 1);
  set_word(reg::link_speed, interface.link_speed_mbit_s);
  set_word(reg::message_channels, 1);
  set_word(reg::stream_channels, 1);
  set_word(reg::action_signals, action_signal_count);
  set_word(reg::active_links, 1);
  set_word(reg::stream_capability, 1u << 31 | 1u << 30);  // source port register, 16-bit block ids too
  set_word(reg::message_capability, 1u << 31);
  set_word(reg::control_capability, control_capabilities);
  set_word(reg::heartbeat, 3000);
  set_word(reg::tick_low, 1000000000);
  set_word(reg::control_configuration, configuration_pending);
  set_word(reg::pending_timeout, 1000);
  set_word(reg::link_capability, 1);
  set_word(reg::packet_size, do_not_fragment | default_packet_bytes);
  set_word(reg::fault_loss_ppm, ppm(faults.packet_loss));
  set_word(reg::fault_burst, faults.burst);
  set_word(reg::fault_reorder_ppm, ppm(faults.reorder));
  set_word(reg::fault_duplicate_ppm, ppm(faults.duplicate));
  set_word(reg::fault_delay_ppm, ppm(faults.frame_delay));
  set_word(reg::fault_delay_us, faults.frame_delay_us);
  set_word(reg::fault_drop_frames_ppm, ppm(faults.frame_drop));
  set_word(reg::fault_seed, static_cast<std::uint32_t>(faults.seed));
}

void Control::allow(std::uint32_t begin, std::uint32_t end, Use use) {
  for (std::uint32_t address = begin; address < end; address += 4) use_[address / 4] = use;
}

void Control::set_text(std::uint32_t address, std::size_t capacity, const std::string& text) {
  std::fill_n(registers_.begin() + address, capacity, std::uint8_t{0});
  std::copy_n(text.begin(), std::min(text.size(), capacity - 1), registers_.begin() + address);
}

void Control::set_source_ports(std::uint16_t stream, std::uint16_t messages) {
  set_word(reg::stream_source, stream);
  set_word(reg::message_source, messages);
}

StreamConfiguration Control::stream() const {
  return {.destination = {word(reg::stream_address), static_cast<std::uint16_t>(word(reg::stream_port))},
          .packet_bytes = word(reg::packet_size) & 0xffff,
          .do_not_fragment = (word(reg::packet_size) & do_not_fragment) != 0,
          .packet_delay_ns = word(reg::packet_delay),
          .extended_ids = (word(reg::stream_configuration) & extended_block_ids) != 0};
}

FaultConfiguration Control::faults() const {
  return {.packet_loss = word(reg::fault_loss_ppm) * 1e-6,
          .burst = word(reg::fault_burst),
          .reorder = word(reg::fault_reorder_ppm) * 1e-6,
          .duplicate = word(reg::fault_duplicate_ppm) * 1e-6,
          .frame_delay = word(reg::fault_delay_ppm) * 1e-6,
          .frame_delay_us = word(reg::fault_delay_us),
          .frame_drop = word(reg::fault_drop_frames_ppm) * 1e-6,
          .seed = word(reg::fault_seed)};
}

MessageChannel Control::messages() const {
  return {.destination = {word(reg::message_address), static_cast<std::uint16_t>(word(reg::message_port))},
          .timeout_ms = word(reg::message_timeout),
          .retries = word(reg::message_retries)};
}

Bytes Control::handle(std::span<const std::uint8_t> packet, Endpoint from, std::uint64_t now_ns) {
  if (packet.size() < 8) return {};
  const std::uint16_t request = load16(packet, 6);
  const auto command = static_cast<Command>(load16(packet, 2));
  if (packet[0] != command_key) {
    // The acknowledge of an event comes back this way; it is told by its command number.
    if (load16(packet, 2) == static_cast<std::uint16_t>(Command::event) + 1)
      device_.event_acknowledged(request);
    return {};
  }
  const std::uint8_t flags = packet[1];
  const std::size_t length = load16(packet, 4);
  bool answer = (flags & flag_acknowledge) != 0;
  if (request == 0) return {};
  Result result;
  if (length != packet.size() - 8 || length > control_payload_limit) {
    result.status = Status::invalid_header;
  } else {
    const auto payload = packet.subspan(8);
    if (controller_ == from) heard_ns_ = now_ns;
    switch (command) {
      case Command::discovery:
        result = discovery();
        break;
      case Command::force_ip:
        result = force_ip(payload);
        break;
      case Command::packet_resend:
        packet_resend(payload, flags, from);
        return {};
      case Command::read_register:
        result = read_registers(payload, from);
        break;
      case Command::write_register:
        result = write_registers(payload, from, now_ns, request);
        break;
      case Command::read_memory:
        result = read_memory(payload, from);
        break;
      case Command::write_memory:
        result = write_memory(payload, from, now_ns, request);
        break;
      case Command::action:
        result = action(payload, flags, answer);
        break;
      default:
        result.status = Status::not_implemented;
        break;
    }
  }
  if (!answer) return {};
  const auto acknowledge = static_cast<std::uint16_t>(static_cast<std::uint16_t>(command) + 1);
  return datagram(static_cast<std::uint16_t>(result.status), acknowledge, request, result.payload);
}

Control::Result Control::discovery() const {
  return {Status::success, Bytes(registers_.begin(), registers_.begin() + reg::discovery_end)};
}

Control::Result Control::force_ip(std::span<const std::uint8_t> payload) const {
  // The address is the host's, not ours to change: the command succeeds if it asks for what is.
  if (payload.size() < 56) return {Status::invalid_header, {}};
  if (!std::equal(interface_.mac.begin(), interface_.mac.end(), payload.begin() + 2))
    return {Status::invalid_parameter, {}};
  const std::uint32_t address = load32(payload, 20);
  return {address == 0 || address == interface_.address ? Status::success : Status::invalid_parameter, {}};
}

bool Control::may_read(Endpoint from) const {
  return !controller_ || *controller_ == from || (word(reg::control_privilege) & privilege_exclusive) == 0;
}

Control::Result Control::read_registers(std::span<const std::uint8_t> payload, Endpoint from) {
  if (payload.empty() || payload.size() % 4 != 0) return {Status::invalid_header, {}};
  Result result;
  result.payload.resize(payload.size());
  for (std::size_t i = 0; i < payload.size(); i += 4) {
    result.status = read(load32(payload, i), std::span(result.payload).subspan(i, 4), from);
    if (result.status != Status::success) {
      result.payload.resize(i);  // what was read before the failing one
      return result;
    }
  }
  return result;
}

Control::Result Control::write_registers(std::span<const std::uint8_t> payload, Endpoint from,
                                         std::uint64_t now_ns, std::uint16_t request) {
  if (payload.empty() || payload.size() % 8 != 0) return {Status::invalid_header, {}};
  Result result;
  result.payload.resize(4);
  for (std::size_t i = 0; i < payload.size(); i += 8) {
    result.status = write(load32(payload, i), payload.subspan(i + 4, 4), from, now_ns, request);
    // The number written; on failure that is the index of the failing one.
    store16(result.payload, 2,
            static_cast<std::uint16_t>(result.status == Status::success ? i / 8 + 1 : i / 8));
    if (result.status != Status::success) return result;
  }
  return result;
}

Control::Result Control::read_memory(std::span<const std::uint8_t> payload, Endpoint from) {
  if (payload.size() != 8) return {Status::invalid_header, {}};
  const std::uint32_t address = load32(payload, 0);
  const std::size_t count = load16(payload, 6);
  if (count == 0 || count > control_payload_limit - 4) return {Status::invalid_parameter, {}};
  Result result;
  result.payload.resize(4 + count);
  store32(result.payload, 0, address);
  result.status = read(address, std::span(result.payload).subspan(4), from);
  if (result.status != Status::success) result.payload.clear();
  return result;
}

Control::Result Control::write_memory(std::span<const std::uint8_t> payload, Endpoint from,
                                      std::uint64_t now_ns, std::uint16_t request) {
  if (payload.size() < 8) return {Status::invalid_header, {}};
  Result result;
  result.payload.resize(4);
  const auto data = payload.subspan(4);
  result.status = write(load32(payload, 0), data, from, now_ns, request);
  if (result.status == Status::success) store16(result.payload, 2, static_cast<std::uint16_t>(data.size()));
  return result;
}

Control::Result Control::action(std::span<const std::uint8_t> payload, std::uint8_t flags, bool& answer) {
  const bool scheduled = (flags & flag_scheduled) != 0;
  if (payload.size() < (scheduled ? 20u : 12u)) return {Status::invalid_header, {}};
  if (scheduled) return {Status::not_implemented, {}};
  const std::uint32_t device_key = load32(payload, 0), group_key = load32(payload, 4),
                      group_mask = load32(payload, 8);
  const bool armed =
      controller_ || (word(reg::control_configuration) & configuration_unconditional_action) != 0;
  bool executed = false;
  for (int signal = 0; signal < action_signal_count; ++signal) {
    const std::uint32_t key = word(reg::action_group + 16 * signal),
                        mask = word(reg::action_group + 16 * signal + 4);
    if (!armed || device_key != word(reg::action_device_key) || group_key != key || (group_mask & mask) == 0)
      continue;
    camera_.fire_action(signal);
    executed = true;
  }
  answer = answer && executed;  // a device that an action does not concern is silent
  return {};
}

void Control::packet_resend(std::span<const std::uint8_t> payload, std::uint8_t flags, Endpoint from) {
  const bool extended = (flags & flag_broadcast_or_extended) != 0;
  if (payload.size() < (extended ? 20u : 12u) || load16(payload, 0) != 0) return;
  ResendRequest request{.from = from, .extended = extended};
  const std::uint32_t configuration = word(reg::control_configuration);
  request.extended_status = (configuration & (configuration_status_1_1 | configuration_status_2_0)) != 0;
  if (extended) {
    request.first = load32(payload, 4);
    request.last = load32(payload, 8);
    request.block = load64(payload, 12);
  } else {
    request.block = load16(payload, 2);
    request.first = load32(payload, 4) & 0xffffff;
    request.last = load32(payload, 8) & 0xffffff;
  }
  // Only who receives the stream may have packets of it again; its port is not that of the control channel.
  if (from.address != word(reg::stream_address)) return;
  device_.resend(request);
}

Status Control::read(std::uint32_t address, std::span<std::uint8_t> bytes, Endpoint from) {
  if (address % 4 != 0 || bytes.size() % 4 != 0) return Status::bad_alignment;
  if (!may_read(from) && address != reg::control_privilege) return Status::access_denied;
  if (address < reg::transport_end) {
    if (bytes.size() > reg::transport_end - address) return Status::invalid_address;
    for (std::size_t i = 0; i < bytes.size(); i += 4) {
      const auto use = static_cast<std::uint8_t>(use_[(address + i) / 4]);
      if (use == 0) return Status::invalid_address;
      if ((use & static_cast<std::uint8_t>(Use::read)) == 0) return Status::access_denied;
    }
    std::copy_n(registers_.begin() + address, bytes.size(), bytes.begin());
    return Status::success;
  }
  if (address >= reg::xml) {
    const std::uint32_t offset = address - reg::xml;
    if (offset > xml_.size() || bytes.size() > xml_.size() - offset) return Status::invalid_address;
    std::copy_n(xml_.begin() + offset, bytes.size(), bytes.begin());
    return Status::success;
  }
  if (bytes.size() > reg::xml - address) return Status::invalid_address;
  return status_of(camera_.read(address, bytes));
}

Status Control::write(std::uint32_t address, std::span<const std::uint8_t> bytes, Endpoint from,
                      std::uint64_t now_ns, std::uint16_t request) {
  if (address % 4 != 0 || bytes.size() % 4 != 0) return Status::bad_alignment;
  if (address == reg::control_privilege && bytes.size() == 4)
    return write_privilege(load32(bytes, 0), from, now_ns);
  if (controller_ != from) return Status::access_denied;
  if (address >= reg::xml) {
    return address - reg::xml < xml_.size() ? Status::write_protect : Status::invalid_address;
  }
  if (address >= reg::transport_end) return write_camera(address, bytes, from, request);
  if (bytes.size() > reg::transport_end - address) return Status::invalid_address;
  for (std::size_t i = 0; i < bytes.size(); i += 4) {
    const auto use = static_cast<std::uint8_t>(use_[(address + i) / 4]);
    if (use == 0) return Status::invalid_address;
    if ((use & static_cast<std::uint8_t>(Use::write)) == 0) return Status::write_protect;
  }
  for (std::size_t i = 0; i < bytes.size(); i += 4) {
    const Status status = write_word(address + static_cast<std::uint32_t>(i), load32(bytes, i), from, now_ns);
    if (status != Status::success) return status;
  }
  return Status::success;
}

Status Control::write_camera(std::uint32_t address, std::span<const std::uint8_t> bytes, Endpoint from,
                             std::uint16_t request) {
  if ((word(reg::control_configuration) & configuration_pending) == 0)
    return status_of(camera_.write(address, bytes));
  // Feature writes are quick; should one not be, the client is told to wait.
  auto writing = std::async(std::launch::async, [&] { return camera_.write(address, bytes); });
  if (writing.wait_for(std::chrono::milliseconds(long_command_ms)) == std::future_status::timeout) {
    std::array<std::uint8_t, 4> wait{};
    store16(wait, 2, word(reg::pending_timeout));
    device_.send_control(
        from, datagram(0, static_cast<std::uint16_t>(Command::pending_acknowledge), request, wait));
  }
  const RegisterStatus status = writing.get();
  return status_of(status);
}

Status Control::write_word(std::uint32_t address, std::uint32_t value, Endpoint, std::uint64_t) {
  const StreamConfiguration stream_before = stream();
  switch (address) {
    case reg::heartbeat:
      value = std::max(value, shortest_heartbeat_ms);
      break;
    case reg::ip_configuration:
      value = (value & 7) | 4;
      break;
    case reg::control_configuration:
      value &= configuration_heartbeat_off | configuration_pending | configuration_status_1_1 |
               configuration_unconditional_action | configuration_status_2_0;
      break;
    case reg::stream_configuration:
      value &= extended_block_ids;
      break;
    case reg::link_configuration:
    case reg::channel_configuration:
      if (value != 0) return Status::invalid_parameter;  // single link; no multi-part, no multi-zone
      break;
    case reg::timestamp_control:
      if (value & 1) camera_.reset_timestamp();
      if (value & 2) {
        const std::uint64_t time = camera_.timestamp_ns();
        set_word(reg::timestamp_high, static_cast<std::uint32_t>(time >> 32));
        set_word(reg::timestamp_low, static_cast<std::uint32_t>(time));
      }
      return Status::success;
    case reg::packet_size: {
      const std::uint32_t bytes = value & 0xffff;
      if (bytes < smallest_packet || bytes > std::min(largest_packet, interface_.mtu) || bytes % 4 != 0 ||
          (value & 0x3fff0000u) != 0)
        return Status::invalid_parameter;
      const bool fire = (value & fire_test_packet) != 0;
      set_word(address, value & ~fire_test_packet);
      device_.stream_configured(stream());
      if (fire) device_.send_test_packet(stream());
      return Status::success;
    }
    case reg::stream_port:
    case reg::message_port:
      if (channel_zero(value) != 0) return Status::invalid_parameter;  // one network interface, number 0
      break;
    case reg::stream_address:
      // 0.0.0.0 and broadcast are nobody's address; a group (224.0.0.0/4) is served.
      if (value == 0 || value == 0xffffffffu) return Status::invalid_parameter;
      break;
    case reg::fault_loss_ppm:
    case reg::fault_reorder_ppm:
    case reg::fault_duplicate_ppm:
    case reg::fault_delay_ppm:
    case reg::fault_drop_frames_ppm:
      if (value > 1000000) return Status::invalid_parameter;
      break;
    case reg::fault_burst:
      if (value < 1 || value > 10000) return Status::invalid_parameter;
      break;
    case reg::fault_delay_us:
      if (value > 10000000) return Status::invalid_parameter;
      break;
    default:
      break;
  }
  set_word(address, value);
  if (address >= reg::user_name && address < reg::discovery_end) {
    registers_[reg::discovery_end - 1] = 0;
    camera_.set_user_name(reinterpret_cast<const char*>(&registers_[reg::user_name]));
  }
  if (address == reg::stream_port && stream_before.destination.port != 0 && (value & 0xffff) == 0)
    camera_.stop_acquisition();
  if (!(stream() == stream_before)) device_.stream_configured(stream());
  if (address >= reg::fault_loss_ppm && address <= reg::fault_seed) device_.faults_configured(faults());
  if (address >= reg::message_port && address <= reg::message_retries)
    device_.messages_configured(messages());
  return Status::success;
}

Status Control::write_privilege(std::uint32_t value, Endpoint from, std::uint64_t now_ns) {
  const std::uint32_t wanted = value & (privilege_exclusive | privilege_control | privilege_switchover);
  if (controller_ && *controller_ != from) {
    const bool offered = (word(reg::control_privilege) & privilege_switchover) != 0;
    const bool keyed = value >> 16 == (word(reg::switchover_key) & 0xffff);
    if (!offered || !keyed || (wanted & (privilege_exclusive | privilege_control)) == 0)
      return Status::access_denied;
  }
  if ((wanted & (privilege_exclusive | privilege_control)) == 0) {
    if (controller_) release();
    return Status::success;
  }
  controller_ = from;
  heard_ns_ = now_ns;
  set_word(reg::control_privilege, wanted);
  set_word(reg::primary_port, from.port);
  set_word(reg::primary_ip, from.address);
  return Status::success;
}

void Control::check_heartbeat(std::uint64_t now_ns) {
  if (!controller_ || (word(reg::control_configuration) & configuration_heartbeat_off) != 0) return;
  if (now_ns > heard_ns_ && now_ns - heard_ns_ > std::uint64_t{word(reg::heartbeat)} * 1000000) release();
}

void Control::release() {
  controller_.reset();
  for (const std::uint32_t address :
       {reg::control_privilege, reg::primary_port, reg::primary_ip, reg::stream_port, reg::message_port})
    set_word(address, 0);
  camera_.stop_acquisition();
  device_.stream_configured(stream());
  device_.messages_configured(messages());
}

}  // namespace atomcam::gige
