#pragma once
// The blocks sent last, kept for clients that ask for packets again.

#include <cstdint>
#include <deque>
#include <memory>

#include "gige/gvsp.hpp"

namespace atomcam::gige {

struct RingLimits {
  std::size_t frames = 4;                      // kept whatever their size and age
  std::chrono::milliseconds age{250};          // kept beyond that, as long as
  std::size_t bytes = std::size_t{256} << 20;  // all together are no larger
};

class BlockRing {
 public:
  explicit BlockRing(RingLimits limits) : limits_(limits) {}

  void add(std::shared_ptr<Block> block, Time now) {
    bytes_ += block->frame->payload.size();
    blocks_.push_back(std::move(block));
    while (blocks_.size() > limits_.frames &&
           (bytes_ > limits_.bytes || now - blocks_.front()->finished > limits_.age)) {
      bytes_ -= blocks_.front()->frame->payload.size();
      blocks_.pop_front();
    }
  }
  void clear() {
    blocks_.clear();
    bytes_ = 0;
  }

  std::shared_ptr<Block> find(std::uint64_t wire_id) const {
    // Newest first: 16-bit ids come again.
    for (auto block = blocks_.rbegin(); block != blocks_.rend(); ++block)
      if ((*block)->wire_id() == wire_id) return *block;
    return nullptr;
  }

 private:
  RingLimits limits_;
  std::deque<std::shared_ptr<Block>> blocks_;
  std::size_t bytes_ = 0;
};

}  // namespace atomcam::gige
