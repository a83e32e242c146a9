#pragma once
// Simulated stacks of a model whose open parameters are drawn anew for each, and what the battery measures
// in them.

#include <Eigen/Dense>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string_view>
#include <vector>

#include "analysis/battery.hpp"
#include "base/random.hpp"
#include "data/kept_results.hpp"
#include "diagnosis/chosen_frames.hpp"
#include "diagnosis/uncertain.hpp"

namespace atomcam {

/// How every stack is simulated and measured: the frames of the real one that are looked at.
struct StackPlan {
  StackModel model;  // measures real and simulated stacks alike
  FrameChoice frames, dark_frames;
  BatterySplit split;
  std::uint64_t seed = 1;
  int threads = 1;
  const KeptResults* kept = nullptr;  // null: everything is simulated
  std::function<void()> check_in;     // after every stack, on its thread; what it throws ends the work
};

/// The first stack number of a step: far from those of all others, and the same whatever else is done.
inline std::uint64_t numbers_of(std::string_view step) {
  return stream_id(step) & ~std::uint64_t{0xFFFFFF};
}

/// The lab of one simulated stack, with a seed of its own. Stacks have a sensor each, or, where
/// `sensor_number` is given, that of the stack of this number.
Lab lab_of_stack(const Lab& lab, const StackPlan& plan, std::uint64_t stack_number,
                 std::optional<std::uint64_t> sensor_number = {});
/// The light (or dark) frames of such a stack.
std::unique_ptr<FrameSequence> simulate_stack(const Lab& lab, const StackPlan& plan,
                                              std::uint64_t stack_number, bool shutter_open,
                                              std::optional<std::uint64_t> sensor_number = {});
BatteryValues simulate_and_measure(const Lab& lab, const StackPlan& plan, std::uint64_t stack_number);

/// The battery's values as a vector.
inline Eigen::VectorXd as_vector(const std::vector<double>& values) {
  return Eigen::Map<const Eigen::VectorXd>(values.data(), static_cast<Eigen::Index>(values.size()));
}

/// A row per stack.
struct Population {
  Eigen::MatrixXd draws;                 // [stack, open parameter], coordinates
  Eigen::MatrixXd whole;                 // [stack, statistic]
  Eigen::MatrixXd part[2];               // of the interleaved parts
  std::vector<bool> outliers, unsteady;  // per statistic, as declared; empty: none is
  Eigen::Index stacks() const { return whole.rows(); }
  void append(const Population& more);
};

/// `draw(stack, parameter)` gives coordinates; the default draws normally about the centres. `first` numbers
/// the stacks (their seeds and serial numbers).
Population simulate_population(const Lab& lab, const std::vector<Uncertain>& open, int stacks,
                               const StackPlan& plan, std::uint64_t first,
                               const Eigen::MatrixXd* draws = nullptr,
                               const std::function<void(int)>& progress = {});

/// Normal draws about the centres, by stack number: the same number gives the same draw.
Eigen::MatrixXd draw_parameters(const std::vector<Uncertain>& open, int stacks, std::uint64_t seed,
                                std::uint64_t first);

}  // namespace atomcam
