#include "judging/judgement.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <numeric>

#include "base/error.hpp"

namespace atomcam {
namespace {

constexpr std::size_t most_roc_points = 1000;
constexpr int parts = 5;

/// A share with its error: sums per frame, because what one frame's sites have in common (light, drift) makes
/// them err together.
class ShareOf {
 public:
  explicit ShareOf(std::uint64_t frames) : part_(frames), number_(frames) {}
  void add(std::uint64_t frame, bool hit) {
    ++number_[frame];
    part_[frame] += hit;
  }
  Share share() const {
    Share share;
    std::uint64_t frames = 0;
    for (std::size_t f = 0; f < part_.size(); ++f) {
      share.part += part_[f];
      share.number += number_[f];
      frames += number_[f] > 0;
    }
    if (share.number == 0) return share;
    const double n = static_cast<double>(share.number), rate = share.value();
    const double guess = (static_cast<double>(share.part) + 1) / (n + 2);
    double variance = guess * (1 - guess) / n;
    if (frames > 1) {
      double squares = 0;
      for (std::size_t f = 0; f < part_.size(); ++f) squares += std::pow(part_[f] - rate * number_[f], 2);
      variance = std::max(variance,
                          squares / (n * n) * static_cast<double>(frames) / static_cast<double>(frames - 1));
    }
    share.error = std::sqrt(variance);
    return share;
  }

 private:
  std::vector<std::uint32_t> part_, number_;
};

void check(const SiteScores& scores, const std::vector<SiteTruth>& truth) {
  if (scores.values.size() != scores.frames * scores.sites || truth.size() != scores.values.size())
    throw Error("scores", fmt::format("{} x {} scores and {} sites of truth", scores.frames, scores.sites,
                                      truth.size()));
  for (std::size_t i = 0; i < scores.values.size(); ++i)
    if (!std::isfinite(scores.values[i]))
      throw Error("scores",
                  fmt::format("frame {}, site {}: {}", i / scores.sites, i % scores.sites, scores.values[i]));
  const auto filled = std::ranges::count(truth, true, &SiteTruth::filled);
  if (filled == 0 || filled == std::ssize(truth))
    throw Error("truth", fmt::format("{} of {} sites are filled; a detector is judged with both kinds",
                                     filled, truth.size()));
}

std::vector<std::uint32_t> falling(const SiteScores& scores) {
  std::vector<std::uint32_t> order(scores.values.size());
  std::iota(order.begin(), order.end(), 0u);
  std::ranges::sort(order,
                    [&](std::uint32_t a, std::uint32_t b) { return scores.values[a] > scores.values[b]; });
  return order;
}

/// Calls visit(score, filled, empty, begin, end) for every score, from the largest: numbers at or above it,
/// and where those with just this score stand in `order`.
void walk(const SiteScores& scores, const std::vector<SiteTruth>& truth,
          const std::vector<std::uint32_t>& order,
          const std::function<void(float, std::uint64_t, std::uint64_t, std::size_t, std::size_t)>& visit) {
  std::uint64_t filled = 0, empty = 0;
  for (std::size_t begin = 0; begin < order.size();) {
    std::size_t end = begin;
    const float score = scores.values[order[begin]];
    for (; end < order.size() && scores.values[order[end]] == score; ++end)
      ++(truth[order[end]].filled ? filled : empty);
    visit(score, filled, empty, begin, end);
    begin = end;
  }
}

struct Best {
  double threshold = 0, fidelity = 0;
};

Best best_of(const SiteScores& scores, const std::vector<SiteTruth>& truth,
             const std::vector<std::uint32_t>& order) {
  std::uint64_t filled_in_all =
      static_cast<std::uint64_t>(std::ranges::count(truth, true, &SiteTruth::filled));
  const std::uint64_t empty_in_all = truth.size() - filled_in_all;
  std::uint64_t most = empty_in_all;  // none called filled
  double threshold = std::nextafter(static_cast<double>(scores.values[order[0]]), INFINITY);
  walk(scores, truth, order,
       [&](float score, std::uint64_t filled, std::uint64_t empty, std::size_t, std::size_t end) {
         const std::uint64_t right = filled + empty_in_all - empty;
         if (right <= most) return;
         most = right;
         threshold = end < order.size()
                         ? 0.5 * (static_cast<double>(score) + static_cast<double>(scores.values[order[end]]))
                         : static_cast<double>(score);
       });
  return {threshold, static_cast<double>(most) / static_cast<double>(truth.size())};
}

/// Area and its error after DeLong (1988), with frames as clusters (Obuchowski 1997).
void area(Judgement& judgement, const SiteScores& scores, const std::vector<SiteTruth>& truth,
          const std::vector<std::uint32_t>& order) {
  const double filled_in_all = static_cast<double>(std::ranges::count(truth, true, &SiteTruth::filled));
  const double empty_in_all = static_cast<double>(truth.size()) - filled_in_all;
  // Of each site: share of the other kind that it beats, ties as half.
  std::vector<float> placement(truth.size());
  double filled_before = 0, empty_before = 0, sum = 0;
  walk(scores, truth, order,
       [&](float, std::uint64_t filled, std::uint64_t empty, std::size_t begin, std::size_t end) {
         const double filled_here = static_cast<double>(filled) - filled_before,
                      empty_here = static_cast<double>(empty) - empty_before;
         const double beats = (empty_in_all - empty_before - 0.5 * empty_here) / empty_in_all;
         const double beaten = (filled_before + 0.5 * filled_here) / filled_in_all;
         for (std::size_t i = begin; i < end; ++i)
           placement[order[i]] = static_cast<float>(truth[order[i]].filled ? beats : beaten);
         sum += filled_here * beats;
         filled_before = static_cast<double>(filled), empty_before = static_cast<double>(empty);
       });
  judgement.auc = sum / filled_in_all;
  double variance = 0;
  const double clusters = static_cast<double>(scores.frames);
  const auto add = [&](std::size_t step, double scale) {
    double total = 0;
    for (std::size_t start = 0; start < truth.size(); start += step) {
      double both = 0;
      for (std::size_t i = start; i < start + step; ++i)
        both += (placement[i] - judgement.auc) / (truth[i].filled ? filled_in_all : empty_in_all);
      total += both * both;
    }
    variance = std::max(variance, total * scale);
  };
  if (scores.frames > 1) add(scores.sites, clusters / (clusters - 1));
  add(1, 1);  // each site for itself
  // Of a perfect detector nothing scatters: what one pair in the wrong order would make.
  judgement.auc_error = std::max(std::sqrt(variance), 1 / std::sqrt(filled_in_all * empty_in_all));
}

}  // namespace

double best_threshold(const SiteScores& scores, const std::vector<SiteTruth>& truth) {
  check(scores, truth);
  return best_of(scores, truth, falling(scores)).threshold;
}

Judgement judge(const SiteScores& scores, const std::vector<SiteTruth>& truth, double threshold,
                double exposure_s) {
  check(scores, truth);
  Judgement judgement;
  judgement.frames = scores.frames;
  judgement.sites = scores.sites;
  judgement.threshold = threshold;
  const auto order = falling(scores);
  const Best best = best_of(scores, truth, order);
  judgement.best_threshold = best.threshold;
  judgement.best_fidelity = best.fidelity;
  area(judgement, scores, truth, order);

  const auto filled_in_all = static_cast<double>(std::ranges::count(truth, true, &SiteTruth::filled));
  const double empty_in_all = static_cast<double>(truth.size()) - filled_in_all;
  judgement.roc.push_back({INFINITY, 0, 0});
  const double step = 1.0 / most_roc_points;
  walk(scores, truth, order,
       [&](float score, std::uint64_t filled, std::uint64_t empty, std::size_t, std::size_t end) {
         const RocPoint point{score, static_cast<double>(empty) / empty_in_all,
                              static_cast<double>(filled) / filled_in_all};
         const RocPoint& last = judgement.roc.back();
         if (end == order.size() || point.false_alarms - last.false_alarms + point.found - last.found >= step)
           judgement.roc.push_back(point);
       });

  const auto share = [&](const std::function<bool(const SiteTruth&)>& counts,
                         const std::function<bool(const SiteTruth&, bool)>& hit) {
    ShareOf sums(scores.frames);
    for (std::size_t i = 0; i < truth.size(); ++i)
      if (counts(truth[i])) sums.add(i / scores.sites, hit(truth[i], scores.values[i] >= threshold));
    return sums.share();
  };
  const auto called_filled = [](const SiteTruth&, bool called) { return called; };
  const auto confusion = [&](std::string of, double from, double to,
                             const std::function<bool(const SiteTruth&)>& in) {
    Confusion row{std::move(of), from, to, {}, {}};
    row.found = share([&](const SiteTruth& site) { return site.filled && in(site); }, called_filled);
    row.false_alarms = share([&](const SiteTruth& site) { return !site.filled && in(site); }, called_filled);
    return row;
  };
  judgement.fidelity = share([](const SiteTruth&) { return true; },
                             [](const SiteTruth& site, bool called) { return called == site.filled; });
  judgement.found = share([](const SiteTruth& site) { return site.filled; }, called_filled);
  judgement.false_alarms = share([](const SiteTruth& site) { return !site.filled; }, called_filled);

  std::vector<float> electrons;
  for (const SiteTruth& site : truth)
    if (site.filled) electrons.push_back(site.electrons);
  std::ranges::sort(electrons);
  for (int part = 0; part < parts; ++part) {
    const auto edge = [&](int p) {
      return electrons[std::min(electrons.size() - 1,
                                electrons.size() * static_cast<std::size_t>(p) / parts)];
    };
    const float from = edge(part), to = edge(part + 1);
    const bool last = part == parts - 1;
    if (from == to && !last) continue;
    judgement.by_brightness.push_back(
        confusion(fmt::format("{:g} to {:g} electrons", from, to), from, to, [=](const SiteTruth& site) {
          return site.filled && site.electrons >= from && (site.electrons < to || last);
        }));
  }
  for (int part = 0; part < parts; ++part) {
    const double from = exposure_s * part / parts, to = exposure_s * (part + 1) / parts;
    judgement.by_loss.push_back(
        confusion(fmt::format("lost at {:g} to {:g} s", from, to), from, to, [=](const SiteTruth& site) {
          return site.lost && site.loss_s >= from && (site.loss_s < to || part == parts - 1);
        }));
  }
  judgement.by_loss.push_back(
      confusion("not lost", exposure_s, INFINITY, [](const SiteTruth& site) { return !site.lost; }));
  int most_neighbours = 0;
  for (const SiteTruth& site : truth) most_neighbours = std::max<int>(most_neighbours, site.neighbours);
  for (int count = 0; count <= most_neighbours; ++count)
    judgement.by_neighbours.push_back(
        confusion(fmt::format("{} neighbours", count), count, count,
                  [=](const SiteTruth& site) { return site.neighbours == count; }));
  return judgement;
}

}  // namespace atomcam
