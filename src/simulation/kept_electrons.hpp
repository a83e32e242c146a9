#pragma once
// The electrons of the last frames, for effects that look back.

#include <cstdint>
#include <deque>
#include <memory>
#include <mutex>

#include "base/camera_settings.hpp"
#include "base/image.hpp"

namespace atomcam {

/// Electrons as collected, before any effect on them. From any thread; what is not kept has to be made again,
/// with the same result.
class KeptElectrons {
 public:
  /// nullptr: not kept. Whoever asks will ask for others: from then on they are.
  std::shared_ptr<const ElectronImage> find(std::uint64_t frame, const CameraSettings& settings) {
    const std::lock_guard lock(mutex_);
    wanted_ = true;
    for (const Kept& one : kept_)
      if (one.frame == frame && one.settings == settings) return one.electrons;
    return nullptr;
  }
  /// Does nothing as long as nobody has asked.
  void keep(std::uint64_t frame, const CameraSettings& settings, const ElectronImage& electrons) {
    constexpr std::size_t most = 6;  // an effect looks back over four frames
    const std::lock_guard lock(mutex_);
    if (!wanted_) return;
    kept_.push_front({frame, settings, std::make_shared<const ElectronImage>(electrons)});
    if (kept_.size() > most) kept_.pop_back();
  }

 private:
  struct Kept {
    std::uint64_t frame;
    CameraSettings settings;
    std::shared_ptr<const ElectronImage> electrons;
  };
  std::mutex mutex_;
  bool wanted_ = false;
  std::deque<Kept> kept_;
};

}  // namespace atomcam
