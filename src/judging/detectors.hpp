#pragma once
// Two detectors to compare others with.

#include <functional>
#include <span>
#include <vector>

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

/// A detector for the sites of a lab.
class ReferenceDetector {
 public:
  /// Counts of one frame after the other, row by row; the same at every call.
  using Visit = std::function<void(std::span<const float> frame)>;
  using Frames = std::function<void(const Visit& visit)>;

  /// `shape` is that of the frames. `half_width_px`: of the square, in pixels of the frames; 0 chooses the
  /// one that holds three quarters of an atom's light. Sites at the border have what is inside.
  ReferenceDetector(const Lab& lab, const StackPlace& place, Shape shape, Detector kind,
                    int half_width_px = 0);
  std::size_t sites() const { return windows_.size(); }
  Shape shape() const { return shape_; }

  /// Learns the threshold, and the matched filter the noise, from frames and what is true of their sites,
  /// [frame, site]. Throws Error if the truth is of other frames, or all sites are filled or empty.
  void teach(const Frames& frames, std::span<const SiteTruth> truth);
  bool taught() const { return taught_; }
  /// Half way between the two scores that it parts.
  double threshold() const { return threshold_; }

  /// Of each site: the larger, the likelier it is filled. Once it is taught.
  void score(std::span<const float> frame, std::span<float> scores) const;

 private:
  /// The pixels that tell about a site.
  struct Window {
    std::vector<std::size_t> pixels;  // in the frame
    std::vector<double> light;        // of an atom at the site, as a share of all
    std::vector<double> weights;
  };
  void weigh(const Frames& frames, std::span<const SiteTruth> truth);

  Shape shape_;
  Detector kind_;
  std::vector<Window> windows_;
  double threshold_ = 0;
  bool taught_ = false;
};

/// The frames of even number teach the detector, those of odd number are what it is judged by.
struct Detected {
  SiteScores scores;  // of the frames of odd number
  std::vector<SiteTruth> truth;
  double threshold = 0;
};

/// Throws Error for fewer than two frames.
Detected detect(StackReader& stack, const Lab& lab, const StackPlace& place, Detector detector,
                const std::vector<SiteTruth>& truth, int half_width_px = 0);

}  // namespace atomcam
