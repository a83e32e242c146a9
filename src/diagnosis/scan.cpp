#include "diagnosis/scan.hpp"

#include <algorithm>
#include <cmath>

#include "base/random.hpp"
#include "simulation/parallel.hpp"

namespace atomcam {
namespace {

/// Uniform over the ranges, evenly in each (a Latin hypercube of `stacks`).
Eigen::MatrixXd spread_draws(const std::vector<Uncertain>& open, int stacks, std::uint64_t seed,
                             std::uint64_t first) {
  Eigen::MatrixXd draws(stacks, static_cast<Eigen::Index>(open.size()));
  RandomStream random(seed, stream_id("diagnosis/scan"), first, 0);
  const auto uniform = [&] { return (static_cast<double>(random()) + 0.5) * 0x1p-32; };
  for (std::size_t k = 0; k < open.size(); ++k) {
    std::vector<int> order(static_cast<std::size_t>(stacks));
    for (int n = 0; n < stacks; ++n) order[static_cast<std::size_t>(n)] = n;
    if (k > 0)
      for (std::size_t n = order.size(); n > 1; --n)
        std::swap(order[n - 1], order[static_cast<std::size_t>(uniform() * static_cast<double>(n))]);
    for (int n = 0; n < stacks; ++n)
      draws(n, static_cast<Eigen::Index>(k)) =
          open[k].lowest +
          (open[k].highest - open[k].lowest) * (order[static_cast<std::size_t>(n)] + uniform()) / stacks;
  }
  return draws;
}

}  // namespace

std::vector<const EffectDeclaration*> candidates(const Model& before,
                                                 const std::vector<std::string>& excluded) {
  std::vector<const EffectDeclaration*> list;
  const CameraKind kind = before.lab.kind();
  const bool sites = !before.lab.scene.sites.empty();
  const auto has = [](const std::vector<std::string>& names, const std::string& name) {
    return std::find(names.begin(), names.end(), name) != names.end();
  };
  for (const EffectDeclaration& effect : effect_catalogue()) {
    if (!(kind == CameraKind::emccd ? effect.emccd : effect.qcmos)) continue;
    if (has(excluded, effect.name) || has(before.effects, effect.name)) continue;
    if (before.lab.effects.contains(effect.name)) continue;  // the notes have it
    if (!sites && effect.plane == Plane::scene) continue;
    list.push_back(&effect);
  }
  return list;
}

void explore(Scan& scan, const Model& before, int stacks, const StackPlan& plan, std::uint64_t first,
             const std::function<void(int)>& progress) {
  if (scan.open.empty()) scan.open = effect_prior(*scan.effect, before.lab);
  Eigen::MatrixXd own;
  if (!scan.emulator) {
    own = spread_draws(scan.open, stacks, plan.seed, first);
  } else {
    std::vector<Uncertain> near = scan.open;
    for (std::size_t k = 0; k < near.size(); ++k) {
      near[k].centre = scan.best(static_cast<Eigen::Index>(k));
      near[k].width = scan.width(static_cast<Eigen::Index>(k));
    }
    own = draw_parameters(near, stacks, plan.seed + 17, first);
  }
  // The model's own open parameters stay at their centres where making them costs much, else they are drawn.
  std::vector<Uncertain> all = before.open;
  for (Uncertain& one : all)
    if (one.shared) one.width = 0;
  Eigen::MatrixXd draws(stacks, static_cast<Eigen::Index>(all.size() + scan.open.size()));
  draws.leftCols(static_cast<Eigen::Index>(all.size())) = draw_parameters(all, stacks, plan.seed + 23, first);
  draws.rightCols(own.cols()) = own;
  all.insert(all.end(), scan.open.begin(), scan.open.end());
  const Population population = simulate_population(before.lab, all, stacks, plan, first, &draws, progress);
  Eigen::MatrixXd values(stacks, population.whole.cols());
  for (int n = 0; n < stacks; ++n)
    values.row(n) = compressed(before.standard->judge(population.whole.row(n).transpose())).transpose();
  const Eigen::Index old = scan.draws.rows();
  scan.draws.conservativeResize(old + stacks, own.cols());
  scan.draws.bottomRows(stacks) = own;
  scan.values.conservativeResize(old + stacks, values.cols());
  scan.values.bottomRows(stacks) = values;
  scan.emulator = std::make_unique<Emulator>(scan.open, scan.draws, scan.values);
}

void match(Scan& scan, const Model& before, const Eigen::VectorXd& z) {
  const Eigen::VectorXd real = compressed(z);
  const Correlation correlation(before.standard->own());
  const auto dimension = static_cast<Eigen::Index>(scan.open.size());
  // Scatter of the stacks about the emulator beyond the model's own, where the effect is on.
  Eigen::VectorXd extra = Eigen::VectorXd::Zero(real.size());
  for (Eigen::Index n = 0; n < scan.draws.rows(); ++n) {
    const auto prediction = (*scan.emulator)(scan.draws.row(n).transpose());
    extra.array() += (scan.values.row(n).transpose() - prediction.mean).array().square() /
                     static_cast<double>(scan.draws.rows());
  }
  extra = (extra.array() * 1.5 - 1).max(0.0).matrix();
  scan.extra = extra;
  Eigen::MatrixXd covariance = correlation.matrix;
  covariance.diagonal() += extra;
  const Eigen::MatrixXd inverse =
      covariance.ldlt().solve(Eigen::MatrixXd::Identity(covariance.rows(), covariance.cols()));
  const double log_determinant = covariance.ldlt().vectorD().array().max(1e-12).log().sum();
  const auto plain_solver = correlation.matrix.ldlt();
  const double before_log =
      -0.5 * real.dot(plain_solver.solve(real)) - 0.5 * plain_solver.vectorD().array().max(1e-12).log().sum();
  const auto evidence = [&](const Eigen::VectorXd& at) {
    const auto prediction = (*scan.emulator)(at);
    // What the emulator does not know counts as scatter; to first order only, so that the inverse serves all.
    const Eigen::VectorXd miss =
        (real - prediction.mean)
            .cwiseQuotient((1 + prediction.variance.array() / (1 + extra.array())).sqrt().matrix());
    return -0.5 * miss.dot(inverse * miss) - 0.5 * log_determinant -
           0.5 * (prediction.variance.array() / (1 + extra.array())).log1p().sum();
  };
  std::vector<std::pair<double, Eigen::VectorXd>> tried;
  const auto attempt = [&](const Eigen::VectorXd& at) { tried.emplace_back(evidence(at), at); };
  RandomStream random(1, stream_id("diagnosis/match"), 0, 0);
  const auto uniform = [&] { return (static_cast<double>(random()) + 0.5) * 0x1p-32; };
  for (Eigen::Index n = 0; n < scan.draws.rows(); ++n) attempt(scan.draws.row(n).transpose());
  for (int n = 0; n < 400; ++n) {
    Eigen::VectorXd at(dimension);
    for (Eigen::Index k = 0; k < dimension; ++k) {
      const Uncertain& one = scan.open[static_cast<std::size_t>(k)];
      at(k) = one.lowest + (one.highest - one.lowest) * uniform();
    }
    attempt(at);
  }
  for (const double step : {0.15, 0.06, 0.025}) {
    const auto top = std::max_element(tried.begin(), tried.end(),
                                      [](const auto& a, const auto& b) { return a.first < b.first; });
    const Eigen::VectorXd centre = top->second;
    for (int n = 0; n < 120; ++n) {
      Eigen::VectorXd at = centre;
      for (Eigen::Index k = 0; k < dimension; ++k) {
        const Uncertain& one = scan.open[static_cast<std::size_t>(k)];
        at(k) += (one.highest - one.lowest) * step * (uniform() + uniform() + uniform() - 1.5);
        if (one.cycle > 0)
          at(k) -= one.cycle * std::floor((at(k) - one.lowest) / one.cycle);
        else
          at(k) = std::clamp(at(k), one.lowest, one.highest);
      }
      attempt(at);
    }
  }
  const auto top = std::max_element(tried.begin(), tried.end(),
                                    [](const auto& a, const auto& b) { return a.first < b.first; });
  scan.best = top->second;
  scan.log_likelihood = top->first - before_log;
  scan.predicted = (*scan.emulator)(scan.best).mean;
  // Widths from how fast the evidence falls.
  Eigen::VectorXd squares = Eigen::VectorXd::Zero(dimension);
  double weights = 0;
  for (const auto& [value, at] : tried) {
    const double weight = std::exp(std::max(-60.0, (value - top->first) / 4));
    Eigen::VectorXd off = at - scan.best;
    for (Eigen::Index k = 0; k < dimension; ++k) {
      const double cycle = scan.open[static_cast<std::size_t>(k)].cycle;
      if (cycle > 0) off(k) -= cycle * std::round(off(k) / cycle);
    }
    squares += weight * off.cwiseAbs2();
    weights += weight;
  }
  scan.width.resize(dimension);
  for (Eigen::Index k = 0; k < dimension; ++k) {
    const Uncertain& one = scan.open[static_cast<std::size_t>(k)];
    const double range = one.highest - one.lowest;
    scan.width(k) = std::clamp(1.5 * std::sqrt(squares(k) / weights), 0.015 * range, 0.25 * range);
  }
}

namespace {

/// Logarithmic likelihood of independent statistics.
double independent(const Eigen::VectorXd& real, const Eigen::VectorXd& mean,
                   const Eigen::VectorXd& variance) {
  const Eigen::ArrayXd wide = 1 + variance.array();
  return -0.5 * ((real - mean).array().square() / wide).sum() - 0.5 * wide.log().sum();
}
Eigen::VectorXd expanded(const Eigen::VectorXd& y) {
  return y.unaryExpr([](double v) { return 2 * std::sinh(v / 2); });
}

}  // namespace

std::vector<PairMatch> match_pairs(const std::vector<Scan>& scans, std::size_t leaders,
                                   const Eigen::VectorXd& z, int threads) {
  const Eigen::VectorXd real = compressed(z);
  const auto alone = [&](const Scan& scan) {
    const auto prediction = (*scan.emulator)(scan.best);
    return independent(real, prediction.mean, prediction.variance + scan.extra);
  };
  std::vector<PairMatch> pairs;
  for (std::size_t a = 0; a < std::min(leaders, scans.size()); ++a)
    for (std::size_t b = 0; b < scans.size(); ++b)
      if (b > a || b >= leaders)
        pairs.push_back({.first = a, .second = b, .best_first = {}, .best_second = {}});
  parallel_for(static_cast<int>(pairs.size()), threads, 1, [&](int n) {
    PairMatch& pair = pairs[static_cast<std::size_t>(n)];
    const Scan &one = scans[pair.first], &two = scans[pair.second];
    RandomStream random(1, stream_id("diagnosis/pairs"), static_cast<std::uint64_t>(n), 0);
    const auto uniform = [&] { return (static_cast<double>(random()) + 0.5) * 0x1p-32; };
    const auto evidence = [&](const Eigen::VectorXd& a, const Eigen::VectorXd& b) {
      const auto first = (*one.emulator)(a), second = (*two.emulator)(b);
      return independent(real, compressed(expanded(first.mean) + expanded(second.mean)),
                         first.variance + second.variance + one.extra + two.extra);
    };
    const auto moved = [&](const Scan& scan, Eigen::VectorXd at, double step) {
      for (Eigen::Index k = 0; k < at.size(); ++k) {
        const Uncertain& open = scan.open[static_cast<std::size_t>(k)];
        at(k) += (open.highest - open.lowest) * step * (uniform() + uniform() + uniform() - 1.5);
        if (open.cycle > 0)
          at(k) -= open.cycle * std::floor((at(k) - open.lowest) / open.cycle);
        else
          at(k) = std::clamp(at(k), open.lowest, open.highest);
      }
      return at;
    };
    pair.best_first = one.best;
    pair.best_second = two.best;
    double best = evidence(one.best, two.best);
    const auto attempt = [&](const Eigen::VectorXd& a, const Eigen::VectorXd& b) {
      const double value = evidence(a, b);
      if (value <= best) return;
      best = value;
      pair.best_first = a;
      pair.best_second = b;
    };
    for (Eigen::Index k = 0; k < two.draws.rows(); ++k)
      attempt(pair.best_first, two.draws.row(k).transpose());
    for (int k = 0; k < 80; ++k) attempt(moved(one, pair.best_first, 0.1), moved(two, two.best, 0.7));
    for (const double step : {0.2, 0.08, 0.03})
      for (int k = 0; k < 60; ++k)
        attempt(moved(one, pair.best_first, step), moved(two, pair.best_second, step));
    pair.gain = best - std::max(alone(one), alone(two));
  });
  std::sort(pairs.begin(), pairs.end(), [&](const PairMatch& a, const PairMatch& b) {
    return a.gain + std::max(alone(scans[a.first]), alone(scans[a.second])) >
           b.gain + std::max(alone(scans[b.first]), alone(scans[b.second]));
  });
  return pairs;
}

}  // namespace atomcam
