#pragma once
// Events on their way to the client: sent at once, or one at a time until acknowledged where the client wants
// to acknowledge them.

#include <deque>
#include <optional>

#include "gige/control_handler.hpp"

namespace atomcam::gige {

class MessageSender {
 public:
  void configure(const MessageChannel& channel);
  void queue(int event_id, std::uint64_t timestamp_ns, Time now, ControlHandler::Answers& out);
  /// An acknowledge came in on the channel's socket.
  void receive(Bytes datagram, Time now, ControlHandler::Answers& out);
  void tick(Time now, ControlHandler::Answers& out);
  std::optional<Time> next_deadline() const;

 private:
  struct Message {
    std::uint16_t id = 0;
    std::vector<std::uint8_t> datagram;
    std::uint32_t sent = 0;
    Time again{};
  };
  void send_front(Time now, ControlHandler::Answers& out);

  MessageChannel channel_;
  std::deque<Message> waiting_;  // the first is under way
  std::uint16_t last_id_ = 0;
};

}  // namespace atomcam::gige
