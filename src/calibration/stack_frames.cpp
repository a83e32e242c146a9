#include "calibration/stack_frames.hpp"

#include <vector>

#include "data/stack_reader.hpp"

namespace atomcam {
namespace {

constexpr std::size_t kept_bytes = 256u << 20;

class FramesInFile : public FrameSequence {
 public:
  explicit FramesInFile(std::filesystem::path file) : file_(std::move(file)) {
    const auto reader = open_stack(file_);
    count_ = static_cast<std::size_t>(reader->frames());
    shape_ = reader->shape().frame();
    if (count_ * shape_.pixels() * 2 <= kept_bytes)
      for (std::size_t n = 0; n < count_; ++n) kept_.push_back(reader->counts(n));
  }
  std::size_t frames() const override { return count_; }
  Shape shape() const override { return shape_; }
  void visit(const std::function<void(std::size_t, const CountImage&)>& take) const override {
    if (!kept_.empty()) {
      for (std::size_t n = 0; n < count_; ++n) take(n, kept_[n]);
      return;
    }
    const auto reader = open_stack(file_);
    for (std::size_t n = 0; n < count_; ++n) take(n, reader->counts(n));
  }

 private:
  std::filesystem::path file_;
  std::size_t count_ = 0;
  Shape shape_;
  std::vector<CountImage> kept_;
};

}  // namespace

std::unique_ptr<FrameSequence> open_frames(const std::filesystem::path& file) {
  return std::make_unique<FramesInFile>(file);
}

}  // namespace atomcam
