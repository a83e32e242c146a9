#include "diagnosis/report_opinions.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "calibration/report_page.hpp"

namespace atomcam::report {
namespace {

std::string words(std::string text) {
  std::replace(text.begin(), text.end(), '_', ' ');
  return text;
}

std::string cell(const Figure& figure) {
  const std::string text = !std::isfinite(figure.value)   ? ""
                           : !std::isfinite(figure.error) ? short_number(figure.value, 3)
                                                          : with_error(figure.value, figure.error);
  return fmt::format("<td class=\"number\">{}</td>", text);
}

std::string metrics(const SecondOpinions& opinions, bool fixed) {
  std::string out = fmt::format(
      "<table>\n<tr><th>metric</th><th class=\"number\">plain model</th>{}<th class=\"number\">floor</th>{}"
      "<th>sees</th><th>blind to</th></tr>\n",
      fixed ? "<th class=\"number\">with the effects</th>" : "",
      fixed ? "<th class=\"number\">closed</th>" : "");
  for (const SecondOpinion& one : opinions.metrics) {
    out += "<tr><td>" + escaped(words(one.metric)) + "</td>" + cell(one.before);
    if (fixed) out += cell(one.after);
    out += cell(one.floor);
    if (fixed)
      out += fmt::format("<td class=\"number\">{}</td>",
                         std::isfinite(one.closed) ? fmt::format("{:.0f} %", 100 * one.closed) : "–");
    out += fmt::format("<td>{}</td><td>{}</td></tr>\n", escaped(one.sees), escaped(one.blind_to));
  }
  return out + "</table>\n";
}

std::string detectors(const SecondOpinions& opinions, bool fixed) {
  std::string out =
      "<table>\n<tr><th>atom detector</th><th>frames</th><th class=\"number\">fidelity, from its scores</th>"
      "<th class=\"number\">separation of the peaks, widths</th><th class=\"number\">fidelity, from the "
      "truth</th></tr>\n";
  for (const DetectorOpinion& one : opinions.detectors) {
    const auto line = [&](const char* detector, const char* frames, const DetectorOpinion::OfFrames& said) {
      out += fmt::format("<tr><td>{}</td><td>{}</td>{}{}{}</tr>\n", detector, frames, cell(said.fidelity),
                         cell(said.separation), cell(said.truly));
    };
    line(words(one.detector).c_str(), "yours", one.real);
    line("", "plain model", one.before);
    if (fixed) line("", "with the effects", one.after);
  }
  return out + "</table>\n";
}

}  // namespace

std::string second_opinions_markup(const SecondOpinions& opinions) {
  if (opinions.metrics.empty()) return {};
  const bool fixed = std::isfinite(opinions.metrics.front().after.value);
  std::string out = fmt::format(
      "<h2>Second opinions</h2>\n<p class=\"note\">By metrics that no fit has seen, on {} held-out frames. "
      "The "
      "floor is what stacks simulated from the model itself give, with their scatter: only what is some of "
      "its "
      "errors above it is a difference.</p>\n",
      opinions.frames);
  out += metrics(opinions, fixed);
  if (!opinions.detectors.empty())
    out +=
        "<p class=\"note\">Real frames have no truth: a fidelity is estimated from the law of the scores, "
        "the "
        "same way for simulated frames, whose truth is known besides.</p>\n" +
        detectors(opinions, fixed);
  return out;
}

}  // namespace atomcam::report
