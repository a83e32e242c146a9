#include "diagnosis/blind_score.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>

#include "base/quantile.hpp"

namespace atomcam {
namespace {

std::string row_of(const std::vector<BlindEffect>& sealed) {
  return sealed.empty() ? "(none)" : sealed.size() > 1 ? "(pairs)" : sealed.front().name;
}

bool has(const std::vector<BlindEffect>& sealed, const std::string& name) {
  return std::any_of(sealed.begin(), sealed.end(), [&](const BlindEffect& one) { return one.name == name; });
}

std::string share(int part, int all) {
  return all == 0 ? "none to count" : fmt::format("{} of {} ({:.1f} %)", part, all, 100.0 * part / all);
}

}  // namespace

double uniform_p_value(std::vector<double> values) {
  if (values.empty()) return 1;
  std::sort(values.begin(), values.end());
  const double n = static_cast<double>(values.size());
  double distance = 0;
  for (std::size_t k = 0; k < values.size(); ++k)
    distance = std::max(
        {distance, values[k] - static_cast<double>(k) / n, (static_cast<double>(k) + 1) / n - values[k]});
  const double x = distance * (std::sqrt(n) + 0.12 + 0.11 / std::sqrt(n));
  if (x < 0.2) return 1;
  double p = 0;
  for (int k = 1; k < 100; ++k) p += (k % 2 ? 2 : -2) * std::exp(-2.0 * k * k * x * x);
  return std::clamp(p, 0.0, 1.0);
}

void BlindScore::count(Outcome& outcome, const BlindResult& result) {
  ++outcome.stacks;
  if (result.verdict == "no_gap") {
    ++outcome.no_gap;
    return;
  }
  if (!result.sealed.empty()) {
    ++outcome.with_stage;
    const std::string& stage = result.found.empty() ? result.unexplained_stage : result.found.front().stage;
    outcome.stage_right += std::any_of(result.sealed.begin(), result.sealed.end(),
                                       [&](const BlindEffect& one) { return one.stage == stage; });
  }
  if (result.verdict == "unexplained") {
    ++outcome.unexplained;
    return;
  }
  if (result.verdict == "ambiguous") {
    ++outcome.ambiguous;
    return;
  }
  const auto right =
      std::count_if(result.found.begin(), result.found.end(),
                    [&](const BlindResult::Found& one) { return has(result.sealed, one.name); });
  if (right < static_cast<std::ptrdiff_t>(result.found.size()))
    ++outcome.wrong;
  else if (result.verdict == "partly_explained" || result.found.size() < result.sealed.size())
    ++outcome.partly;
  else
    ++outcome.named;
  if (right == static_cast<std::ptrdiff_t>(result.found.size())) outcome.closed.push_back(result.closed);
}

void BlindScore::add(const BlindResult& result) {
  const std::string row = row_of(result.sealed);
  count(outcomes_[row], result);
  count(outcomes_["(all)"], result);
  if (result.sealed.empty()) null_p_.push_back(result.p_gap);
  for (const BlindEffect& sealed : result.sealed)
    if (sealed.matched_filter > 0)
      over_matched_filter_.push_back(sealed.detection_strength / sealed.matched_filter);
  std::vector<std::string> names;
  for (const BlindResult::Found& one : result.found) {
    names.push_back(one.name);
    for (const BlindEffect& sealed : result.sealed)
      if (sealed.name == one.name && sealed.strength > 0) {
        ++strengths_;
        covered_ += one.low <= sealed.strength && sealed.strength <= one.high;
      }
  }
  if (result.sealed.size() > 1 && result.verdict != "no_gap") {
    ++pairs_;
    pairs_both_ += std::all_of(result.sealed.begin(), result.sealed.end(), [&](const BlindEffect& one) {
      return std::find(names.begin(), names.end(), one.name) != names.end();
    });
  }
  std::string sealed = row;
  if (result.sealed.size() > 1) {
    std::vector<std::string> both;
    for (const BlindEffect& one : result.sealed) both.push_back(one.name);
    sealed = fmt::format("{}", fmt::join(both, " + "));
  }
  const std::string called = names.empty() ? result.verdict
                             : result.verdict == "ambiguous"
                                 ? fmt::format("ambiguous: {}", fmt::join(names, " + "))
                                 : fmt::format("{}", fmt::join(names, " + "));
  ++called_[sealed][called];
}

std::string BlindScore::tables() const {
  std::string out =
      "| sealed | stacks | no gap | named right | partly | ambiguous | unexplained | wrong name | stage "
      "right | "
      "closed (median) |\n| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |\n";
  for (const auto& [row, o] : outcomes_)
    out += fmt::format("| {} | {} | {} | {} | {} | {} | {} | {} | {} | {} |\n", row, o.stacks, o.no_gap,
                       o.named, o.partly, o.ambiguous, o.unexplained, o.wrong,
                       o.with_stage ? fmt::format("{} of {}", o.stage_right, o.with_stage) : "",
                       o.closed.empty() ? "" : fmt::format("{:.3f}", median(o.closed)));
  const auto none = outcomes_.find("(none)");
  const auto all = outcomes_.find("(all)");
  const Outcome null = none == outcomes_.end() ? Outcome{} : none->second;
  const Outcome total = all == outcomes_.end() ? Outcome{} : all->second;
  const int with = total.stacks - null.stacks, seen = with - (total.no_gap - null.no_gap);
  out += "\n| rate | |\n| --- | --- |\n";
  out += fmt::format("| false alarms: a gap where there is none | {} |\n",
                     share(null.stacks - null.no_gap, null.stacks));
  if (null_p_.size() >= 20)
    out += fmt::format("| p-values without effect are uniform (Kolmogorov-Smirnov) | p = {:.2g} |\n",
                       uniform_p_value(null_p_));
  if (refused_ > 0)
    out += fmt::format("| refused: no calibration, not counted below | {} |\n",
                       share(refused_, refused_ + total.stacks));
  out += fmt::format("| detected, of stacks with effects | {} |\n", share(seen, with));
  if (!over_matched_filter_.empty())
    out +=
        fmt::format("| detection strength over the matched filter's, median (largest) | {:.2f} ({:.2f}) |\n",
                    median(over_matched_filter_), quantile(over_matched_filter_, 1));
  out += fmt::format("| false accusations: a wrong name, of the detected | {} |\n",
                     share(total.wrong - null.wrong, seen));
  out += fmt::format("| unexplained, of the detected | {} |\n",
                     share(total.unexplained - null.unexplained, seen));
  out += fmt::format("| stage right, of the detected | {} |\n", share(total.stage_right, total.with_stage));
  if (pairs_ > 0) out += fmt::format("| both named, of detected pairs | {} |\n", share(pairs_both_, pairs_));
  if (strengths_ > 0)
    out +=
        fmt::format("| true strength in its interval (68 % expected) | {} |\n", share(covered_, strengths_));
  out += "\n| sealed | called |\n| --- | --- |\n";
  for (const auto& [sealed, names] : called_) {
    std::vector<std::string> parts;
    for (const auto& [name, count] : names) parts.push_back(fmt::format("{} ({})", name, count));
    out += fmt::format("| {} | {} |\n", sealed, fmt::join(parts, ", "));
  }
  return out;
}

}  // namespace atomcam
