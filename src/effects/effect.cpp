#include "effects/effect.hpp"

#include <string>

namespace atomcam {

RandomStream FrameContext::random_at(std::string_view what, std::uint64_t at_frame,
                                     std::uint32_t block) const {
  return RandomStream(seed, stream_id("effects/" + std::string(effect) + "/" + std::string(what)), at_frame,
                      block);
}

RandomStream FrameContext::fixed(std::string_view what, std::uint32_t block) const {
  return RandomStream(stream_id(serial),
                      stream_id("effects/" + std::string(effect) + "/" + std::string(what)), 0, block);
}

std::string_view EffectDeclaration::stage() const {
  switch (plane) {
    case Plane::scene:
      return "scene";
    case Plane::photons:
      return "optics";
    default:
      return "sensor";
  }
}

}  // namespace atomcam
