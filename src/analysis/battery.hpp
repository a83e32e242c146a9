#pragma once
// The battery: what is measured in a stack. Every statistic is one number with a place in the camera's chain
// and an axis along which it lives; real and simulated stacks go through the same code.

#include <algorithm>
#include <cstddef>
#include <span>
#include <string>
#include <vector>

#include "analysis/frame_sequence.hpp"
#include "analysis/stack_model.hpp"

namespace atomcam {

struct StatisticDeclaration {
  std::string name;        // "light.row_means.variance"
  std::string observable;  // a name of base/observable.hpp
  std::string axis;        // "space", "time", "intensity", "frequency", "site", "shape"
  std::string place;       // in words: "dark pixels", "rows", "columns", "occupied sites", "whole frame"
  bool darks = false;      // measured in the frames with the shutter closed
  bool outliers = false;   // logarithm of 1 and a sum over outliers: a part of one of them means nothing
  /// In plain stacks many deviations off now and then: an extreme, a count of rare events, a number that does
  /// not follow the calibration in a straight line.
  bool unsteady = false;
};

/// Where the battery splits a stack: frame n belongs to part (n / block) % 2.
struct BatterySplit {
  std::size_t block = 10;
};
/// Blocks of so many frames, or fewer: a stack has eight blocks at least.
inline BatterySplit split_of(std::size_t frames, std::size_t block = BatterySplit{}.block) {
  return {std::max<std::size_t>(1, std::min(block, frames / 8))};
}

/// Values in the order of battery(model, darks); NaN where a statistic cannot be had (too few frames or
/// sites).
struct BatteryValues {
  std::vector<double> whole;    // all frames
  std::vector<double> part[2];  // the interleaved parts
};

/// The statistics that a stack of this kind has.
std::vector<StatisticDeclaration> battery(const StackModel& model, bool darks);

/// Measures `light` and, if not null, `darks`. Two visits of each sequence; memory of a few maps. Pure:
/// the same frames give the same values.
BatteryValues measure(const StackModel& model, const FrameSequence& light, const FrameSequence* darks,
                      BatterySplit split = {});

}  // namespace atomcam
