#include "laws/measures.hpp"

#include <algorithm>
#include <cmath>
#include <complex>
#include <functional>
#include <limits>
#include <numbers>
#include <stdexcept>
#include <thread>

namespace atomcam::laws {
namespace {

constexpr int pixels = side_px * side_px;
constexpr int frames_per_block = 2 * pairs_per_block;
using Map = std::vector<double>;  // [row * side_px + column]

double mean_of(const std::vector<double>& values) {
  double sum = 0;
  for (const double value : values) sum += value;
  return sum / static_cast<double>(values.size());
}

double covariance(const std::vector<double>& a, const std::vector<double>& b) {
  const double mean_a = mean_of(a), mean_b = mean_of(b);
  double sum = 0;
  for (std::size_t i = 0; i < a.size(); ++i) sum += (a[i] - mean_a) * (b[i] - mean_b);
  return sum / static_cast<double>(a.size());
}

/// Sample variance.
double variance(const std::vector<double>& values) {
  return covariance(values, values) * static_cast<double>(values.size()) /
         static_cast<double>(values.size() - 1);
}

void transform(std::vector<std::complex<double>>& values) {
  const std::size_t n = values.size();
  for (std::size_t i = 1, j = 0; i < n; ++i) {
    std::size_t bit = n >> 1;
    for (; j & bit; bit >>= 1) j ^= bit;
    j ^= bit;
    if (i < j) std::swap(values[i], values[j]);
  }
  for (std::size_t length = 2; length <= n; length *= 2) {
    const std::complex<double> step = std::polar(1.0, -2 * std::numbers::pi / static_cast<double>(length));
    std::vector<std::complex<double>> turn(length / 2, 1);
    for (std::size_t k = 1; k < turn.size(); ++k) turn[k] = turn[k - 1] * step;
    for (std::size_t i = 0; i < n; i += length)
      for (std::size_t k = 0; k < length / 2; ++k) {
        const auto even = values[i + k], odd = values[i + k + length / 2] * turn[k];
        values[i + k] = even + odd;
        values[i + k + length / 2] = even - odd;
      }
  }
}

/// Frames in electrons, [frame][pixel].
struct Electrons {
  /// What stands out of a pixel's mean by more than `hit_e` is a hit: counted, and taken out of the frames.
  Electrons(const Stack& stack, const Stacks& stacks, double hit_e) {
    for (const CountImage& frame : stack.frames) {
      Map map(pixels);
      for (int i = 0; i < pixels; ++i)
        map[static_cast<std::size_t>(i)] =
            (frame.pixels()[static_cast<std::size_t>(i)] - stacks.bias_counts) / stacks.counts_per_electron;
      frames.push_back(std::move(map));
    }
    take_mean();
    for (Map& map : frames) {
      std::vector<bool> hit(pixels);
      double tracks = 0;
      for (int i = 0; i < pixels; ++i) {
        hit[i] = map[i] > mean[i] + hit_e;
        if (!hit[i]) continue;
        map[i] = mean[i];
        const bool goes_on =
            (i > 0 && hit[i - 1]) ||
            (i > side_px && (hit[i - side_px - 1] || hit[i - side_px] || hit[i - side_px + 1]));
        tracks += !goes_on;
      }
      hits.push_back(tracks);
    }
    take_mean();
  }
  void take_mean() {
    mean.assign(pixels, 0);
    for (const Map& map : frames)
      for (int i = 0; i < pixels; ++i) mean[i] += map[i] / static_cast<double>(frames.size());
  }
  const Map& at(int block, int frame) const { return frames[frames_per_block * block + frame]; }
  /// Frame minus each pixel's mean and minus what is left of the frame's mean; 0 where more than `hit_e` is
  /// left.
  Map deviation(int block, int frame) const {
    Map map = at(block, frame);
    for (int i = 0; i < pixels; ++i) map[i] -= mean[i];
    const double level = mean_of(map);
    for (double& value : map) value -= level;
    return map;
  }
  /// Mean of the block's even or odd pairs.
  Map half(int block, int which) const {
    Map map(pixels);
    for (int pair = which; pair < pairs_per_block; pair += 2)
      for (int image = 0; image < 2; ++image) {
        const Map& frame = at(block, 2 * pair + image);
        for (int i = 0; i < pixels; ++i) map[i] += frame[i] / pairs_per_block;
      }
    return map;
  }
  std::vector<Map> frames;
  Map mean;
  std::vector<double> hits;  // per frame
};

/// Means of 12 x 12 pixels.
std::vector<double> tiles(const Map& map) {
  constexpr int tile = 12, count = side_px / tile;
  std::vector<double> means(count * count);
  for (int y = 0; y < side_px; ++y)
    for (int x = 0; x < side_px; ++x)
      means[y / tile * count + x / tile] += map[y * side_px + x] / (tile * tile);
  return means;
}

/// What the map has of a pattern over the field, u and v from -1 to 1.
double share(const Map& map, const std::function<double(double u, double v)>& pattern) {
  double sum = 0;
  for (int y = 0; y < side_px; ++y)
    for (int x = 0; x < side_px; ++x)
      sum += map[y * side_px + x] * pattern((x + 0.5) / (side_px / 2.0) - 1, (y + 0.5) / (side_px / 2.0) - 1);
  return sum / pixels;
}

class Measures {
 public:
  explicit Measures(const Stacks& stacks)
      : read_noise_e_(stacks.read_noise_counts / stacks.counts_per_electron),
        atoms_(stacks.atoms, stacks, 600 + 10 * read_noise_e_),
        empty_(stacks.empty, stacks, 200 + 10 * read_noise_e_),
        dark_(stacks.dark, stacks, 100 + 10 * read_noise_e_) {}

  std::vector<Statistic> take() const {
    const auto of_dark = [this](std::vector<Statistic>& into) {
      for (int block = 0; block < blocks; ++block) dark_frames(into, block);
      pixel_series(into);
    };
    const auto of_light = [this](std::vector<Statistic>& into) {
      for (int block = 0; block < blocks; ++block) {
        empty_frames(into, block);
        site_frames(into, block);
      }
    };
    std::vector<Statistic> dark, light;
    std::thread other([&] { of_dark(dark); });
    of_light(light);
    other.join();
    dark.insert(dark.end(), light.begin(), light.end());
    return dark;
  }

 private:
  static void add(std::vector<Statistic>& into, const std::string& observable, const std::string& what,
                  double value) {
    for (Statistic& statistic : into)
      if (statistic.observable == observable && statistic.what == what) {
        statistic.values.push_back(value);
        return;
      }
    into.push_back({observable, what, {value}});
  }

  /// Products of neighbours, rows, columns: of frames without their means.
  void noise_structure(std::vector<Statistic>& into, const Electrons& stack, int block,
                       const std::string& where) const {
    double across = 0, down = 0, lag = 0;
    std::vector<double> row_means, column_means;
    for (int pair = 0; pair < pairs_per_block; ++pair) {
      const Map one = stack.deviation(block, 2 * pair), two = stack.deviation(block, 2 * pair + 1);
      for (const Map* map : {&one, &two}) {
        std::vector<double> rows(side_px), columns(side_px);
        for (int y = 0; y < side_px; ++y)
          for (int x = 0; x < side_px; ++x) {
            const double value = (*map)[y * side_px + x];
            if (x + 1 < side_px) across += value * (*map)[y * side_px + x + 1];
            if (y + 1 < side_px) down += value * (*map)[(y + 1) * side_px + x];
            rows[y] += value / side_px;
            columns[x] += value / side_px;
          }
        row_means.push_back(covariance(rows, rows));
        column_means.push_back(covariance(columns, columns));
      }
      for (int i = 0; i < pixels; ++i) lag += one[i] * two[i];
    }
    add(into, "horizontal_correlation", where, across / (frames_per_block * pixels));
    add(into, "vertical_correlation", where, down / (frames_per_block * pixels));
    add(into, "lag_correlation", where, lag / (pairs_per_block * pixels));
    add(into, "row_means", where, mean_of(row_means));
    add(into, "column_means", where, mean_of(column_means));
  }

  void dark_frames(std::vector<Statistic>& into, int block) const {
    noise_structure(into, dark_, block, "dark");
    std::vector<double> frame_means;
    double square = 0, centre = 0, tail = 0, tracks = 0;
    std::vector<double> spectrum(4096);
    std::vector<std::complex<double>> series;
    for (int frame = 0; frame < frames_per_block; ++frame) {
      const Map& map = dark_.at(block, frame);
      frame_means.push_back(mean_of(map));
      tracks += dark_.hits[frames_per_block * block + frame] + empty_.hits[frames_per_block * block + frame];
      const double level = frame_means.back() - mean_of(dark_.mean);
      if (frame % 2 == 0) series.assign(8192, 0);
      for (int i = 0; i < pixels; ++i) {
        const double value = map[i] - dark_.mean[i];
        square += value * value;
        centre += std::fabs(value) < read_noise_e_;
        tail += value > 5 * read_noise_e_;
        // Two frames at once, as real and imaginary part.
        if (i < 8192) series[i] += frame % 2 == 0 ? value - level : std::complex<double>(0, value - level);
      }
      if (frame % 2 == 0) continue;
      transform(series);
      for (std::size_t k = 1; k < spectrum.size(); ++k)
        spectrum[k] += std::norm(series[k]) + std::norm(series[series.size() - k]);
    }
    constexpr double values = frames_per_block * pixels;
    add(into, "pixel_histogram", "variance", std::log(square / values));
    add(into, "pixel_histogram", "centre", centre / values);
    add(into, "pixel_histogram", "tail", tail / values);
    add(into, "bright_clusters", "tracks", tracks / frames_per_block);
    add(into, "frame_means", "dark", std::log(variance(frame_means)));
    add(into, "row_spectrum", "highest peak",
        *std::max_element(spectrum.begin(), spectrum.end()) / mean_of(spectrum));
  }

  void empty_frames(std::vector<Statistic>& into, int block) const {
    noise_structure(into, empty_, block, "empty");
    const Map even = empty_.half(block, 0), odd = empty_.half(block, 1);
    Map whole(pixels);
    for (int i = 0; i < pixels; ++i) whole[i] = (even[i] + odd[i]) / 2;
    add(into, "mean_map", "pixels", covariance(even, odd));
    add(into, "mean_map", "dark pixels", covariance(dark_.half(block, 0), dark_.half(block, 1)));
    add(into, "mean_map", "tiles", covariance(tiles(even), tiles(odd)));
    add(into, "mean_map", "slope x", share(whole, [](double u, double) { return u; }));
    add(into, "mean_map", "slope y", share(whole, [](double, double v) { return v; }));
    add(into, "mean_map", "bowl", share(whole, [](double u, double v) { return u * u + v * v - 2.0 / 3; }));
    double spread = 0, temporal = 0, dark = 0;
    for (int frame = 0; frame < frames_per_block; ++frame) {
      const Map lit = empty_.deviation(block, frame), unlit = dark_.deviation(block, frame);
      spread += covariance(empty_.at(block, frame), empty_.at(block, frame)) / frames_per_block;
      temporal += covariance(lit, lit) / frames_per_block;
      dark += covariance(unlit, unlit) / frames_per_block;
    }
    const double level = mean_of(whole) - mean_of(dark_.half(block, 0));
    add(into, "mean_variance_curve", "temporal", (temporal - dark) / level);
    add(into, "mean_variance_curve", "spatial", (spread - dark) / level);
  }

  /// One site's image in a frame or in a mean of frames.
  struct SiteImage {
    double light = 0, x = 0, y = 0, xx = 0, yy = 0, behind = 0;
  };
  static double pixel(const Map& map, int x, int y) {
    return map[std::clamp(y, 0, side_px - 1) * side_px + std::clamp(x, 0, side_px - 1)];
  }
  static SiteImage look(const Map& map, int site) {
    const auto [cx, cy] = site_place(site);
    const int x0 = static_cast<int>(std::lround(cx)), y0 = static_cast<int>(std::lround(cy));
    double ground = 0;  // of the 40 pixels around the box
    for (int d = -5; d < 5; ++d)
      ground += (pixel(map, x0 + d, y0 - 5) + pixel(map, x0 + 5, y0 + d) + pixel(map, x0 - d, y0 + 5) +
                 pixel(map, x0 - 5, y0 - d)) /
                40;
    SiteImage image;
    for (int y = y0 - 4; y <= y0 + 4; ++y)
      for (int x = x0 - 4; x <= x0 + 4; ++x) {
        const double value = pixel(map, x, y) - ground, dx = x - cx, dy = y - cy;
        image.light += value;
        image.x += value * dx;
        image.y += value * dy;
        image.xx += value * dx * dx;
        image.yy += value * dy * dy;
      }
    for (int y = y0 - 1; y <= y0 + 1; ++y)
      for (int d = 4; d <= 5; ++d) image.behind += pixel(map, x0 + d, y) - pixel(map, x0 - d, y);
    return image;
  }

  void site_frames(std::vector<Statistic>& into, int block) const {
    double light = 0;  // mean of a filled site
    int lights = 0;
    std::vector<std::vector<SiteImage>> images(frames_per_block);
    for (int frame = 0; frame < frames_per_block; ++frame) {
      for (int site = 0; site < site_count; ++site) {
        images[frame].push_back(look(atoms_.at(block, frame), site));
        if (filled(site, frame / 2)) {
          light += images[frame][site].light;
          ++lights;
        }
      }
    }
    light /= lights;

    // Per site: its two filled pairs.
    std::vector<double> first(site_count), second(site_count), site_mean(site_count);
    for (int site = 0; site < site_count; ++site) {
      const int pair = filled(site, 0) ? 0 : 1;
      for (int image = 0; image < 2; ++image) {
        first[site] += images[2 * pair + image][site].light / 2 / light;
        second[site] += images[2 * (pair + 2) + image][site].light / 2 / light;
      }
    }
    add(into, "site_brightness", "spread", covariance(first, second));

    // Sums of all frames against the two peaks.
    double two = 0, three = 0, between = 0, empty_mean = 0, empty_square = 0, together = 0;
    std::vector<double> series, centroid_x, centroid_y, frame_level[2];
    for (int frame = 0; frame < frames_per_block; ++frame) {
      double sum = 0, sum2 = 0, whole = 0, x = 0, y = 0;
      for (int site = 0; site < site_count; ++site)
        if (filled(site, frame / 2)) whole += images[frame][site].light;
      const double here = 2 * whole / site_count;  // peaks are taken within their frame
      for (int site = 0; site < site_count; ++site) {
        const SiteImage& image = images[frame][site];
        const double relative = image.light / here;
        between += relative > 0.35 && relative < 0.65;
        if (filled(site, frame / 2)) {
          const double w = relative - 1, d = image.light / light - 1;
          two += w * w / lights;
          three += w * w * w / lights;
          sum += d;
          sum2 += d * d;
          x += image.x;
          y += image.y;
        } else {
          empty_mean += relative / lights;
          empty_square += relative * relative / lights;
        }
      }
      constexpr double n = site_count / 2.0;
      together += (sum * sum - sum2) / (n * (n - 1)) / frames_per_block;
      series.push_back(sum / n);
      centroid_x.push_back(x / whole);
      centroid_y.push_back(y / whole);
      frame_level[frame / 2 % 2].push_back(mean_of(atoms_.at(block, frame)));
    }
    add(into, "site_histogram", "width", two);
    add(into, "site_histogram", "skewness", three);
    add(into, "site_histogram", "between", between / (2 * lights));
    add(into, "site_histogram", "empty mean", empty_mean);
    add(into, "site_histogram", "empty width", empty_square - empty_mean * empty_mean);
    add(into, "site_correlation", "pairs of sites", std::asinh(together * site_count / two));
    add(into, "brightness_series", "variance", std::log(variance(series)));
    add(into, "centroid_series", "x", std::log(variance(centroid_x)));
    add(into, "centroid_series", "y", std::log(variance(centroid_y)));
    add(into, "frame_means", "atoms", std::log(variance(frame_level[0]) + variance(frame_level[1])));

    // From the first image of a shot to the second.
    double exchange = 0;
    for (int pair = 0; pair < pairs_per_block; ++pair)
      for (int site = 0; site < site_count; ++site) {
        const auto change = [&](int s) {
          return (images[2 * pair + 1][s].light - images[2 * pair][s].light) / light;
        };
        if (site % sites_per_side + 1 < sites_per_side) exchange += change(site) * change(site + 1);
        if (site + sites_per_side < site_count) exchange += change(site) * change(site + sites_per_side);
      }
    add(into, "neighbour_exchange", "products", exchange);

    shapes(into, block, light);
  }

  /// Of the mean images of filled sites.
  void shapes(std::vector<Statistic>& into, int block, double light) const {
    const Map means[2] = {atoms_.half(block, 0), atoms_.half(block, 1)};
    double behind = 0, gap = 0, smear = 0;
    std::vector<double> width_x, width_y, u, v;
    double slope_u = 0, slope_v = 0, bowl = 0;
    for (int site = 0; site < site_count; ++site) {
      const SiteImage image = look(means[filled(site, 0) ? 0 : 1], site);
      const auto [cx, cy] = site_place(site);
      const double here_u = cx / (side_px / 2.0) - 1, here_v = cy / (side_px / 2.0) - 1;
      const double wx = image.xx / image.light, wy = image.yy / image.light;
      width_x.push_back(wx);
      width_y.push_back(wy);
      slope_u += (wx + wy) * here_u / site_count;
      slope_v += (wx + wy) * here_v / site_count;
      bowl += (wx + wy) * (here_u * here_u + here_v * here_v - 0.55) / site_count;
      behind += image.behind / light / site_count;
    }
    add(into, "point_spread_width", "x", mean_of(width_x));
    add(into, "point_spread_width", "y", mean_of(width_y));
    add(into, "point_spread_width", "both", std::log(std::max(mean_of(width_x) + mean_of(width_y), 1e-3)));
    add(into, "point_spread_field", "slope x", slope_u);
    add(into, "point_spread_field", "slope y", slope_v);
    add(into, "point_spread_field", "bowl", bowl);
    add(into, "trailing_charge", "right against left", behind);

    // Midway between four sites; and above sites against beside them.
    Map mean(pixels), ground = empty_.half(block, 0);
    const Map other = empty_.half(block, 1);
    for (int i = 0; i < pixels; ++i) {
      mean[i] = (means[0][i] + means[1][i]) / 2;
      ground[i] = (ground[i] + other[i]) / 2;
    }
    constexpr int cells = sites_per_side - 1;
    for (int j = 0; j < cells; ++j)
      for (int i = 0; i < cells; ++i) {
        const auto at = [](double k) {
          return static_cast<int>(std::lround(first_site_px + spacing_px * k));
        };
        for (int d = -1; d <= 1; ++d) {
          for (int e = -1; e <= 1; ++e)
            gap += pixel(mean, at(i + 0.5) + d, at(j + 0.5) + e) -
                   pixel(ground, at(i + 0.5) + d, at(j + 0.5) + e);
          for (int e = -1; e <= 1; ++e)
            smear += pixel(mean, at(i) + d, at(j + 0.5) + e) - pixel(mean, at(i + 0.5) + e, at(j) + d);
        }
      }
    add(into, "point_spread_halo", "between sites", gap / light);
    add(into, "column_smear", "above against beside", smear / light);
  }

  /// Per pixel over all dark frames, without its highest and its lowest value: a single hit is no property of
  /// the pixel. Means over tiles of pixels.
  void pixel_series(std::vector<Statistic>& into) const {
    Map spread(pixels), kurtosis(pixels), bright(pixels);
    std::vector<double> series(dark_.frames.size());
    const double level = mean_of(dark_.mean);
    for (int i = 0; i < pixels; ++i) {
      for (std::size_t n = 0; n < series.size(); ++n) series[n] = dark_.frames[n][i];
      const auto [low, high] = std::minmax_element(series.begin(), series.end());
      const double count = static_cast<double>(series.size()) - 2;
      double sum = -*low - *high, two = 0, four = 0;
      for (const double value : series) sum += value;
      const double mean = sum / count;
      const auto power = [&](double value, int n) { return std::pow(value - mean, n); };
      for (const double value : series) {
        const double square = (value - mean) * (value - mean);
        two += square;
        four += square * square;
      }
      two -= power(*low, 2) + power(*high, 2);
      four -= power(*low, 4) + power(*high, 4);
      two /= count;
      four /= count;
      spread[i] = std::log(std::max(two, 1e-12));
      kurtosis[i] = two > 0 ? four / (two * two) : 0;
      bright[i] = mean - level > 5 * read_noise_e_ / std::sqrt(count) + 1;
    }
    for (const double value : tiles(spread)) add(into, "variance_map", "mean", value);
    Map square(pixels);
    const double middle = mean_of(spread);
    for (int i = 0; i < pixels; ++i) square[i] = (spread[i] - middle) * (spread[i] - middle);
    for (const double value : tiles(square)) add(into, "variance_map", "spread", value);
    for (const double value : tiles(kurtosis)) add(into, "kurtosis_map", "mean", value);
    for (const double value : tiles(bright)) add(into, "bright_clusters", "static", value);
  }

  double read_noise_e_;
  Electrons atoms_, empty_, dark_;
};

}  // namespace

std::vector<Statistic> measure(const Stacks& stacks) {
  return Measures(stacks).take();
}

double sigmas(const Statistic& a, const Statistic& b) {
  const double difference = mean_of(a.values) - mean_of(b.values);
  const double error = std::sqrt(variance(a.values) / static_cast<double>(a.values.size()) +
                                 variance(b.values) / static_cast<double>(b.values.size()));
  if (error == 0) return difference == 0 ? 0 : std::numeric_limits<double>::infinity();
  return std::fabs(difference) / error;
}

std::map<std::string, double, std::less<>> compare(const std::vector<Statistic>& reference,
                                                   const std::vector<Statistic>& changed) {
  if (reference.size() != changed.size()) throw std::logic_error("two batteries");
  std::map<std::string, double, std::less<>> result;
  for (std::size_t i = 0; i < reference.size(); ++i) {
    double& largest = result[reference[i].observable];
    largest = std::max(largest, sigmas(reference[i], changed[i]));
  }
  return result;
}

}  // namespace atomcam::laws
