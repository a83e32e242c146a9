#pragma once
// FFTW's planner (of double precision) is not thread safe; executing a plan is. Whoever makes or destroys one
// holds this, in whatever part of the program.

#include <mutex>

namespace atomcam {

inline std::mutex& fftw_planner() {
  static std::mutex mutex;
  return mutex;
}

}  // namespace atomcam
