// Every family moves when what it is there for is put into the frames, and stays where it is otherwise:
// against the spread of plain stacks, at five standard deviations.

#include <gtest/gtest.h>

#include <cstdlib>
#include <iostream>
#include <map>
#include <numbers>

#include "analysis/synthetic.hpp"

namespace atomcam {
namespace {

using synthetic::Camera;
using synthetic::frames_of;
using synthetic::Hooks;
using synthetic::model_of;

constexpr std::size_t light_frames = 120, dark_frames = 60;

using Values = std::map<std::string, double>;

Values measured(const Camera& camera, std::uint64_t seed, const Hooks& hooks, bool in_darks) {
  const StackModel model = model_of(camera);
  const auto light = frames_of(camera, light_frames, seed, false, hooks);
  const auto darks = frames_of(camera, dark_frames, seed, true, in_darks ? hooks : Hooks{});
  const auto values = measure(model, light, &darks);
  const auto declarations = battery(model, true);
  Values result;
  for (std::size_t i = 0; i < declarations.size(); ++i) result[declarations[i].name] = values.whole[i];
  return result;
}

/// Mean and standard deviation of every statistic over plain stacks.
class Null {
 public:
  explicit Null(const Camera& camera) : camera_(camera) {
    for (std::uint64_t seed = 1; seed <= stacks; ++seed)
      for (const auto& [name, value] : measured(camera, seed, {}, false)) {
        auto& [sum, square] = sums_[name];
        sum += value / stacks;
        square += value * value / stacks;
      }
  }
  double z(const std::string& name, double value) const {
    const auto& [mean, square] = sums_.at(name);
    const double variance = std::max(square - mean * mean, 0.0) * stacks / (stacks - 1);
    // Counts of what never happens in a plain stack have no spread: any is many.
    return (value - mean) / std::sqrt(variance + 1e-6);
  }
  const Camera& camera() const { return camera_; }
  static constexpr double stacks = 40;

 private:
  Camera camera_;
  std::map<std::string, std::pair<double, double>> sums_;
};

const Null& null_of(bool multiplied) {
  static std::map<bool, Null> nulls;
  auto found = nulls.find(multiplied);
  if (found == nulls.end()) found = nulls.emplace(multiplied, Null(Camera{.multiplied = multiplied})).first;
  return found->second;
}

struct Case {
  std::string name;
  bool multiplied;
  bool in_darks;
  Hooks hooks;
  std::vector<std::string> move;  // at least these
};

double noise_of(std::uint64_t key) {
  key = (key + 0x9e3779b97f4a7c15) * 0xbf58476d1ce4e5b9;
  key = (key ^ (key >> 29)) * 0x94d049bb133111eb;
  key ^= key >> 32;
  std::mt19937 random(static_cast<std::uint32_t>(key));
  return std::normal_distribution<double>()(random);
}

std::vector<Case> cases() {
  constexpr int size = 64;
  const auto at = [](int r, int c) { return static_cast<std::size_t>(r * size + c); };
  const auto in_counts = [](auto add) {  // add(frame, row, column) in counts
    return Hooks{.counts = [add](std::size_t n, std::vector<double>& counts) {
      for (int r = 0; r < size; ++r)
        for (int c = 0; c < size; ++c) counts[static_cast<std::size_t>(r * size + c)] += add(n, r, c);
    }};
  };
  const auto in_brightness = [](auto change) {
    return Hooks{.brightness = [change](std::size_t n, std::vector<double>& b) { change(n, b); }};
  };
  std::vector<Case> list;
  list.push_back({"row noise",
                  true,
                  true,
                  in_counts([](std::size_t n, int r, int) { return 1.0 * noise_of(n * 64 + r); }),
                  {"light.lines.rows.variance", "dark.lines.rows.variance"}});
  list.push_back({"column noise",
                  false,
                  true,
                  in_counts([](std::size_t n, int, int c) { return 1.0 * noise_of(n * 64 + c); }),
                  {"light.lines.columns.variance", "dark.lines.columns.variance"}});
  list.push_back({"stripes",
                  true,
                  true,
                  in_counts([](std::size_t n, int r, int c) {
                    return 0.5 * std::sin(2 * std::numbers::pi * ((r * 100 + c) / 7.3) + n * 2.4);
                  }),
                  {"light.readout_spectrum.peak_oblique", "dark.readout_spectrum.peak_oblique"}});
  list.push_back({"baseline that wanders",
                  true,
                  true,
                  in_counts([](std::size_t n, int, int) { return 0.5 * std::sin(n / 9.0); }),
                  {"light.frames.level.variance", "dark.frames.level.variance",
                   "light.frames.level.correlation_1", "light.frames.level.peak"}});
  list.push_back(
      {"first frames",
       true,
       true,
       in_counts([](std::size_t n, int, int) { return 2 * std::exp(-static_cast<double>(n) / 2); }),
       {"light.frames.level.first_frames", "dark.frames.level.first_frames"}});
  list.push_back({"odd frames",
                  false,
                  true,
                  in_counts([](std::size_t n, int, int) { return n % 2 ? 0.5 : 0; }),
                  {"light.frames.level.odd_frames"}});
  list.push_back({"slope",
                  false,
                  true,
                  in_counts([](std::size_t, int, int c) { return c * 0.02; }),
                  {"light.static_offsets.gradient_x", "dark.static_offsets.gradient_x",
                   "dark.static_charge.gradient_x"}});
  list.push_back({"column pattern",
                  false,
                  true,
                  in_counts([](std::size_t, int, int c) { return c % 8 == 0 ? 1.0 : 0; }),
                  {"light.static_offsets.columns.period_8", "dark.static_offsets.columns.period_8",
                   "dark.static_offsets.columns.variance"}});
  list.push_back({"first column",
                  true,
                  true,
                  in_counts([](std::size_t, int, int c) { return c == 0 ? 3 : 0; }),
                  {"light.static_offsets.columns.first", "dark.static_offsets.columns.first"}});
  list.push_back({"fixed pattern",
                  true,
                  true,
                  in_counts([](std::size_t, int r, int c) { return 1.5 * noise_of(r * 64 + c); }),
                  {"light.static_offsets.spread", "dark.static_offsets.spread"}});
  list.push_back({"waves",
                  true,
                  true,
                  in_counts([](std::size_t, int r, int c) { return 0.4 * std::sin((r * 5 + c * 7) * 0.1); }),
                  {"light.static_offsets.peak_oblique", "dark.static_offsets.peak_oblique"}});
  list.push_back({"two peaks",
                  false,
                  true,
                  in_counts([](std::size_t n, int r, int c) {
                    return (r * 64 + c) % 331 == 0 ? 10 * (noise_of(n * 4096 + r * 64 + c) > 0) : 0;
                  }),
                  {"light.temporal_maps.noisiest_few.variance", "dark.temporal_maps.noisy"}});
  list.push_back({"telegraph",
                  false,
                  true,
                  in_counts([](std::size_t n, int r, int c) {
                    return (r * 64 + c) % 331 == 0 ? 12 * (noise_of(n / 6 * 4096 + r * 64 + c) > 0) : 0;
                  }),
                  {"light.temporal_maps.noisiest_few.lag_1", "dark.temporal_maps.noisiest_few.lag_1",
                   "dark.temporal_maps.lag_1_map.above"}});
  list.push_back({"noise of one half",
                  true,
                  true,
                  in_counts([](std::size_t n, int r, int c) {
                    return c < 32 ? 1.5 * noise_of(n * 4096 + r * 64 + c) : 0;
                  }),
                  {"dark.temporal_maps.left_right"}});
  list.push_back({"crosstalk",
                  false,
                  false,
                  {.counts =
                       [at](std::size_t, std::vector<double>& counts) {
                         std::vector<double> from = counts;
                         for (int r = 0; r < size; ++r)
                           for (int c = 1; c + 1 < size; ++c)
                             counts[at(r, c)] +=
                                 0.01 * (from[at(r, c - 1)] + from[at(r, c + 1)] - 2 * from[at(r, c)]);
                       }},
                  {"light.neighbours.dark.right_1", "light.neighbours.all.right_1"}});
  list.push_back({"tail along the row",
                  true,
                  true,
                  {.counts =
                       [at](std::size_t, std::vector<double>& counts) {
                         for (int r = 0; r < size; ++r)
                           for (int c = size - 1; c > 0; --c)
                             counts[at(r, c)] += 0.01 * (counts[at(r, c - 1)] - 200);
                       }},
                  {"light.trailing.right_1"}});
  auto last = std::make_shared<std::vector<double>>();
  list.push_back({"lag of the image",
                  true,
                  false,
                  {.counts =
                       [last](std::size_t n, std::vector<double>& counts) {
                         const std::vector<double> now = counts;
                         if (n > 0)
                           for (std::size_t i = 0; i < counts.size(); ++i)
                             counts[i] += 0.01 * ((*last)[i] - 200);
                         *last = now;
                       }},
                  {"light.trailing.next_frame", "light.sites.memory.afterglow"}});
  list.push_back({"hot pixels",
                  true,
                  true,
                  {.counts =
                       [](std::size_t n, std::vector<double>& counts) {
                         for (std::size_t i = 5; i < counts.size(); i += 797)
                           if (noise_of(n * 4096 + i) > 0) counts[i] += 90;
                       }},
                  {"dark.static_charge.above", "dark.temporal_maps.noisy"}});
  list.push_back(
      {"cosmic rays",
       true,
       true,
       {.counts =
            [at](std::size_t n, std::vector<double>& counts) {
              if (n % 5) return;
              for (int k = 0; k < 6; ++k) counts[at(20 + static_cast<int>(n % 17), 10 + k)] += 5000;
            }},
       {"light.clusters.four_and_more", "dark.clusters.four_and_more", "dark.clusters.elongated"}});
  list.push_back({"frame sent twice",
                  true,
                  false,
                  {.counts =
                       [last](std::size_t n, std::vector<double>& counts) {
                         if (n == 77) counts = *last;
                         *last = counts;
                       }},
                  {"light.frames.most_alike"}});
  list.push_back({"missing codes",
                  true,
                  true,
                  {.counts =
                       [](std::size_t, std::vector<double>& counts) {
                         for (double& c : counts) c = 2 * std::floor(c / 2);
                       }},
                  {"light.pixel_histogram.odd_codes", "dark.pixel_histogram.comb"}});
  list.push_back({"charge made in the register",
                  true,
                  true,
                  {.counts =
                       [](std::size_t n, std::vector<double>& counts) {
                         for (std::size_t i = 0; i < counts.size(); ++i) {
                           const double u = noise_of(n * 4096 + i);
                           if (u > 2.5) counts[i] += 60 * std::exp(-(u - 2.5) * 12);
                         }
                       }},
                  {"dark.pixel_histogram.between_5_and_8_read_noises", "dark.pixel_histogram.tail_fill"}});
  list.push_back({"bright and dim sites",
                  true,
                  false,
                  in_brightness([](std::size_t, std::vector<double>& b) {
                    for (std::size_t s = 0; s < b.size(); ++s) b[s] *= 1 + 0.08 * noise_of(s);
                  }),
                  {"light.sites.by_site.spread"}});
  list.push_back({"brightness slopes",
                  true,
                  false,
                  in_brightness([](std::size_t, std::vector<double>& b) {
                    for (std::size_t s = 0; s < b.size(); ++s)
                      b[s] *= 1 + 0.05 * (static_cast<double>(s % 5) - 2);
                  }),
                  {"light.sites.by_site.gradient_x"}});
  list.push_back({"brightness of frames",
                  true,
                  false,
                  in_brightness([](std::size_t n, std::vector<double>& b) {
                    for (double& one : b) one *= 1 + 0.06 * noise_of(n);
                  }),
                  {"light.sites.common.variance"}});
  list.push_back({"brightness drifts",
                  false,
                  false,
                  in_brightness([](std::size_t n, std::vector<double>& b) {
                    for (double& one : b) one *= 1 + 0.08 * (static_cast<double>(n) / 120 - 0.5);
                  }),
                  {"light.sites.common.trend"}});
  list.push_back({"half lights",
                  true,
                  false,
                  in_brightness([](std::size_t n, std::vector<double>& b) {
                    for (std::size_t s = 0; s < b.size(); ++s)
                      if (noise_of(n * 25 + s) > 1.8) b[s] *= 0.5;
                  }),
                  {"light.sites.partial"}});
  list.push_back({"exchange",
                  true,
                  false,
                  in_brightness([](std::size_t n, std::vector<double>& b) {
                    for (std::size_t s = 0; s + 1 < b.size(); ++s)
                      if (s % 5 < 4 && b[s] == 1 && b[s + 1] == 0 && noise_of(n * 25 + s) > 1.5)
                        b[s] = b[s + 1] = 0.5;
                  }),
                  {"light.sites.pairs.exchange"}});
  list.push_back({"two atoms in a site",
                  true,
                  false,
                  in_brightness([](std::size_t n, std::vector<double>& b) {
                    for (std::size_t s = 0; s < b.size(); ++s)
                      if (noise_of(n * 25 + s) > 2.3) b[s] = 2;
                  }),
                  {"light.sites.more_than_one"}});
  // Light that is where the model has none.
  const StackModel model = model_of(Camera{});
  const auto in_light = [model](auto add) {  // add(frame, lit sites, expected)
    auto lit = std::make_shared<std::vector<double>>();
    return Hooks{
        .brightness = [lit](std::size_t, std::vector<double>& b) { *lit = b; },
        .light = [lit, add, model](std::size_t n,
                                   std::vector<double>& expected) { add(n, *lit, model, expected); }};
  };
  /// Moves a fraction of every site's light by whole pixels.
  const auto moved = [at](const std::vector<double>& lit, const StackModel& of, std::vector<double>& expected,
                          auto fraction, int dr, int dc) {
    for (std::size_t s = 0; s < lit.size(); ++s)
      for (int r = 0; r < 11; ++r)
        for (int c = 0; c < 11; ++c) {
          const double light =
              lit[s] * of.atom_e * static_cast<double>(of.sites[s].share(r, c)) * fraction(s);
          const int row = of.sites[s].top + r, column = of.sites[s].left + c;
          if (row + dr < 0 || row + dr >= size || column + dc < 0 || column + dc >= size) continue;
          expected[at(row, column)] -= light;
          expected[at(row + dr, column + dc)] += light;
        }
  };
  list.push_back({"wider image",
                  true,
                  false,
                  in_light([moved](std::size_t, const std::vector<double>& lit, const StackModel& of,
                                   std::vector<double>& e) {
                    for (const int d : {-1, 1})
                      moved(
                          lit, of, e, [](std::size_t) { return 0.04; }, 0, d);
                  }),
                  {"light.point_spread.width_x.mean"}});
  list.push_back({"width along the field",
                  true,
                  false,
                  in_light([moved](std::size_t, const std::vector<double>& lit, const StackModel& of,
                                   std::vector<double>& e) {
                    for (const int d : {-1, 1})
                      moved(
                          lit, of, e, [](std::size_t s) { return 0.15 * static_cast<double>(s % 5) / 4; }, d,
                          0);
                  }),
                  {"light.point_spread.width_y.along_x"}});
  list.push_back({"position that wanders",
                  true,
                  false,
                  in_light([moved](std::size_t n, const std::vector<double>& lit, const StackModel& of,
                                   std::vector<double>& e) {
                    moved(
                        lit, of, e,
                        [n](std::size_t) { return 0.15 * (1 + std::sin(static_cast<double>(n) / 8)); }, 0, 1);
                  }),
                  {"light.position.x.variance", "light.position.x.correlation_1"}});
  list.push_back({"halo",
                  true,
                  false,
                  in_light([](std::size_t, const std::vector<double>& lit, const StackModel& of,
                              std::vector<double>& e) {
                    for (std::size_t s = 0; s < lit.size(); ++s)
                      for (int r = 0; r < size; ++r)
                        for (int c = 0; c < size; ++c) {
                          const double d = std::hypot(r - of.sites[s].y_px, c - of.sites[s].x_px);
                          if (d > 3)
                            e[static_cast<std::size_t>(r * size + c)] +=
                                lit[s] * of.atom_e * 0.08 * std::exp(-d / 6) / (2 * std::numbers::pi * 36);
                        }
                  }),
                  {"light.far_light.halo.near", "light.frames.level_against_light"}});
  list.push_back({"smear",
                  true,
                  false,
                  in_light([](std::size_t, const std::vector<double>& lit, const StackModel& of,
                              std::vector<double>& e) {
                    for (std::size_t s = 0; s < lit.size(); ++s)
                      for (int c = -1; c <= 1; ++c)
                        for (int r = 0; r < size; ++r)
                          e[static_cast<std::size_t>(r * size + static_cast<int>(of.sites[s].x_px) + c)] +=
                              lit[s] * 0.12;
                  }),
                  {"light.far_light.up", "light.far_light.down"}});
  list.push_back(
      {"ghost",
       true,
       false,
       in_light([](std::size_t, const std::vector<double>& lit, const StackModel& of,
                   std::vector<double>& e) {
         for (std::size_t s = 0; s < lit.size(); ++s)
           for (int c = -1; c <= 1; ++c)
             for (int r = -1; r <= 1; ++r)
               e[static_cast<std::size_t>((size + 4 - static_cast<int>(of.sites[s].y_px) + r) * size + size -
                                          1 - static_cast<int>(of.sites[s].x_px) + c)] += lit[s] * 0.3;
       }),
       {"light.far_light.ghost.turned"}});
  list.push_back(
      {"response of pixels",
       false,
       false,
       in_light([](std::size_t, const std::vector<double>&, const StackModel&, std::vector<double>& e) {
         for (std::size_t i = 0; i < e.size(); ++i) e[i] *= 1 + 0.05 * noise_of(i);
       }),
       {"light.point_spread.misfit.core"}});
  list.push_back({"light that saturates",
                  false,
                  false,
                  {.counts =
                       [](std::size_t, std::vector<double>& counts) {
                         for (double& c : counts) c = c > 200 ? 200 + (c - 200) * (1 - (c - 200) / 1500) : c;
                       }},
                  {"light.image_noise.occupied.core"}});
  list.push_back({"rows of sites fail",
                  true,
                  false,
                  in_brightness([](std::size_t n, std::vector<double>& b) {
                    for (std::size_t s = 0; s < b.size(); ++s)
                      if (noise_of(n * 5 + s / 5) > 1.4) b[s] = 0;
                  }),
                  {"light.sites.pairs.occupancy_rows"}});
  list.push_back({"beams along columns flicker",
                  true,
                  false,
                  in_brightness([](std::size_t n, std::vector<double>& b) {
                    for (std::size_t s = 0; s < b.size(); ++s) b[s] *= 1 + 0.1 * noise_of(n * 5 + s % 5);
                  }),
                  {"light.sites.pairs.light_columns"}});
  list.push_back({"quarters",
                  true,
                  true,
                  in_counts([](std::size_t, int r, int c) { return (r < 32) == (c < 32) ? 1.0 : 0.0; }),
                  {"dark.static_offsets.seam.columns_top", "dark.static_offsets.seam.rows_right"}});
  list.push_back({"distortion",
                  true,
                  false,
                  in_light([moved](std::size_t, const std::vector<double>& lit, const StackModel& of,
                                   std::vector<double>& e) {
                    moved(
                        lit, of, e,
                        [](std::size_t s) { return 0.06 * std::pow(static_cast<double>(s % 5) - 2, 2); }, 0,
                        1);
                  }),
                  {"light.point_spread.x.smooth", "light.point_spread.x.spread"}});
  list.push_back({"fringes across the sites",
                  true,
                  false,
                  in_brightness([](std::size_t, std::vector<double>& b) {
                    for (std::size_t s = 0; s < b.size(); ++s)
                      b[s] *= 1 + 0.08 * std::cos(1.7 * static_cast<double>(s % 5) +
                                                  0.9 * static_cast<double>(s / 5));
                  }),
                  {"light.sites.by_site.few_waves"}});
  list.push_back(
      {"response of odd columns",
       false,
       false,
       in_light([](std::size_t, const std::vector<double>&, const StackModel&, std::vector<double>& e) {
         for (std::size_t i = 0; i < e.size(); ++i) e[i] *= i % 2 ? 1.03 : 0.97;
       }),
       {"light.point_spread.columns.response_period_2"}});
  list.push_back(
      {"response of rows",
       true,
       false,
       in_light([](std::size_t, const std::vector<double>&, const StackModel&, std::vector<double>& e) {
         for (std::size_t i = 0; i < e.size(); ++i)
           e[i] *= (1 + 0.1 * noise_of(i / size)) * (i / size == 31 ? 0.5 : 1);
       }),
       {"light.point_spread.rows.response_variance", "light.point_spread.rows.response_largest"}});
  list.push_back(
      {"a pixel that hardly answers",
       false,
       false,
       in_light([](std::size_t, const std::vector<double>&, const StackModel& of, std::vector<double>& e) {
         const SiteImage& site = of.sites[7];
         e[static_cast<std::size_t>(static_cast<int>(site.y_px) * size + static_cast<int>(site.x_px))] *= 0.3;
       }),
       {"light.point_spread.pixels.loneliest"}});
  list.push_back({"charge that comes and goes with the frames",
                  true,
                  true,
                  in_counts([](std::size_t n, int r, int c) {
                    const bool there = noise_of((n * 64 + static_cast<std::uint64_t>(r)) * 64 +
                                                static_cast<std::uint64_t>(c)) > 2 - std::sin(n / 9.0);
                    return there ? 15.0 : 0.0;
                  }),
                  {"light.frames.noise_against_level", "dark.frames.noise_against_level"}});
  auto held = std::make_shared<std::vector<double>>();
  list.push_back({"light of the next frame",
                  true,
                  false,
                  {.counts =
                       [held](std::size_t n, std::vector<double>& counts) {
                         const std::vector<double> next = counts;  // frames come one later
                         if (n > 0)
                           for (std::size_t i = 0; i < counts.size(); ++i)
                             counts[i] = (*held)[i] + 0.01 * (next[i] - 200);
                         *held = next;
                       }},
                  {"light.sites.memory.foreglow"}});
  list.push_back({"images that get wider along the stack",
                  true,
                  false,
                  in_light([moved](std::size_t n, const std::vector<double>& lit, const StackModel& of,
                                   std::vector<double>& e) {
                    for (const int d : {-1, 1})
                      moved(
                          lit, of, e, [n](std::size_t) { return 0.0022 * static_cast<double>(n); }, 0, d);
                  }),
                  {"light.focus.width.trend", "light.focus.width.correlation_1"}});
  Hooks faint_and_wide = in_light(
      [moved](std::size_t, const std::vector<double>& lit, const StackModel& of, std::vector<double>& e) {
        const auto wider = [&lit](std::size_t s) { return lit[s] < 0.9 ? 0.2 : 0.0; };
        for (const int d : {-1, 1}) moved(lit, of, e, wider, 0, d), moved(lit, of, e, wider, d, 0);
      });
  faint_and_wide.brightness = [then = faint_and_wide.brightness](std::size_t n, std::vector<double>& b) {
    for (std::size_t s = 0; s < b.size(); ++s)
      if (noise_of(n * 25 + s) > 0.8) b[s] *= 0.7;
    then(n, b);
  };
  list.push_back({"images of faint atoms that are wider",
                  false,
                  false,
                  faint_and_wide,
                  {"light.focus.width.against_brightness"}});
  auto glowing = std::make_shared<std::vector<double>>();
  list.push_back({"light that fades over many frames",
                  true,
                  false,
                  {.counts =
                       [glowing](std::size_t n, std::vector<double>& counts) {
                         if (n == 0) glowing->assign(counts.size(), 0.0);
                         for (std::size_t i = 0; i < counts.size(); ++i) {
                           const double now = counts[i] - 200;
                           counts[i] += 0.003 * (*glowing)[i];
                           (*glowing)[i] = 0.95 * (*glowing)[i] + now;
                         }
                       }},
                  {"light.sites.memory.persistence"}});
  return list;
}

class Families : public testing::TestWithParam<std::size_t> {};

TEST_P(Families, Move) {
  const Case one = cases()[GetParam()];
  const Null& null = null_of(one.multiplied);
  const Values values = measured(null.camera(), 1000 + GetParam(), one.hooks, one.in_darks);
  for (const std::string& name : one.move) {
    ASSERT_TRUE(values.contains(name)) << name;
    EXPECT_GT(std::abs(null.z(name, values.at(name))), 5)
        << one.name << ": " << name << " " << values.at(name);
  }
  // ATOMCAM_PRINT=1 lists what moved.
  if (!std::getenv("ATOMCAM_PRINT")) return;
  std::vector<std::pair<double, std::string>> moved;
  for (const auto& [name, value] : values)
    if (const double z = null.z(name, value); std::abs(z) > 5) moved.emplace_back(-std::abs(z), name);
  std::sort(moved.begin(), moved.end());
  std::cout << one.name << ":";
  for (std::size_t i = 0; i < std::min<std::size_t>(moved.size(), 12); ++i)
    std::cout << " " << moved[i].second << " " << -moved[i].first << ";";
  std::cout << " (" << moved.size() << ")\n";
}

INSTANTIATE_TEST_SUITE_P(Cases, Families, testing::Range<std::size_t>(0, cases().size()),
                         [](const testing::TestParamInfo<std::size_t>& one) {
                           std::string name = cases()[one.param].name;
                           std::replace(name.begin(), name.end(), ' ', '_');
                           return name;
                         });

TEST(Plain, StacksStayPut) {
  for (const bool multiplied : {true, false}) {
    const Null& null = null_of(multiplied);
    std::size_t beyond = 0, total = 0;
    for (std::uint64_t seed = 500; seed < 510; ++seed)
      for (const auto& [name, value] : measured(null.camera(), seed, {}, false)) {
        ++total;
        if (const double z = null.z(name, value); !(std::abs(z) < 5)) {
          ++beyond;
          std::cout << "seed " << seed << ": " << name << " " << value << " z " << z << "\n";
        }
      }
    EXPECT_EQ(beyond, 0u) << "of " << total;
  }
}

// Light that differs from frame to frame and light that drifts vary as much along a stack; their steps do
// not.
TEST(Series, StepsTellNoiseFromDrift) {
  const auto light = [](auto factor) {
    return Hooks{.brightness = [factor](std::size_t n, std::vector<double>& b) {
      for (double& one : b) one *= factor(n);
    }};
  };
  const Null& null = null_of(false);
  const auto z = [&](const Hooks& hooks, const std::string& name) {
    return null.z(name, measured(null.camera(), 77, hooks, false).at(name));
  };
  const Hooks noise = light([](std::size_t n) { return 1 + 0.1 * noise_of(n); }),
              drift = light([](std::size_t n) { return 1 + 0.14 * std::sin(static_cast<double>(n) / 15); });
  for (const Hooks& hooks : {noise, drift}) EXPECT_GT(z(hooks, "light.sites.common.variance"), 5);
  EXPECT_GT(z(noise, "light.sites.common.steps"), 5);
  EXPECT_LT(std::abs(z(drift, "light.sites.common.steps")), 4);
}

// What a small stack may lack by chance (a pixel beyond three deviations) must not set it apart from others.
TEST(Plain, TheHighestPixelIsNeverMissing) {
  const Camera camera{.size = 32, .sites = 0};
  for (std::uint64_t seed = 1; seed <= 30; ++seed)
    EXPECT_GT(measured(camera, seed, {}, false).at("light.static_offsets.highest"), std::log(1 + 2)) << seed;
}

}  // namespace
}  // namespace atomcam
