#pragma once
// How well a detector of atoms finds them: its scores against the truth.

#include <cstdint>
#include <string>
#include <vector>

namespace atomcam {

/// What is true of one site in one frame.
struct SiteTruth {
  bool filled = false;          // what a detector is asked for
  bool lost = false;            // its atom was there when the exposure began and not when it ended
  float loss_s = 0;             // since the exposure began, if it was lost
  float electrons = 0;          // detected from its atom
  std::uint8_t neighbours = 0;  // sites next to it that are filled
};

/// One value per site and frame: [frame, site]; the larger, the likelier the site is filled.
struct SiteScores {
  std::uint64_t frames = 0;
  std::size_t sites = 0;
  std::vector<float> values;
};

/// Part of `number`; `error` is one standard error, from the scatter between frames and never below that of
/// independent draws (with (part + 1) / (number + 2) in place of a rate of 0 or 1).
struct Share {
  std::uint64_t part = 0, number = 0;
  double value() const { return number ? static_cast<double>(part) / static_cast<double>(number) : 0; }
  double error = 0;
};

struct Confusion {
  std::string of;  // "electrons 120 to 340"
  double from = 0, to = 0;
  Share found;         // of the filled sites: called filled
  Share false_alarms;  // of the empty sites: called filled
};

struct RocPoint {
  double threshold = 0;
  double false_alarms = 0, found = 0;  // shares at scores >= threshold
};

struct Judgement {
  std::uint64_t frames = 0;
  std::size_t sites = 0;
  double threshold = 0;  // a site whose score is not below it is called filled
  Share fidelity;        // of all sites in all frames: called rightly
  Share found, false_alarms;
  double best_threshold = 0, best_fidelity = 0;  // with the truth in hand
  double auc = 0, auc_error = 0;  // area under the curve: of a filled and an empty site, which scores higher
  std::vector<RocPoint> roc;      // from (0, 0) to (1, 1)
  std::vector<Confusion> by_brightness;  // filled sites, in five parts of equal number
  std::vector<Confusion> by_loss;        // filled at the start: lost in which fifth of the exposure, or never
  std::vector<Confusion> by_neighbours;
};

/// `truth` is [frame, site] as the scores are. Throws Error where their numbers differ, a score is no number,
/// or all sites are filled or empty.
Judgement judge(const SiteScores& scores, const std::vector<SiteTruth>& truth, double threshold,
                double exposure_s);

/// The threshold at which most sites are called rightly: half way between the two scores that it parts.
double best_threshold(const SiteScores& scores, const std::vector<SiteTruth>& truth);

}  // namespace atomcam
