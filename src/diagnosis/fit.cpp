#include "diagnosis/fit.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

namespace atomcam {
namespace {

constexpr double winsor = 4;        // deviations beyond this count as this in a step
constexpr double trust = 2.5;       // widths of an effect's parameter that a step may go
constexpr double plain_trust = 5;   // and of a calibration's
constexpr double prior_widths = 6;  // of a step, in widths: keeps what the data do not say where it is

// Widths shrink where the mean square of the deviations is below this, or a parameter has stayed where it is
// for some rounds: over wide draws statistics bend, and what looks far away may only be that.
constexpr double near = 1.3;
constexpr int still_rounds = 2;

// A way may lead over a hill, as the calibration follows the effects a step later. By how much less likely
// frames are than at the best place, in parts of its distance:
constexpr int uphill_rounds = 2;
constexpr double hill = 0.3, lost = 2;  // no hill is as high as the latter
constexpr double as_far = 0.2;          // is hardly another place

// Far from the real stack, where a step leads on it leads far: rounds in a row that gain less than this part
// are the end of the way. Near it they first come closer with smaller widths.
constexpr int plateau_rounds = 3, near_plateau_rounds = 5;
constexpr double plateau_gain = 0.03;
// But a parameter that goes on the same way, by this part of its range in each of two rounds, is on its way.
constexpr double stride = 0.02;

/// Stacks of a round, for so many parameters. Far away a rough direction does: the next round has another.
int stacks_of_round(int parameters, double distance) {
  constexpr double far = 2;
  return distance > far ? 6 + 2 * parameters : 10 + 3 * parameters;
}

/// How the statistics follow the effects' parameters about the centre, from a few stacks: straight lines.
struct Local {
  Eigen::VectorXd middle, noise;  // of the statistics at the centre; of one stack about the lines
  Eigen::MatrixXd slopes;         // [statistic, effect parameter], per unit of its coordinate
};

Local straight_lines(const Population& population, const std::vector<Uncertain>& open, Eigen::Index from,
                     const Eigen::VectorXd& unit) {
  const Eigen::Index n = population.stacks(), p = population.whole.cols(),
                     m = static_cast<Eigen::Index>(open.size()) - from;
  Eigen::MatrixXd design = Eigen::MatrixXd::Ones(n, m + 1);
  for (Eigen::Index j = 0; j < m; ++j) {
    const Uncertain& one = open[static_cast<std::size_t>(from + j)];
    design.col(j + 1) = (population.draws.col(from + j).array() - one.centre) / one.width;
    if (one.cycle > 0)
      for (Eigen::Index k = 0; k < n; ++k)
        design(k, j + 1) -= one.cycle / one.width * std::round(design(k, j + 1) * one.width / one.cycle);
  }
  Eigen::MatrixXd normal = design.transpose() * design;
  normal.diagonal().tail(m).array() += 0.3;
  const Eigen::MatrixXd inverse = normal.ldlt().solve(Eigen::MatrixXd::Identity(m + 1, m + 1));
  Local local;
  local.middle.setZero(p);
  local.noise.setZero(p);
  local.slopes.setZero(p, m);
  for (Eigen::Index i = 0; i < p; ++i) {
    if (!(unit(i) > 0)) continue;
    Eigen::VectorXd y = population.whole.col(i);
    double known = 0, sum = 0;
    for (Eigen::Index k = 0; k < n; ++k)
      if (std::isfinite(y(k))) known += 1, sum += y(k);
    if (known < 0.7 * static_cast<double>(n)) continue;
    for (Eigen::Index k = 0; k < n; ++k)
      if (!std::isfinite(y(k))) y(k) = sum / known;
    Eigen::VectorXd line = inverse * (design.transpose() * y);
    for (int round = 0; round < 2; ++round) {  // single stacks must not tilt the lines
      const Eigen::VectorXd predicted = design * line, rest = y - predicted;
      const double limit =
          2.5 * std::max(0.3 * unit(i), 1.25 * rest.cwiseAbs().mean());  // mean |x| is 0.8 sigma
      line = inverse * (design.transpose() * (predicted + rest.cwiseMax(-limit).cwiseMin(limit)));
    }
    local.middle(i) = line(0);
    local.noise(i) = std::sqrt((y - design * line).squaredNorm() /
                               static_cast<double>(std::max<Eigen::Index>(1, n - m - 1)));
    // Slopes of hundreds of statistics that do not know of the effect would together weigh more than the few
    // that do: each is shrunk by what it may be by chance.
    for (Eigen::Index j = 0; j < m; ++j) {
      const double chance = 2 * local.noise(i) * std::sqrt(inverse(j + 1, j + 1));
      local.slopes(i, j) =
          beyond_chance(line(j + 1), chance) / open[static_cast<std::size_t>(from + j)].width;
    }
  }
  return local;
}

class Fitter {
 public:
  Fitter(const Model& model, const FitGround& ground, const StackPlan& plan)
      : statistics_(as_vector(ground.real.values->whole)),
        unit_(ground.plain->standard->deviation()),
        plain_slopes_(ground.plain->standard->slopes()),
        discrepancy_(allowed_discrepancy(*ground.plain, *ground.real.values, plan, model.explains)),
        correlation_(*ground.plain->correlation) {}

  struct Step {
    Eigen::VectorXd delta, error;  // of all open parameters, coordinates
    double distance = 0;           // before the step, calibration's parameters at their best
    double unlikeliness = 0;       // there: the distance and what scatter costs
  };

  Step step(const Local& local, const std::vector<Uncertain>& open, Eigen::Index from) const {
    const Eigen::Index p = statistics_.size(), m = static_cast<Eigen::Index>(open.size());
    // Deviations in units of a stack's scatter; one that is not known to be straight counts less.
    Eigen::VectorXd z = Eigen::VectorXd::Zero(p), scale = Eigen::VectorXd::Zero(p);
    double scatter = 0;
    for (Eigen::Index i = 0; i < p; ++i) {
      if (!(unit_(i) > 0) || !std::isfinite(statistics_(i)) || local.noise(i) == 0) continue;
      scale(i) = 1 / std::hypot(std::max(unit_(i), local.noise(i)), discrepancy_(i));
      scatter -= 2 * std::log(scale(i) * std::hypot(unit_(i), discrepancy_(i)));
      z(i) = (statistics_(i) - local.middle(i)) * scale(i);
    }
    Eigen::MatrixXd slopes(p, m);
    for (Eigen::Index j = 0; j < m; ++j) {
      const double width = open[static_cast<std::size_t>(j)].width;
      slopes.col(j) = (j < from ? Eigen::VectorXd(plain_slopes_.col(j)) : local.slopes.col(j - from))
                          .cwiseProduct(scale) *
                      width;
    }
    const Eigen::MatrixXd weighted = correlation_.weighed(slopes);
    Eigen::MatrixXd information = slopes.transpose() * weighted;
    information.diagonal().array() += 1 / (prior_widths * prior_widths);
    const auto inverse = information.ldlt();
    Step out;
    // First calibration's parameters alone: how far the effects' centres are from the real stack.
    {
      const Eigen::MatrixXd own = information.topLeftCorner(from, from);
      const auto own_inverse = own.ldlt();
      Eigen::VectorXd delta = Eigen::VectorXd::Zero(from);
      for (int round = 0; round < 5 && from > 0; ++round) {
        const Eigen::VectorXd rest = z - slopes.leftCols(from) * delta;
        delta +=
            own_inverse.solve(weighted.leftCols(from).transpose() * rest.cwiseMax(-winsor).cwiseMin(winsor));
        delta = delta.cwiseMax(-plain_trust).cwiseMin(plain_trust);
      }
      out.distance = compressed(z - slopes.leftCols(from) * delta).squaredNorm() / static_cast<double>(p);
      out.unlikeliness = out.distance + scatter / static_cast<double>(p);
    }
    Eigen::VectorXd delta = Eigen::VectorXd::Zero(m);
    // Far from the real stack the large deviations show the way, near it they are somebody else's.
    const double limit = winsor * std::max(1.0, out.distance);
    for (int round = 0; round < 12; ++round) {
      const Eigen::VectorXd rest = z - slopes * delta;
      delta += inverse.solve(weighted.transpose() * rest.cwiseMax(-limit).cwiseMin(limit));
      for (Eigen::Index j = 0; j < m; ++j) {
        const double most = j < from ? plain_trust : trust;
        delta(j) = std::clamp(delta(j), -most, most);
      }
    }
    const Eigen::VectorXd variance = inverse.solve(Eigen::MatrixXd::Identity(m, m)).diagonal().cwiseMax(0);
    out.delta.resize(m);
    out.error.resize(m);
    for (Eigen::Index j = 0; j < m; ++j) {
      const double width = open[static_cast<std::size_t>(j)].width;
      out.delta(j) = delta(j) * width;
      out.error(j) = std::sqrt(variance(j)) * width;
    }
    return out;
  }

  const Eigen::VectorXd& unit() const { return unit_; }

 private:
  Eigen::VectorXd statistics_, unit_;
  Eigen::MatrixXd plain_slopes_;
  Eigen::VectorXd discrepancy_;
  const Correlation& correlation_;
};

}  // namespace

double plain_distance(const FitGround& ground, const StackPlan& plan,
                      const std::vector<std::string>& explains) {
  const Model& plain = *ground.plain;
  const Eigen::VectorXd z = tolerated(plain.z, plain.standard->deviation(),
                                      allowed_discrepancy(plain, *ground.real.values, plan, explains));
  return compressed(z).squaredNorm() / static_cast<double>(z.size());
}

void fit(Model& model, const FitGround& ground, int rounds, const StackPlan& plan, std::uint64_t first) {
  const Fitter fitter(model, ground, plan);
  const Eigen::Index from = model.first_effect_parameter;
  const auto effects = static_cast<int>(model.open.size()) - static_cast<int>(from);
  double last = model.unlikeliness, plateau = model.unlikeliness;
  int uphill = 0, on_plateau = 0;
  std::vector<double> ways(model.open.size());  // of the last round, in parts of the ranges
  std::vector<int> still(model.open.size());    // rounds with steps that are small beside the widths
  for (int round = 0; round < rounds; ++round) {
    if (on_plateau >= (model.distance < near ? near_plateau_rounds : plateau_rounds)) break;
    const std::uint64_t number = first + static_cast<std::uint64_t>(round) * 10000;
    recalibrate(model, ground.real, plan, number + 5000);
    // Calibration's parameters stand still: what they do is known from the plain model.
    std::vector<Uncertain> drawn = model.open;
    for (Eigen::Index k = 0; k < from; ++k) drawn[static_cast<std::size_t>(k)].width = 0;
    const Population population =
        simulate_population(model.lab, drawn, stacks_of_round(effects, model.distance), plan, number);
    const Local local = straight_lines(population, drawn, from, fitter.unit());
    const Fitter::Step step = fitter.step(local, model.open, from);
    ++on_plateau;
    if (step.unlikeliness < plateau - plateau_gain * step.distance) {
      plateau = step.unlikeliness;
      on_plateau = 0;
    }
    last = step.unlikeliness;
    const double worse = (step.unlikeliness - model.unlikeliness) / model.distance;
    if (worse > hill) ++uphill;
    const int patience = model.distance > near ? uphill_rounds : 0;
    if (uphill > patience || worse > lost) {
      // Back: part of the way only, and a closer look.
      uphill = 0;
      for (std::size_t k = 0; k < model.open.size(); ++k) {
        Uncertain& one = model.open[k];
        one.centre = model.nearest[k].centre + 0.4 * (one.centre - model.nearest[k].centre);
        if (static_cast<Eigen::Index>(k) >= from) one.width *= 0.6;
      }
      continue;
    }
    if (step.unlikeliness < model.unlikeliness) {
      model.nearest = model.open;
      model.distance = step.distance;
      model.unlikeliness = step.unlikeliness;
      uphill = 0;
    }
    bool settled = true, on_its_way = false;
    for (std::size_t k = 0; k < model.open.size(); ++k) {
      Uncertain& one = model.open[k];
      const auto at = static_cast<Eigen::Index>(k);
      if (one.width <= 0 || one.held) continue;
      double moved = one.centre + step.delta(at);
      if (at < from) {
        one.move_to(moved);
        one.steady = 0;  // the next recalibration sees this step, not its own last one
        one.pull = 0;
        continue;
      }
      if (one.cycle == 0) {
        one.make_room_at(moved);
        moved = one.within(moved);
      }
      const double range = one.highest - one.lowest;
      const double went = std::fabs(moved - one.centre);
      if (went > std::max(1.5 * step.error(at), 0.004 * range)) settled = false;
      const double way = one.cycle > 0 ? 0 : (moved - one.centre) / range;
      double& before = ways[k];
      if (std::min(std::fabs(way), std::fabs(before)) > stride && (way > 0) == (before > 0))
        on_its_way = true;
      before = way;
      one.centre = moved;
      if (went > 1.5 * one.width)
        one.width = std::min(1.5 * one.width, 0.15 * range);
      else if (went < 0.7 * one.width && (step.distance < near || ++still[k] >= still_rounds))
        one.width = std::clamp(std::max(1.5 * step.error(at), 0.01 * range), 0.5 * one.width, one.width);
    }
    if (on_its_way) on_plateau = std::max(0, on_plateau - 1);
    if (settled && round >= 1 && step.distance < near) break;
  }
  if (last > model.unlikeliness + as_far * model.distance) model.open = model.nearest;
}

}  // namespace atomcam
