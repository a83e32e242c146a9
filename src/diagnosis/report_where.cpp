#include "diagnosis/report_where.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>

#include "calibration/report_map.hpp"
#include "calibration/report_page.hpp"

namespace atomcam::report {
namespace {

constexpr double significant = 0.01;  // false discovery rate

std::string words(std::string text) {
  std::replace(text.begin(), text.end(), '_', ' ');
  return text;
}

std::string observable_of(const Difference& one) {
  return words(one.observable) + (one.statistic.starts_with("dark.") ? ", dark frames" : "");
}

std::string signed_number(double value) {
  std::string text = fmt::format("{:+.{}f}", value, std::fabs(value) >= 10 ? 0 : 1);
  if (text.starts_with('-')) text.replace(0, 1, "−");
  return text;
}

std::string rgb(const Colour& colour) {
  return fmt::format("#{:02x}{:02x}{:02x}", colour[0], colour[1], colour[2]);
}

}  // namespace

std::string where_matrix(const Diagnosis& diagnosis) {
  static constexpr std::array stages = {"scene", "optics", "sensor"};
  static constexpr std::array axes = {"space", "time", "intensity", "frequency", "site", "shape"};
  // Of each row, the strongest difference by axis; rows by their strongest.
  std::map<std::pair<std::string, std::string>, std::map<std::string, const Difference*>> rows;
  for (const Difference& one : diagnosis.where) {
    const Difference*& cell = rows[{one.stage, observable_of(one)}][one.axis];
    if (!cell || std::fabs(one.z) > std::fabs(cell->z)) cell = &one;
  }
  const bool fixed = !diagnosis.effects.empty();
  std::string out = "<table>\n<tr><th>stage</th><th>observable</th>";
  for (const char* axis : axes) out += fmt::format("<th style=\"text-align: center\">{}</th>", axis);
  out += "</tr>\n";
  for (const char* stage : stages) {
    std::vector<std::pair<double, const decltype(rows)::value_type*>> order;
    for (const auto& row : rows) {
      if (row.first.first != stage) continue;
      double strongest = 0;
      for (const auto& cell : row.second) strongest = std::max(strongest, std::fabs(cell.second->z));
      order.emplace_back(strongest, &row);
    }
    std::stable_sort(order.begin(), order.end(),
                     [](const auto& a, const auto& b) { return a.first > b.first; });
    for (std::size_t k = 0; k < order.size(); ++k) {
      out += fmt::format("<tr><td>{}</td><td>{}</td>", k == 0 ? stage : "",
                         escaped(order[k].second->first.second));
      for (const char* axis : axes) {
        const auto cell = order[k].second->second.find(axis);
        if (cell == order[k].second->second.end()) {
          out += "<td class=\"cell\" style=\"background: #f6f6f4\"></td>";
          continue;
        }
        const Difference& one = *cell->second;
        const double t = std::asinh(one.z / 3) / (2 * std::asinh(10.0));
        const Colour colour = colour_of(Palette::diverging, 0.5 + t);
        std::string label;
        if (one.q < significant)
          label = fixed ? signed_number(one.z) + " → " + signed_number(one.z_after) : signed_number(one.z);
        out += fmt::format(
            "<td class=\"cell\" style=\"background: {}{}\" title=\"{}\">{}</td>", rgb(colour),
            std::fabs(t) > 0.38 ? "; color: #fff" : "",
            escaped(fmt::format("{}, {}: z {:.1f}, q {:.2g}", one.statistic, one.place, one.z, one.q)),
            label);
      }
      out += "</tr>\n";
    }
  }
  return out + "</table>\n";
}

std::string where_list(const Diagnosis& diagnosis, std::size_t most) {
  const bool fixed = !diagnosis.effects.empty();
  std::string out = fmt::format(
      "<table>\n<tr><th>stage</th><th>statistic</th><th>axis</th><th>place</th><th class=\"number\">z</th>"
      "<th class=\"number\">q</th>{}</tr>\n",
      fixed ? "<th class=\"number\">z after</th>" : "");
  for (std::size_t k = 0; k < std::min(most, diagnosis.where.size()); ++k) {
    const Difference& one = diagnosis.where[k];
    out += fmt::format(
        "<tr><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td class=\"number\">{}</td><td "
        "class=\"number\">{}</td>{}"
        "</tr>\n",
        escaped(one.stage), escaped(one.statistic), escaped(one.axis), escaped(one.place),
        signed_number(one.z), short_number(one.q, 2),
        fixed ? fmt::format("<td class=\"number\">{}</td>", signed_number(one.z_after)) : "");
  }
  return out + "</table>\n";
}

}  // namespace atomcam::report
