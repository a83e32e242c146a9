#include "diagnosis/where.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <set>

#include "diagnosis/stages.hpp"
#include "diagnosis/standard.hpp"

namespace atomcam {
namespace {

/// How often statistics of a plain stack are so many deviations off: further tails than a normal law has, and
/// further still of those that are unsteady.
class Tails {
 public:
  Tails(const std::vector<StatisticDeclaration>& battery, const Eigen::MatrixXd& own)
      : steady_(sizes(battery, own, false)), unsteady_(sizes(battery, own, true)) {}
  double p_value(const StatisticDeclaration& statistic, double z) const {
    const double normal = std::erfc(std::fabs(z) / std::sqrt(2.0));
    return std::max(normal, (statistic.unsteady ? unsteady_ : steady_).p_value(std::fabs(z)));
  }

 private:
  static std::vector<double> sizes(const std::vector<StatisticDeclaration>& battery,
                                   const Eigen::MatrixXd& own, bool unsteady) {
    std::vector<double> sizes;
    for (std::size_t k = 0; k < battery.size(); ++k)
      if (battery[k].unsteady == unsteady)
        for (const double z : own.col(static_cast<Eigen::Index>(k))) sizes.push_back(std::fabs(z));
    return sizes;
  }

  NullDistribution steady_, unsteady_;
};

}  // namespace

std::vector<Difference> ranked_differences(const std::vector<StatisticDeclaration>& battery,
                                           const Eigen::VectorXd& z, const Eigen::VectorXd& tolerated,
                                           const Eigen::VectorXd& z_after, const Eigen::MatrixXd& own) {
  constexpr std::size_t listed = 40;
  constexpr double clearly = 0.01;
  const auto size = [&](std::size_t k) { return std::fabs(z(static_cast<Eigen::Index>(k))); };
  std::vector<std::size_t> order(battery.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) { return size(a) > size(b); });
  // Benjamini and Hochberg over the battery.
  const Tails tails(battery, own);
  const double count = static_cast<double>(order.size());
  std::vector<double> p(order.size()), q(order.size());
  for (std::size_t k = 0; k < p.size(); ++k)
    p[k] = tails.p_value(battery[k], tolerated(static_cast<Eigen::Index>(k)));
  std::vector<std::size_t> likely = order;
  std::sort(likely.begin(), likely.end(), [&](std::size_t a, std::size_t b) { return p[a] < p[b]; });
  double least = 1;
  for (std::size_t rank = likely.size(); rank-- > 0;) {
    least = std::min(least, p[likely[rank]] * count / static_cast<double>(rank + 1));
    q[likely[rank]] = least;
  }
  std::vector<Difference> list;
  std::set<std::string_view> seen;
  for (std::size_t rank = 0; rank < order.size(); ++rank) {
    const StatisticDeclaration& statistic = battery[order[rank]];
    // Beyond the first some, the strongest of every other kind that is odd.
    const std::string_view name = statistic.name;
    const bool first = seen.insert(name.substr(0, name.rfind('.'))).second;
    if (rank >= listed && !(first && q[order[rank]] < clearly)) continue;
    const auto at = static_cast<Eigen::Index>(order[rank]);
    Difference one;
    one.stage = stage_of_observable(statistic.observable, statistic.darks);
    one.statistic = statistic.name;
    one.observable = statistic.observable;
    one.axis = statistic.axis;
    one.place = statistic.place;
    one.z = z(at);
    one.q = q[order[rank]];
    one.z_after = z_after(at);
    list.push_back(std::move(one));
  }
  return list;
}

}  // namespace atomcam
