#include "gige/message_channel.hpp"

namespace atomcam::gige {

namespace {
constexpr std::size_t most_waiting = 64;
constexpr std::uint16_t no_stream = 0xffff;
}  // namespace

void MessageSender::configure(const MessageChannel& channel) {
  if (channel.destination != channel_.destination || !channel.open()) waiting_.clear();
  channel_ = channel;
}

void MessageSender::queue(int event_id, std::uint64_t timestamp_ns, Time now, ControlHandler::Answers& out) {
  if (!channel_.open() || waiting_.size() >= most_waiting) return;
  if (++last_id_ == 0) last_id_ = 1;
  const bool acknowledge = channel_.timeout_ms != 0;
  Message message;
  message.id = last_id_;
  std::vector<std::uint8_t>& bytes = message.datagram;
  bytes.push_back(gvcp_key);
  bytes.push_back(static_cast<std::uint8_t>((acknowledge ? flag::acknowledge : 0) |
                                            (channel_.extended_ids ? flag::extended_ids : 0)));
  append16(bytes, static_cast<std::uint16_t>(Command::event));
  append16(bytes, channel_.extended_ids ? 24 : 16);
  append16(bytes, message.id);
  append16(bytes, 0);
  append16(bytes, static_cast<std::uint16_t>(event_id));
  append16(bytes, no_stream);
  append16(bytes, 0);  // no block
  if (channel_.extended_ids) append64(bytes, 0);
  append64(bytes, timestamp_ns);
  if (!acknowledge) {
    out.push_back({channel_.destination, std::move(bytes)});
    return;
  }
  waiting_.push_back(std::move(message));
  if (waiting_.size() == 1) send_front(now, out);
}

void MessageSender::send_front(Time now, ControlHandler::Answers& out) {
  Message& message = waiting_.front();
  ++message.sent;
  message.again = now + std::chrono::milliseconds(channel_.timeout_ms);
  out.push_back({channel_.destination, message.datagram});
}

void MessageSender::receive(Bytes datagram, Time now, ControlHandler::Answers& out) {
  constexpr std::uint16_t event_acknowledge = static_cast<std::uint16_t>(Command::event) + 1;
  if (waiting_.empty() || datagram.size() < gvcp_header_bytes) return;
  if (load16(datagram, 2) != event_acknowledge || load16(datagram, 6) != waiting_.front().id) return;
  waiting_.pop_front();
  if (!waiting_.empty()) send_front(now, out);
}

void MessageSender::tick(Time now, ControlHandler::Answers& out) {
  if (waiting_.empty() || now < waiting_.front().again) return;
  if (waiting_.front().sent > channel_.retries) {
    waiting_.pop_front();
    if (waiting_.empty()) return;
  }
  send_front(now, out);
}

std::optional<Time> MessageSender::next_deadline() const {
  if (waiting_.empty()) return std::nullopt;
  return waiting_.front().again;
}

}  // namespace atomcam::gige
