#include "effects/effect.hpp"

#include <string>

namespace atomcam {
namespace {

std::uint64_t stream_of(std::string_view effect, std::string_view what) {
  return stream_id("effects/" + std::string(effect) + "/" + std::string(what));
}

}  // namespace

RandomStream FrameContext::random_at(std::string_view what, std::uint64_t at_frame,
                                     std::uint32_t block) const {
  return RandomStream(seed, stream_of(effect, what), at_frame, block);
}

RandomStream FrameContext::fixed(std::string_view what, std::uint32_t block) const {
  return RandomStream(stream_id(serial), stream_of(effect, what), 0, block);
}

std::string_view plane_name(Plane plane) {
  switch (plane) {
    case Plane::scene:
      return "scene";
    case Plane::photons:
      return "photons";
    case Plane::electrons:
      return "electrons";
    case Plane::electron_register:
      return "register";
    case Plane::counts:
      return "counts";
  }
  return {};
}

std::string_view EffectDeclaration::stage() const {
  switch (plane) {
    case Plane::scene:
      return "scene";
    case Plane::photons:
      return "optics";
    case Plane::electrons:
    case Plane::electron_register:
    case Plane::counts:
      return "sensor";
  }
  return "";
}

}  // namespace atomcam
