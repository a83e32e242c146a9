#include "gige/control_handler.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "gige/udp_socket.hpp"

namespace atomcam::gige {

namespace {

using namespace std::chrono_literals;

constexpr std::uint32_t xml_address = 0x100000;
constexpr std::size_t url_bytes = 512;
constexpr std::size_t user_name_bytes = 16;
constexpr std::size_t commands_waiting = 16;
constexpr auto repeat_window = 1s;
// A client told to wait longer than this is told so.
constexpr auto patience = 20ms;
constexpr std::uint16_t pending_ms = 1000;
// AcquisitionStop takes effect a moment after its acknowledge; registers stay locked until then.
constexpr auto stop_patience = 50ms;
constexpr double million = 1e6;

constexpr std::uint32_t gvcp_capabilities = 1u << 0      // concatenation
                                            | 1u << 1    // WRITEMEM
                                            | 1u << 2    // PACKETRESEND
                                            | 1u << 3    // EVENT
                                            | 1u << 5    // PENDING_ACK
                                            | 1u << 6    // ACTION
                                            | 1u << 18   // status codes of version 2.0
                                            | 1u << 20   // unconditional ACTION
                                            | 1u << 21   // switchover
                                            | 1u << 22   // status codes of version 1.1
                                            | 1u << 27   // port and address of the controller
                                            | 1u << 28   // link speed
                                            | 1u << 29   // heartbeat can be disabled
                                            | 1u << 30   // serial number
                                            | 1u << 31;  // user name
constexpr std::uint32_t gvcp_settings =
    bit::heartbeat_disable | bit::pending_ack | bit::status_1_1 | bit::unconditional_action | bit::status_2_0;

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
  return Status::error;
}

constexpr std::uint32_t per_million(double share) {
  return static_cast<std::uint32_t>(share * million + 0.5);
}

bool is(const CommandHeader& header, Command command) {
  return header.command == static_cast<std::uint16_t>(command);
}

bool same(Bytes one, Bytes other) {
  return std::equal(one.begin(), one.end(), other.begin(), other.end());
}

bool in_camera(std::uint32_t address) {
  return address >= TransportCamera::first_address && address < xml_address;
}

}  // namespace

ControlHandler::ControlHandler(TransportCamera& camera, ControlActions& actions, DeviceFacts facts)
    : camera_(camera), actions_(actions), facts_(std::move(facts)), faults_(facts_.faults) {
  const TransportCamera::Identity identity = camera_.identity();
  const std::size_t xml_bytes = facts_.xml.size();
  facts_.xml.resize((xml_bytes + 3) / 4 * 4, '\0');  // clients read whole words

  BootstrapRegisters& r = registers_;
  constexpr bool readable = true, writable = true, write_only = false;
  r.declare(reg::version, 0x00020000);
  r.declare(reg::device_mode, 0x80000001);  // big endian, transmitter, single link, UTF-8
  r.declare(reg::mac_high, static_cast<std::uint32_t>(facts_.mac >> 32));
  r.declare(reg::mac_low, static_cast<std::uint32_t>(facts_.mac));
  r.declare(reg::ip_capability, 7);  // link-local, DHCP, persistent
  r.declare(reg::ip_configuration, 5, readable, writable);
  r.declare(reg::current_ip, facts_.address);
  r.declare(reg::subnet_mask, facts_.mask);
  r.declare(reg::gateway, 0);
  r.declare_string(reg::manufacturer, 32, identity.vendor);
  r.declare_string(reg::model, 32, identity.model);
  r.declare_string(reg::device_version, 32, identity.version);
  r.declare_string(reg::manufacturer_info, 48, identity.info);
  r.declare_string(reg::serial_number, 16, identity.serial);
  for (std::uint32_t at = 0; at < user_name_bytes; at += 4)
    r.declare(reg::user_name + at, 0, readable, writable);
  r.set_string(reg::user_name, user_name_bytes, identity.user_name);
  r.declare_string(reg::first_url, url_bytes,
                   fmt::format("Local:{};{:x};{:x}", facts_.xml_name, xml_address, xml_bytes));
  r.declare_string(reg::second_url, url_bytes, "");
  r.declare(reg::interfaces, 1);
  r.declare(reg::persistent_ip, facts_.address, readable, writable);
  r.declare(reg::persistent_mask, facts_.mask, readable, writable);
  r.declare(reg::persistent_gateway, 0, readable, writable);
  r.declare(reg::link_speed, facts_.link_mbps);
  r.declare(reg::message_channels, 1);
  r.declare(reg::stream_channels, 1);
  r.declare(reg::action_signals, action_signals);
  r.declare(reg::action_device_key, 0, write_only, writable);
  r.declare(reg::active_links, 1);
  r.declare(reg::gvsp_capability, 1u << 31 | 1u << 30);  // source port told, 16-bit block ids served
  r.declare(reg::message_capability, 1u << 31);          // source port told
  r.declare(reg::gvcp_capability, gvcp_capabilities);
  r.declare(reg::heartbeat_timeout, 3000, readable, writable);
  r.declare(reg::tick_frequency_high, 0);
  r.declare(reg::tick_frequency_low, 1'000'000'000);
  r.declare(reg::timestamp_control, 0, write_only, writable);
  r.declare(reg::timestamp_high, 0);
  r.declare(reg::timestamp_low, 0);
  r.declare(reg::gvcp_configuration, 0, readable, writable);
  r.declare(reg::pending_timeout, pending_ms);
  r.declare(reg::switchover_key, 0, write_only, writable);
  r.declare(reg::gvsp_configuration, 0, readable, writable);
  r.declare(reg::link_capability, 1);  // single link
  r.declare(reg::link_configuration, 0, readable, writable);
  r.declare(reg::control, 0, readable, writable);
  r.declare(reg::controller_port, 0);
  r.declare(reg::controller_ip, 0);
  r.declare(reg::message_port, 0, readable, writable);
  r.declare(reg::message_address, 0, readable, writable);
  r.declare(reg::message_timeout, 0, readable, writable);
  r.declare(reg::message_retries, 0, readable, writable);
  r.declare(reg::message_source_port, facts_.message_source_port);
  r.declare(reg::stream_port, 0, readable, writable);
  r.declare(reg::stream_packet_size, facts_.packet_bytes, readable, writable);
  r.declare(reg::stream_delay, 0, readable, writable);
  r.declare(reg::stream_address, 0, readable, writable);
  r.declare(reg::stream_source_port, facts_.stream_source_port);
  r.declare(reg::stream_capability, 0);
  r.declare(reg::stream_configuration, 0, readable, writable);
  for (std::uint32_t signal = 0; signal < action_signals; ++signal) {
    r.declare(reg::action_group_key + 16 * signal, 0, readable, writable);
    r.declare(reg::action_group_mask + 16 * signal, 0, readable, writable);
  }
  r.declare(reg::fault_loss, per_million(faults_.packet_loss), readable, writable);
  r.declare(reg::fault_burst, faults_.burst, readable, writable);
  r.declare(reg::fault_reorder, per_million(faults_.reorder), readable, writable);
  r.declare(reg::fault_duplicate, per_million(faults_.duplicate), readable, writable);
  r.declare(reg::fault_delayed_frames, per_million(faults_.frame_delay), readable, writable);
  r.declare(reg::fault_delay_us, faults_.frame_delay_us, readable, writable);
  r.declare(reg::fault_dropped_frames, per_million(faults_.frame_drop), readable, writable);
  r.declare(reg::fault_seed, static_cast<std::uint32_t>(faults_.seed), readable, writable);
  r.declare(reg::resend_requests, 0);
  r.declare(reg::resent_packets, 0);
  r.declare(reg::unavailable_packets, 0);
  r.declare(reg::dropped_frames, 0);
}

// Datagrams

void ControlHandler::receive(Bytes datagram, Endpoint from, Time now, Answers& out) {
  if (datagram.size() < gvcp_header_bytes || datagram[0] != gvcp_key) return;
  const CommandHeader header{datagram[1], load16(datagram, 2), load16(datagram, 4), load16(datagram, 6)};
  // Odd codes are acknowledges; nothing here waits for one.
  if (header.command % 2 != 0) return;
  if (header.id == 0 || header.length != datagram.size() - gvcp_header_bytes)
    return acknowledge(header, from, Status::invalid_header, {}, out);
  if (controller_ == from) last_heard_ = now;

  if (job_ && job_->from == from && same(job_->datagram, datagram)) return;  // repeated while under way
  if (job_ && needs_camera(header, datagram.subspan(gvcp_header_bytes))) {
    for (const Waiting& other : waiting_)
      if (other.from == from && same(other.datagram, datagram)) return;
    if (waiting_.size() >= commands_waiting) return acknowledge(header, from, Status::busy, {}, out);
    waiting_.push_back({from, {datagram.begin(), datagram.end()}});
    return;
  }
  dispatch(datagram, header, from, now, out);
}

void ControlHandler::dispatch(Bytes datagram, const CommandHeader& header, Endpoint from, Time now,
                              Answers& out) {
  const Bytes payload = datagram.subspan(gvcp_header_bytes);
  switch (static_cast<Command>(header.command)) {
    case Command::discovery:
      return discovery(header, from, out);
    case Command::force_ip:
      return force_ip(payload, header, from, out);
    case Command::packet_resend:
      return packet_resend(payload, header, from);
    case Command::read_register:
      return read_register(payload, header, from, out);
    case Command::read_memory:
      return read_memory(payload, header, from, out);
    case Command::write_register:
    case Command::write_memory:
      return write_command(datagram, header, from, now, out);
    case Command::action:
      return action(payload, header, from, out);
    case Command::pending:
    case Command::event:
      break;
  }
  acknowledge(header, from, Status::not_implemented, {}, out);
}

void ControlHandler::acknowledge(const CommandHeader& header, Endpoint to, Status status, Bytes payload,
                                 Answers& out) {
  if (!header.wants_acknowledge()) return;
  Outgoing answer{to, {}};
  answer.bytes.reserve(gvcp_header_bytes + payload.size());
  append16(answer.bytes, static_cast<std::uint16_t>(status));
  append16(answer.bytes, static_cast<std::uint16_t>(header.command + 1));
  append16(answer.bytes, static_cast<std::uint16_t>(payload.size()));
  append16(answer.bytes, header.id);
  answer.bytes.insert(answer.bytes.end(), payload.begin(), payload.end());
  out.push_back(std::move(answer));
}

void ControlHandler::discovery(const CommandHeader& header, Endpoint from, Answers& out) {
  refresh(reg::user_name, user_name_bytes);
  std::vector<std::uint8_t> identity;
  registers_.read(0, reg::discovery_end, identity);
  acknowledge(header, from, Status::success, identity, out);
}

// Names by MAC a device whose address its sender cannot reach. Addresses of this host are not ours to change:
// what is granted is the address that the device has already, or "configure yourself anew" (0.0.0.0), which
// ends there too.
void ControlHandler::force_ip(Bytes payload, const CommandHeader& header, Endpoint from, Answers& out) {
  constexpr std::size_t length = 56;
  if (payload.size() != length) return acknowledge(header, from, Status::invalid_header, {}, out);
  const std::uint64_t mac = std::uint64_t{load16(payload, 2)} << 32 | load32(payload, 4);
  if (mac != facts_.mac) return;  // meant for another device
  if (controller_) return acknowledge(header, from, Status::access_denied, {}, out);
  const std::uint32_t address = load32(payload, 20);
  const bool kept = address == 0 || address == facts_.address;
  acknowledge(header, from, kept ? Status::success : Status::invalid_parameter, {}, out);
}

// Comes from the client's stream socket, whose port differs from that of its control socket.
void ControlHandler::packet_resend(Bytes payload, const CommandHeader& header, Endpoint from) {
  const bool wide = (header.flags & flag::extended_ids) != 0;
  if (payload.size() != (wide ? 20u : 12u) || load16(payload, 0) != 0) return;
  const std::uint32_t destination = registers_.value(reg::stream_address);
  if (!controller_ || (from.address != controller_->address && from.address != destination)) return;
  ResendRequest request;
  request.extended_ids = wide;
  request.block = wide ? load64(payload, 12) : load16(payload, 2);
  request.first = load32(payload, 4);
  request.last = load32(payload, 8);
  if (!wide) {
    request.first &= 0xffffff;
    request.last &= 0xffffff;
  }
  if (request.first <= request.last) actions_.resend(request);
}

// Reading

bool ControlHandler::may_read(Endpoint from, std::uint32_t address) const {
  if ((registers_.value(reg::control) & bit::exclusive) == 0 || controller_ == from) return true;
  // Others see whether the device is free, and who holds it.
  return address == reg::control || address == reg::controller_port || address == reg::controller_ip;
}

bool ControlHandler::touches_text(std::uint32_t address, std::size_t bytes) const {
  return address < reg::user_name + user_name_bytes && address + bytes > reg::user_name;
}

/// Brings registers up to date that change by themselves. While a command is under way in the camera its name
/// is not asked for: discovery does not wait.
void ControlHandler::refresh(std::uint32_t address, std::size_t bytes) {
  if (touches_text(address, bytes) && !job_)
    registers_.set_string(reg::user_name, user_name_bytes, camera_.identity().user_name);
  if (address < reg::dropped_frames + 4 && address + bytes > reg::resend_requests) {
    const ControlActions::Counters counters = actions_.counters();
    registers_.set(reg::resend_requests, static_cast<std::uint32_t>(counters.resend_requests));
    registers_.set(reg::resent_packets, static_cast<std::uint32_t>(counters.resent_packets));
    registers_.set(reg::unavailable_packets, static_cast<std::uint32_t>(counters.unavailable_packets));
    registers_.set(reg::dropped_frames, static_cast<std::uint32_t>(counters.dropped_frames));
  }
}

Status ControlHandler::read_bytes(std::uint32_t address, std::size_t bytes, std::vector<std::uint8_t>& out) {
  if (address < reg::end) {
    refresh(address, bytes);
    return registers_.read(address, bytes, out);
  }
  if (in_camera(address)) {
    std::vector<std::uint8_t> values(bytes);
    const Status status = status_of(camera_.read(address, values));
    if (status == Status::success) out.insert(out.end(), values.begin(), values.end());
    return status;
  }
  const std::size_t at = address - xml_address;
  if (at > facts_.xml.size() || bytes > facts_.xml.size() - at) return Status::invalid_address;
  const auto first = facts_.xml.begin() + static_cast<std::ptrdiff_t>(at);
  out.insert(out.end(), first, first + static_cast<std::ptrdiff_t>(bytes));
  return Status::success;
}

Status ControlHandler::read_word(std::uint32_t address, std::uint32_t& value) {
  if (address % 4 != 0) return Status::bad_alignment;
  if (address < reg::end) {
    refresh(address, 4);
    return registers_.read(address, value);
  }
  std::vector<std::uint8_t> bytes;
  const Status status = read_bytes(address, 4, bytes);
  if (status == Status::success) value = load32(bytes, 0);
  return status;
}

void ControlHandler::read_register(Bytes payload, const CommandHeader& header, Endpoint from, Answers& out) {
  const std::size_t count = payload.size() / 4;
  if (payload.size() % 4 != 0 || count == 0 || count > read_registers)
    return acknowledge(header, from, Status::invalid_header, {}, out);
  std::vector<std::uint8_t> values;
  for (std::size_t i = 0; i < count; ++i) {
    const std::uint32_t address = load32(payload, 4 * i);
    std::uint32_t value = 0;
    const Status status = may_read(from, address) ? read_word(address, value) : Status::access_denied;
    // The values before the one that failed.
    if (status != Status::success) return acknowledge(header, from, status, values, out);
    append32(values, value);
  }
  acknowledge(header, from, Status::success, values, out);
}

void ControlHandler::read_memory(Bytes payload, const CommandHeader& header, Endpoint from, Answers& out) {
  if (payload.size() != 8) return acknowledge(header, from, Status::invalid_header, {}, out);
  const std::uint32_t address = load32(payload, 0);
  const std::size_t count = load16(payload, 6);
  std::vector<std::uint8_t> answer;
  append32(answer, address);
  Status status = Status::success;
  if (!may_read(from, address) || (count > 4 && !may_read(from, reg::version)))
    status = Status::access_denied;
  else if (address % 4 != 0 || count % 4 != 0)
    status = Status::bad_alignment;
  else if (count == 0 || count > memory_bytes)
    status = Status::invalid_parameter;
  else
    status = read_bytes(address, count, answer);
  if (status != Status::success) answer.clear();
  acknowledge(header, from, status, answer, out);
}

// Writing

bool ControlHandler::needs_camera(const CommandHeader& header, Bytes payload) const {
  if (is(header, Command::write_register) || is(header, Command::write_memory)) return true;
  if (is(header, Command::read_memory)) return payload.size() >= 4 && in_camera(load32(payload, 0));
  if (!is(header, Command::read_register)) return false;
  for (std::size_t at = 0; at + 4 <= payload.size(); at += 4)
    if (in_camera(load32(payload, at))) return true;
  return false;
}

void ControlHandler::write_command(Bytes datagram, const CommandHeader& header, Endpoint from, Time now,
                                   Answers& out) {
  if (completed_ && completed_->from == from && now - completed_->at < repeat_window &&
      same(completed_->datagram, datagram)) {
    if (!completed_->answer.empty()) out.push_back({from, completed_->answer});
    return;
  }
  const Bytes payload = datagram.subspan(gvcp_header_bytes);
  Job job;
  job.from = from;
  job.header = header;
  job.since = now;
  job.next_pending = now + patience;
  if (is(header, Command::write_register)) {
    const std::size_t count = payload.size() / 8;
    if (payload.size() % 8 != 0 || count == 0 || count > write_registers)
      return acknowledge(header, from, Status::invalid_header, {}, out);
    for (std::size_t i = 0; i < count; ++i)
      job.steps.push_back({load32(payload, 8 * i), gvcp_header_bytes + 8 * i + 4, 4});
    job.index_on_success = static_cast<std::uint16_t>(count);
  } else {
    if (payload.size() < 4) return acknowledge(header, from, Status::invalid_header, {}, out);
    const std::uint32_t address = load32(payload, 0);
    const std::size_t bytes = payload.size() - 4;
    Status status = Status::success;
    if (bytes == 0 || bytes > memory_bytes)
      status = Status::invalid_parameter;
    else if (bytes % 4 != 0)
      status = Status::bad_alignment;
    if (status != Status::success) {
      const std::uint8_t nothing[4] = {};
      return acknowledge(header, from, status, nothing, out);
    }
    // Into the camera, the string or the XML as a whole; into other bootstrap registers word by word.
    const bool whole = address >= reg::end || address % 4 != 0 ||
                       (address >= reg::user_name && address + bytes <= reg::user_name + user_name_bytes);
    if (whole)
      job.steps.push_back({address, gvcp_header_bytes + 4, bytes});
    else
      for (std::size_t at = 0; at < bytes; at += 4)
        job.steps.push_back({address + static_cast<std::uint32_t>(at), gvcp_header_bytes + 4 + at, 4});
    job.index_on_success = static_cast<std::uint16_t>(bytes);
  }
  job.datagram.assign(datagram.begin(), datagram.end());
  job_ = std::move(job);
  proceed(now, out);
}

/// Registers that a stream under way depends on.
bool ControlHandler::locked(const Step& step, Bytes datagram) const {
  switch (step.address) {
    case reg::stream_packet_size:
    case reg::stream_address:
    case reg::stream_configuration:
    case reg::gvsp_configuration:
      return actions_.acquiring();
    case reg::stream_port:  // closing is always granted
      return actions_.acquiring() && (load32(datagram, step.at) & 0xffff) != 0;
    default:
      return false;
  }
}

void ControlHandler::proceed(Time now, Answers& out) {
  while (job_ && job_->done < job_->steps.size()) {
    Job& job = *job_;
    const Step& step = job.steps[job.done];
    const Bytes bytes = Bytes(job.datagram).subspan(step.at, step.bytes);
    if (step.address % 4 != 0) return finish(Status::bad_alignment, now, out);
    if (controller_ != job.from && step.address != reg::control)
      return finish(Status::access_denied, now, out);
    if (step.address >= xml_address) {
      const bool hit = step.address - xml_address < facts_.xml.size();
      return finish(hit ? Status::write_protect : Status::invalid_address, now, out);
    }
    if (step.address >= reg::end) {
      job.wait = Job::Wait::camera;
      camera_write_ = CameraWrite{step.address, {bytes.begin(), bytes.end()}};
      return;
    }
    if (!registers_.writable(step.address))
      return finish(registers_.readable(step.address) ? Status::write_protect : Status::invalid_address, now,
                    out);
    if (locked(step, job.datagram)) {
      if (now - job.since >= stop_patience) return finish(Status::access_denied, now, out);
      job.wait = Job::Wait::stop;
      job.next_look = now + 1ms;
      return;
    }
    job.wait = Job::Wait::none;
    Status status = Status::success;
    if (touches_text(step.address, step.bytes)) {
      for (std::size_t at = 0; at < step.bytes; at += 4)
        registers_.set(step.address + static_cast<std::uint32_t>(at), load32(bytes, at));
      std::vector<std::uint8_t> text;
      registers_.read(reg::user_name, user_name_bytes, text);
      camera_.set_user_name({text.begin(), std::find(text.begin(), text.end(), 0)});
    } else {
      status = write_bootstrap(step.address, load32(bytes, 0), job.from, now);
    }
    if (status != Status::success) return finish(status, now, out);
    ++job.done;
  }
  if (job_) finish(Status::success, now, out);
}

void ControlHandler::finish(Status status, Time now, Answers& out) {
  const Job job = std::move(*job_);
  job_.reset();
  if (controller_ == job.from) last_heard_ = now;
  std::uint16_t index = job.index_on_success;
  if (status != Status::success) {
    // WRITEREG tells which register, WRITEMEM which byte.
    index = static_cast<std::uint16_t>(
        is(job.header, Command::write_register) ? job.done : job.steps[job.done].at - gvcp_header_bytes - 4);
  }
  std::uint8_t payload[4] = {};
  store16(payload + 2, index);
  const std::size_t before = out.size();
  acknowledge(job.header, job.from, status, payload, out);
  completed_ = Completed{job.from, job.datagram, {}, now};
  if (out.size() > before) completed_->answer = out.back().bytes;

  // What waited for the camera, until one of it waits again.
  while (!job_ && !waiting_.empty()) {
    const Waiting next = std::move(waiting_.front());
    waiting_.pop_front();
    const Bytes datagram = next.datagram;
    const CommandHeader header{datagram[1], load16(datagram, 2), load16(datagram, 4), load16(datagram, 6)};
    dispatch(datagram, header, next.from, now, out);
  }
}

std::optional<ControlHandler::CameraWrite> ControlHandler::take_camera_write() {
  std::optional<CameraWrite> write;
  write.swap(camera_write_);
  return write;
}

void ControlHandler::camera_wrote(RegisterStatus status, Time now, Answers& out) {
  if (!job_ || job_->wait != Job::Wait::camera) return;
  if (status != RegisterStatus::ok) return finish(status_of(status), now, out);
  ++job_->done;
  proceed(now, out);
}

Status ControlHandler::write_bootstrap(std::uint32_t address, std::uint32_t value, Endpoint from, Time now) {
  const auto keep = [&](std::uint32_t kept) {
    registers_.set(address, kept);
    return Status::success;
  };
  const auto keep_if = [&](bool allowed) { return allowed ? keep(value) : Status::invalid_parameter; };
  const auto then = [](Status status, auto&& act) {
    if (status == Status::success) act();
    return status;
  };
  const auto stream = [this] { apply_stream(); };
  const auto messages = [this] { apply_messages(); };
  const auto faults = [this] { apply_faults(); };

  if (address >= reg::action_group_key && address < reg::action_group_key + 16 * action_signals)
    return keep(value);
  switch (address) {
    case reg::control:
      return write_control(value, from, now);
    case reg::ip_configuration:
      return keep((value & 7) | 4);  // link-local cannot be switched off
    case reg::persistent_ip:
    case reg::persistent_mask:
    case reg::persistent_gateway:
    case reg::action_device_key:
    case reg::message_timeout:
      return then(keep(value), messages);
    case reg::message_retries:
      return then(keep_if(value <= 255), messages);
    case reg::switchover_key:
      return keep(value & 0xffff);
    case reg::heartbeat_timeout:
      return keep_if(value >= shortest_heartbeat_ms);
    case reg::timestamp_control:
      if ((value & 2) != 0) {
        const std::uint64_t ticks = camera_.timestamp_ns();
        registers_.set(reg::timestamp_high, static_cast<std::uint32_t>(ticks >> 32));
        registers_.set(reg::timestamp_low, static_cast<std::uint32_t>(ticks));
      }
      if ((value & 1) != 0) camera_.reset_timestamp();
      return Status::success;
    case reg::gvcp_configuration:
      return then(keep_if((value & ~gvcp_settings) == 0), stream);
    case reg::gvsp_configuration:
      return then(keep_if((value & ~bit::extended_ids) == 0), [this] {
        apply_stream();
        apply_messages();
      });
    case reg::link_configuration:
    case reg::stream_configuration:
      return keep_if(value == 0);
    case reg::message_port:
      return then(value >> 16 == 0 ? keep(value) : Status::invalid_parameter, messages);
    case reg::message_address:
      return then(write_destination(address, value), messages);
    case reg::stream_port: {
      if ((value >> 16 & 0xf) != 0) return Status::invalid_parameter;  // there is one interface
      const bool closes = (value & 0xffff) == 0 && registers_.value(address) != 0;
      if (closes && actions_.acquiring()) actions_.stop_acquisition();
      return then(keep(value & 0xffff), stream);
    }
    case reg::stream_packet_size:
      return write_packet_size(value);
    case reg::stream_delay:
      return then(keep_if(value <= largest_delay_ns), stream);
    case reg::stream_address:
      return then(write_destination(address, value), stream);
    case reg::fault_loss:
    case reg::fault_reorder:
    case reg::fault_duplicate:
    case reg::fault_delayed_frames:
    case reg::fault_dropped_frames:
      return then(keep_if(value <= per_million(1)), faults);
    case reg::fault_burst:
      return then(keep_if(value >= 1 && value <= 1000), faults);
    case reg::fault_seed:
      return then(keep(value), faults);
    case reg::fault_delay_us:
      return then(keep_if(value <= 10'000'000), faults);
    default:
      return Status::write_protect;
  }
}

Status ControlHandler::write_control(std::uint32_t value, Endpoint from, Time now) {
  const std::uint32_t wanted = value & (bit::exclusive | bit::controlling | bit::switchover);
  const bool asks = (wanted & (bit::exclusive | bit::controlling)) != 0;
  if (controller_ && controller_ != from) {
    const std::uint32_t granted = registers_.value(reg::control);
    const bool open = (granted & bit::switchover) != 0 && (granted & bit::exclusive) == 0;
    if (!asks || !open || value >> 16 != registers_.value(reg::switchover_key)) return Status::access_denied;
    constexpr int primary_application_switch = 0x0007;
    actions_.send_message(primary_application_switch);
  } else if (!asks) {
    if (controller_) lose_control();
    return Status::success;
  }
  controller_ = from;
  last_heard_ = now;
  registers_.set(reg::control, wanted);
  registers_.set(reg::controller_port, from.port);
  registers_.set(reg::controller_ip, from.address);
  return Status::success;
}

Status ControlHandler::write_packet_size(std::uint32_t value) {
  const std::uint32_t bytes = (value & 0xffff) / packet_bytes_step * packet_bytes_step;
  if (bytes < facts_.smallest_packet_bytes || bytes > facts_.largest_packet_bytes)
    return Status::invalid_parameter;
  registers_.set(reg::stream_packet_size, (value & bit::do_not_fragment) | bytes);
  apply_stream();
  const bool open = registers_.value(reg::stream_port) != 0 && registers_.value(reg::stream_address) != 0;
  if ((value & bit::fire_test) != 0 && open) actions_.fire_test_packet(bytes);
  return Status::success;
}

Status ControlHandler::write_destination(std::uint32_t address, std::uint32_t value) {
  const bool reserved = value >> 28 == 0xf || (value != 0 && value >> 24 == 0);
  // The kernel sends from a loopback address to the loopback only.
  const bool reachable =
      value == 0 || !is_loopback(facts_.address) || is_loopback(value) || is_multicast(value);
  const bool broadcast = !is_multicast(value) && value != 0 && (value | facts_.mask) == 0xffffffffu &&
                         (value & facts_.mask) == (facts_.address & facts_.mask);
  if (reserved || broadcast || !reachable) return Status::invalid_parameter;
  registers_.set(address, value);
  return Status::success;
}

void ControlHandler::lose_control() {
  controller_.reset();
  registers_.set(reg::control, 0);
  registers_.set(reg::controller_port, 0);
  registers_.set(reg::controller_ip, 0);
  registers_.set(reg::stream_port, 0);
  registers_.set(reg::message_port, 0);
  apply_stream();
  apply_messages();
  actions_.stop_acquisition();
}

void ControlHandler::apply_stream() {
  StreamSettings settings;
  settings.destination = {registers_.value(reg::stream_address),
                          static_cast<std::uint16_t>(registers_.value(reg::stream_port))};
  const std::uint32_t size = registers_.value(reg::stream_packet_size);
  settings.packet_bytes = size & 0xffff;
  settings.do_not_fragment = (size & bit::do_not_fragment) != 0;
  settings.delay_ns = registers_.value(reg::stream_delay);
  settings.extended_ids = (registers_.value(reg::gvsp_configuration) & bit::extended_ids) != 0;
  const std::uint32_t configuration = registers_.value(reg::gvcp_configuration);
  settings.status_1_1 = (configuration & bit::status_1_1) != 0;
  settings.status_2_0 = (configuration & bit::status_2_0) != 0;
  actions_.configure_stream(settings);
}

void ControlHandler::apply_messages() {
  MessageChannel channel;
  channel.destination = {registers_.value(reg::message_address),
                         static_cast<std::uint16_t>(registers_.value(reg::message_port))};
  channel.timeout_ms = registers_.value(reg::message_timeout);
  channel.retries = registers_.value(reg::message_retries);
  channel.extended_ids = (registers_.value(reg::gvsp_configuration) & bit::extended_ids) != 0;
  actions_.configure_messages(channel);
}

void ControlHandler::apply_faults() {
  const auto share = [this](std::uint32_t address) { return registers_.value(address) / million; };
  faults_.packet_loss = share(reg::fault_loss);
  faults_.burst = registers_.value(reg::fault_burst);
  faults_.reorder = share(reg::fault_reorder);
  faults_.duplicate = share(reg::fault_duplicate);
  faults_.frame_delay = share(reg::fault_delayed_frames);
  faults_.frame_delay_us = registers_.value(reg::fault_delay_us);
  faults_.frame_drop = share(reg::fault_dropped_frames);
  faults_.seed = registers_.value(reg::fault_seed);
  actions_.inject_faults(faults_);
}

// Actions: answered only where one was carried out. There is no synchronised clock to schedule them on.
void ControlHandler::action(Bytes payload, const CommandHeader& header, Endpoint from, Answers& out) {
  const bool scheduled = (header.flags & flag::scheduled) != 0;
  if (payload.size() != (scheduled ? 20u : 12u))
    return acknowledge(header, from, Status::invalid_header, {}, out);
  if (load32(payload, 0) != registers_.value(reg::action_device_key)) return;
  const bool unconditional = (registers_.value(reg::gvcp_configuration) & bit::unconditional_action) != 0;
  if (!controller_ && !unconditional) return;
  bool done = false;
  for (std::uint32_t signal = 0; signal < action_signals; ++signal) {
    if (load32(payload, 4) != registers_.value(reg::action_group_key + 16 * signal)) continue;
    if ((load32(payload, 8) & registers_.value(reg::action_group_mask + 16 * signal)) == 0) continue;
    if (!scheduled) camera_.fire_action(static_cast<int>(signal));
    done = true;
  }
  if (done) acknowledge(header, from, scheduled ? Status::not_implemented : Status::success, {}, out);
}

// Time

void ControlHandler::tick(Time now, Answers& out) {
  if (job_ && job_->wait == Job::Wait::stop) proceed(now, out);
  if (job_ && (registers_.value(reg::gvcp_configuration) & bit::pending_ack) != 0 &&
      now >= job_->next_pending) {
    std::uint8_t payload[4] = {};
    store16(payload + 2, pending_ms);
    CommandHeader header = job_->header;
    header.command = static_cast<std::uint16_t>(Command::pending);
    acknowledge(header, job_->from, Status::success, payload, out);
    job_->next_pending = now + std::chrono::milliseconds(pending_ms) / 2;
  }
  if (job_ || !controller_) return;
  if ((registers_.value(reg::gvcp_configuration) & bit::heartbeat_disable) != 0) return;
  if (now - last_heard_ >= std::chrono::milliseconds(registers_.value(reg::heartbeat_timeout)))
    lose_control();
}

std::optional<Time> ControlHandler::next_deadline() const {
  if (job_) {
    if (job_->wait == Job::Wait::stop) return job_->next_look;
    if ((registers_.value(reg::gvcp_configuration) & bit::pending_ack) != 0) return job_->next_pending;
    return std::nullopt;
  }
  if (!controller_ || (registers_.value(reg::gvcp_configuration) & bit::heartbeat_disable) != 0)
    return std::nullopt;
  return last_heard_ + std::chrono::milliseconds(registers_.value(reg::heartbeat_timeout));
}

}  // namespace atomcam::gige
