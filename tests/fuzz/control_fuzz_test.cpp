// Mutated commands through the control side. ATOMCAM_FUZZ_COMMANDS sets how many; under the sanitizers of the
// preset "asan" ten million take minutes.

#include <gtest/gtest.h>

#include <cstdlib>
#include <string>

#include "fuzz/control_target.hpp"
#include "fuzz/mutated_commands.hpp"

namespace atomcam {
namespace {

TEST(ControlFuzz, NoDatagramDoesHarm) {
  const char* asked = std::getenv("ATOMCAM_FUZZ_COMMANDS");
  const std::uint64_t commands = asked != nullptr ? std::stoull(asked) : 200'000;
  test::MutatedCommands source(20260101);
  test::ControlTarget target;
  for (std::uint64_t i = 0; i < commands; ++i) {
    const std::vector<std::uint8_t> datagram = source.next();
    target.feed(datagram, source.chance());
  }
  // The commands reach everything they are to try.
  using gige::Status;
  const auto reached = [&](std::uint16_t acknowledge, std::initializer_list<Status> statuses) {
    for (const Status status : statuses)
      EXPECT_GT((target.answers[{acknowledge, static_cast<std::uint16_t>(status)}]), 0u)
          << std::hex << acknowledge << " " << static_cast<int>(status);
  };
  reached(0x0003, {Status::success, Status::invalid_header});
  reached(0x0005,
          {Status::success, Status::invalid_parameter, Status::access_denied, Status::invalid_header});
  reached(0x0081, {Status::success, Status::invalid_address, Status::bad_alignment, Status::access_denied,
                   Status::busy, Status::invalid_header});
  reached(0x0083, {Status::success, Status::invalid_parameter, Status::invalid_address, Status::write_protect,
                   Status::bad_alignment, Status::access_denied, Status::busy, Status::invalid_header});
  reached(0x0085, {Status::success, Status::invalid_parameter, Status::invalid_address, Status::bad_alignment,
                   Status::access_denied, Status::busy, Status::invalid_header});
  reached(0x0087, {Status::success, Status::invalid_parameter, Status::invalid_address, Status::write_protect,
                   Status::bad_alignment, Status::access_denied, Status::busy, Status::invalid_header});
  reached(0x0089, {Status::success});
  reached(0x0101, {Status::success, Status::not_implemented});
}

}  // namespace
}  // namespace atomcam
