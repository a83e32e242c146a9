#pragma once
// What a calibration is given, and what it says to what it cannot use.

#include <string>

#include "base/error.hpp"
#include "calibration/calibrate.hpp"

namespace atomcam {

inline CalibrationInput input_of(const Notes& notes, const FrameSequence& frames,
                                 const FrameSequence* darks = nullptr) {
  CalibrationInput input;
  input.notes = notes;
  input.frames = &frames;
  input.darks = darks;
  return input;
}

/// The message of the refusal; empty if there is none.
inline std::string problem_with(const Notes& notes, const FrameSequence& frames) {
  try {
    calibrate(input_of(notes, frames));
  } catch (const Error& error) {
    return error.what();
  }
  return "";
}

}  // namespace atomcam
