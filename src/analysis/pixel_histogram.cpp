// The histogram of dark pixels: its quantiles, what lies beyond the read noise, its tail, its codes.

#include <algorithm>
#include <cmath>

#include "analysis/family.hpp"
#include "analysis/law_bands.hpp"

namespace atomcam::analysis {
namespace {

constexpr std::size_t codes = 65536;

struct Quantile {
  std::string_view name;
  double level;
};
constexpr Quantile quantiles[] = {{"0001", .0001}, {"001", .001}, {"01", .01},    {"05", .05},
                                  {"16", .16},     {"50", .5},    {"84", .84},    {"95", .95},
                                  {"99", .99},     {"999", .999}, {"9999", .9999}};

class PixelHistogram : public Family {
 public:
  explicit PixelHistogram(const Layout& layout)
      : layout_(layout),
        law_(layout),
        counts_{std::vector<std::uint32_t>(codes), std::vector<std::uint32_t>(codes)} {}

  void first_look(const FirstLook& look) override {
    std::uint32_t* histogram = counts_[static_cast<std::size_t>(look.part)].data();
    const auto pixels = look.counts.pixels();
    if (layout_.dark_pixels.size() == pixels.size())
      for (const std::uint16_t code : pixels) ++histogram[code];
    else
      for (const std::uint32_t p : layout_.dark_pixels) ++histogram[pixels[p]];
  }

  void summarise(Part which, const Record& record, Sheet& sheet) const override {
    sheet.family("pixel_histogram");
    sheet.kind({"pixel_histogram", "intensity", "dark pixels"});
    std::size_t first = 0, last = codes;
    const auto at = [&](std::size_t code) -> double {
      if (which == Part::whole)
        return static_cast<double>(counts_[0][code]) + static_cast<double>(counts_[1][code]);
      return counts_[which == Part::first ? 0 : 1][code];
    };
    if (record.count(which) == 0) last = 0;
    while (first < last && at(first) == 0) ++first;
    while (last > first && at(last - 1) == 0) --last;
    std::vector<double> below(last - first + 1);  // number of pixels below each code
    for (std::size_t code = first; code < last; ++code)
      below[code - first + 1] = below[code - first] + at(code);
    const double total = below.back(), bias = static_cast<double>(layout_.bias),
                 read = static_cast<double>(layout_.read_noise);
    // Number of pixels below a value, each code spread over its unit interval.
    const auto number_below = [&](double value) {
      const double position =
          std::clamp(value + 0.5 - static_cast<double>(first), 0.0, static_cast<double>(last - first));
      const auto k = std::min(static_cast<std::size_t>(position), below.size() - 1);
      const double next = k + 1 < below.size() ? below[k + 1] : below[k];
      return below[k] + (position - static_cast<double>(k)) * (next - below[k]);
    };
    const auto quantile = [&](double level) {
      if (total == 0) return not_a_number;
      const auto k = static_cast<std::size_t>(std::upper_bound(below.begin(), below.end(), level * total) -
                                              below.begin());
      if (k == 0 || k >= below.size()) return static_cast<double>(last) - 0.5;
      return static_cast<double>(first + k - 1) - 0.5 +
             (level * total - below[k - 1]) / (below[k] - below[k - 1]);
    };
    for (const Quantile& q : quantiles)
      sheet.put_unsteady("quantile", q.name, std::asinh((quantile(q.level) - bias) / read));
    const auto above = [&](double value) { return total - number_below(value); };
    const auto root = [&](double number) { return std::sqrt(std::max(number, 0.0) / total); };
    const double band3 = bias + 3 * read, band5 = bias + 5 * read, band8 = bias + 8 * read,
                 band15 = bias + 15 * read;
    sheet.put("between_3_and_5_read_noises", root(above(band3) - above(band5)));
    sheet.put("between_5_and_8_read_noises", root(above(band5) - above(band8)));
    sheet.put("between_8_and_15_read_noises", root(above(band8) - above(band15)));
    sheet.put_unsteady("above_15_read_noises", root(above(band15)));
    sheet.put_unsteady("below_3_read_noises", root(number_below(bias - 3 * read)));
    sheet.put_unsteady("below_5_read_noises", root(number_below(bias - 5 * read)));

    // Moments, clipped where the model's law ends, so that a cosmic ray is one pixel among many.
    const double scale = std::max(layout_.white, read);
    const double end =
        bias + (layout_.multiplied ? 12 * static_cast<double>(layout_.counts_per_e) : 8 * scale) + 5 * read;
    double mean = 0, odd = 0, low_tail = 0, low_number = 0, high_tail = 0, high_number = 0;
    const double gain = static_cast<double>(layout_.counts_per_e);
    const double low_end = band5 + gain, high_begin = std::max(band5, bias + gain);
    for (std::size_t code = first; code < last; ++code) {
      const double n = at(code), x = static_cast<double>(code);
      mean += n * std::min(x, end);
      odd += code % 2 ? n : -n;
      if (x > band5 && x <= low_end) {
        low_tail += n * (x - band5);
        low_number += n;
      }
      if (x > high_begin && x <= end) {
        high_tail += n * (x - high_begin);
        high_number += n;
      }
    }
    mean /= total;
    double m2 = 0, m3 = 0, m4 = 0, all = 0;
    for (std::size_t code = first; code < last; ++code) {
      const double n = at(code), d = std::min(static_cast<double>(code), end) - mean;
      m2 += n * d * d;
      m3 += n * d * d * d;
      m4 += n * d * d * d * d;
      all += n * (static_cast<double>(code) - mean) * (static_cast<double>(code) - mean);
    }
    m2 /= total, m3 /= total, m4 /= total, all /= total;
    sheet.put("variance", std::log(m2));
    sheet.put("skewness", std::asinh(m3 / std::pow(m2, 1.5)));
    sheet.put("kurtosis", std::log(m4 / (m2 * m2)));
    sheet.put_unsteady("unclipped_variance", std::log(all / m2));
    // Mean excess over a threshold: the gain, for an exponential tail; in the first gain's length it is
    // shorter where charge was made on the way through the register.
    sheet.put("tail_length", std::log((high_tail + gain) / (high_number + 1) / gain));
    sheet.put("tail_bend", (low_tail + gain / 2) / (low_number + 1) / gain);
    sheet.put("tail_fill", std::log((low_number + 1) / (high_number + 1)));
    // Codes that the converter prefers or leaves out.
    const double width = std::sqrt(total);
    sheet.put("odd_codes", std::asinh(odd / width / 4));
    double missing = 0;
    const double p16 = quantile(.16), p84 = quantile(.84);
    for (std::size_t code = first + 1; code + 1 < last; ++code)
      if (const double x = static_cast<double>(code); x > p16 && x < p84) {
        // Of the law's own shape, where it is known.
        const double expected = law_.probability(code);
        const double around =
            expected *
            (at(code - 1) / law_.probability(code - 1) + at(code + 1) / law_.probability(code + 1)) / 2;
        if (around > 0) missing += std::pow(at(code) - around, 2) / (1.5 * around);
      }
    sheet.put("comb", std::log(missing / std::max(1.0, p84 - p16) + 0.1));
    law_.put(below, static_cast<int>(first), sheet);
    sheet.kind({"pixel_histogram", "intensity", "whole frame"});
    sheet.put_unsteady("smallest", std::asinh((quantile(0) - bias) / read));
    sheet.put_unsteady("largest", std::log(std::max(quantile(1) - bias, 1.0)));
  }

 private:
  const Layout& layout_;
  LawBands law_;
  std::array<std::vector<std::uint32_t>, 2> counts_;
};

}  // namespace

std::unique_ptr<Family> make_pixel_histogram(const Layout& layout) {
  return std::make_unique<PixelHistogram>(layout);
}

}  // namespace atomcam::analysis
