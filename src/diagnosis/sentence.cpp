#include "diagnosis/sentence.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <set>

#include "diagnosis/character.hpp"
#include "diagnosis/stages.hpp"

namespace atomcam {
namespace {

/// "a, b and c".
std::string in_a_row(const std::vector<std::string>& list) {
  if (list.size() < 2) return list.empty() ? "" : list.front();
  return fmt::format("{} and {}", fmt::join(list.begin(), list.end() - 1, ", "), list.back());
}

std::vector<std::string> strongest(const std::vector<StatisticDeclaration>& battery,
                                   const Eigen::VectorXd& z) {
  std::vector<std::size_t> order(battery.size());
  for (std::size_t k = 0; k < order.size(); ++k) order[k] = k;
  std::sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
    return std::fabs(z(static_cast<Eigen::Index>(a))) > std::fabs(z(static_cast<Eigen::Index>(b)));
  });
  std::vector<std::string> parts;
  for (std::size_t k = 0; k < order.size() && parts.size() < 4; ++k) {
    const double value = z(static_cast<Eigen::Index>(order[k]));
    if (std::fabs(value) < 3) break;
    const StatisticDeclaration& one = battery[order[k]];
    parts.push_back(fmt::format("{} ({}, {}{}) {:+.1f} sigma", one.name, one.axis, one.place,
                                one.darks ? ", dark frames" : "", value));
  }
  return parts;
}

}  // namespace

Unexplained unexplained_of(const std::vector<StatisticDeclaration>& battery, const Eigen::VectorXd& z,
                           const std::vector<Hypothesis>& hypotheses) {
  Unexplained rest;
  rest.present = true;
  rest.stage = stage_of_differences(battery, z, hypotheses);
  rest.character = character_of(battery, z);
  std::vector<std::string> parts = strongest(battery, z);
  if (std::string words = in_words(rest.character); !words.empty()) parts.insert(parts.begin(), words);
  rest.looks_like = fmt::format("{}", fmt::join(parts, "; "));
  return rest;
}

std::vector<std::string> next_measurements(const Diagnosis& diagnosis, bool has_darks) {
  std::vector<std::string> list;
  if (diagnosis.verdict == Verdict::no_gap || diagnosis.verdict == Verdict::explained) return list;
  if (!has_darks)
    list.push_back(
        "100 or more frames with the shutter closed, same settings: they separate what the sensor does from "
        "what light does");
  if (!diagnosis.gap.shows)
    list.push_back("as many frames again: a gap that shows in half of them can confirm a name");
  std::string stage = diagnosis.unexplained.stage;
  if (stage.empty() && !diagnosis.effects.empty()) stage = diagnosis.effects.front().stage;
  if (stage == "sensor") {
    list.push_back("flat fields at five levels, 20 frames each: response per pixel and linearity");
    list.push_back(
        "dark frames at another EM gain or scan mode: what comes before and after the multiplication");
  } else if (stage == "optics") {
    list.push_back(
        "frames with the focus moved by about one depth of field to either side: width against field "
        "position");
    list.push_back("frames without atoms, light on: background against atoms' own light");
  } else {
    list.push_back("two images of the same atoms in each shot: hopping and loss against brightness");
    list.push_back("an exposure half as long: what grows with time and what with light");
  }
  return list;
}

std::string sentence_of(const Diagnosis& d) {
  const auto percent = [](double fraction) {
    return fmt::format("{:.0f} %", 100 * std::clamp(fraction, 0.0, 1.0));
  };
  const auto names = [&] {
    std::vector<std::string> list;
    for (const FoundEffect& effect : d.effects) {
      const FoundParameter* p = effect.parameters.empty() ? nullptr : &effect.parameters.front();
      list.push_back(p ? fmt::format("{} ({} {:.3g} +- {:.1g}{}; {} stage)", effect.name, p->name, p->value,
                                     p->error(), p->unit == "1" ? "" : " " + p->unit, effect.stage)
                       : effect.name);
    }
    return fmt::format("{}", fmt::join(list, " and "));
  };
  switch (d.verdict) {
    case Verdict::no_gap:
      return fmt::format("The frames agree with the calibrated plain model (p = {:.2g}{}).", d.p_gap,
                         d.frames.is_all()
                             ? ""
                             : fmt::format("; {} of {} were looked at", d.frames.count(), d.frames.all()));
    case Verdict::explained:
      return fmt::format("{} {} {} of the gap on held-out frames.", names(),
                         d.effects.size() > 1 ? "close" : "closes", percent(d.gap.closed));
    case Verdict::partly_explained:
      if (!d.gap.explains.empty())
        return fmt::format(
            "{} {} {} of the gap in {} on held-out frames; what remains, there and elsewhere, is not "
            "explained: {}.",
            names(), d.effects.size() > 1 ? "close" : "closes", percent(d.gap.part_closed),
            in_a_row(d.gap.explains), d.unexplained.looks_like);
      return fmt::format("{} {} {} of the gap on held-out frames; what remains is not explained.", names(),
                         d.effects.size() > 1 ? "close" : "closes", percent(d.gap.closed));
    case Verdict::ambiguous: {
      std::set<std::string> others;  // of several effects each has the same
      for (const FoundEffect& effect : d.effects)
        others.insert(effect.confusable_with.begin(), effect.confusable_with.end());
      if (!d.gap.shows)
        return fmt::format(
            "{}{} may explain a gap that all frames have (p = {:.1g}, with {} {:.2g}) and the held-out half "
            "does not show, which confirms no name.",
            names(), others.empty() ? "" : fmt::format(" or {}", fmt::join(others, ", ")), d.p_gap,
            d.effects.size() > 1 ? "them" : "it", d.p_after);
      return fmt::format("{} or {}: these frames cannot tell them apart.", names(), fmt::join(others, ", "));
    }
    case Verdict::unexplained: {
      // Notes of another camera make a gap, too.
      const std::vector<std::string>& warnings = d.calibration.warnings;
      return fmt::format(
          "There is a gap (p = {:.1g}), most likely in the {} stage, and no known effect explains it: {}.{}",
          d.p_gap, d.unexplained.stage, d.unexplained.looks_like,
          warnings.empty() ? "" : fmt::format(" Calibration warns: {}.", fmt::join(warnings, "; ")));
    }
  }
  return "";
}

}  // namespace atomcam
