#pragma once
// Datagrams near the protocol: valid commands with fields that matter, then bent.

#include <vector>

#include "base/random.hpp"
#include "gige/bootstrap.hpp"
#include "gige/bytes.hpp"

namespace atomcam::test {

class MutatedCommands {
 public:
  explicit MutatedCommands(std::uint64_t seed) : random_(seed, stream_id("fuzz/gvcp"), 0, 0) {}

  std::uint32_t chance() { return random_(); }

  std::vector<std::uint8_t> next() {
    std::vector<std::uint8_t> bytes{0x42, pick<std::uint8_t>({0x01, 0x01, 0x01, 0x00, 0x11, 0x81, 0xff})};
    const std::uint32_t command =
        pick<std::uint32_t>({0x0002, 0x0004, 0x0040, 0x0080, 0x0080, 0x0082, 0x0082, 0x0082, 0x0084, 0x0084,
                             0x0086, 0x0086, 0x0088, 0x00c0, 0x00c1, 0x0100});
    gige::append16(bytes, command);
    gige::append16(bytes, 0);
    gige::append16(bytes, below(4) == 0 ? below(3) : below(65536));
    switch (command) {
      case 0x0004:
        bytes.resize(64);
        gige::store16(bytes.data() + 10, 0x0200);
        gige::store32(bytes.data() + 12, below(2));
        break;
      case 0x0040:
        for (int i = 0; i < (bytes[1] & 0x10 ? 5 : 3); ++i) gige::append32(bytes, number());
        break;
      case 0x0080:
        for (std::uint32_t n = count(140); n > 0; --n) gige::append32(bytes, address());
        break;
      case 0x0082:
        for (std::uint32_t n = count(70); n > 0; --n) {
          gige::append32(bytes, address());
          gige::append32(bytes, number());
        }
        break;
      case 0x0084:
        gige::append32(bytes, address());
        gige::append32(bytes, below(8) == 0 ? number() : 4 * below(140));
        break;
      case 0x0086:
        gige::append32(bytes, address());
        for (std::uint32_t n = count(140); n > 0; --n) gige::append32(bytes, number());
        break;
      case 0x0100:
        for (int i = 0; i < (bytes[1] & 0x80 ? 5 : 3); ++i)
          gige::append32(bytes, i == 2 ? number() : below(4) / 3);
        break;
      default:
        for (std::uint32_t n = below(8); n > 0; --n) gige::append32(bytes, number());
    }
    if (below(16) != 0) gige::store16(bytes.data() + 4, static_cast<std::uint32_t>(bytes.size()) - 8);
    bend(bytes);
    return bytes;
  }

 private:
  std::uint32_t below(std::uint32_t bound) { return random_() % bound; }
  std::uint32_t count(std::uint32_t most) { return below(8) == 0 ? below(most) : below(4); }
  template <class Value>
  Value pick(std::initializer_list<Value> values) {
    return *(values.begin() + below(static_cast<std::uint32_t>(values.size())));
  }

  std::uint32_t address() {
    switch (below(8)) {
      case 0:
        return random_();
      case 1:
        return 4 * below(0x4000);
      case 2:
        return 0x10000 + 4 * below(20);
      case 3:
        return 0x100000 + 4 * below(6);
      default:
        namespace reg
        = gige::reg;
        return pick<std::uint32_t>({reg::control,
                                    reg::control,
                                    reg::control,
                                    reg::stream_port,
                                    reg::stream_packet_size,
                                    reg::stream_address,
                                    reg::stream_delay,
                                    reg::stream_configuration,
                                    reg::gvcp_configuration,
                                    reg::gvsp_configuration,
                                    reg::heartbeat_timeout,
                                    reg::switchover_key,
                                    reg::user_name,
                                    reg::user_name + 12,
                                    reg::message_port,
                                    reg::message_address,
                                    reg::message_timeout,
                                    reg::message_retries,
                                    reg::timestamp_control,
                                    reg::action_group_key,
                                    reg::action_group_mask,
                                    reg::action_device_key,
                                    reg::fault_loss,
                                    reg::fault_burst,
                                    reg::fault_delay_us,
                                    reg::first_url,
                                    reg::version,
                                    reg::resend_requests});
    }
  }
  std::uint32_t number() {
    switch (below(6)) {
      case 0:
        return random_();
      case 1:
        return pick<std::uint32_t>({0, 1, 2, 3, 4, 6, 7, 0xffffffff, 0x80000000, 0x7fffffff, 0x40000000});
      case 2:
        return pick<std::uint32_t>({0x7f000001, 0xe0000001, 0x800005dc, 0xc0002328, 1500, 9000, 500, 40000});
      default:
        return below(70000);
    }
  }
  void bend(std::vector<std::uint8_t>& bytes) {
    switch (below(12)) {
      case 0:
        bytes.resize(below(static_cast<std::uint32_t>(bytes.size()) + 1));
        break;
      case 1:
        bytes.resize(bytes.size() + below(600), 0xa5);
        break;
      case 2:
      case 3:
        for (std::uint32_t n = 1 + below(4); n > 0 && !bytes.empty(); --n)
          bytes[below(static_cast<std::uint32_t>(bytes.size()))] ^= static_cast<std::uint8_t>(1u << below(8));
        break;
      default:
        break;
    }
  }

  RandomStream random_;
};

}  // namespace atomcam::test
