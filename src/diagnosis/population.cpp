#include "diagnosis/population.hpp"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <numbers>

#include "base/random.hpp"
#include "diagnosis/simulated_frames.hpp"
#include "simulation/parallel.hpp"

namespace atomcam {
namespace {

constexpr std::uint64_t optical_systems = 40;  // different draws of shared parameters

}  // namespace

Lab lab_of_stack(const Lab& lab, const StackPlan& plan, std::uint64_t stack_number,
                 std::optional<std::uint64_t> sensor_number) {
  const auto seed = [&](std::uint64_t number) { return plan.seed * 1000003 + number; };
  Lab own = lab;
  own.seed = seed(stack_number);
  own.serial = std::to_string(seed(sensor_number.value_or(stack_number)));
  return own;
}

std::unique_ptr<FrameSequence> simulate_stack(const Lab& lab, const StackPlan& plan,
                                              std::uint64_t stack_number, bool shutter_open,
                                              std::optional<std::uint64_t> sensor_number) {
  const Lab own = lab_of_stack(lab, plan, stack_number, sensor_number);
  return std::make_unique<SimulatedFrames>(own, shutter_open ? plan.frames : plan.dark_frames, shutter_open);
}

BatteryValues simulate_and_measure(const Lab& lab, const StackPlan& plan, std::uint64_t stack_number) {
  const auto light = simulate_stack(lab, plan, stack_number, true);
  if (plan.dark_frames.count() == 0) return measure(plan.model, *light, nullptr, plan.split);
  const auto darks = simulate_stack(lab, plan, stack_number, false);
  return measure(plan.model, *light, darks.get(), plan.split);
}

void Population::append(const Population& more) {
  outliers = more.outliers;
  unsteady = more.unsteady;
  const auto stack_rows = [](Eigen::MatrixXd& upper, const Eigen::MatrixXd& lower) {
    if (upper.rows() == 0) {
      upper = lower;
      return;
    }
    Eigen::MatrixXd both(upper.rows() + lower.rows(), upper.cols());
    both << upper, lower;
    upper = std::move(both);
  };
  stack_rows(draws, more.draws);
  stack_rows(whole, more.whole);
  stack_rows(part[0], more.part[0]);
  stack_rows(part[1], more.part[1]);
}

Eigen::MatrixXd draw_parameters(const std::vector<Uncertain>& open, int stacks, std::uint64_t seed,
                                std::uint64_t first) {
  Eigen::MatrixXd draws(stacks, static_cast<Eigen::Index>(open.size()));
  const PhiloxKey key = stream_key(seed, stream_id("diagnosis/draws"));
  for (int n = 0; n < stacks; ++n) {
    RandomStream own(key, first + static_cast<std::uint64_t>(n), 0);
    RandomStream group(key, (first + static_cast<std::uint64_t>(n)) % optical_systems, 1);
    for (std::size_t k = 0; k < open.size(); ++k) {
      RandomStream& random = open[k].shared ? group : own;
      const double u = (static_cast<double>(random()) + 0.5) * 0x1p-32,
                   v = (static_cast<double>(random()) + 0.5) * 0x1p-32;
      const double normal = std::sqrt(-2 * std::log(u)) * std::cos(2 * std::numbers::pi * v);
      double c = open[k].centre + open[k].width * normal;
      if (open[k].cycle == 0) {  // what goes round goes on: lines through the draws know of no jump
        // Reflected at the bounds, so that none is favoured.
        if (c > open[k].highest) c = std::max(open[k].lowest, 2 * open[k].highest - c);
        if (c < open[k].lowest) c = std::min(open[k].highest, 2 * open[k].lowest - c);
      }
      draws(n, static_cast<Eigen::Index>(k)) = c;
    }
  }
  return draws;
}

Population simulate_population(const Lab& lab, const std::vector<Uncertain>& open, int stacks,
                               const StackPlan& plan, std::uint64_t first, const Eigen::MatrixXd* given,
                               const std::function<void(int)>& progress) {
  Population population;
  population.draws = given ? *given : draw_parameters(open, stacks, plan.seed, first);
  const std::vector<StatisticDeclaration> declared = battery(plan.model, plan.dark_frames.count() > 0);
  const auto statistics = std::ssize(declared);
  for (const StatisticDeclaration& one : declared) {
    population.outliers.push_back(one.outliers);
    population.unsteady.push_back(one.unsteady);
  }
  population.whole.resize(stacks, statistics);
  population.part[0].resize(stacks, statistics);
  population.part[1].resize(stacks, statistics);
  ResultKey key;
  key.add("population").add(plan.seed).add(first).add(population.draws);
  for (const Uncertain& one : open) key.add(one.name);
  if (plan.kept)
    if (auto found = plan.kept->find(key); found && found->size() == 3 && found->front().rows() == stacks &&
                                           found->front().cols() == statistics) {
      population.whole = std::move((*found)[0]);
      population.part[0] = std::move((*found)[1]);
      population.part[1] = std::move((*found)[2]);
      if (progress) progress(stacks);
      return population;
    }
  std::atomic<int> done{0};
  parallel_for(stacks, plan.threads, 1, [&](int n) {
    Lab drawn = lab;
    for (std::size_t k = 0; k < open.size(); ++k)
      open[k].apply(drawn, open[k].within(population.draws(n, static_cast<Eigen::Index>(k))));
    drawn.place_sites();
    const BatteryValues values = simulate_and_measure(drawn, plan, first + static_cast<std::uint64_t>(n));
    const auto row = [&](const std::vector<double>& v) {
      return Eigen::Map<const Eigen::RowVectorXd>(v.data(), static_cast<Eigen::Index>(v.size()));
    };
    population.whole.row(n) = row(values.whole);
    population.part[0].row(n) = row(values.part[0]);
    population.part[1].row(n) = row(values.part[1]);
    if (plan.check_in) plan.check_in();
    const int count = ++done;
    if (progress) progress(count);
  });
  if (plan.kept) plan.kept->keep(key, {population.whole, population.part[0], population.part[1]});
  return population;
}

}  // namespace atomcam
