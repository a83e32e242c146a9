#include "diagnosis/second_opinions.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <set>

#include "diagnosis/classifier.hpp"
#include "diagnosis/distances.hpp"
#include "diagnosis/gap_closed.hpp"
#include "diagnosis/model.hpp"
#include "diagnosis/patch_views.hpp"
#include "diagnosis/population.hpp"
#include "diagnosis/site_detectors.hpp"
#include "simulation/parallel.hpp"
#include "simulation/simulation.hpp"

namespace atomcam {
namespace {

constexpr double nothing = std::numeric_limits<double>::quiet_NaN();
constexpr std::size_t references = 4;  // stacks at the fitted values that others are compared with
constexpr std::size_t alike_stacks = 8;
constexpr int folds = 5;
/// Pixels that one stack's frames may have together before some are left out.
constexpr double most_pixels = 1.5e7;
constexpr std::size_t fewest_frames = 40;
constexpr std::size_t count_range = 65536;

/// The held-out frames to look at, evenly spread if not all.
std::vector<std::size_t> chosen_frames(const StackPlan& plan) {
  std::vector<std::size_t> frames;
  for (std::size_t n = 0; n < plan.frames.count(); ++n)
    if ((n / plan.split.block) % 2 == 1) frames.push_back(n);
  const auto most = std::max(
      fewest_frames, static_cast<std::size_t>(most_pixels / static_cast<double>(plan.model.shape.pixels())));
  if (frames.size() > most) {
    std::vector<std::size_t> fewer;
    for (std::size_t k = 0; k < most; ++k) fewer.push_back(frames[k * frames.size() / most]);
    frames = std::move(fewer);
  }
  return frames;
}

int fold_of(std::size_t frame, const StackPlan& plan) {
  return static_cast<int>(frame / (2 * plan.split.block) % folds);
}

/// What is kept of the frames of one stack.
struct Seen {
  LabelledFrames frames;
  std::vector<std::vector<std::uint64_t>> views;   // by fold: [view][bin]
  std::vector<std::vector<std::uint64_t>> counts;  // by fold
  std::vector<float> scores[2];                    // [frame, site] of each detector
  std::vector<bool> filled;                        // [frame, site], of simulated frames
};

class Eyes {
 public:
  explicit Eyes(const StackPlan& plan)
      : plan_(plan),
        chosen_(chosen_frames(plan)),
        views_(plan.model, plan.seed),
        detectors_{SiteDetector(plan.model, SiteDetector::Kind::threshold),
                   SiteDetector(plan.model, SiteDetector::Kind::matched)} {}
  std::size_t frames() const { return chosen_.size(); }
  const PatchViews& views() const { return views_; }

  Seen look_at(const FrameSequence& real) const {
    Seen seen = empty(folds);
    std::size_t next = 0;
    real.visit([&](std::size_t n, const CountImage& frame) {
      if (next == chosen_.size() || n != chosen_[next]) return;
      add(seen, next++, frame);
    });
    return seen;
  }
  Seen look_at(const Lab& lab, std::uint64_t stack_number) const {
    Seen seen = empty(1);
    const Simulation simulation(lab_of_stack(lab, plan_, stack_number));
    CameraSettings settings = simulation.lab().settings;
    settings.shutter_open = true;
    const std::size_t sites = plan_.model.sites.size();
    for (std::size_t k = 0; k < chosen_.size(); ++k) {
      const Frame frame = simulation.render(plan_.frames.number(chosen_[k]), settings);
      add(seen, k, frame.counts);
      if (frame.truth.atoms.size() != sites) continue;
      for (const AtomTruth& atom : frame.truth.atoms) seen.filled.push_back(atom.present_at_start);
    }
    return seen;
  }

 private:
  Seen empty(int parts) const {
    Seen seen;
    seen.frames.features.resize(static_cast<Eigen::Index>(chosen_.size()), views_.features());
    for (const std::size_t n : chosen_) seen.frames.fold.push_back(fold_of(n, plan_));
    seen.views.assign(static_cast<std::size_t>(parts),
                      std::vector<std::uint64_t>(views_.views() * PatchViews::bins, 0));
    seen.counts.assign(static_cast<std::size_t>(parts), std::vector<std::uint64_t>(count_range, 0));
    for (auto& scores : seen.scores) scores.resize(chosen_.size() * plan_.model.sites.size());
    return seen;
  }
  void add(Seen& seen, std::size_t k, const CountImage& frame) const {
    const std::size_t part = static_cast<std::size_t>(seen.frames.fold[k]) % seen.views.size();
    Eigen::RowVectorXd features(views_.features());
    views_.look(chosen_[k], frame, features, seen.views[part]);
    seen.frames.features.row(static_cast<Eigen::Index>(k)) = features;
    for (const std::uint16_t count : frame.pixels()) ++seen.counts[part][count];
    const std::size_t sites = plan_.model.sites.size();
    for (std::size_t d = 0; d < 2; ++d)
      detectors_[d].score(frame, std::span(seen.scores[d]).subspan(k * sites, sites));
  }

  const StackPlan& plan_;
  std::vector<std::size_t> chosen_;
  PatchViews views_;
  SiteDetector detectors_[2];
};

/// Sum over the parts, but for one of them.
std::vector<std::uint64_t> pooled(const std::vector<std::vector<std::uint64_t>>& parts, int without = -1) {
  std::vector<std::uint64_t> sum(parts.front().size(), 0);
  for (std::size_t p = 0; p < parts.size(); ++p)
    if (static_cast<int>(p) != without)
      std::transform(sum.begin(), sum.end(), parts[p].begin(), sum.begin(), std::plus<>());
  return sum;
}

/// Of a distance that is taken again without each part of the frames in turn (jackknife).
template <class Distance>
Figure with_parts_left_out(const Seen& one, const Distance& distance) {
  Figure figure{distance(-1), nothing};
  const std::set<int> parts(one.frames.fold.begin(), one.frames.fold.end());
  if (one.views.size() < 2 || parts.size() < 2) return figure;
  std::vector<double> values;
  for (const int part : parts) values.push_back(distance(part));
  double mean = 0, squares = 0;
  for (const double value : values) mean += value / static_cast<double>(values.size());
  for (const double value : values) squares += (value - mean) * (value - mean);
  figure.error =
      std::sqrt(squares * static_cast<double>(values.size() - 1) / static_cast<double>(values.size()));
  return figure;
}

Figure mean_and_scatter(const std::vector<double>& values) {
  if (values.empty()) return {nothing, nothing};
  double mean = 0, squares = 0;
  for (const double value : values) mean += value / static_cast<double>(values.size());
  for (const double value : values) squares += (value - mean) * (value - mean);
  return {mean, values.size() < 2 ? nothing : std::sqrt(squares / static_cast<double>(values.size() - 1))};
}

/// The stacks of one model.
struct SeenModel {
  std::vector<Seen> references, alike;
  std::vector<std::uint64_t> views, counts;  // of the references together
  std::vector<float> scores[2];
  void pool() {
    views.assign(references.front().views.front().size(), 0);
    counts.assign(count_range, 0);
    for (const Seen& one : references) {
      std::transform(views.begin(), views.end(), one.views.front().begin(), views.begin(), std::plus<>());
      std::transform(counts.begin(), counts.end(), one.counts.front().begin(), counts.begin(), std::plus<>());
      for (std::size_t d = 0; d < 2; ++d)
        scores[d].insert(scores[d].end(), one.scores[d].begin(), one.scores[d].end());
    }
  }
};

class Comparison {
 public:
  Comparison(const Eyes& eyes, const Seen& real, const SeenModel& plain, const SeenModel* fixed)
      : eyes_(eyes), real_(real), plain_(plain), fixed_(fixed) {
    std::vector<std::uint64_t> pool = pooled(real.counts);
    for (const SeenModel* model : {&plain_, fixed_})
      if (model) std::transform(pool.begin(), pool.end(), model->counts.begin(), pool.begin(), std::plus<>());
    bins_ = count_bins(pool);
  }

  /// `distance(one, model)` of the frames from each model, of the model's own stacks from it.
  template <class Distance>
  SecondOpinion opinion(const Distance& distance) const {
    SecondOpinion opinion;
    opinion.before = distance(real_, plain_);
    opinion.after = fixed_ ? distance(real_, *fixed_) : Figure{nothing, nothing};
    const SeenModel& right = fixed_ ? *fixed_ : plain_;
    std::vector<double> own;
    for (const Seen& one : right.alike) own.push_back(distance(one, right).value);
    opinion.floor = mean_and_scatter(own);
    const double above = opinion.before.value - opinion.floor.value;
    opinion.closed = fixed_ && above > 3 * std::hypot(opinion.floor.error, opinion.before.error)
                         ? 1 - (opinion.after.value - opinion.floor.value) / above
                         : nothing;
    return opinion;
  }

  Figure classifier(const Seen& one, const SeenModel& model) const {
    std::vector<const LabelledFrames*> low;
    for (const Seen& reference : model.references) low.push_back(&reference.frames);
    const TwoSampleTest test = two_sample_test(one.frames, low);
    return {test.auc, test.error};
  }
  Figure sliced_wasserstein(const Seen& one, const SeenModel& model) const {
    return with_parts_left_out(one, [&](int without) {
      const auto views = pooled(one.views, without);
      double sum = 0;
      for (std::size_t v = 0; v < eyes_.views().views(); ++v) {
        const auto of = [&](const std::vector<std::uint64_t>& all) {
          return std::span(all).subspan(v * PatchViews::bins, PatchViews::bins);
        };
        sum += wasserstein(of(views), of(model.views));
      }
      return sum * PatchViews::bin_width / static_cast<double>(eyes_.views().views());
    });
  }
  Figure histogram_divergence(const Seen& one, const SeenModel& model) const {
    const auto reference = binned(model.counts, bins_);
    return with_parts_left_out(
        one, [&](int without) { return divergence(binned(pooled(one.counts, without), bins_), reference); });
  }
  /// Of a detector's scores, in distances between the peaks of the plain model.
  Figure score_distance(std::size_t detector, const Seen& one, const SeenModel& model) const {
    const TwoPeaks peaks = two_peaks(plain_.scores[detector]);
    const std::size_t sites = one.scores[detector].size() / std::max<std::size_t>(1, one.frames.fold.size());
    return with_parts_left_out(one, [&](int without) {
      std::vector<float> scores;
      for (std::size_t n = 0; n < one.frames.fold.size(); ++n)
        if (one.frames.fold[n] != without)
          scores.insert(scores.end(), one.scores[detector].begin() + static_cast<std::ptrdiff_t>(n * sites),
                        one.scores[detector].begin() + static_cast<std::ptrdiff_t>((n + 1) * sites));
      return wasserstein_of_samples(std::move(scores), model.scores[detector]) / (peaks.upper - peaks.lower);
    });
  }

  DetectorOpinion detector(std::size_t which) const {
    DetectorOpinion opinion;
    const auto of = [&](const Seen& seen) {
      const TwoPeaks peaks = two_peaks(seen.scores[which]);
      DetectorOpinion::OfFrames said;
      said.fidelity = {peaks.fidelity(), nothing};
      said.separation = {peaks.separation(), nothing};
      said.truly = {nothing, nothing};
      if (seen.filled.empty() || seen.filled.size() != seen.scores[which].size()) return said;
      double right = 0;
      for (std::size_t n = 0; n < seen.filled.size(); ++n)
        right += (static_cast<double>(seen.scores[which][n]) >= peaks.threshold) == seen.filled[n];
      said.truly.value = right / static_cast<double>(seen.filled.size());
      return said;
    };
    const auto of_model = [&](const SeenModel& model) {
      // Values of the model at its fitted place, scatter of a stack where the lab may be.
      DetectorOpinion::OfFrames said;
      for (const auto figure : {&DetectorOpinion::OfFrames::fidelity, &DetectorOpinion::OfFrames::separation,
                                &DetectorOpinion::OfFrames::truly}) {
        std::vector<double> values, scatter;
        for (const Seen& one : model.references) values.push_back((of(one).*figure).value);
        for (const Seen& one : model.alike) scatter.push_back((of(one).*figure).value);
        said.*figure = {mean_and_scatter(values).value, mean_and_scatter(scatter).error};
      }
      return said;
    };
    opinion.real = of(real_);
    opinion.before = of_model(plain_);
    constexpr DetectorOpinion::OfFrames none = {{nothing, nothing}, {nothing, nothing}, {nothing, nothing}};
    opinion.after = fixed_ ? of_model(*fixed_) : none;
    // A real stack scatters as the simulated ones that are nearest to it do.
    const DetectorOpinion::OfFrames& like = fixed_ ? opinion.after : opinion.before;
    opinion.real.fidelity.error = like.fidelity.error;
    opinion.real.separation.error = like.separation.error;
    return opinion;
  }

 private:
  const Eyes& eyes_;
  const Seen& real_;
  const SeenModel& plain_;
  const SeenModel* fixed_;
  std::vector<std::size_t> bins_;
};

}  // namespace

OpinionModel opinion_model(const Model& model, const BatteryValues& real, bool as_calibrated) {
  const Standard standard = model.estimator(Part::fitting);
  Eigen::VectorXd fitted = fitted_to_first_part(model, standard, real);
  for (std::size_t k = 0; as_calibrated && k < model.open.size(); ++k)
    fitted(static_cast<Eigen::Index>(k)) = model.open[k].centre;
  OpinionModel opinion;
  opinion.lab = model.lab_at(fitted);
  const Eigen::Index stacks = standard.misses().rows();
  for (std::size_t k = 0; k < alike_stacks && stacks > 0; ++k) {
    // An optical system is dear to make: two of them.
    const Eigen::VectorXd miss = standard.misses().row(static_cast<Eigen::Index>(k) % stacks);
    const Eigen::VectorXd shared = standard.misses().row(static_cast<Eigen::Index>(k % 2) % stacks);
    Eigen::VectorXd at = fitted - miss;
    for (std::size_t j = 0; j < model.open.size(); ++j)
      if (model.open[j].shared) {
        const auto i = static_cast<Eigen::Index>(j);
        at(i) = fitted(i) - shared(i);
      }
    opinion.alike.push_back(model.lab_at(at));
  }
  return opinion;
}

SecondOpinions second_opinions(const FrameSequence& real, const StackPlan& plan, const OpinionModel& plain,
                               const OpinionModel* fixed, std::uint64_t first) {
  const Eyes eyes(plan);
  SecondOpinions result;
  result.frames = eyes.frames();
  if (eyes.frames() == 0) return result;
  struct Task {
    const Lab* lab;
    std::uint64_t stack;
    Seen* to;
  };
  SeenModel seen[2];
  std::vector<Task> tasks;
  for (int m = 0; m < (fixed ? 2 : 1); ++m) {
    const OpinionModel& model = m == 0 ? plain : *fixed;
    seen[m].references.resize(references);
    seen[m].alike.resize(model.alike.size());
    for (std::size_t k = 0; k < references; ++k)
      tasks.push_back({&model.lab, first + k, &seen[m].references[k]});
    for (std::size_t k = 0; k < model.alike.size(); ++k)
      tasks.push_back({&model.alike[k], first + references + k, &seen[m].alike[k]});
  }
  Seen of_real;
  parallel_for(static_cast<int>(tasks.size()) + 1, plan.threads, 1, [&](int k) {
    if (k == 0) {
      of_real = eyes.look_at(real);
      return;
    }
    const Task& task = tasks[static_cast<std::size_t>(k) - 1];
    *task.to = eyes.look_at(*task.lab, task.stack);
    if (plan.check_in) plan.check_in();
  });
  for (int m = 0; m < (fixed ? 2 : 1); ++m) seen[m].pool();
  const Comparison comparison(eyes, of_real, seen[0], fixed ? &seen[1] : nullptr);

  const bool sites = !plan.model.sites.empty();
  result.metrics.resize(sites ? 5 : 3);
  result.detectors.resize(sites ? 2 : 0);
  parallel_for(
      static_cast<int>(result.metrics.size() + result.detectors.size()), plan.threads, 1, [&](int k) {
        const auto put = [&](std::string metric, std::string sees, std::string blind_to,
                             const auto& distance) {
          SecondOpinion& opinion = result.metrics[static_cast<std::size_t>(k)];
          opinion = comparison.opinion(distance);
          opinion.metric = std::move(metric);
          opinion.sees = std::move(sees);
          opinion.blind_to = std::move(blind_to);
        };
        if (k == 0)
          put("classifier_auc",
              "frames as a whole: means of random patches, their spread, the brightest pixels",
              "where in the frame; the order of the frames",
              [&](const Seen& one, const SeenModel& model) { return comparison.classifier(one, model); });
        else if (k == 1)
          put("sliced_wasserstein", "the law of random patches, pieces of rows and of columns",
              "where in the frame; anything beyond 24 pixels or from frame to frame",
              [&](const Seen& one, const SeenModel& model) {
                return comparison.sliced_wasserstein(one, model);
              });
        else if (k == 2)
          put("histogram_divergence", "the law of single pixels' counts", "space and time",
              [&](const Seen& one, const SeenModel& model) {
                return comparison.histogram_divergence(one, model);
              });
        else if (sites && k < 5)
          put(k == 3 ? "threshold_scores" : "matched_filter_scores", "the law of the detector's scores",
              "which site, which frame; pixels without atoms",
              [&, d = static_cast<std::size_t>(k - 3)](const Seen& one, const SeenModel& model) {
                return comparison.score_distance(d, one, model);
              });
        else
          result.detectors[static_cast<std::size_t>(k - 5)] =
              comparison.detector(static_cast<std::size_t>(k - 5));
      });
  if (sites) result.detectors[0].detector = "threshold", result.detectors[1].detector = "matched_filter";
  return result;
}

}  // namespace atomcam
