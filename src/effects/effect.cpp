#include "effects/effect.hpp"

namespace atomcam {
namespace {

std::uint64_t stream_of(std::string_view effect, std::string_view what) {
  return stream_id(what, stream_id("/", stream_id(effect, stream_id("effects/"))));
}

}  // namespace

RandomStream FrameContext::random_at(std::string_view what, std::uint64_t at_frame,
                                     std::uint32_t block) const {
  return RandomStream(key(what), at_frame, block);
}

PhiloxKey FrameContext::key(std::string_view what) const {
  return stream_key(seed, stream_of(effect, what));
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
