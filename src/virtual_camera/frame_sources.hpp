#pragma once
// Where a virtual camera's pixels come from: the simulation, live or from a ring of frames rendered
// beforehand.

#include <memory>
#include <mutex>
#include <vector>

#include "camera/frame_source.hpp"
#include "simulation/simulation.hpp"

namespace atomcam {

/// Every frame rendered when it is asked for.
class LiveFrames : public FrameSource {
 public:
  explicit LiveFrames(std::shared_ptr<const Simulation> simulation) : simulation_(std::move(simulation)) {}
  RenderedFrame render(std::uint64_t number, const CameraSettings& settings) override;
  std::uint64_t seed() const override { return simulation_->lab().seed; }

 private:
  std::shared_ptr<const Simulation> simulation_;
};

/// The first `frames` frames again and again, each rendered once per settings: frame n shows (and its truth
/// names) frame n modulo `frames`. For rates that live rendering does not reach. A change of settings renders
/// anew.
class RepeatedFrames : public FrameSource {
 public:
  RepeatedFrames(std::shared_ptr<FrameSource> source, int frames)
      : source_(std::move(source)), ring_(static_cast<std::size_t>(frames)) {}
  RenderedFrame render(std::uint64_t number, const CameraSettings& settings) override;
  std::uint64_t seed() const override { return source_->seed(); }
  /// Renders the whole ring for these settings now.
  void fill(const CameraSettings& settings);

 private:
  using Kept = std::shared_ptr<const RenderedFrame>;
  std::shared_ptr<FrameSource> source_;
  std::mutex mutex_;
  CameraSettings settings_;
  std::vector<Kept> ring_;
};

}  // namespace atomcam
