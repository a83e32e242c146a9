#include "diagnosis/simulated_frames.hpp"

namespace atomcam {
namespace {

constexpr std::size_t kept_bytes = 64u << 20;
constexpr std::uint64_t first_dark_frame = 1000000;

}  // namespace

SimulatedFrames::SimulatedFrames(Lab lab, const FrameChoice& choice, bool shutter_open)
    : simulation_(std::move(lab)), choice_(choice), settings_(simulation_.lab().settings) {
  settings_.shutter_open = shutter_open;
  if (frames() * shape().pixels() * sizeof(std::uint16_t) <= kept_bytes)
    for (std::size_t n = 0; n < frames(); ++n) kept_.push_back(render(n));
}

void SimulatedFrames::visit(const std::function<void(std::size_t, const CountImage&)>& take) const {
  for (std::size_t n = 0; n < frames(); ++n) {
    if (!kept_.empty())
      take(n, kept_[n]);
    else
      take(n, render(n));
  }
}

CountImage SimulatedFrames::render(std::size_t n) const {
  const std::size_t number = choice_.number(n);
  return simulation_.render(settings_.shutter_open ? number : first_dark_frame + number, settings_).counts;
}

}  // namespace atomcam
