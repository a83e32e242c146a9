#include "diagnosis/report.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>

#include "calibration/report.hpp"
#include "calibration/report_chart.hpp"
#include "calibration/report_page.hpp"
#include "diagnosis/report_opinions.hpp"
#include "diagnosis/report_profiles.hpp"
#include "diagnosis/report_where.hpp"

namespace atomcam {
namespace {

using namespace report;

std::string percent(double fraction) {
  return std::isfinite(fraction) ? fmt::format("{:.0f} %", 100 * fraction) : "–";
}

std::string verdict_in_words(Verdict verdict) {
  std::string text(name_of(verdict));
  std::replace(text.begin(), text.end(), '_', ' ');
  return text;
}

std::string names_of(const std::vector<std::string>& effects) {
  return effects.empty() ? "plain model" : fmt::format("{}", fmt::join(effects, " + "));
}

/// The gap as one bar: what the effects close, what they leave, what no model can go below.
std::string gap_budget(const Diagnosis& diagnosis) {
  const GapClosed& gap = diagnosis.gap;
  struct Part {
    std::string label;
    double size;
    const char* colour;
  };
  std::vector<Part> parts;
  double level = gap.before;
  std::vector<std::string> found;
  for (const FoundEffect& effect : diagnosis.effects) found.push_back(effect.name);
  if (gap.steps.size() == found.size() && found.size() > 1) {
    for (const GapStep& step : gap.steps) {
      const double below = std::clamp(step.gap, gap.floor, level);
      parts.push_back({"closed by " + step.effect, level - below, green});
      level = below;
    }
  } else if (!found.empty()) {
    const double below = std::clamp(gap.after, gap.floor, level);
    parts.push_back({"closed by " + names_of(found), level - below, green});
    level = below;
  }
  const double floor = std::min(gap.floor, gap.before);
  const bool chance = diagnosis.verdict == Verdict::no_gap;
  parts.push_back(
      {chance ? fmt::format("more than the floor, by chance (p = {:.2g})", diagnosis.p_gap) : "left",
       std::max(0.0, level - floor), chance ? "#c9c9c4" : orange});
  parts.push_back(
      {diagnosis.against ? "floor: stacks that do not differ" : "floor: simulation against simulation", floor,
       grey});
  const double total = std::max(gap.before, 1e-9);
  constexpr double width = 720, height = 30;
  std::string bars, legend;
  double x = 0, y = height + 18;
  for (const Part& part : parts) {
    const double broad = width * part.size / total;
    bars += fmt::format(
        "<rect x=\"{:.1f}\" y=\"0\" width=\"{:.1f}\" height=\"{}\" fill=\"{}\" fill-opacity=\"0.8\" "
        "stroke=\"#fff\"/>\n",
        x, std::max(0.0, broad), height, part.colour);
    legend += fmt::format(
        "<rect x=\"0\" y=\"{:.1f}\" width=\"11\" height=\"11\" fill=\"{}\" fill-opacity=\"0.8\"/>"
        "<text x=\"18\" y=\"{:.1f}\" font-size=\"12\" fill=\"#333\">{}: {} ({})</text>\n",
        y - 10, part.colour, y, escaped(part.label), short_number(part.size, 3), percent(part.size / total));
    x += broad, y += 18;
  }
  return fmt::format("<figure><svg width=\"{:.0f}\" height=\"{:.0f}\" role=\"img\">\n{}{}</svg>\n", width,
                     y - 8, bars, legend) +
         fmt::format(
             "<figcaption style=\"max-width: 75ch\">Gap: {}. Before {}, after {}, floor "
             "{}.</figcaption></figure>\n",
             escaped(gap.metric), short_number(gap.before, 3), short_number(gap.after, 3),
             short_number(gap.floor, 3));
}

std::string found_effects(const Diagnosis& diagnosis) {
  if (diagnosis.effects.empty()) return {};
  std::string out =
      "<h2>Which effect</h2>\n<table>\n<tr><th>effect</th><th>stage</th><th>parameter</th>"
      "<th class=\"number\">value</th><th>unit</th><th class=\"number\">probability</th><th>confusable "
      "with</th></tr>\n";
  for (const FoundEffect& effect : diagnosis.effects) {
    const std::size_t lines = std::max<std::size_t>(1, effect.parameters.size());
    for (std::size_t k = 0; k < lines; ++k) {
      const FoundParameter* p = k < effect.parameters.size() ? &effect.parameters[k] : nullptr;
      out += fmt::format(
          "<tr><td>{}</td><td>{}</td><td>{}</td><td class=\"number\">{}</td><td>{}</td><td "
          "class=\"number\">{}</td>"
          "<td>{}</td></tr>\n",
          k == 0 ? escaped(effect.name) : "", k == 0 ? escaped(effect.stage) : "", p ? escaped(p->name) : "",
          p ? with_error(p->value, p->error()) : "", p && p->unit != "1" ? escaped(p->unit) : "",
          k == 0 ? short_number(effect.probability, 3) : "",
          k == 0 ? escaped(fmt::format("{}", fmt::join(effect.confusable_with, ", "))) : "");
    }
  }
  return out + "</table>\n";
}

/// A hypothesis that was fitted stands in the list twice: once from the scan. The fitted one tells more.
std::vector<Hypothesis> ranking(const Diagnosis& diagnosis) {
  std::vector<Hypothesis> list;
  for (const Hypothesis& one : diagnosis.hypotheses) {
    const auto same = std::find_if(list.begin(), list.end(),
                                   [&](const Hypothesis& other) { return other.effects == one.effects; });
    if (same == list.end())
      list.push_back(one);
    else if (one.p_value >= 0)
      *same = one;
  }
  std::stable_sort(list.begin(), list.end(), [](const Hypothesis& a, const Hypothesis& b) {
    if ((a.p_value >= 0) != (b.p_value >= 0)) return a.p_value >= 0;
    return a.p_value >= 0 ? a.closed > b.closed : a.log_evidence > b.log_evidence;
  });
  return list;
}

std::string hypotheses(const Diagnosis& diagnosis) {
  if (diagnosis.hypotheses.empty()) return {};
  std::vector<std::string> found;
  for (const FoundEffect& effect : diagnosis.effects) found.push_back(effect.name);
  std::string out =
      "<h2>What was tried</h2>\n<p class=\"note\">Evidence: logarithm of the likelihood ratio to the model "
      "before, from "
      "a scan of simulated stacks. The best were fitted by simulation: p is the probability that the fitted "
      "model "
      "gives a stack as far off as this one.</p>\n<table>\n<tr><th>hypothesis</th><th class=\"number\">ln "
      "evidence</th>"
      "<th class=\"number\">p of the fit</th><th class=\"number\">gap closed</th>"
      "<th class=\"number\">could pass for what was found</th><th>why not</th></tr>\n";
  for (const Hypothesis& one : ranking(diagnosis)) {
    const bool fitted = one.p_value >= 0, chosen = one.effects == found;
    const std::string why = !one.why_not.empty() ? one.why_not
                            : chosen             ? ""
                            : fitted             ? "passes, another one is likelier"
                                                 : "not fitted: others explain more";
    out += fmt::format(
        "<tr{}><td>{}</td><td class=\"number\">{:.1f}</td><td class=\"number\">{}</td><td "
        "class=\"number\">{}</td>"
        "<td class=\"number\">{}</td><td>{}</td></tr>\n",
        chosen ? " class=\"chosen\"" : "", escaped(names_of(one.effects)), one.log_evidence,
        fitted ? short_number(one.p_value, 2) : "", fitted ? percent(one.closed) : "",
        one.imitates >= 0 ? percent(one.imitates) : "", escaped(why));
  }
  return out + "</table>\n";
}

std::string inputs_markup(const DiagnosisInputs& inputs, const Diagnosis& diagnosis) {
  std::string out = "<table>\n<tr><th>input</th><th>file</th><th>frames</th><th>SHA-256</th></tr>\n";
  for (const DiagnosisInputs::File& file : inputs.files) {
    std::string frames;
    if (file.frames > 0)
      frames = fmt::format("{} × {} × {}", file.frames, file.shape.rows, file.shape.columns);
    if (const FrameChoice choice = diagnosis.looked_at(file.role); !choice.is_all())
      frames += fmt::format(", looked at: {}", choice.count());
    out += fmt::format("<tr><td>{}</td><td>{}</td><td>{}</td><td><code>{}</code></td></tr>\n",
                       escaped(file.role), escaped(file.path), frames, file.sha256);
  }
  return out + "</table>\n";
}

}  // namespace

int report_stacks(std::size_t frames, std::size_t pixels) {
  const double cost = static_cast<double>(frames) * static_cast<double>(pixels);
  return cost > 1e8 ? 3 : cost > 2e7 ? 4 : 8;
}

std::string diagnosis_report(const Diagnosis& diagnosis, const DiagnosisInputs& inputs,
                             const ReportProfiles& profiles) {
  const GapClosed& gap = diagnosis.gap;
  std::string out = diagnosis.against ? "<h1>One stack against another</h1>\n"
                                      : "<h1>Simulation against your frames</h1>\n";
  out += fmt::format("<p class=\"sentence\"><span class=\"verdict\">{}</span>{}</p>\n",
                     verdict_in_words(diagnosis.verdict), escaped(diagnosis.sentence));
  out += gap_budget(diagnosis);
  if (diagnosis.against)
    out += fmt::format("<p>Probability of two stacks as different as these by chance: {}.</p>\n",
                       short_number(diagnosis.p_gap, 2));
  else
    out += fmt::format("<p>Probability of frames as odd as these under the plain model: {}{}</p>\n",
                       short_number(diagnosis.p_gap, 2),
                       diagnosis.effects.empty()
                           ? "."
                           : fmt::format("; with the effects found: {}. {} of the gap is closed ({} to {}).",
                                         short_number(diagnosis.p_after, 2), percent(gap.closed),
                                         percent(gap.closed_low), percent(gap.closed_high)));
  if (diagnosis.unexplained.present)
    out += fmt::format("<p><b>Not explained:</b> {} stage; {}.</p>\n", escaped(diagnosis.unexplained.stage),
                       escaped(diagnosis.unexplained.looks_like));
  if (!diagnosis.next_measurement.empty()) {
    out += "<h2>What to measure next</h2>\n<ul>\n";
    for (const std::string& one : diagnosis.next_measurement) out += "<li>" + escaped(one) + "</li>\n";
    out += "</ul>\n";
  }
  out += found_effects(diagnosis);
  out += fmt::format(
      "<h2>Where</h2>\n<p class=\"note\">The strongest differences between the frames and the {}, in "
      "standard "
      "deviations of {}{}; labelled where fewer than one in a hundred would be a false discovery. Orange: "
      "more "
      "in the frames, blue: less.</p>\n",
      diagnosis.against ? "other stack" : "calibrated plain model",
      diagnosis.against ? "stacks that do not differ" : "simulated stacks",
      diagnosis.effects.empty() ? "" : " (before → with the effects found)");
  out += where_matrix(diagnosis);
  out += "<details><summary>One by one</summary>\n" + where_list(diagnosis, 40) + "</details>\n";
  if (!profiles.plain.empty()) {
    out += fmt::format("<h2>Frames, {}{}</h2>\n<p class=\"note\">Dots: the frames. Bands: ", profiles.other,
                       profiles.fixed.empty() ? "" : ", with the effects found");
    out += diagnosis.against ? "two standard deviations of what such stacks differ by, about the other stack."
                             : fmt::format("two standard deviations of {} simulated stacks about their mean.",
                                           profiles.plain.size());
    out += " The curves that differ most come first.</p>\n";
    out += curves(profiles, 6);
    out += "<h2>Maps</h2>\n" + maps(profiles);
  }
  out += second_opinions_markup(diagnosis.gap.second_opinions);
  out += hypotheses(diagnosis);
  out += "<h2>Calibration of the plain model</h2>\n<details><summary>Parameters</summary>\n" +
         parameter_table_markup(diagnosis.calibration) + "</details>\n";
  for (const std::string& warning : diagnosis.calibration.warnings)
    out += fmt::format("<p><b>Warning:</b> {}</p>\n", escaped(warning));
  out += "<h2>Made from</h2>\n" + inputs_markup(inputs, diagnosis);
  out += fmt::format("<p class=\"note\">atomcam {}, seed {}, {:.0f} s.</p>\n<pre>{}</pre>\n",
                     escaped(inputs.version), inputs.seed, diagnosis.seconds, escaped(inputs.command));
  return page("atomcam: " + verdict_in_words(diagnosis.verdict), out);
}

}  // namespace atomcam
