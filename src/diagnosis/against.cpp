#include "diagnosis/against.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>

#include "base/error.hpp"
#include "calibration/stack_check.hpp"
#include "diagnosis/changed_parameter.hpp"
#include "diagnosis/evidence.hpp"
#include "diagnosis/halves.hpp"
#include "diagnosis/sentence.hpp"
#include "diagnosis/where.hpp"
#include "simulation/parallel.hpp"

namespace atomcam {
namespace {

constexpr std::size_t least_frames = 16;  // of either stack
constexpr double told = 0.25;             // of a difference that a changed parameter has to make to be named

class Joined : public FrameSequence {
 public:
  Joined(const FrameSequence& one, const FrameSequence& other) : one_(one), other_(other) {}
  std::size_t frames() const override { return one_.frames() + other_.frames(); }
  Shape shape() const override { return one_.shape(); }
  void visit(const std::function<void(std::size_t, const CountImage&)>& take) const override {
    one_.visit(take);
    other_.visit([&](std::size_t n, const CountImage& frame) { take(one_.frames() + n, frame); });
  }

 private:
  const FrameSequence &one_, &other_;
};

void check(const FrameSequence& frames, const FrameSequence& against) {
  const Shape a = frames.shape(), b = against.shape();
  if (!(a == b))
    throw Error("against", fmt::format("has {} rows and {} columns, the frames {} and {}", b.rows, b.columns,
                                       a.rows, a.columns));
  const auto one = [](const FrameSequence& stack, const char* place) {
    if (stack.frames() < least_frames)
      throw Error(place, fmt::format("{} frames are too few to compare, {} or more are needed",
                                     stack.frames(), least_frames));
    check_stack(sum_stack(stack), place);
  };
  one(frames, "frames");
  one(against, "against");
}

/// Pairs of simulated stacks of one lab and one sensor.
struct Pairs {
  Population first;        // the stacks that stand for the frames
  Population differences;  // frames less the other stack; its draws are constant: nothing is estimated
  Eigen::MatrixXd halves;  // of the first stacks
};

class Comparison {
 public:
  Comparison(const ChosenFrames& frames, const ChosenFrames& against, const DiagnosisOptions& options)
      : frames_(frames), against_(against), options_(options) {}

  Diagnosis run(const Notes& notes, const FrameSequence* darks) {
    const auto start = std::chrono::steady_clock::now();
    result_.against = true;
    check(frames_, against_);
    tell("calibrating", 0);
    result_.calibration = calibrate_both(notes, darks);
    plan_.model = result_.calibration.model;
    plan_.frames = result_.frames = frames_.choice();
    result_.against_frames = against_.choice();
    plan_.seed = options_.seed;
    plan_.threads = options_.threads;
    plan_.check_in = options_.check_in;
    plan_.split.block = block_of_halves(plan_.frames.count());
    compare();
    result_.plain_lab = result_.lab = result_.calibration.lab;
    tell("done", 1);
    result_.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    return std::move(result_);
  }

 private:
  void tell(std::string_view step, double done) const {
    if (options_.progress) options_.progress(step, done);
  }

  Calibration calibrate_both(const Notes& notes, const FrameSequence* darks) const {
    const Joined both(frames_, against_);
    CalibrationInput input;
    input.notes = notes;
    input.frames = &both;
    input.darks = darks;
    options_.beside.add_to(input);
    try {
      return calibrate(input);
    } catch (const Error&) {
      // What changed between them may be too much for one calibration.
      input.frames = &frames_;
      return calibrate(input);
    }
  }

  Pairs simulate(const std::vector<Uncertain>& open, int count) const {
    StackPlan other = plan_;
    other.frames = against_.choice();
    Pairs pairs;
    pairs.first.draws = draw_parameters(open, count, plan_.seed, 0);
    pairs.differences.draws = Eigen::MatrixXd::Zero(count, 1);
    const auto statistics = static_cast<Eigen::Index>(battery(plan_.model, false).size());
    for (Eigen::MatrixXd* matrix : {&pairs.first.whole, &pairs.differences.whole, &pairs.halves})
      matrix->resize(count, statistics);
    std::atomic<int> done{0};
    parallel_for(count, plan_.threads, 1, [&](int n) {
      Lab lab = result_.calibration.lab;
      for (std::size_t k = 0; k < open.size(); ++k)
        open[k].apply(lab, pairs.first.draws(n, static_cast<Eigen::Index>(k)));
      lab.place_sites();
      const auto number = static_cast<std::uint64_t>(n);
      const auto one = simulate_stack(lab, plan_, 2 * number, true);
      const auto two = simulate_stack(lab, other, 2 * number + 1, true, 2 * number);
      const BatteryValues a = measure(plan_.model, *one, nullptr, plan_.split);
      const BatteryValues b = measure(plan_.model, *two, nullptr, plan_.split);
      pairs.first.whole.row(n) = as_vector(a.whole).transpose();
      pairs.differences.whole.row(n) = (as_vector(a.whole) - as_vector(b.whole)).transpose();
      pairs.halves.row(n) = (as_vector(a.part[0]) - as_vector(a.part[1])).transpose();
      if (plan_.check_in) plan_.check_in();
      tell("stacks that do not differ", 0.05 + 0.6 * (++done) / count);
    });
    return pairs;
  }

  void compare() {
    const double cost = static_cast<double>(frames_.frames() + against_.frames()) *
                        static_cast<double>(frames_.shape().pixels());
    const int count = cost > 5e6 ? 120 : 200, choices = cost > 3e7 ? 24 : 60;
    const std::vector<StatisticDeclaration> declarations = battery(plan_.model, false);
    const std::vector<Uncertain> open = calibration_uncertainty(result_.calibration);
    const Pairs pairs = simulate(open, count);
    const Standard standard(pairs.differences, Part::whole);
    tell("halves of the stacks", 0.65);
    const Eigen::MatrixXd of_frames = differences_of_halves(frames_, plan_, choices);
    tell("halves of the stacks", 0.8);
    const Eigen::MatrixXd of_against = differences_of_halves(against_, plan_, choices);
    const Eigen::VectorXd factor =
        unrest(of_frames, of_against, scatter_of(pairs.halves), standard.deviation());
    tell("comparing", 0.95);
    const BatteryValues one = measure(plan_.model, frames_, nullptr, plan_.split);
    const BatteryValues two = measure(plan_.model, against_, nullptr, plan_.split);
    const Eigen::VectorXd z =
        standard.judge(as_vector(one.whole) - as_vector(two.whole)).cwiseQuotient(factor);

    // As unlikely as among simulated stacks and as among halves of the real ones: the likelier of both.
    std::vector<bool> unsteady;
    for (const StatisticDeclaration& each : declarations) unsteady.push_back(each.unsteady);
    result_.p_gap = std::max(OmnibusTest(standard.own(), unsteady).p_value(z),
                             OmnibusTest(in_own_scatter(of_frames, of_against), unsteady).p_value(z));
    result_.p_after = result_.p_gap;
    GapClosed& gap = result_.gap;
    gap.metric = "mean square of the 12 largest differences of the battery between the two stacks";
    gap.before = gap.after = gap_of(z);
    gap.floor = Floor(standard.own()).at(0.5);
    result_.where = ranked_differences(declarations, z, z, z, standard.own());
    if (result_.p_gap >= gap_level) {
      result_.verdict = Verdict::no_gap;
      result_.sentence = fmt::format("The two stacks do not differ (p = {:.2g}).", result_.p_gap);
      return;
    }
    result_.verdict = Verdict::unexplained;
    Unexplained& rest = result_.unexplained = unexplained_of(declarations, z);
    const ChangedParameter changed =
        changed_parameter(pairs.first, open, z, standard.deviation().cwiseProduct(factor), standard.own());
    if (changed.closed > told) {
      rest.stage = changed.stage;
      rest.looks_like +=
          fmt::format("; {:.0f} % of it as if in the frames {}", 100 * changed.closed, changed.words);
    }
    result_.sentence = fmt::format("The two stacks differ (p = {:.1g}), most likely in the {} stage: {}.",
                                   result_.p_gap, rest.stage, rest.looks_like);
  }

  /// By how much more the real stacks' halves differ than simulated ones do, at least 1. Where simulated
  /// halves never differ (no event of its kind), in the deviations that count then.
  Eigen::VectorXd unrest(const Eigen::MatrixXd& of_frames, const Eigen::MatrixXd& of_against,
                         const Eigen::VectorXd& simulated, const Eigen::VectorXd& deviation) const {
    const auto a = static_cast<double>(frames_.frames()), b = static_cast<double>(against_.frames());
    const Eigen::VectorXd one = scatter_of(of_frames), other = scatter_of(of_against);
    Eigen::VectorXd factor = Eigen::VectorXd::Ones(simulated.size());
    for (Eigen::Index i = 0; i < factor.size(); ++i) {
      const double unit = simulated(i) > 0 ? simulated(i) : deviation(i);
      if (!(unit > 0)) continue;
      // Half of the other stack has another number of frames than half of this one.
      const double mine = one(i) / unit, its = other(i) / unit * std::sqrt(b / a);
      const double both = std::sqrt((mine * mine * b + its * its * a) / (a + b));
      // A rare event is in one half or the other, whole.
      factor(i) = std::max(1.0, simulated(i) > 0 ? both : std::max(mine, its));
    }
    return factor;
  }

  static Eigen::MatrixXd in_own_scatter(const Eigen::MatrixXd& of_frames, const Eigen::MatrixXd& of_against) {
    Eigen::MatrixXd rows(of_frames.rows() + of_against.rows(), of_frames.cols());
    Eigen::Index at = 0;
    for (const Eigen::MatrixXd* stack : {&of_frames, &of_against}) {
      const Eigen::VectorXd scatter = scatter_of(*stack);
      for (Eigen::Index n = 0; n < stack->rows(); ++n, ++at)
        for (Eigen::Index i = 0; i < rows.cols(); ++i) {
          const double value = (*stack)(n, i);
          rows(at, i) = scatter(i) > 0 && std::isfinite(value) ? value / scatter(i) : 0;
        }
    }
    return rows;
  }

  const ChosenFrames &frames_, &against_;
  const DiagnosisOptions& options_;
  StackPlan plan_;
  Diagnosis result_;
};

}  // namespace

Diagnosis diagnose_against(const Notes& notes, const FrameSequence& frames, const FrameSequence& against,
                           const FrameSequence* darks, const DiagnosisOptions& options) {
  const ChosenFrames one(frames, options.all_frames), other(against, options.all_frames);
  return Comparison(one, other, options).run(notes, darks);
}

}  // namespace atomcam
