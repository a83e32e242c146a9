#include "simulation/frame_range.hpp"

#include <fmt/format.h>

#include <chrono>
#include <limits>

#include "base/error.hpp"
#include "simulation/parallel.hpp"

namespace atomcam {
namespace {

void write(const FrameTruth& truth, std::size_t row, const TruthArrays& arrays) {
  const auto put = [](auto* array, std::size_t at, auto value) {
    if (array) array[at] = static_cast<std::remove_reference_t<decltype(*array)>>(value);
  };
  put(arrays.shift_x_px, row, truth.shift_x_px);
  put(arrays.shift_y_px, row, truth.shift_y_px);
  put(arrays.background_e, row, truth.background_e);
  std::size_t at = row * truth.atoms.size();
  for (const AtomTruth& atom : truth.atoms) {
    put(arrays.present_at_start, at, atom.present_at_start);
    put(arrays.present_at_end, at, atom.present_at_end);
    put(arrays.x_px, at, atom.x_px);
    put(arrays.y_px, at, atom.y_px);
    put(arrays.loss_time_s, at, atom.loss_time_s);
    put(arrays.photons_emitted, at, atom.photons_emitted);
    put(arrays.electrons_expected, at, atom.electrons_expected);
    put(arrays.electrons_detected, at, atom.electrons_detected);
    ++at;
  }
}

/// Calls `poll` on the thread that made it, at most twenty times a second.
class Polling {
 public:
  explicit Polling(const std::function<void()>& poll) : poll_(poll) {}
  void operator()() const {
    if (!poll_ || std::this_thread::get_id() != thread_) return;
    const auto now = std::chrono::steady_clock::now();
    if (now - last_ < std::chrono::milliseconds(50)) return;
    last_ = now;
    poll_();
  }

 private:
  const std::function<void()>& poll_;
  std::thread::id thread_ = std::this_thread::get_id();
  mutable std::chrono::steady_clock::time_point last_ = std::chrono::steady_clock::now();
};

}  // namespace

void render_frames(const Simulation& simulation, const CameraSettings& settings, FrameRange range,
                   std::span<std::uint16_t> counts, const TruthArrays& truth, int threads,
                   const std::function<void()>& poll) {
  constexpr std::uint64_t most = std::numeric_limits<int>::max();
  if (range.count > most)
    throw Error("frames", fmt::format("{} in one call; allowed up to {}", range.count, most));
  if (range.first > std::numeric_limits<std::uint64_t>::max() - range.count)
    throw Error("first", fmt::format("{}, too large for {} frames", range.first, range.count));
  if (threads < 0) throw Error("threads", fmt::format("{}; allowed 0 (all cores) or more", threads));
  const std::size_t pixels = Shape{settings.output_height(), settings.output_width()}.pixels();
  if (counts.size() != range.count * pixels)
    throw Error("counts",
                fmt::format("room for {} pixels; {} frames of {} x {} need {}", counts.size(), range.count,
                            settings.output_width(), settings.output_height(), range.count * pixels));
  if (range.count == 0) return;
  threads = thread_count(threads);
  const int side_by_side = static_cast<int>(std::min<std::uint64_t>(range.count, threads));
  const int threads_each = threads / side_by_side;
  const Polling polling(poll);
  parallel_for(static_cast<int>(range.count), side_by_side, 1, [&](int i) {
    const auto at = static_cast<std::size_t>(i);
    write(
        simulation.render_into(counts.subspan(at * pixels, pixels), range.first + at, settings, threads_each),
        at, truth);
    polling();
  });
}

}  // namespace atomcam
