#pragma once
// Which frames of a stack are looked at. Every hypothesis is simulated over and over with as many frames as
// are looked at; of a long stack of large frames a part tells nearly as much and costs less by as much.

#include <cstddef>

#include "analysis/frame_sequence.hpp"

namespace atomcam {

/// All frames of a stack, or stretches of it, evenly spread from its first frame to its last: what changes
/// from frame to frame is seen within a stretch, what drifts between them.
class FrameChoice {
 public:
  FrameChoice() = default;
  FrameChoice(std::size_t all)
      : all_(all), count_(all), stretch_(all) {}  // NOLINT: a number of frames is all
  /// Stretches of `stretch` frames, so many that they have `count` frames or hardly fewer.
  FrameChoice(std::size_t all, std::size_t count, std::size_t stretch);

  std::size_t count() const { return count_; }
  std::size_t all() const { return all_; }
  bool is_all() const { return count_ == all_; }
  std::size_t stretch() const { return stretch_; }
  /// In the stack, of the k-th frame that is looked at.
  std::size_t number(std::size_t k) const;

 private:
  std::size_t all_ = 0, count_ = 0, stretch_ = 0;
};

/// All, or as many as have 2^24 pixels (64 frames of 512 x 512) but 64 at least. Every stretch has a block of
/// either part of the frames (BatterySplit).
FrameChoice frames_worth_looking_at(std::size_t frames, const Shape& shape);

/// Frames of another sequence, which must outlive it.
class ChosenFrames : public FrameSequence {
 public:
  ChosenFrames(const FrameSequence& all, const FrameChoice& choice) : all_(all), choice_(choice) {}
  /// All of them, or those that are worth looking at.
  ChosenFrames(const FrameSequence& all, bool every_one)
      : ChosenFrames(all, every_one ? FrameChoice(all.frames())
                                    : frames_worth_looking_at(all.frames(), all.shape())) {}
  std::size_t frames() const override { return choice_.count(); }
  Shape shape() const override { return all_.shape(); }
  const FrameChoice& choice() const { return choice_; }
  void visit(const std::function<void(std::size_t, const CountImage&)>& take) const override;

 private:
  const FrameSequence& all_;
  FrameChoice choice_;
};

}  // namespace atomcam
