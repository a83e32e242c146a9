#include "diagnosis/stages.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>
#include <set>

#include "diagnosis/deviations.hpp"
#include "diagnosis/standard.hpp"
#include "diagnosis/uncertain.hpp"

namespace atomcam {

std::string stage_of_observable(std::string_view observable, bool darks) {
  if (darks) return "sensor";
  static const std::map<std::string_view, std::string_view> stages = {
      {"site_brightness", "scene"},     {"site_histogram", "scene"},
      {"site_correlation", "scene"},    {"neighbour_exchange", "scene"},
      {"brightness_series", "scene"},   {"point_spread_width", "optics"},
      {"point_spread_field", "optics"}, {"point_spread_halo", "optics"},
      {"centroid_series", "optics"},    {"mean_map", "optics"}};
  const auto found = stages.find(observable);
  return found == stages.end() ? "sensor" : std::string(found->second);
}

namespace {

/// Rows that vary from frame to frame with the shutter open but not with it closed: what reads them out is
/// the same, so it is the light that flickers while the rows are exposed one after the other. Of the sites',
/// too, where these go together along the rows: then less of it is clear.
bool light_flickers(const std::vector<StatisticDeclaration>& battery, const Eigen::VectorXd& z) {
  const bool with_sites = deviation_of("light.sites.pairs.light_rows", battery, z) > 5;
  const double clear = with_sites ? 5 : 8, quiet = 4;
  const auto rows = [](const StatisticDeclaration& one) { return has(one, ".lines.rows."); };
  return largest(battery, z, [&](const auto& one) { return one.darks && rows(one); }) < quiet &&
         largest(battery, z, [&](const auto& one) { return !one.darks && rows(one); }) >
             std::max(clear, 0.5 * z.cwiseAbs().maxCoeff());
}

/// Mean and noise that slope across the frame with the shutter open, while the noise does not with it closed:
/// the light slopes, and its shot noise with it. Not where sites are odd far beyond that: it is the atoms'
/// own light that slopes, and the noise about them.
bool light_slopes(const std::vector<StatisticDeclaration>& battery, const Eigen::VectorXd& z) {
  constexpr double clear = 8, seen = 5, quiet = 4, far_beyond = 2;
  const auto slope = [](const StatisticDeclaration& one) {
    const std::string_view last = std::string_view(one.name).substr(one.name.rfind('.') + 1);
    return last == "gradient_x" || last == "gradient_y" || last == "left_right" || last == "top_bottom";
  };
  // What ends at columns or rows is no slope, though it may tilt one.
  const auto lines = [](const StatisticDeclaration& one) {
    return !one.darks && (has(one, ".columns") || has(one, ".rows"));
  };
  const auto noise = [&](const StatisticDeclaration& one) {
    return slope(one) && has(one, ".temporal_maps.");
  };
  const auto sites = [](const StatisticDeclaration& one) {
    return stage_of_observable(one.observable, one.darks) == "scene";
  };
  const auto mean = [&](const StatisticDeclaration& one) {
    return slope(one) && !one.darks && one.observable == "mean_map";
  };
  return largest(battery, z, [&](const auto& one) { return one.darks && noise(one); }) < quiet &&
         largest(battery, z, mean) > seen &&
         largest(battery, z, [&](const auto& one) { return !one.darks && noise(one); }) >
             std::max({clear, 0.4 * z.cwiseAbs().maxCoeff(), largest(battery, z, lines),
                       largest(battery, z, sites) / far_beyond});
}

/// Frames whose level away from the sites varies, while that of dark frames does not, and with it their noise
/// or from every frame to the next: it is light that varies, with its shot noise if there is enough of it. A
/// few frames that stand out may be missing among the dark ones by chance. A drift of the level is as clear
/// in its noise that follows, if the two go the same way.
bool light_flashes(const std::vector<StatisticDeclaration>& battery, const Eigen::VectorXd& z) {
  constexpr double clear = 8, quiet = 4;
  const double level = largest(battery, z, [&](const auto& one) {
    return !one.darks && (has(one, ".frames.level.") || has(one, ".frames.linear_level."));
  });
  const auto of = [&](std::string_view name) { return std::fabs(deviation_of(name, battery, z)); };
  const double noise =
      largest(battery, z, [&](const auto& one) { return !one.darks && has(one, ".frames.noise."); });
  const double drift = deviation_of("light.frames.level.trend", battery, z),
               noise_drift = deviation_of("light.frames.noise.trend", battery, z);
  const bool with_noise = noise > std::max(clear, 0.3 * level) ||
                          (std::fabs(drift) > 0.5 * level && noise_drift * drift > quiet * std::fabs(drift)),
             every_frame = of("light.frames.level.steps") > std::max(clear, 0.5 * level) &&
                           of("light.frames.level.largest") < quiet;
  return level > std::max(clear, 0.4 * z.cwiseAbs().maxCoeff()) && (with_noise || every_frame) &&
         largest(battery, z, [&](const auto& one) { return one.darks && has(one, ".frames."); }) < quiet;
}

/// The sites' light changes with the light beside them, no more clearly than that: not the lamp behind the
/// one nor the atoms, whose light hardly reaches so far, but what turns all light into counts. Exposure or
/// gain.
bool all_light_changes(const std::vector<StatisticDeclaration>& battery, const Eigen::VectorXd& z) {
  constexpr double clear = 6, beside = 0.4, no_less = 0.7;
  const auto of = [&](std::string_view name) {
    return largest(battery, z, [&](const auto& one) { return !one.darks && has(one, name); });
  };
  const double level = std::max(of(".frames.level."), of(".frames.linear_level.")),
               sites = of(".sites.common.");
  return sites > std::max(clear, beside * level) && level > no_less * sites;
}

/// Pixels away from the sites that go together over some distance in frames with the shutter open, and not
/// with it closed: a pattern of light that moves. Charge that leaks goes to the next pixels.
bool light_ripples(const std::vector<StatisticDeclaration>& battery, const Eigen::VectorXd& z) {
  constexpr double clear = 8, quiet = 4;
  const auto far = [&](std::string_view way) {
    return largest(battery, z, [&](const auto& one) {
      return !one.darks && has(one, ".neighbours.dark.") && std::string_view(one.name).ends_with(way);
    });
  };
  const auto in_darks = [](const auto& one) {
    return one.darks && (has(one, ".neighbours.") || has(one, ".readout_spectrum.") || has(one, ".lines."));
  };
  return std::min(far("right_3"), far("down_3")) > std::max(clear, 0.5 * z.cwiseAbs().maxCoeff()) &&
         largest(battery, z, in_darks) < quiet;
}

/// Charge gathers where no site is, now here and now there, with the shutter open only: atoms that are not in
/// the traps. Radiation does not mind the shutter; beside an image that moves the sites' own light gathers.
bool light_gathers(const std::vector<StatisticDeclaration>& battery, const Eigen::VectorXd& z) {
  constexpr double clear = 8, quiet = 4, beside = 0.35;
  const auto clusters = [&](bool darks) {
    return largest(battery, z, [&](const auto& one) { return one.darks == darks && has(one, ".clusters."); });
  };
  return clusters(true) < quiet && clusters(false) > std::max(clear, beside * z.cwiseAbs().maxCoeff()) &&
         largest(battery, z, [](const auto& one) { return has(one, ".position."); }) < clear;
}

/// Whose images move, if any: occupied sites have more noise than their light, in pixels that go together
/// along rows and columns, while pixels that no site lights do not. All together, or about the middle of the
/// array, which stays: the optics. Each on its own: the atoms, which move their mean as well, but by less.
std::string_view stage_of_moving_images(const std::vector<StatisticDeclaration>& battery,
                                        const Eigen::VectorXd& z) {
  constexpr double clear = 8, beside = 0.4, together = 1, middle_stays = 0.3;
  const auto neighbours = [&](std::string_view where, std::string_view way) {
    return largest(battery, z, [&](const auto& one) {
      return !one.darks && has(one, where) && std::string_view(one.name).ends_with(way);
    });
  };
  const double noise = deviation_of("light.image_noise.occupied.core", battery, z);
  const double lit =
      std::min(neighbours(".neighbours.all.", "right_1"), neighbours(".neighbours.all.", "down_1"));
  const double dark =
      std::max(neighbours(".neighbours.dark.", "right_1"), neighbours(".neighbours.dark.", "down_1"));
  const double closed =
      largest(battery, z, [](const auto& one) { return one.darks && has(one, ".neighbours."); });
  if (noise < std::max(clear, beside * z.cwiseAbs().maxCoeff()) || lit < beside * noise ||
      std::max(dark, closed) > beside * lit)
    return "";
  const double position = largest(battery, z, [](const auto& one) {
    return has(one, ".position.") && std::string_view(one.name).ends_with(".variance");
  });
  return position > together * noise || position < middle_stays * noise ? "optics" : "scene";
}

/// Light far from the sites that comes and goes with theirs.
bool is_far_halo(const StatisticDeclaration& one) {
  return has(one, ".far_light.halo.");
}

/// Sites whose images are displaced, but no wider, all along the stack.
bool sites_are_displaced(const std::vector<StatisticDeclaration>& battery, const Eigen::VectorXd& z) {
  constexpr double clear = 8, quiet = 8, beside = 1.5;
  const auto centroid = [](const auto& one) {
    return has(one, ".point_spread.x.") || has(one, ".point_spread.y.");
  };
  const double displaced = largest(battery, z, [&](const auto& one) {
    return centroid(one) && std::string_view(one.name).ends_with(".spread");
  });
  const double wider = largest(battery, z, [&](const auto& one) {
    return has(one, ".point_spread.") && !has(one, ".misfit.") && !centroid(one);
  });
  return displaced > std::max(clear, beside * wider) &&
         largest(battery, z, [](const auto& one) { return has(one, ".position."); }) < quiet;
}

/// Displaced smoothly along the field: not atoms that are not where the lattice has them, but a lens that
/// distorts.
bool field_is_displaced(const std::vector<StatisticDeclaration>& battery, const Eigen::VectorXd& z) {
  constexpr double clear = 4;
  return largest(battery, z, [](const auto& one) {
           return one.name == "light.point_spread.x.smooth" || one.name == "light.point_spread.y.smooth";
         }) > clear;
}

/// Clearly odd, and as odd as anything else or nearly so.
template <class Counts>
bool foremost(const std::vector<StatisticDeclaration>& battery, const Eigen::VectorXd& z,
              const Counts& counts, double clear = 8) {
  constexpr double beside = 0.9;
  return largest(battery, z, counts) > std::max(clear, beside * z.cwiseAbs().maxCoeff());
}

/// Empty sites that all hold some light, and nothing else nearly as odd. Atoms that come and go during an
/// exposure would show between empty and occupied, light of other atoms beyond the sites.
bool empty_sites_glow(const std::vector<StatisticDeclaration>& battery, const Eigen::VectorXd& z) {
  constexpr double clear = 8, beside = 0.4;
  const auto of_the_empty = [](const auto& one) {
    return one.name == "light.sites.empty.mean" || has(one, ".sites.histogram.") ||
           has(one, ".image_noise.empty.");
  };
  const double glow = deviation_of("light.sites.empty.mean", battery, z);
  return glow > clear &&
         largest(battery, z, [&](const auto& one) { return !of_the_empty(one); }) < beside * glow;
}

/// Empty sites glow more where an atom was in the frame before: the sensor remembers.
bool sites_remember(const std::vector<StatisticDeclaration>& battery, const Eigen::VectorXd& z) {
  constexpr double clear = 5;
  return deviation_of("light.sites.memory.afterglow", battery, z) > clear;
}

/// Whether sites hold an atom more or less often than others: loading. The light's noise over the frame
/// follows; nothing behind the atoms does this.
bool is_loading(const StatisticDeclaration& one) {
  return has(one, ".sites.filling_by_site.");
}

/// The same, than before: the light's level and noise follow.
bool is_loading_along_the_stack(const StatisticDeclaration& one) {
  return has(one, ".sites.loading.");
}

/// Occupied sites whose light varies less than the shot noise of so much of it, in their images' middle and
/// in their sums: no light does that. The bright values are compressed or cut off.
bool light_is_too_calm(const std::vector<StatisticDeclaration>& battery, const Eigen::VectorXd& z) {
  constexpr double clear = 6, beside = 0.5;
  const double calm = std::min(-deviation_of("light.image_noise.occupied.core", battery, z),
                               -deviation_of("light.sites.peak.variance_within_sites", battery, z));
  return calm > std::max(clear, beside * z.cwiseAbs().maxCoeff());
}

/// Images of some sites in which one pixel answers otherwise than those around it: no lens does that.
bool pixels_answer_otherwise(const std::vector<StatisticDeclaration>& battery, const Eigen::VectorXd& z) {
  constexpr double clear = 8, beside = 0.4;
  return deviation_of("light.point_spread.pixels.loneliest", battery, z) >
         std::max(clear, beside * z.cwiseAbs().maxCoeff());
}

/// Light far above and below the sites, in their columns: charge that is shifted while it is lit. The columns
/// it leaves are a pattern of the mean, as stray light would leave.
bool is_smear(const StatisticDeclaration& one) {
  return one.observable == "column_smear";
}

/// What an image is around a site, far more than anything else: the shape itself, not where it is nor the
/// charge that trails behind it. Where nothing is as odd as the shape, the sites' brightness may follow, and
/// the lines that answer to it.
bool images_change_shape(const std::vector<StatisticDeclaration>& battery, const Eigen::VectorXd& z) {
  constexpr double clear = 15, beside = 1.5;
  const auto shape = [](const auto& one) {
    return has(one, ".point_spread.") && stage_of_observable(one.observable, one.darks) == "optics" &&
           !has(one, ".point_spread.x.") && !has(one, ".point_spread.y.");
  };
  const auto follows_shape = [](const auto& one) {
    return stage_of_observable(one.observable, one.darks) == "scene" || has(one, ".response_");
  };
  const bool most = foremost(battery, z, shape);
  const double others = largest(battery, z, [&](const auto& one) {
    return stage_of_observable(one.observable, one.darks) != "optics" && !(most && follows_shape(one));
  });
  return largest(battery, z, shape) > std::max(clear, beside * others);
}

/// Light in a ring about the sites that is as far out as nothing which the sensor does to a bright pixel
/// reaches, but what trails behind it on one side.
bool light_reaches_far(const std::vector<StatisticDeclaration>& battery, const Eigen::VectorXd& z) {
  constexpr double clear = 15, beside = 0.4, behind = 2;
  const double ring = deviation_of("light.point_spread.ring.4", battery, z);
  const double trailing =
      largest(battery, z, [](const auto& one) { return !one.darks && one.observable == "trailing_charge"; });
  return ring > std::max({clear, beside * z.cwiseAbs().maxCoeff(), behind * trailing});
}

/// Images that get wider along the field: the light that a site's neighbourhood holds slopes with them.
bool width_follows_field(const std::vector<StatisticDeclaration>& battery, const Eigen::VectorXd& z) {
  constexpr double clear = 4.5;
  return largest(battery, z, [](const auto& one) {
           const std::string_view name = one.name;
           return has(one, ".point_spread.width") &&
                  (name.ends_with(".along_x") || name.ends_with(".along_y") || name.ends_with(".radial"));
         }) > clear;
}

/// Noise and counts that the light brings along, whatever it is that is odd about the light.
bool follows_light(const StatisticDeclaration& one) {
  return !one.darks && (one.observable == "variance_map" || one.observable == "pixel_histogram");
}

}  // namespace

std::string stage_of_differences(const std::vector<StatisticDeclaration>& battery, const Eigen::VectorXd& z,
                                 const std::vector<Hypothesis>& hypotheses) {
  std::map<std::string, double> votes = {{"scene", 0}, {"optics", 0}, {"sensor", 0}};
  // Light and dark frames are compared only where there are both.
  const bool both = std::any_of(battery.begin(), battery.end(), [](const auto& one) { return one.darks; });
  const bool field = width_follows_field(battery, z);
  double darks = 0, all = 0;
  for (std::size_t k = 0; k < battery.size(); ++k) {
    const double size = std::fabs(z(static_cast<Eigen::Index>(k)));
    if (size < 3.5) continue;
    const double weight = std::log1p(size - 3) * (both && follows_light(battery[k]) ? 0.5 : 1);
    const bool of_the_field = field && has(battery[k], ".sites.by_site.");
    votes[of_the_field ? "optics" : stage_of_observable(battery[k].observable, battery[k].darks)] += weight;
    all += weight;
    if (battery[k].darks) darks += weight;
  }
  // What shows with the shutter closed is the sensor's.
  if (darks > 0.2 * all && darks > 1) return "sensor";
  if (foremost(battery, z, is_far_halo)) return "optics";
  if (both && light_flashes(battery, z)) return all_light_changes(battery, z) ? "sensor" : "optics";
  if (both && (light_flickers(battery, z) || light_slopes(battery, z) || light_ripples(battery, z)))
    return "optics";
  if (foremost(battery, z, is_loading) || foremost(battery, z, is_loading_along_the_stack, 4.5))
    return "scene";
  if (foremost(battery, z, is_smear) || light_is_too_calm(battery, z) || pixels_answer_otherwise(battery, z))
    return "sensor";
  if (empty_sites_glow(battery, z)) return sites_remember(battery, z) ? "sensor" : "optics";  // traps' light
  if (images_change_shape(battery, z) || light_reaches_far(battery, z)) return "optics";
  if (const std::string_view stage = stage_of_moving_images(battery, z); !stage.empty())
    return std::string(stage);
  if (both && light_gathers(battery, z)) return "scene";
  if (sites_are_displaced(battery, z)) return field_is_displaced(battery, z) ? "optics" : "scene";
  if (!hypotheses.empty()) {
    // The stage of the known effects that come closest, as far as these take anything away.
    double best = 0, share = 0;
    for (const Hypothesis& one : hypotheses)
      if (one.effects.size() == 1 && one.log_evidence > best) best = one.log_evidence, share = one.share;
    const double trust = 2 * std::max(1.0, all) * std::pow(std::min(1.0, 2 * share), 3);
    for (const Hypothesis& one : hypotheses)
      if (one.effects.size() == 1 && one.log_evidence > 0)
        votes[stage_of(one.effects.front())] += trust * std::pow(one.log_evidence / best, 4);
  }
  return std::max_element(votes.begin(), votes.end(),
                          [](const auto& a, const auto& b) { return a.second < b.second; })
      ->first;
}

namespace {

/// How often statistics of a plain stack are so many deviations off: further tails than a normal law has, and
/// further still of those that are unsteady.
class Tails {
 public:
  Tails(const std::vector<StatisticDeclaration>& battery, const Eigen::MatrixXd& own)
      : steady_(sizes(battery, own, false)), unsteady_(sizes(battery, own, true)) {}
  double p_value(const StatisticDeclaration& statistic, double z) const {
    const double normal = std::erfc(std::fabs(z) / std::sqrt(2.0));
    return std::max(normal, (statistic.unsteady ? unsteady_ : steady_).p_value(std::fabs(z)));
  }

 private:
  static std::vector<double> sizes(const std::vector<StatisticDeclaration>& battery,
                                   const Eigen::MatrixXd& own, bool unsteady) {
    std::vector<double> sizes;
    for (std::size_t k = 0; k < battery.size(); ++k)
      if (battery[k].unsteady == unsteady)
        for (const double z : own.col(static_cast<Eigen::Index>(k))) sizes.push_back(std::fabs(z));
    return sizes;
  }

  NullDistribution steady_, unsteady_;
};

}  // namespace

std::vector<Difference> ranked_differences(const std::vector<StatisticDeclaration>& battery,
                                           const Eigen::VectorXd& z, const Eigen::VectorXd& z_after,
                                           const Eigen::MatrixXd& own) {
  constexpr std::size_t listed = 40;
  constexpr double clearly = 0.01;
  const auto size = [&](std::size_t k) { return std::fabs(z(static_cast<Eigen::Index>(k))); };
  std::vector<std::size_t> order(battery.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) { return size(a) > size(b); });
  // Benjamini and Hochberg over the battery.
  const Tails tails(battery, own);
  const double count = static_cast<double>(order.size());
  std::vector<double> p(order.size()), q(order.size());
  for (std::size_t k = 0; k < p.size(); ++k)
    p[k] = tails.p_value(battery[k], z(static_cast<Eigen::Index>(k)));
  std::vector<std::size_t> likely = order;
  std::sort(likely.begin(), likely.end(), [&](std::size_t a, std::size_t b) { return p[a] < p[b]; });
  double least = 1;
  for (std::size_t rank = likely.size(); rank-- > 0;) {
    least = std::min(least, p[likely[rank]] * count / static_cast<double>(rank + 1));
    q[likely[rank]] = least;
  }
  std::vector<Difference> list;
  std::set<std::string_view> seen;
  for (std::size_t rank = 0; rank < order.size(); ++rank) {
    const StatisticDeclaration& statistic = battery[order[rank]];
    // Beyond the first some, the strongest of every other kind that is odd.
    const std::string_view name = statistic.name;
    const bool first = seen.insert(name.substr(0, name.rfind('.'))).second;
    if (rank >= listed && !(first && q[order[rank]] < clearly)) continue;
    const auto at = static_cast<Eigen::Index>(order[rank]);
    Difference one;
    one.stage = stage_of_observable(statistic.observable, statistic.darks);
    one.statistic = statistic.name;
    one.observable = statistic.observable;
    one.axis = statistic.axis;
    one.place = statistic.place;
    one.z = z(at);
    one.q = q[order[rank]];
    one.z_after = z_after(at);
    list.push_back(std::move(one));
  }
  return list;
}

namespace {

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
                                     p->error, p->unit == "1" ? "" : " " + p->unit, effect.stage)
                       : effect.name);
    }
    return fmt::format("{}", fmt::join(list, " and "));
  };
  switch (d.verdict) {
    case Verdict::no_gap:
      return fmt::format("The frames agree with the calibrated plain model (p = {:.2g}).", d.p_gap);
    case Verdict::explained:
      return fmt::format("{} {} {} of the gap on held-out frames.", names(),
                         d.effects.size() > 1 ? "close" : "closes", percent(d.gap.closed));
    case Verdict::partly_explained:
      if (!d.gap.explains.empty())
        return fmt::format(
            "{} {} {} of the gap in {} on held-out frames; what remains, there and elsewhere, is not "
            "explained: {}.",
            names(), d.effects.size() > 1 ? "close" : "closes", percent(d.gap.part_closed),
            fmt::join(d.gap.explains, " and "), d.unexplained.looks_like);
      return fmt::format("{} {} {} of the gap on held-out frames; what remains is not explained.", names(),
                         d.effects.size() > 1 ? "close" : "closes", percent(d.gap.closed));
    case Verdict::ambiguous: {
      std::set<std::string> others;  // of several effects each has the same
      for (const FoundEffect& effect : d.effects)
        others.insert(effect.confusable_with.begin(), effect.confusable_with.end());
      return fmt::format("{} or {}: these frames cannot tell them apart.", names(), fmt::join(others, ", "));
    }
    case Verdict::unexplained:
      return fmt::format(
          "There is a gap (p = {:.1g}), most likely in the {} stage, and no known effect explains it: {}.",
          d.p_gap, d.unexplained.stage, d.unexplained.looks_like);
  }
  return "";
}

}  // namespace atomcam
