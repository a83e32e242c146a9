#pragma once
// How far a diagnosis has come.

#include <algorithm>
#include <functional>
#include <string>
#include <string_view>

namespace atomcam {

/// Takes what is being done and how much of all is done (0 to 1); may be empty.
using DiagnosisProgress = std::function<void(std::string_view step, double done)>;

/// For a population of `stacks`, which is the part of all from `from` to `to`: takes how many are done.
/// `progress` must outlive it.
inline std::function<void(int)> stacks_done(const DiagnosisProgress& progress, std::string step, double from,
                                            double to, int stacks) {
  if (!progress) return {};
  return [&progress, step = std::move(step), from, to, stacks](int done) {
    progress(step, from + (to - from) * std::min(1.0, static_cast<double>(done) / stacks));
  };
}

}  // namespace atomcam
