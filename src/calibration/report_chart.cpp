#include "calibration/report_chart.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "calibration/report_page.hpp"

namespace atomcam::report {
namespace {

struct Range {
  double low = 1e300, high = -1e300;
  void take(double value) {
    if (!std::isfinite(value)) return;
    low = std::min(low, value);
    high = std::max(high, value);
  }
  bool empty() const { return low > high; }
};

/// Round numbers within a range, about `count` of them.
std::vector<double> ticks(const Range& range, int count) {
  const double rough = (range.high - range.low) / count;
  const double power = std::pow(10, std::floor(std::log10(rough)));
  const double step = power * (rough / power < 1.5   ? 1
                               : rough / power < 3.5 ? 2
                               : rough / power < 7.5 ? 5
                                                     : 10);
  std::vector<double> list;
  for (double k = std::ceil(range.low / step - 1e-9); k * step <= range.high + 1e-9 * step; ++k)
    list.push_back(k == 0 ? 0 : k * step);
  return list;
}

class Frame {
 public:
  Frame(const Chart& chart, Range x, Range y) : chart_(chart), x_(x), y_(y) {
    if (x_.empty()) x_ = {0, 1};
    if (y_.empty()) y_ = {0, 1};
    if (x_.high <= x_.low) x_.high = x_.low + 1, x_.low -= 1;
    if (chart.log_y) {
      y_.low = std::floor(std::log10(std::max(y_.low, 1e-30)));
      y_.high = std::ceil(std::log10(std::max(y_.high, 1e-30)));
      y_.low = std::max(y_.low, y_.high - 8);
      if (y_.high <= y_.low) y_.high = y_.low + 1;
    } else {
      if (chart.from_zero) y_.take(0);
      if (y_.high <= y_.low) {
        const double some = std::max(1e-12, std::fabs(y_.low) * 0.1);
        y_.high += some, y_.low -= some;
      }
      const double room = 0.06 * (y_.high - y_.low);
      if (!(chart.from_zero && y_.low == 0)) y_.low -= room;
      y_.high += room;
    }
  }
  double px(double x) const {
    return left + (x - x_.low) / (x_.high - x_.low) * (chart_.width - left - right);
  }
  double py(double y) const {
    const double v = chart_.log_y ? (y > 0 ? std::log10(y) : y_.low) : y;
    const double t = std::clamp((v - y_.low) / (y_.high - y_.low), -0.02, 1.02);
    return chart_.height - bottom - t * (chart_.height - top - bottom);
  }
  std::string axes() const {
    const double x0 = left, x1 = chart_.width - right, y0 = chart_.height - bottom, y1 = top;
    std::string out = fmt::format(
        "<rect x=\"{:.1f}\" y=\"{:.1f}\" width=\"{:.1f}\" height=\"{:.1f}\" fill=\"none\" "
        "stroke=\"#888\"/>\n",
        x0, y1, x1 - x0, y0 - y1);
    const auto text = [&](double x, double y, const char* anchor, const std::string& words, int size) {
      out += fmt::format(
          "<text x=\"{:.1f}\" y=\"{:.1f}\" text-anchor=\"{}\" font-size=\"{}\" fill=\"#333\">{}</text>\n", x,
          y, anchor, size, escaped(words));
    };
    for (const double t : ticks(x_, 6)) {
      out += fmt::format("<path d=\"M{:.1f} {:.1f}v4\" stroke=\"#888\"/>\n", px(t), y0);
      text(px(t), y0 + 16, "middle", short_number(t), 11);
    }
    if (chart_.log_y) {
      const int step = y_.high - y_.low > 5 ? 2 : 1;
      for (int e = static_cast<int>(y_.low); e <= static_cast<int>(y_.high); e += step) {
        const double y = py(std::pow(10, e));
        out += fmt::format("<path d=\"M{:.1f} {:.1f}h-4\" stroke=\"#888\"/>\n", x0, y);
        text(x0 - 7, y + 4, "end", fmt::format("1e{}", e), 11);
      }
    } else {
      for (const double t : ticks(y_, 5)) {
        out += fmt::format("<path d=\"M{:.1f} {:.1f}h-4\" stroke=\"#888\"/>\n", x0, py(t));
        text(x0 - 7, py(t) + 4, "end", short_number(t), 11);
      }
      if (y_.low < 0 && y_.high > 0)
        out += fmt::format("<path d=\"M{:.1f} {:.1f}H{:.1f}\" stroke=\"#ccc\"/>\n", x0, py(0), x1);
    }
    text(x0, 16, "start", chart_.title, 13);
    text((x0 + x1) / 2, chart_.height - 6, "middle", chart_.x_label, 12);
    out += fmt::format(
        "<text transform=\"translate(13 {:.1f}) rotate(-90)\" text-anchor=\"middle\" font-size=\"12\" "
        "fill=\"#333\">{}</text>\n",
        (y0 + y1) / 2, escaped(chart_.y_label));
    return out;
  }

  static constexpr double left = 66, right = 14, top = 44, bottom = 42;

 private:
  const Chart& chart_;
  Range x_, y_;
};

std::string path_of(const Frame& frame, const std::vector<double>& x, const std::vector<double>& y) {
  std::string path;
  bool on = false;
  for (std::size_t i = 0; i < std::min(x.size(), y.size()); ++i) {
    if (!std::isfinite(x[i]) || !std::isfinite(y[i])) {
      on = false;
      continue;
    }
    path += fmt::format("{}{:.1f} {:.1f}", on ? 'L' : 'M', frame.px(x[i]), frame.py(y[i]));
    on = true;
  }
  return path;
}

std::string opening(int width, int height) {
  return fmt::format("<svg viewBox=\"0 0 {0} {1}\" width=\"{0}\" height=\"{1}\" role=\"img\">\n", width,
                     height);
}

}  // namespace

std::string svg(const Chart& chart) {
  Range x, y;
  const auto take_y = [&](double value) {
    if (!chart.log_y || value > 0) y.take(value);
  };
  for (const Line& line : chart.lines) {
    for (const double v : line.x) x.take(v);
    for (const double v : line.y) take_y(v);
  }
  for (const Band& band : chart.bands)
    for (std::size_t i = 0; i < band.x.size(); ++i)
      x.take(band.x[i]), take_y(band.low[i]), take_y(band.high[i]);
  const Frame frame(chart, x, y);
  std::string out = opening(chart.width, chart.height);
  double legend = Frame::left;
  const auto entry = [&](const std::string& label, const std::string& mark) {
    if (label.empty()) return;
    out += fmt::format(
        "<g transform=\"translate({:.0f} 33)\">{}<text x=\"22\" y=\"4\" font-size=\"11\" "
        "fill=\"#333\">{}</text></g>\n",
        legend, mark, escaped(label));
    legend += 36 + 5.8 * static_cast<double>(label.size());
  };
  for (const Band& band : chart.bands) {
    std::string path;
    std::vector<std::size_t> good;
    for (std::size_t i = 0; i < band.x.size(); ++i)
      if (std::isfinite(band.low[i]) && std::isfinite(band.high[i])) good.push_back(i);
    for (const std::size_t i : good)
      path += fmt::format("{}{:.1f} {:.1f}", path.empty() ? 'M' : 'L', frame.px(band.x[i]),
                          frame.py(band.high[i]));
    for (auto i = good.rbegin(); i != good.rend(); ++i)
      path += fmt::format("L{:.1f} {:.1f}", frame.px(band.x[*i]), frame.py(band.low[*i]));
    if (path.empty()) continue;
    out += fmt::format("<path d=\"{}Z\" fill=\"{}\" fill-opacity=\"0.3\" stroke=\"none\"/>\n", path,
                       band.colour);
    entry(band.label,
          fmt::format("<rect y=\"-5\" width=\"18\" height=\"10\" fill=\"{}\" fill-opacity=\"0.3\"/>",
                      band.colour));
  }
  for (const Line& line : chart.lines) {
    if (line.points) {
      for (std::size_t i = 0; i < std::min(line.x.size(), line.y.size()); ++i) {
        if (!std::isfinite(line.y[i]) || (chart.log_y && line.y[i] <= 0)) continue;
        const double at = frame.px(line.x[i]);
        if (i < line.error.size() && line.error[i] > 0)
          out += fmt::format("<path d=\"M{0:.1f} {1:.1f}V{2:.1f}\" stroke=\"{3}\" stroke-width=\"1\"/>\n", at,
                             frame.py(line.y[i] - line.error[i]), frame.py(line.y[i] + line.error[i]),
                             line.colour);
        out += fmt::format("<circle cx=\"{:.1f}\" cy=\"{:.1f}\" r=\"1.9\" fill=\"{}\"/>\n", at,
                           frame.py(line.y[i]), line.colour);
      }
      entry(line.label, fmt::format("<circle cx=\"9\" r=\"2.5\" fill=\"{}\"/>", line.colour));
      continue;
    }
    const std::string dash = line.dashed ? " stroke-dasharray=\"5 3\"" : "";
    const std::string path = path_of(frame, line.x, line.y);
    if (!path.empty())
      out += fmt::format("<path d=\"{}\" fill=\"none\" stroke=\"{}\" stroke-width=\"{}\"{}/>\n", path,
                         line.colour, line.width, dash);
    entry(line.label, fmt::format("<path d=\"M0 0H18\" stroke=\"{}\" stroke-width=\"{}\"{}/>", line.colour,
                                  std::max(1.4, line.width), dash));
  }
  out += frame.axes();
  return out + "</svg>\n";
}

std::string bars_svg(const std::string& title, const std::string& y_label, const std::vector<Bar>& bars,
                     int width, int height) {
  Chart chart;
  chart.title = title;
  chart.y_label = y_label;
  chart.width = width;
  chart.height = height;
  chart.from_zero = true;
  Range y;
  for (const Bar& bar : bars) y.take(bar.value - bar.error), y.take(bar.value + bar.error);
  y.take(0);
  constexpr double label_room = 150;
  Chart inner = chart;
  inner.height = height;
  const Frame frame(inner, {-0.6, static_cast<double>(bars.size()) - 0.4}, y);
  std::string out = opening(width, height + static_cast<int>(label_room) - 30);
  const double floor = height - Frame::bottom;
  const double broad = frame.px(0.35) - frame.px(-0.35);
  for (std::size_t k = 0; k < bars.size(); ++k) {
    const double x = frame.px(static_cast<double>(k)), a = frame.py(bars[k].value), b = frame.py(0);
    out += fmt::format(
        "<rect x=\"{:.1f}\" y=\"{:.1f}\" width=\"{:.1f}\" height=\"{:.1f}\" fill=\"{}\" "
        "fill-opacity=\"0.75\"/>\n",
        x - broad / 2, std::min(a, b), broad, std::fabs(a - b), blue);
    if (bars[k].error > 0)
      out += fmt::format(
          "<path d=\"M{0:.1f} {1:.1f}V{2:.1f}M{3:.1f} {1:.1f}h6M{3:.1f} {2:.1f}h6\" stroke=\"{4}\"/>\n", x,
          frame.py(bars[k].value - bars[k].error), frame.py(bars[k].value + bars[k].error), x - 3, ink);
    out += fmt::format(
        "<text transform=\"translate({:.1f} {:.1f}) rotate(-40)\" text-anchor=\"end\" font-size=\"11\" "
        "fill=\"#333\">{}</text>\n",
        x + 4, floor + 14, escaped(bars[k].label));
  }
  // The frame without numbers along x, which the labels stand for.
  out += fmt::format(
      "<rect x=\"{:.1f}\" y=\"{:.1f}\" width=\"{:.1f}\" height=\"{:.1f}\" fill=\"none\" stroke=\"#888\"/>\n",
      Frame::left, Frame::top, width - Frame::left - Frame::right, floor - Frame::top);
  const double room = 0.06 * (y.high - y.low);
  for (const double t : ticks({y.low - (y.low < 0 ? room : 0), y.high + room}, 5))
    out += fmt::format(
        "<path d=\"M{0:.1f} {1:.1f}h-4\" stroke=\"#888\"/><text x=\"{2:.1f}\" y=\"{3:.1f}\" "
        "text-anchor=\"end\" font-size=\"11\" fill=\"#333\">{4}</text>\n",
        Frame::left, frame.py(t), Frame::left - 7, frame.py(t) + 4, short_number(t));
  out += fmt::format("<path d=\"M{:.1f} {:.1f}H{:.1f}\" stroke=\"#555\"/>\n", Frame::left, frame.py(0),
                     width - Frame::right);
  out += fmt::format("<text x=\"{:.1f}\" y=\"16\" font-size=\"13\" fill=\"#333\">{}</text>\n", Frame::left,
                     escaped(title));
  out += fmt::format(
      "<text transform=\"translate(13 {:.1f}) rotate(-90)\" text-anchor=\"middle\" font-size=\"12\" "
      "fill=\"#333\">{}</text>\n",
      (floor + Frame::top) / 2, escaped(y_label));
  return out + "</svg>\n";
}

}  // namespace atomcam::report
