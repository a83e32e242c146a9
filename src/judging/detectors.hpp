#pragma once
// Two detectors to compare others with.

#include <functional>

#include "data/stack_reader.hpp"
#include "judging/judgement.hpp"
#include "simulation/lab.hpp"

namespace atomcam {

enum class Detector {
  threshold,  // sum of the counts in a square around each site
  matched,    // sum weighted with the lab's point-spread function over the noise
};

/// Where a stack's pixels are on the sensor.
struct StackPlace {
  int offset_x_px = 0, offset_y_px = 0;
  int binning_x = 1, binning_y = 1;
};

/// The frames of even number teach the detector its threshold (and the matched filter the noise), those of
/// odd number are what it is judged by.
struct Detected {
  SiteScores scores;  // of the frames of odd number
  std::vector<SiteTruth> truth;
  double threshold = 0;
};

/// `half_width_px`: of the square, in pixels of the stack; 0 chooses the one that holds three quarters of an
/// atom's light. Sites at the border have what is inside. Throws Error for fewer than two frames.
Detected detect(StackReader& stack, const Lab& lab, const StackPlace& place, Detector detector,
                const std::vector<SiteTruth>& truth, int half_width_px = 0);

}  // namespace atomcam
