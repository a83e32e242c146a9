#pragma once
// When the next batch of packets is due. A frame's packets are spread over a part of the frame period on an
// absolute schedule; a sender that has fallen behind catches up, but never in one burst.

#include <algorithm>
#include <cstdint>

#include "gige/gvsp.hpp"

namespace atomcam::gige {

class Pacer {
 public:
  /// `share`: part of the frame period that a frame's packets take; 0 sends without pauses.
  explicit Pacer(double share) : share_(share) {}

  /// A frame of `bytes` begins now; `period_ns` between frames, 0 if unknown; `backlog` more frames wait.
  void begin_frame(Time now, std::size_t bytes, std::uint64_t period_ns, std::size_t backlog,
                   std::uint64_t delay_ns) {
    // Nothing is gained by spreading a frame over longer than this, and the client would wait for it.
    constexpr double longest_ns = 20e6, slowest_bytes_per_ns = 0.25;
    const double size = static_cast<double>(std::max<std::size_t>(bytes, 1));
    double duration = std::max(longest_ns, size / slowest_bytes_per_ns);
    if (period_ns != 0) duration = std::min(duration, share_ * static_cast<double>(period_ns));
    if (share_ == 0) duration = 0;
    constexpr double haste = 0.8;
    ns_per_byte_ = duration / size * (backlog > 0 ? haste : 1);
    delay_ns_ = delay_ns;
    slot_ = std::max(slot_, now);
  }

  /// Packets that may go in one batch: single ones where the delay between packets is long.
  std::size_t packets_at_once() const {
    constexpr std::uint64_t batch_ns = 100'000;
    return delay_ns_ == 0 ? 64 : std::clamp<std::uint64_t>(batch_ns / delay_ns_, 1, 64);
  }

  Time due(bool resend) const { return resend ? next_ : std::max(slot_, next_); }

  void sent(Time now, std::size_t packets, std::size_t bytes, bool resend) {
    const double ns = std::max(static_cast<double>(bytes) * ns_per_byte_,
                               static_cast<double>(packets) * static_cast<double>(delay_ns_));
    // A client that asks for packets again is at its limit: more haste would make it lose more.
    constexpr double catch_up = 0.7, careful_catch_up = 0.95;
    constexpr auto memory = std::chrono::milliseconds(100);
    if (resend) last_resend_ = now;
    const double least = now - last_resend_ < memory ? careful_catch_up : catch_up;
    // The delay between packets is a floor that no catching up may break.
    next_ = now + nanoseconds(std::max(least * ns, static_cast<double>(packets * delay_ns_)));
    if (resend) return;
    constexpr auto most_debt = std::chrono::milliseconds(20);
    slot_ = std::max(slot_ + nanoseconds(ns), now - most_debt);
  }

 private:
  static std::chrono::nanoseconds nanoseconds(double value) {
    return std::chrono::nanoseconds(static_cast<std::int64_t>(value));
  }

  double share_;
  double ns_per_byte_ = 0;
  std::uint64_t delay_ns_ = 0;
  Time slot_{}, next_{}, last_resend_{};
};

}  // namespace atomcam::gige
