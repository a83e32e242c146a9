#include "diagnosis/scan.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "base/random.hpp"
#include "effects/patterns.hpp"
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

/// About the emulator's best place and, in turn, about the stacks that really came nearest: an emulator that
/// is wrong must not keep the search where it is.
Eigen::MatrixXd near_draws(const Scan& scan, int stacks, std::uint64_t seed, std::uint64_t first) {
  constexpr std::size_t nearest = 3;
  const ScanView& view = scan.best();
  std::vector<Eigen::Index> order(static_cast<std::size_t>(view.miss.size()));
  for (std::size_t n = 0; n < order.size(); ++n) order[n] = static_cast<Eigen::Index>(n);
  std::sort(order.begin(), order.end(),
            [&](Eigen::Index a, Eigen::Index b) { return view.miss(a) < view.miss(b); });
  // Kernels shrink as stacks fill the space: by their number per dimension.
  const double share =
      0.6 / std::pow(static_cast<double>(scan.draws.rows()), 1 / static_cast<double>(scan.open.size() + 0.5));
  Eigen::MatrixXd draws(stacks, static_cast<Eigen::Index>(scan.open.size()));
  for (int n = 0; n < stacks; ++n) {
    const bool emulated = n % 2 == 0;
    const auto about = static_cast<std::size_t>(n / 2) % std::min(nearest, order.size());
    std::vector<Uncertain> near = scan.open;
    for (std::size_t k = 0; k < near.size(); ++k) {
      const auto at = static_cast<Eigen::Index>(k);
      near[k].centre = emulated ? view.best(at) : scan.draws(order[about], at);
      near[k].width = emulated ? view.width(at) : share * (near[k].highest - near[k].lowest);
    }
    draws.row(n) = draw_parameters(near, 1, seed + 17, first + static_cast<std::uint64_t>(n)).row(0);
  }
  return draws;
}

/// A place near another, by parts of the parameters' ranges.
template <class Uniform>
Eigen::VectorXd moved_by(const std::vector<Uncertain>& open, Eigen::VectorXd at, double step,
                         const Uniform& uniform) {
  for (Eigen::Index k = 0; k < at.size(); ++k) {
    const Uncertain& one = open[static_cast<std::size_t>(k)];
    at(k) += (one.highest - one.lowest) * step * (uniform() + uniform() + uniform() - 1.5);
    at(k) = one.within(at(k));
  }
  return at;
}

using ViewsOfStacks = std::array<Eigen::MatrixXd, scan_views>;  // [stack, statistic]

ViewsOfStacks views_of_stacks(const Standard& standard, const Eigen::MatrixXd& stacks) {
  ViewsOfStacks views;
  for (Eigen::MatrixXd& view : views) view.resize(stacks.rows(), stacks.cols());
  for (Eigen::Index n = 0; n < stacks.rows(); ++n) {
    const ScanViews seen = views_of(standard, stacks.row(n).transpose());
    for (std::size_t v = 0; v < scan_views; ++v) views[v].row(n) = seen[v].transpose();
  }
  return views;
}

}  // namespace

ScanViews views_of(const Standard& standard, const Eigen::VectorXd& statistics) {
  return {compressed(standard.judge(statistics)), compressed(standard.judge_recalibrated(statistics))};
}

std::vector<const EffectDeclaration*> candidates(const Model& before,
                                                 const std::vector<std::string>& excluded) {
  std::vector<const EffectDeclaration*> list;
  const CameraKind kind = before.lab.kind();
  const bool sites = !before.lab.scene.sites.empty();
  for (const EffectDeclaration& effect : effect_catalogue()) {
    if (!effect.on(kind)) continue;
    if (before.has(effect.name) || std::find(excluded.begin(), excluded.end(), effect.name) != excluded.end())
      continue;
    if (before.lab.effects.contains(effect.name)) continue;  // the notes have it
    if (!sites && effect.plane == Plane::scene) continue;
    list.push_back(&effect);
  }
  return list;
}

void explore(Scan& scan, const Model& before, int stacks, const StackPlan& plan, std::uint64_t first,
             const std::function<void(int)>& progress) {
  if (scan.open.empty()) {
    const Region& frame = before.lab.settings.region;
    scan.open = effect_prior(*scan.effect, std::max(frame.width, frame.height),
                             static_cast<double>(plan.frames.all()));
  }
  Eigen::MatrixXd own;
  if (scan.draws.rows() == 0) {
    own = spread_draws(scan.open, stacks, plan.seed, first);
  } else {
    own = near_draws(scan, stacks, plan.seed, first);
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
  const Eigen::Index old = scan.draws.rows();
  scan.draws.conservativeResize(old + stacks, own.cols());
  scan.draws.bottomRows(stacks) = own;
  const ViewsOfStacks seen = views_of_stacks(*before.standard, population.whole);
  for (std::size_t v = 0; v < scan_views; ++v) {
    scan.view[v].values.conservativeResize(old + stacks, population.whole.cols());
    scan.view[v].values.bottomRows(stacks) = seen[v];
  }
}

namespace {

/// Places over the whole prior: [parameter, place].
template <class Uniform>
Eigen::MatrixXd anywhere(const std::vector<Uncertain>& open, Eigen::Index places, const Uniform& uniform) {
  Eigen::MatrixXd at(std::ssize(open), places);
  for (Eigen::Index n = 0; n < places; ++n)
    for (Eigen::Index k = 0; k < at.rows(); ++k) {
      const Uncertain& one = open[static_cast<std::size_t>(k)];
      at(k, n) = one.lowest + (one.highest - one.lowest) * uniform();
    }
  return at;
}

void match_view(ScanView& view, const Scan& scan, const Correlation& correlation,
                const Eigen::VectorXd& real) {
  view.emulator = std::make_unique<Emulator>(scan.open, scan.draws, view.values);
  view.miss = (view.values.rowwise() - real.transpose()).rowwise().squaredNorm();
  const double before_log = -0.5 * correlation.squares(real)(0);
  struct Tried {
    double evidence;
    Eigen::VectorXd at;
  };
  std::vector<Tried> tried;
  const auto evidence_at = [&](const Eigen::MatrixXd& places) -> Eigen::VectorXd {
    const Eigen::ArrayXXd variance = 1 + view.emulator->variance(places).array();
    const Eigen::MatrixXd miss =
        (real.replicate(1, places.cols()) - view.emulator->mean(places)).array() / variance.sqrt();
    return -0.5 * correlation.squares(miss) - 0.5 * variance.log().colwise().sum().matrix().transpose();
  };
  const auto attempt = [&](const Eigen::MatrixXd& places) {
    const Eigen::VectorXd evidence = evidence_at(places);
    for (Eigen::Index n = 0; n < places.cols(); ++n) tried.push_back({evidence(n), places.col(n)});
  };
  const auto likeliest_from = [&](std::size_t first) {
    return std::max_element(tried.begin() + static_cast<std::ptrdiff_t>(first), tried.end(),
                            [](const Tried& a, const Tried& b) { return a.evidence < b.evidence; });
  };
  RandomStream random(1, stream_id("diagnosis/match"), 0, 0);
  const auto uniform = [&] { return (static_cast<double>(random()) + 0.5) * 0x1p-32; };
  // Over the whole prior, then nearer and nearer about the likeliest; `hold`: what stays as it is on the way.
  const auto search = [&](const auto& hold) {
    const std::size_t first = tried.size();
    attempt(hold(scan.draws.transpose()));
    attempt(hold(anywhere(scan.open, 400, uniform)));
    for (const double step : {0.15, 0.06, 0.025}) {
      const Eigen::VectorXd centre = likeliest_from(first)->at;
      Eigen::MatrixXd places(centre.size(), 120);
      for (Eigen::Index n = 0; n < places.cols(); ++n)
        places.col(n) = moved_by(scan.open, centre, step, uniform);
      attempt(hold(std::move(places)));
    }
    return likeliest_from(first)->at;
  };
  search([](Eigen::MatrixXd places) { return places; });
  // Many defects of sizes that spread widely look like few large ones of a size.
  for (Eigen::Index k = 1; k < std::ssize(scan.open); ++k)
    if (const Uncertain& one = scan.open[static_cast<std::size_t>(k)];
        one.name.ends_with(fmt::format(".{}", spread_of_sizes_key)))
      view.usual_sizes = search([&](Eigen::MatrixXd places) {
        places.row(k).setConstant(one.usual);
        return places;
      });
  const auto top = likeliest_from(0);
  view.usual = [&] {
    constexpr Eigen::Index strengths = 60;
    Eigen::MatrixXd places = top->at.replicate(1, strengths);
    for (Eigen::Index k = 0; k < places.rows(); ++k) {
      const Uncertain& one = scan.open[static_cast<std::size_t>(k)];
      if (k == 0)
        places.row(k).setLinSpaced(one.lowest, one.highest);
      else if (one.cycle == 0)
        places.row(k).setConstant(one.usual);
    }
    Eigen::Index at = 0;
    evidence_at(places).maxCoeff(&at);
    return Eigen::VectorXd(places.col(at));
  }();
  view.best = top->at;
  view.log_likelihood = top->evidence - before_log;
  view.share = before_log < 0 ? std::clamp(view.log_likelihood / -before_log, 0.0, 1.0) : 0;
  view.predicted = view.emulator->mean(view.best);
  // Widths from how fast the evidence falls.
  const Eigen::Index dimension = std::ssize(scan.open);
  Eigen::VectorXd squares = Eigen::VectorXd::Zero(dimension);
  double weights = 0;
  for (const auto& [evidence, at] : tried) {
    const double weight = std::exp(std::max(-60.0, (evidence - top->evidence) / 4));
    Eigen::VectorXd off = at - view.best;
    for (Eigen::Index k = 0; k < dimension; ++k) {
      const double cycle = scan.open[static_cast<std::size_t>(k)].cycle;
      if (cycle > 0) off(k) -= cycle * std::round(off(k) / cycle);
    }
    squares += weight * off.cwiseAbs2();
    weights += weight;
  }
  view.width.resize(dimension);
  for (Eigen::Index k = 0; k < dimension; ++k) {
    const Uncertain& one = scan.open[static_cast<std::size_t>(k)];
    const double range = one.highest - one.lowest;
    view.width(k) = std::clamp(1.5 * std::sqrt(squares(k) / weights), 0.015 * range, 0.25 * range);
  }
}

}  // namespace

void match(std::span<Scan> scans, const Correlation& correlation, const ScanViews& real, int threads) {
  parallel_for(static_cast<int>(scans.size() * scan_views), threads, 1, [&](int n) {
    Scan& scan = scans[static_cast<std::size_t>(n) / scan_views];
    const std::size_t v = static_cast<std::size_t>(n) % scan_views;
    match_view(scan.view[v], scan, correlation, real[v]);
  });
}

namespace {

/// Logarithmic likelihood of independent statistics with a variance beyond their own of 1.
double independent(const Eigen::VectorXd& real, const Eigen::VectorXd& mean,
                   const Eigen::VectorXd& variance) {
  return -0.5 * ((real - mean).array().square() / (1 + variance.array())).sum() -
         0.5 * variance.array().log1p().sum();
}
Eigen::VectorXd expanded(const Eigen::VectorXd& y) {
  return y.unaryExpr([](double v) { return 2 * std::sinh(v / 2); });
}

struct Least {
  double left = 0;
  Eigen::VectorXd at;
};

/// Where the effect leaves least of something: about `start`, at the stacks made, and nearer and nearer about
/// the best of these.
template <class Left>
Least least_left(const Scan& scan, const Eigen::VectorXd& start, RandomStream& random, const Left& left) {
  const auto uniform = [&] { return (static_cast<double>(random()) + 0.5) * 0x1p-32; };
  Least least{left(start), start};
  const auto attempt = [&](const Eigen::VectorXd& at) {
    if (const double value = left(at); value < least.left) least = {value, at};
  };
  for (Eigen::Index n = 0; n < scan.draws.rows(); ++n) attempt(scan.draws.row(n).transpose());
  for (const double step : {0.2, 0.1, 0.04})
    for (int n = 0; n < 60; ++n) attempt(moved_by(scan.open, least.at, step, uniform));
  return least;
}

}  // namespace

double imitated(const Eigen::VectorXd& fingerprint, const Scan& by, std::size_t view) {
  const double all = fingerprint.squaredNorm();
  if (!(all > 0)) return 0;
  const Emulator& emulator = *by.view[view].emulator;
  RandomStream random(1, stream_id("diagnosis/imitated"), 0, 0);
  const Least found = least_left(by, by.view[view].best, random, [&](const Eigen::VectorXd& at) {
    return (fingerprint - emulator.mean(at)).squaredNorm();
  });
  return std::clamp(1 - found.left / all, 0.0, 1.0);
}

PartMatch match_part(const Scan& scan, const Eigen::VectorXd& mask, const ScanViews& all_real) {
  PartMatch match;
  for (std::size_t v = 0; v < scan_views; ++v) {
    const Eigen::VectorXd real = expanded(all_real[v]).cwiseProduct(mask);
    const double all = real.squaredNorm();
    if (!(all > 0)) continue;
    const Emulator& emulator = *scan.view[v].emulator;
    RandomStream random(1, stream_id("diagnosis/part"), v, 0);
    const Least found = least_left(scan, scan.view[v].best, random, [&](const Eigen::VectorXd& at) {
      return (real - expanded(emulator.mean(at)).cwiseProduct(mask)).squaredNorm();
    });
    if (const double share = 1 - found.left / all; match.best.size() == 0 || share > match.share) {
      match.share = share;
      match.best = found.at;
    }
  }
  if (match.best.size() == 0) match.best = scan.best().best;
  return match;
}

ScanViews less(const ScanViews& real, const Scan& scan, const Eigen::VectorXd& at) {
  ScanViews left;
  for (std::size_t v = 0; v < scan_views; ++v)
    left[v] = compressed(expanded(real[v]) - expanded(scan.view[v].emulator->mean(at)));
  return left;
}

std::vector<PairMatch> match_pairs(const std::vector<Scan>& scans, std::size_t leaders,
                                   const ScanViews& all_real, int threads) {
  struct Task {
    PairMatch pair;
    std::size_t view;
  };
  std::vector<Task> tasks;
  for (std::size_t v = 0; v < scan_views; ++v)
    for (std::size_t a = 0; a < std::min(leaders, scans.size()); ++a)
      for (std::size_t b = 0; b < scans.size(); ++b)
        if (b > a || b >= leaders)
          tasks.push_back({{.first = a, .second = b, .best_first = {}, .best_second = {}}, v});
  parallel_for(static_cast<int>(tasks.size()), threads, 1, [&](int n) {
    auto& [pair, v] = tasks[static_cast<std::size_t>(n)];
    const Eigen::VectorXd& real = all_real[v];
    const Scan &one = scans[pair.first], &two = scans[pair.second];
    const ScanView &view_one = one.view[v], &view_two = two.view[v];
    RandomStream random(1, stream_id("diagnosis/pairs"), static_cast<std::uint64_t>(n), 0);
    const auto uniform = [&] { return (static_cast<double>(random()) + 0.5) * 0x1p-32; };
    const auto alone = [&](const ScanView& view) {
      return independent(real, view.emulator->mean(view.best), view.emulator->variance(view.best));
    };
    const auto evidence = [&](const Eigen::VectorXd& a, const Eigen::VectorXd& b) {
      const Emulator &first = *view_one.emulator, &second = *view_two.emulator;
      return independent(real, compressed(expanded(first.mean(a)) + expanded(second.mean(b))),
                         first.variance(a) + second.variance(b));
    };
    const auto moved = [&](const Scan& scan, const Eigen::VectorXd& at, double step) {
      return moved_by(scan.open, at, step, uniform);
    };
    pair.best_first = view_one.best;
    pair.best_second = view_two.best;
    double best = evidence(view_one.best, view_two.best);
    const auto attempt = [&](const Eigen::VectorXd& a, const Eigen::VectorXd& b) {
      const double value = evidence(a, b);
      if (value <= best) return;
      best = value;
      pair.best_first = a;
      pair.best_second = b;
    };
    for (Eigen::Index k = 0; k < two.draws.rows(); ++k)
      attempt(pair.best_first, two.draws.row(k).transpose());
    for (int k = 0; k < 80; ++k) attempt(moved(one, pair.best_first, 0.1), moved(two, view_two.best, 0.7));
    for (const double step : {0.2, 0.08, 0.03})
      for (int k = 0; k < 60; ++k)
        attempt(moved(one, pair.best_first, step), moved(two, pair.best_second, step));
    const double either = std::max(alone(view_one), alone(view_two));
    pair.alone = either + 0.5 * real.squaredNorm();
    pair.gain = best - either;
  });
  // Of each pair the view in which it is seen best.
  std::vector<PairMatch> pairs;
  const std::size_t count = tasks.size() / scan_views;
  for (std::size_t n = 0; n < count; ++n) {
    PairMatch &near = tasks[n].pair, &far = tasks[count + n].pair;
    pairs.push_back(far.gain + far.alone > near.gain + near.alone ? std::move(far) : std::move(near));
  }
  std::sort(pairs.begin(), pairs.end(),
            [](const PairMatch& a, const PairMatch& b) { return a.gain + a.alone > b.gain + b.alone; });
  return pairs;
}

std::vector<AddedMatch> match_added(const std::vector<Scan>& scans, const Model& model,
                                    const Standard& standard, const ScanViews& real, int threads) {
  const ViewsOfStacks seen = views_of_stacks(standard, model.population.whole);
  ScanViews mean, variance;
  for (std::size_t v = 0; v < scan_views; ++v) {
    mean[v] = seen[v].colwise().mean().transpose();
    variance[v] = ((seen[v].rowwise() - mean[v].transpose()).array().square().colwise().mean() - 1)
                      .max(0.0)
                      .transpose();
  }
  std::vector<AddedMatch> list;
  for (std::size_t k = 0; k < scans.size(); ++k)
    if (!model.has(scans[k].effect->name)) list.push_back({k, {}, -std::numeric_limits<double>::infinity()});
  parallel_for(static_cast<int>(list.size()), threads, 1, [&](int n) {
    AddedMatch& added = list[static_cast<std::size_t>(n)];
    const Scan& scan = scans[added.scan];
    for (std::size_t v = 0; v < scan_views; ++v) {
      const ScanView& view = scan.view[v];
      RandomStream random(1, stream_id("diagnosis/added"), static_cast<std::uint64_t>(n), v);
      const Least found = least_left(scan, view.best, random, [&](const Eigen::VectorXd& at) {
        return -independent(real[v], compressed(expanded(mean[v]) + expanded(view.emulator->mean(at))),
                            variance[v] + view.emulator->variance(at));
      });
      const double gain = -found.left - independent(real[v], mean[v], variance[v]);
      if (gain <= added.gain) continue;
      added.gain = gain;
      added.best = found.at;
    }
  });
  std::sort(list.begin(), list.end(),
            [](const AddedMatch& a, const AddedMatch& b) { return a.gain > b.gain; });
  return list;
}

}  // namespace atomcam
