#include "calibration/report_page.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace atomcam::report {
namespace {

constexpr std::string_view style = R"(
body { font: 15px/1.45 Georgia, 'Times New Roman', serif; color: #1b1b1b; background: #fff;
  max-width: 1080px; margin: 2em auto; padding: 0 1.2em; }
h1 { font-size: 1.5em; font-weight: normal; margin: 0 0 .3em; }
h2 { font-size: 1.15em; font-weight: normal; border-bottom: 1px solid #bbb; margin: 2em 0 .7em; padding-bottom: .2em; }
p { margin: .5em 0; max-width: 75ch; }
p.sentence { font-size: 1.15em; }
p.note, figcaption { color: #555; font-size: .88em; }
figure { margin: 0; display: inline-block; vertical-align: top; break-inside: avoid; }
figcaption { margin: 0 0 .8em; max-width: 46ch; }
.row { display: flex; flex-wrap: wrap; gap: 1em 1.6em; align-items: flex-start; }
table { border-collapse: collapse; font-size: .88em; break-inside: auto; }
th { text-align: left; font-weight: normal; color: #555; border-bottom: 1px solid #999; padding: .2em .8em .2em 0; vertical-align: bottom; }
td { padding: .16em .8em .16em 0; border-bottom: 1px solid #e6e6e6; vertical-align: top; }
td.number, th.number { text-align: right; font-variant-numeric: tabular-nums; white-space: nowrap; }
tr.chosen td { font-weight: bold; }
tr.split td { color: #777; }
td.cell { text-align: center; min-width: 5.5em; padding: .25em .5em; border: 1px solid #fff; font-variant-numeric: tabular-nums; white-space: nowrap; }
.verdict { display: inline-block; border: 1px solid #1b1b1b; padding: .05em .6em; margin-right: .6em; font-size: .9em; letter-spacing: .03em; }
code, pre { font: .85em/1.4 'DejaVu Sans Mono', Consolas, monospace; }
pre { background: #f5f5f2; padding: .7em .9em; white-space: pre-wrap; overflow-wrap: anywhere; }
summary { cursor: pointer; color: #444; margin: .6em 0; }
img.map { image-rendering: pixelated; display: block; border: 1px solid #ccc; }
svg text { font-family: Helvetica, Arial, sans-serif; }
@media print { body { margin: 0; max-width: none; font-size: 11pt; } h2 { break-after: avoid; } a { color: inherit; } }
)";

}  // namespace

std::string escaped(std::string_view text) {
  std::string out;
  for (const char c : text) {
    switch (c) {
      case '&':
        out += "&amp;";
        break;
      case '<':
        out += "&lt;";
        break;
      case '>':
        out += "&gt;";
        break;
      case '"':
        out += "&quot;";
        break;
      default:
        out += static_cast<unsigned char>(c) < 32 && c != '\n' && c != '\t' ? ' ' : c;
    }
  }
  return out;
}

std::string short_number(double value, int figures) {
  if (!std::isfinite(value)) return "–";
  std::string text = fmt::format("{:.{}g}", value, figures);
  if (const auto e = text.find('e'); e != std::string::npos) {
    if (std::fabs(value) < 1e6 && std::fabs(value) >= 1) {
      text = fmt::format("{:.0f}", std::stod(text));
    } else {
      static constexpr const char* raised[] = {"⁰", "¹", "²", "³", "⁴", "⁵", "⁶", "⁷", "⁸", "⁹"};
      std::string power = std::to_string(std::stoi(text.substr(e + 1)));
      text = text.substr(0, e) + " × 10";
      for (const char digit : power) text += digit == '-' ? "⁻" : raised[digit - '0'];
    }
  }
  if (text.starts_with('-')) text.replace(0, 1, "−");
  return text;
}

std::string with_error(double value, double error) {
  if (!(error > 0) || !std::isfinite(error) || !std::isfinite(value)) return short_number(value);
  const int digits = 1 - static_cast<int>(std::floor(std::log10(error)));
  if (digits > 9) return short_number(value) + " ± " + short_number(error, 2);
  std::string text =
      fmt::format("{:.{}f} ± {:.{}f}", value, std::clamp(digits, 0, 9), error, std::clamp(digits, 0, 9));
  if (text.starts_with('-')) text.replace(0, 1, "−");
  return text;
}

std::string page(std::string_view title, std::string_view body) {
  return fmt::format(
      "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\"/>\n"
      "<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\"/>\n"
      "<title>{}</title>\n<style>{}</style>\n</head>\n<body>\n{}\n</body>\n</html>\n",
      escaped(title), style, body);
}

}  // namespace atomcam::report
