// For libFuzzer (option ATOMCAM_FUZZ, clang): a session of datagrams, each after its length (2 bytes) and its
// chance (4 bytes).

#include "fuzz/control_target.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  atomcam::gige::Bytes rest(data, size);
  atomcam::test::ControlTarget target;
  while (rest.size() >= 6) {
    const std::size_t length = std::min<std::size_t>(atomcam::gige::load16(rest, 0) & 0x3ff, rest.size() - 6);
    const std::uint32_t chance = atomcam::gige::load32(rest, 2);
    target.feed(rest.subspan(6, length), chance);
    rest = rest.subspan(6 + length);
  }
  return 0;
}
