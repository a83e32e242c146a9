#include "calibration/site_transfer.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "base/quantile.hpp"
#include "calibration/site_light.hpp"

namespace atomcam {
namespace {

/// Variance of the rest counts - sum_s b_s share_s of every pixel, the counts' own variance being given:
/// v(p) (1 - 2 H(p, p)) + sum_{s,t} share_s(p) share_t(p) cov(b_s, b_t), H = share weight^T.
std::vector<double> rest_variance(const StackModel& model, const std::vector<double>& variance) {
  const int columns = model.shape.columns;
  const auto at = [&](const SiteImage& site, int r, int c) {
    return static_cast<std::size_t>(site.top + r) * columns + static_cast<std::size_t>(site.left + c);
  };
  std::vector<std::vector<std::uint32_t>> covering(model.shape.pixels());
  for (std::size_t s = 0; s < model.sites.size(); ++s)
    for (int r = 0; r < model.sites[s].share.rows(); ++r)
      for (int c = 0; c < model.sites[s].share.columns(); ++c)
        covering[at(model.sites[s], r, c)].push_back(static_cast<std::uint32_t>(s));
  const std::size_t count = model.sites.size();
  constexpr double unknown = -1e300;
  std::vector<double> covariances(count * count, unknown);
  const auto covariance = [&](std::size_t a, std::size_t b) {
    double& known = covariances[a * count + b];
    if (known != unknown) return known;
    const SiteImage &one = model.sites[a], &two = model.sites[b];
    double sum = 0;
    for (int r = std::max(one.top, two.top);
         r < std::min(one.top + one.share.rows(), two.top + two.share.rows()); ++r)
      for (int c = std::max(one.left, two.left);
           c < std::min(one.left + one.share.columns(), two.left + two.share.columns()); ++c)
        sum += static_cast<double>(one.weight(r - one.top, c - one.left)) *
               static_cast<double>(two.weight(r - two.top, c - two.left)) *
               variance[static_cast<std::size_t>(r) * columns + static_cast<std::size_t>(c)];
    covariances[b * count + a] = sum;
    return known = sum;
  };
  std::vector<double> rest = variance;
  for (std::size_t i = 0; i < rest.size(); ++i) {
    const int r = static_cast<int>(i) / columns, c = static_cast<int>(i) % columns;
    double change = 0;
    for (const std::uint32_t a : covering[i]) {
      const SiteImage& one = model.sites[a];
      const double share = one.share(r - one.top, c - one.left);
      change -= 2 * share * static_cast<double>(one.weight(r - one.top, c - one.left)) * variance[i];
      for (const std::uint32_t b : covering[i])
        change += share *
                  static_cast<double>(model.sites[b].share(r - model.sites[b].top, c - model.sites[b].left)) *
                  covariance(a, b);
    }
    rest[i] += change;
  }
  return rest;
}

}  // namespace

double drift_variance(const std::vector<double>& frames, double due) {
  constexpr double clear = 8;  // standard deviations
  const double n = static_cast<double>(frames.size());
  if (n < 8) return 0;
  const double mean = std::accumulate(frames.begin(), frames.end(), 0.0) / n;
  double variance = 0;
  for (const double value : frames) variance += (value - mean) * (value - mean) / (n - 1);
  return variance > due * (1 + clear * std::sqrt(2 / (n - 1))) ? variance - due : 0;
}

namespace {

constexpr int blocks = 8;  // of frames, interleaved, for the error of the photon transfer

/// Frames of such a block.
double frames_of(int block, double frames) {
  return std::floor((frames - block - 1) / blocks) + 1;
}

/// Sums over the frames.
struct Sums {
  std::vector<double> rest, light;           // per pixel: left over, and of the sites' images
  std::vector<std::vector<double>> squares;  // [block, pixel] of the rest
  std::vector<double> block_light;           // of all sites
  std::vector<double> block_rest;            // of the used pixels
  std::vector<double> frame_rest;            // of the used pixels, of every frame
  std::vector<std::vector<double>> by_site;  // [site, pixel of its image]: rest times the site's light
};

std::vector<std::uint8_t> pixels_with_less_light(const StackModel& model,
                                                 const std::vector<std::uint8_t>& odd) {
  const auto light = model.site_light.pixels();
  const double middle = median({light.begin(), light.end()});
  std::vector<std::uint8_t> used(odd.size());
  for (std::size_t i = 0; i < used.size(); ++i) used[i] = !odd[i] && static_cast<double>(light[i]) <= middle;
  return used;
}

/// Charge in one pixel of one frame beyond which it is no light of this scene: a cosmic ray holds thousands
/// of electrons, and a few of them as much variance as all the light.
std::vector<double> struck_from(const StackModel& model, const TransferGround& ground) {
  constexpr double electrons = 40, deviations = 12;
  constexpr double excess = 2;  // of an EM register; none has more
  std::vector<double> limit(ground.dark_variance_e2.size());
  for (std::size_t i = 0; i < limit.size(); ++i) {
    const double light_e =
        std::max(0.0, ground.background_e) + std::max(0.0, static_cast<double>(model.site_light.pixels()[i]));
    limit[i] = electrons + deviations * std::sqrt(ground.dark_variance_e2[i] + excess * light_e);
  }
  return limit;
}

/// What a frame says nothing about: struck pixels, and all of a site's image whose light was fitted to one.
class Struck {
 public:
  Struck(const StackModel& model, std::vector<double> limit)
      : model_(model), limit_(std::move(limit)), out_(limit_.size(), 0) {}

  /// Of a frame's rest; nullptr if nothing is struck.
  const std::vector<std::uint8_t>* find(const std::vector<double>& rest) {
    std::fill(out_.begin(), out_.end(), 0);
    bool any = false;
    for (std::size_t i = 0; i < rest.size(); ++i)
      if (rest[i] > limit_[i]) out_[i] = struck, any = true;
    if (!any) return nullptr;
    for (const SiteImage& site : model_.sites)
      if (in_stamp(site, [](std::uint8_t& pixel) { return pixel == struck; }))
        in_stamp(site, [](std::uint8_t& pixel) { return pixel = std::max(pixel, beside), false; });
    return &out_;
  }

 private:
  static constexpr std::uint8_t beside = 1, struck = 2;

  /// Whether `pixel` says so of any pixel of a site's image.
  template <class Pixel>
  bool in_stamp(const SiteImage& site, const Pixel& pixel) {
    for (int r = 0; r < site.share.rows(); ++r)
      for (int c = 0; c < site.share.columns(); ++c)
        if (pixel(out_[static_cast<std::size_t>(site.top + r) * model_.shape.columns + (site.left + c)]))
          return true;
    return false;
  }

  const StackModel& model_;
  std::vector<double> limit_;
  std::vector<std::uint8_t> out_;
};

/// Splits every frame into its sites' light (least squares) and the rest.
Sums sum_up(const FrameSequence& frames, const StackModel& model, const std::vector<double>& level, double k,
            const std::vector<std::uint8_t>& used, Struck struck, std::vector<float>& brightness) {
  const std::size_t pixels = level.size(), sites = model.sites.size();
  Sums sums;
  sums.rest.assign(pixels, 0);
  sums.light.assign(pixels, 0);
  sums.squares.assign(blocks, std::vector<double>(pixels, 0));
  sums.block_light.assign(blocks, 0);
  sums.block_rest.assign(blocks, 0);
  for (const SiteImage& site : model.sites) sums.by_site.emplace_back(site.share.pixels().size(), 0.0);
  brightness.reserve(frames.frames() * sites);
  std::vector<std::vector<std::uint32_t>> left_out(blocks, std::vector<std::uint32_t>(pixels, 0));
  std::vector<double> rest(pixels);
  std::size_t visited = 0;
  frames.visit([&](std::size_t, const CountImage& frame) {
    const auto counts = frame.pixels();
    for (std::size_t i = 0; i < pixels; ++i) rest[i] = (counts[i] - level[i]) / k;
    const std::size_t first = brightness.size();
    for (const SiteImage& site : model.sites) {
      double sum = 0;
      for (int r = 0; r < site.weight.rows(); ++r) {
        const double* row = &rest[static_cast<std::size_t>(site.top + r) * model.shape.columns + site.left];
        const auto weight = site.weight.row(r);
        for (int c = 0; c < site.weight.columns(); ++c) sum += static_cast<double>(weight[c]) * row[c];
      }
      brightness.push_back(static_cast<float>(sum));
    }
    for (std::size_t s = 0; s < sites; ++s) {
      const SiteImage& site = model.sites[s];
      const double e = brightness[first + s];
      for (int r = 0; r < site.share.rows(); ++r) {
        const std::size_t at = static_cast<std::size_t>(site.top + r) * model.shape.columns + site.left;
        const auto share = site.share.row(r);
        for (int c = 0; c < site.share.columns(); ++c) {
          rest[at + c] -= e * static_cast<double>(share[c]);
          sums.light[at + c] += e * static_cast<double>(share[c]);
        }
      }
    }
    const std::size_t block = visited++ % blocks;
    double whole_rest = 0;
    for (std::size_t s = 0; s < sites; ++s)
      sums.block_light[block] += static_cast<double>(brightness[first + s]);
    const std::vector<std::uint8_t>* const out = struck.find(rest);
    for (std::size_t i = 0; i < pixels; ++i) {
      if (out && (*out)[i]) {
        ++left_out[block][i];
        continue;
      }
      sums.rest[i] += rest[i];
      if (used[i]) sums.block_rest[block] += rest[i], whole_rest += rest[i];
      sums.squares[block][i] += rest[i] * rest[i];
    }
    sums.frame_rest.push_back(whole_rest);
    for (std::size_t s = 0; s < sites; ++s) {
      const SiteImage& site = model.sites[s];
      const double e = brightness[first + s];
      double* sum = sums.by_site[s].data();
      for (int r = 0; r < site.share.rows(); ++r) {
        const std::size_t at = static_cast<std::size_t>(site.top + r) * model.shape.columns + site.left;
        for (int c = 0; c < site.share.columns(); ++c, ++sum)
          if (!out || !(*out)[at + c]) *sum += e * rest[at + c];
      }
    }
  });
  // The frames left out are taken to be as the others.
  const double count = static_cast<double>(frames.frames());
  for (std::size_t i = 0; i < pixels; ++i) {
    double out = 0;
    for (int block = 0; block < blocks; ++block) {
      const auto b = static_cast<std::size_t>(block);
      const double own = frames_of(block, count), missing = left_out[b][i];
      if (missing > 0) sums.squares[b][i] *= missing < own ? own / (own - missing) : 0;
      out += missing;
    }
    if (out > 0) sums.rest[i] *= out < count ? count / (count - out) : 0;
  }
  return sums;
}

/// Of a pixel, from frame to frame.
double variance_of_rest(const Sums& sums, std::size_t pixel, double frames) {
  double squares = 0;
  for (const auto& block : sums.squares) squares += block[pixel];
  return (squares - sums.rest[pixel] * sums.rest[pixel] / frames) / (frames - 1);
}

/// Variance of the used pixels together that they have because whole frames are brighter or darker: a bias
/// that drifts, light that flickers. It is no noise of single electrons.
double common_of_all(const Sums& sums, const std::vector<std::uint8_t>& used, double frames) {
  double pixels = 0, variance = 0;
  for (std::size_t i = 0; i < used.size(); ++i) {
    if (!used[i]) continue;
    variance += variance_of_rest(sums, i, frames);
    ++pixels;
  }
  if (!(pixels > 0)) return 0;
  // Of the sum over the pixels of a frame; of pixels that know nothing of each other it is the variances'
  // sum.
  return drift_variance(sums.frame_rest, variance) / pixels;
}

/// Weights with which the used pixels' variances add up to their slope over the light, whatever both start
/// from. Pixels with more light say less.
std::vector<double> slope_weights(const std::vector<double>& light, const std::vector<std::uint8_t>& used,
                                  double noise) {
  std::vector<double> weight(light.size(), 0);
  double weights = 0, mean = 0, range = 0;
  for (std::size_t i = 0; i < light.size(); ++i) {
    if (!used[i]) continue;
    weight[i] = 1 / ((noise + light[i]) * (noise + light[i]));
    weights += weight[i];
    mean += weight[i] * light[i];
  }
  mean /= weights;
  for (std::size_t i = 0; i < light.size(); ++i) range += weight[i] * (light[i] - mean) * (light[i] - mean);
  for (std::size_t i = 0; i < light.size(); ++i) weight[i] *= (light[i] - mean) / range;
  return weight;
}

/// Variance of every site's light from frame to frame.
std::vector<double> changes_of(const std::vector<float>& brightness, std::size_t sites, double frames) {
  std::vector<double> changes(sites, 0.0);
  for (std::size_t s = 0; s < sites; ++s) {
    double sum = 0, squares = 0;
    for (std::size_t at = s; at < brightness.size(); at += sites) {
      const double e = brightness[at];
      sum += e, squares += e * e;
    }
    changes[s] = std::max(0.0, (squares - sum * sum / frames) / (frames - 1));
  }
  return changes;
}

/// Variance that the rest of each pixel has because the sites' images are not what they are taken for: it
/// follows the sites' light then. `changes`: variance of every site's light.
std::vector<double> variance_of_other_images(const StackModel& model, const Sums& sums,
                                             const std::vector<float>& brightness,
                                             const std::vector<double>& changes, double frames) {
  const std::size_t pixels = sums.rest.size(), sites = model.sites.size();
  std::vector<double> own(pixels, 0), variance(pixels, 0);
  for (std::size_t i = 0; i < pixels; ++i) own[i] = variance_of_rest(sums, i, frames);
  for (std::size_t s = 0; s < sites; ++s) {
    if (!(changes[s] > 0)) continue;
    double mean = 0;
    for (std::size_t at = s; at < brightness.size(); at += sites)
      mean += static_cast<double>(brightness[at]) / frames;
    const SiteImage& site = model.sites[s];
    const double* with_light = sums.by_site[s].data();
    for (int r = 0; r < site.share.rows(); ++r)
      for (int c = 0; c < site.share.columns(); ++c, ++with_light) {
        const std::size_t i = static_cast<std::size_t>(site.top + r) * model.shape.columns +
                              static_cast<std::size_t>(site.left + c);
        const double covariance = (*with_light - mean * sums.rest[i]) / (frames - 1);
        // Less what chance makes of it.
        variance[i] += covariance * covariance / changes[s] - own[i] / (frames - 1);
      }
  }
  return variance;
}

}  // namespace

SiteTransfer site_transfer(const FrameSequence& frames, const StackModel& model,
                           const PointSpreadFunction& point_spread, const TransferGround& ground) {
  SiteTransfer transfer;
  const std::size_t pixels = ground.dark_counts.size();
  const double k = ground.counts_per_electron, background = ground.background_e, site_e = ground.mean_site_e,
               n = static_cast<double>(frames.frames());
  const std::vector<double> far = light_beyond_stamps(model);
  std::vector<double> level(pixels);
  for (std::size_t i = 0; i < pixels; ++i)
    level[i] = ground.dark_counts[i] + (background + site_e * far[i]) * k;
  const std::vector<std::uint8_t> used = pixels_with_less_light(model, ground.odd);
  const Sums sums =
      sum_up(frames, model, level, k, used, {model, struck_from(model, ground)}, transfer.brightness_e);

  std::vector<double> shot(pixels);
  for (std::size_t i = 0; i < pixels; ++i)
    shot[i] = std::max(0.0, sums.light[i] / n + background + site_e * far[i]);
  const std::vector<double> read = rest_variance(model, ground.dark_variance_e2);
  shot = rest_variance(model, shot);
  // Atoms that come and go also move the light that the stamps do not hold.
  const std::vector<double> changes = changes_of(transfer.brightness_e, model.sites.size(), n);
  transfer.leaks = leakage(model, point_spread, changes);
  const std::vector<double> other_images =
      variance_of_other_images(model, sums, transfer.brightness_e, changes, n);
  double signal = 0, floor = 0, of_other_images = 0, count = 0;
  for (std::size_t i = 0; i < pixels; ++i) {
    if (!used[i]) continue;
    floor += read[i] + transfer.leaks.rest_variance[i];
    signal += shot[i];
    of_other_images += other_images[i];
    ++count;
  }
  // A block with more light has more noise: its variance goes with its own light, or the error comes out
  // too large.
  double from_sites = 0, from_all = 0, all_light = 0, all_rest = 0;
  for (std::size_t i = 0; i < pixels; ++i)
    if (used[i]) {
      from_sites += std::max(0.0, sums.light[i] / n) + site_e * far[i];
      from_all += std::max(0.0, sums.light[i] / n) + site_e * far[i] + background;
      all_rest += sums.rest[i] / n;
    }
  for (const double value : sums.block_light) all_light += value / n;
  // What the fit of the sites leaves over is light as well.
  if (from_all > 0) signal *= 1 + all_rest / from_all;
  std::vector<double> by_block;
  double mean = 0, spread = 0;
  const double common = common_of_all(sums, used, n);
  // A pixel's part in the result. Where the level of whole frames wanders, that of the dark frames is not
  // theirs, and light counts from an unknown one on, if there is enough of it, and if it lies where it is
  // thought to lie: images that are clearly others make whole frames brighter and darker, too.
  constexpr double clearly_others = 0.01;  // of the noise
  const bool misplaced = of_other_images > clearly_others * (floor + signal);
  std::vector<double> part(pixels, 1 / signal);
  bool level_known = true;
  if (common > 0 && !misplaced) {
    constexpr double good_enough = 0.1;
    std::vector<double> slope = slope_weights(shot, used, floor / count);
    double variance = 0;
    for (std::size_t i = 0; i < pixels; ++i)
      variance += 2 / n * std::pow(slope[i] * (floor / count + shot[i]), 2);
    level_known = !(variance < good_enough * good_enough);
    if (!level_known) part = std::move(slope);
  }
  for (int block = 0; block < blocks; ++block) {
    const auto b = static_cast<std::size_t>(block);
    const double own = frames_of(block, n);
    double ratio = 0;
    for (std::size_t i = 0; i < pixels; ++i) {
      if (!used[i]) continue;
      const double m = sums.rest[i] / n,
                   noise = read[i] + transfer.leaks.rest_variance[i] + other_images[i] + common / count;
      ratio += part[i] * ((sums.squares[b][i] / own - m * m) * n / (n - 1) - noise);
    }
    const double sites_more = all_light > 0 ? from_sites * (sums.block_light[b] / own / all_light - 1) : 0;
    const double more =
        from_all > 0 ? (sites_more + sums.block_rest[b] / own - all_rest) / (from_all + all_rest) : 0;
    by_block.push_back(ratio / (1 + more));
    mean += by_block.back() / blocks;
  }
  for (const double value : by_block) spread += (value - mean) * (value - mean) / (blocks - 1);
  // All blocks share the dark frames: their noise in the variance and in the light that are taken off.
  double dark_error = 0;
  if (ground.dark_frames > 0 && signal > 0) {
    const double darks = std::max(2.0, static_cast<double>(ground.dark_frames));
    for (std::size_t i = 0; i < pixels; ++i) {
      if (!used[i]) continue;
      const double variance = ground.dark_variance_e2[i];
      dark_error += variance * variance * 2 / (darks - 1) * part[i] * part[i];
      if (level_known) dark_error += variance / darks * mean * mean / (from_all * from_all);
    }
  }
  // A level that is not that of the dark frames is so much more or less light.
  const double of_level = common > 0 && misplaced ? mean * std::sqrt(common * count) / signal : 0;
  transfer.variance_per_e = mean;
  transfer.error = std::sqrt(spread / blocks + dark_error + of_level * of_level);
  return transfer;
}

}  // namespace atomcam
