#include "diagnosis/stages.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <set>

#include "diagnosis/deviations.hpp"
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

constexpr double odd = 3.5;  // deviations: what has a say in the stage

/// Clear, and more than that part of the largest deviation of all.
bool stands_out(double deviation, const Eigen::VectorXd& z, double clear, double beside) {
  return deviation > std::max(clear, beside * z.cwiseAbs().maxCoeff());
}

/// Clearly odd, and as odd as anything else or nearly so.
template <class Counts>
bool foremost(const std::vector<StatisticDeclaration>& battery, const Eigen::VectorXd& z,
              const Counts& counts, double clear = 8) {
  constexpr double beside = 0.9;
  return stands_out(largest(battery, z, counts), z, clear, beside);
}

/// Rows that vary from frame to frame with the shutter open but not with it closed: what reads them out is
/// the same, so it is the light that flickers while the rows are exposed one after the other. Of the sites',
/// too, where these go together along the rows: then less of it is clear.
bool light_flickers(const std::vector<StatisticDeclaration>& battery, const Eigen::VectorXd& z) {
  const bool with_sites = deviation_of("light.sites.pairs.light_rows", battery, z) > 5;
  const double clear = with_sites ? 5 : 8, quiet = 4;
  const auto rows = [](const StatisticDeclaration& one) { return has(one, ".lines.rows."); };
  return largest(battery, z, [&](const auto& one) { return one.darks && rows(one); }) < quiet &&
         stands_out(largest(battery, z, [&](const auto& one) { return !one.darks && rows(one); }), z, clear,
                    0.5);
}

/// How the noise differs between halves of the frame, if by more than it slopes: there it steps. Not where
/// the sites' light slopes more than it steps.
double noise_steps(const std::vector<StatisticDeclaration>& battery, const Eigen::VectorXd& z) {
  constexpr double clear = 5;
  const auto beyond = [&](std::string_view step, std::string_view slope) {
    const auto of = [&](std::string_view family, std::string_view name) {
      return std::fabs(deviation_of(std::string(family).append(name), battery, z));
    };
    const double size = of("light.temporal_maps.", step), sites = of("light.sites.by_site.", slope);
    const bool of_sites = sites > std::max(clear, of("light.sites.by_site.", step));
    return size > of("light.temporal_maps.", slope) && !of_sites ? size : 0;
  };
  return std::max(beyond("left_right", "gradient_x"), beyond("top_bottom", "gradient_y"));
}

/// Two halves that an amplifier each reads: light has no edge in the middle of the sensor.
bool halves_differ(const std::vector<StatisticDeclaration>& battery, const Eigen::VectorXd& z) {
  constexpr double clear = 8, beside = 0.5;
  return stands_out(noise_steps(battery, z), z, clear, beside);
}

/// A change from one side of the frame to the other, or from its middle outwards.
bool is_slope(const StatisticDeclaration& one) {
  const std::string_view last = std::string_view(one.name).substr(one.name.rfind('.') + 1);
  return last == "gradient_x" || last == "gradient_y" || last == "left_right" || last == "top_bottom" ||
         last == "radial";
}

/// Of each pixel's noise in time, with the shutter open or closed.
bool is_slope_of_noise(const StatisticDeclaration& one, bool darks) {
  return one.darks == darks && has(one, ".temporal_maps.") && is_slope(one);
}

/// Columns or rows of other noise than their neighbours, not just more of it to one side: an amplifier each.
/// The noise between images may be odder.
bool lines_differ(const std::vector<StatisticDeclaration>& battery, const Eigen::VectorXd& z) {
  constexpr double clear = 8, beside = 0.8, sloping = 0.5;
  const auto lines = [](const StatisticDeclaration& one) {
    const std::string_view name = one.name;
    return !one.darks && has(one, ".temporal_maps.") &&
           (name.ends_with(".columns") || name.ends_with(".rows"));
  };
  const auto slopes = [](const auto& one) { return is_slope_of_noise(one, false); };
  const double noise = largest(battery, z, lines);
  return stands_out(noise, z, clear, beside) && largest(battery, z, slopes) < sloping * noise;
}

/// Mean and noise that slope across the frame with the shutter open, or fall off from the middle, while the
/// noise does not with it closed: the light slopes, and its shot noise with it. Offsets that differ from
/// pixel to pixel may hide it in the mean, and then nothing is odder. Not where sites are odd far beyond
/// that: it is the atoms' own light that slopes, and the noise about them.
bool light_slopes(const std::vector<StatisticDeclaration>& battery, const Eigen::VectorXd& z) {
  constexpr double clear = 8, seen = 5, quiet = 4, far_beyond = 2;
  // What ends at columns or rows is no slope, though it may tilt one.
  const auto lines = [](const StatisticDeclaration& one) {
    return !one.darks && (has(one, ".columns") || has(one, ".rows"));
  };
  const auto sites = [](const StatisticDeclaration& one) {
    return stage_of_observable(one.observable, one.darks) == "scene";
  };
  const auto mean = [](const StatisticDeclaration& one) {
    return is_slope(one) && !one.darks && one.observable == "mean_map";
  };
  const auto noise = [](const auto& one) { return is_slope_of_noise(one, false); };
  const auto dark_noise = [](const auto& one) { return is_slope_of_noise(one, true); };
  const double sloping = largest(battery, z, noise);
  return largest(battery, z, dark_noise) < quiet &&
         (foremost(battery, z, noise) || largest(battery, z, mean) > seen) &&
         sloping > std::max({clear, 0.4 * z.cwiseAbs().maxCoeff(), largest(battery, z, lines),
                             largest(battery, z, sites) / far_beyond});
}

/// How frames' level away from the sites varies, with the shutter open.
double level_of_light(const std::vector<StatisticDeclaration>& battery, const Eigen::VectorXd& z) {
  return largest(battery, z, [](const auto& one) {
    return !one.darks && (has(one, ".frames.level.") || has(one, ".frames.linear_level."));
  });
}

/// How the light that the sites have in common varies.
double light_of_sites(const std::vector<StatisticDeclaration>& battery, const Eigen::VectorXd& z) {
  return largest(battery, z, [](const auto& one) { return !one.darks && has(one, ".sites.common."); });
}

/// Nothing varies from frame to frame with the shutter closed.
bool dark_frames_are_alike(const std::vector<StatisticDeclaration>& battery, const Eigen::VectorXd& z) {
  constexpr double quiet = 4;
  return largest(battery, z, [](const auto& one) { return one.darks && has(one, ".frames."); }) < quiet;
}

/// Frames whose level away from the sites varies, while that of dark frames does not, and with it their noise
/// or from every frame to the next: it is light that varies, with its shot noise if there is enough of it. A
/// few frames that stand out may be missing among the dark ones by chance. A drift of the level is as clear
/// in its noise that follows, if the two go the same way.
bool light_flashes(const std::vector<StatisticDeclaration>& battery, const Eigen::VectorXd& z) {
  constexpr double clear = 8, quiet = 4;
  const double level = level_of_light(battery, z);
  const auto of = [&](std::string_view name) { return std::fabs(deviation_of(name, battery, z)); };
  const double noise =
      largest(battery, z, [&](const auto& one) { return !one.darks && has(one, ".frames.noise."); });
  const double drift = deviation_of("light.frames.level.trend", battery, z),
               noise_drift = deviation_of("light.frames.noise.trend", battery, z);
  const bool with_noise = noise > std::max(clear, 0.3 * level) ||
                          (std::fabs(drift) > 0.5 * level && noise_drift * drift > quiet * std::fabs(drift)),
             every_frame = of("light.frames.level.steps") > std::max(clear, 0.5 * level) &&
                           of("light.frames.level.largest") < quiet;
  return stands_out(level, z, clear, 0.4) && (with_noise || every_frame) && dark_frames_are_alike(battery, z);
}

/// The sites' light changes with the light beside them, no more clearly than that: not the lamp behind the
/// one nor the atoms, whose light hardly reaches so far, but what turns all light into counts. Exposure or
/// gain.
bool all_light_flashes(const std::vector<StatisticDeclaration>& battery, const Eigen::VectorXd& z) {
  constexpr double clear = 6, beside = 0.4, no_less = 0.7;
  const double level = level_of_light(battery, z), sites = light_of_sites(battery, z);
  return light_flashes(battery, z) && sites > std::max(clear, beside * level) && level > no_less * sites;
}

/// So little of it beside the sites that it has no noise to tell: their light and the level drift the same
/// way, or vary, and the level as clearly.
bool all_light_goes_along(const std::vector<StatisticDeclaration>& battery, const Eigen::VectorXd& z) {
  constexpr double clear = 5, beside = 0.4, no_less = 0.7;
  const auto along = [&](std::string_view how) {
    const auto of = [&](std::string_view what) {
      return deviation_of(std::string(what).append(how), battery, z);
    };
    const double sites = of("light.sites.common."), level = of("light.frames.linear_level.");
    return sites * level > 0 && std::fabs(level) > std::max(clear, no_less * std::fabs(sites)) &&
           stands_out(std::fabs(sites), z, clear, beside);
  };
  return (along("trend") || along("variance")) && dark_frames_are_alike(battery, z);
}

/// The sites' light varies from frame to frame and the noise of what little light there is beside them, but
/// not its level: it is what multiplies both.
bool gain_flickers(const std::vector<StatisticDeclaration>& battery, const Eigen::VectorXd& z) {
  constexpr double clear = 8, beside = 0.4, seen = 4.5, quiet = 0.3;
  const double noise = deviation_of("light.frames.noise.variance", battery, z);
  return stands_out(light_of_sites(battery, z), z, clear, beside) && noise > seen &&
         level_of_light(battery, z) < std::max(3.0, quiet * noise);
}

/// The level away from the sites rises where these fade, and falls where they brighten, or drifts the other
/// way: light that leaves the middle of their images for what is around them. Atoms that shine less leave
/// less of it there, too.
bool light_leaves_images(const std::vector<StatisticDeclaration>& battery, const Eigen::VectorXd& z) {
  constexpr double clear = 6, against = 4.5, beside = 0.4;
  const double sites = deviation_of("light.sites.common.trend", battery, z),
               level = deviation_of("light.frames.level.trend", battery, z);
  const bool drift_apart = sites * level < 0 && std::min(std::fabs(sites), std::fabs(level)) > clear;
  return stands_out(light_of_sites(battery, z), z, clear, beside) &&
         (drift_apart || deviation_of("light.frames.level_against_light", battery, z) < -against);
}

/// How pixels go together with those on one side of them, with the shutter open.
double neighbours_in_light(std::string_view where, std::string_view way,
                           const std::vector<StatisticDeclaration>& battery, const Eigen::VectorXd& z) {
  return largest(battery, z, [&](const auto& one) {
    return !one.darks && has(one, where) && std::string_view(one.name).ends_with(way);
  });
}

/// Likewise on any side, with the shutter closed.
double neighbours_in_darks(const std::vector<StatisticDeclaration>& battery, const Eigen::VectorXd& z) {
  return largest(battery, z, [](const auto& one) { return one.darks && has(one, ".neighbours."); });
}

/// Pixels that go together with their neighbours whether the shutter is open or closed: what is read out of
/// one is also of the other.
bool pixels_share_noise(const std::vector<StatisticDeclaration>& battery, const Eigen::VectorXd& z) {
  constexpr double clear = 8, beside = 0.4;
  const auto shared = [&](std::string_view way) {
    const auto name = [&](std::string_view shutter) {
      return std::string(shutter).append(".neighbours.dark.").append(way);
    };
    const double light = deviation_of(name("light"), battery, z),
                 dark = deviation_of(name("dark"), battery, z);
    return light * dark > 0 ? std::min(std::fabs(light), std::fabs(dark)) : 0;
  };
  return stands_out(std::max(shared("right_1"), shared("down_1")), z, clear, beside);
}

/// Pixels away from the sites that go together over some distance in frames with the shutter open, and not
/// with it closed: a pattern of light that moves. Charge that leaks goes to the next pixels.
bool light_ripples(const std::vector<StatisticDeclaration>& battery, const Eigen::VectorXd& z) {
  constexpr double clear = 8, quiet = 4;
  const auto far = [&](std::string_view way) {
    return neighbours_in_light(".neighbours.dark.", way, battery, z);
  };
  const auto in_darks = [](const auto& one) {
    return one.darks && (has(one, ".neighbours.") || has(one, ".readout_spectrum.") || has(one, ".lines."));
  };
  return stands_out(std::min(far("right_3"), far("down_3")), z, clear, 0.5) &&
         largest(battery, z, in_darks) < quiet;
}

/// Charge gathers where no site is, now here and now there, with the shutter open only: atoms that are not in
/// the traps. Radiation does not mind the shutter; beside an image that moves the sites' own light gathers.
bool light_gathers(const std::vector<StatisticDeclaration>& battery, const Eigen::VectorXd& z) {
  constexpr double clear = 8, quiet = 4, beside = 0.35;
  const auto clusters = [&](bool darks) {
    return largest(battery, z, [&](const auto& one) { return one.darks == darks && has(one, ".clusters."); });
  };
  return clusters(true) < quiet && stands_out(clusters(false), z, clear, beside) &&
         largest(battery, z, [](const auto& one) { return has(one, ".position."); }) < clear;
}

/// Pixels between the sites that go together with those on all sides of them, with the shutter open only, and
/// have more noise than so much light all the time would have, which is odder than anything else: atoms
/// there.
bool light_comes_and_goes(const std::vector<StatisticDeclaration>& battery, const Eigen::VectorXd& z) {
  constexpr double clear = 8, beside = 0.2, quiet = 4;
  const auto near = [&](std::string_view way) {
    return neighbours_in_light(".neighbours.dark.", way, battery, z);
  };
  double noise = 0;
  for (std::size_t k = 0; k < battery.size(); ++k)
    if (!battery[k].darks && has(battery[k], ".temporal_maps.by_light."))
      noise = std::max(noise, z(static_cast<Eigen::Index>(k)));
  return stands_out(noise, z, clear, 0.9) &&
         stands_out(std::min(near("right_1"), near("down_1")), z, clear, beside) &&
         neighbours_in_darks(battery, z) < quiet;
}

/// Likewise where the sites light them as well: they go together as far as images reach, and what is around
/// empty sites has more noise than what is around occupied ones.
bool images_come_and_go(const std::vector<StatisticDeclaration>& battery, const Eigen::VectorXd& z) {
  constexpr double clear = 8, beside = 0.2, quiet = 4;
  const auto lit = [&](std::string_view way) {
    return neighbours_in_light(".neighbours.all.", way, battery, z);
  };
  const double empty = deviation_of("light.image_noise.empty.wing", battery, z);
  return stands_out(empty, z, clear, beside) &&
         empty > deviation_of("light.image_noise.occupied.wing", battery, z) &&
         stands_out(std::min(lit("right_2"), lit("down_2")), z, clear, beside) &&
         neighbours_in_darks(battery, z) < quiet;
}

/// How the common position of the images varies along the stack.
double motion_in_common(const std::vector<StatisticDeclaration>& battery, const Eigen::VectorXd& z) {
  return largest(battery, z, [](const StatisticDeclaration& one) {
    return has(one, ".position.") && std::string_view(one.name).ends_with(".variance");
  });
}

/// Occupied sites that have more noise than their light, in pixels that go together along rows and columns,
/// less clearly if their common position varies as that of sites that move by themselves does, while pixels
/// that no site lights do not: how much more. 0 if not so.
double noise_of_moving_images(const std::vector<StatisticDeclaration>& battery, const Eigen::VectorXd& z) {
  constexpr double clear = 8, beside = 0.4;
  const auto neighbours = [&](std::string_view where, std::string_view way) {
    return neighbours_in_light(where, way, battery, z);
  };
  const double noise = deviation_of("light.image_noise.occupied.core", battery, z),
               position = motion_in_common(battery, z);
  const double along = position > clear && position < 0.5 * noise ? 0.15 : 0.3;
  const double lit =
      std::min(neighbours(".neighbours.all.", "right_1"), neighbours(".neighbours.all.", "down_1"));
  const double dark =
      std::max(neighbours(".neighbours.dark.", "right_1"), neighbours(".neighbours.dark.", "down_1"));
  const bool moving = stands_out(noise, z, clear, beside) && lit > along * noise &&
                      std::max(dark, neighbours_in_darks(battery, z)) < beside * lit;
  return moving ? noise : 0;
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

/// Images that move all together, or about the middle of the array, which stays, or the more the farther out
/// they are. Or their common position varies more than anything else is odd.
bool images_move_together(const std::vector<StatisticDeclaration>& battery, const Eigen::VectorXd& z) {
  constexpr double together = 1, middle_stays = 0.15;
  const double noise = noise_of_moving_images(battery, z), position = motion_in_common(battery, z);
  return (noise > 0 && (position > together * noise || position < middle_stays * noise ||
                        width_follows_field(battery, z))) ||
         foremost(battery, z, [](const auto& one) { return has(one, ".position."); });
}

/// Each on its own: the atoms, which move their mean as well, but by less.
bool images_move_each(const std::vector<StatisticDeclaration>& battery, const Eigen::VectorXd& z) {
  return noise_of_moving_images(battery, z) > 0;
}

/// Light far from the sites that comes and goes with theirs.
bool far_halo_stands_out(const std::vector<StatisticDeclaration>& battery, const Eigen::VectorXd& z) {
  return foremost(battery, z, [](const auto& one) { return has(one, ".far_light.halo."); });
}

/// Sites whose images are displaced, but no wider, all along the stack.
bool sites_are_displaced(const std::vector<StatisticDeclaration>& battery, const Eigen::VectorXd& z) {
  constexpr double clear = 6, quiet = 8, beside = 1.5;
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
  const auto smooth = [](const auto& one) {
    return one.name == "light.point_spread.x.smooth" || one.name == "light.point_spread.y.smooth";
  };
  return sites_are_displaced(battery, z) && largest(battery, z, smooth) > clear;
}

/// Empty sites that all hold some light, and nothing else nearly as odd that does not go with it.
template <class GoesWith>
bool empty_sites_hold_light(const std::vector<StatisticDeclaration>& battery, const Eigen::VectorXd& z,
                            const GoesWith& goes_with) {
  constexpr double clear = 8, beside = 0.4;
  const auto others = [&](const auto& one) {
    return one.name != "light.sites.empty.mean" && !has(one, ".sites.histogram.") &&
           !has(one, ".image_noise.empty.") && !goes_with(one);
  };
  const double glow = deviation_of("light.sites.empty.mean", battery, z);
  return glow > clear && largest(battery, z, others) < beside * glow;
}

/// The traps' light. Atoms that come and go during an exposure would show between empty and occupied, light
/// of other atoms beyond the sites.
bool empty_sites_glow(const std::vector<StatisticDeclaration>& battery, const Eigen::VectorXd& z) {
  return empty_sites_hold_light(battery, z, [](const auto&) { return false; });
}

/// More where an atom was in the frame before or is in the next, or less of it all in the first frames: the
/// sensor remembers, or is not read out yet.
bool empty_sites_remember(const std::vector<StatisticDeclaration>& battery, const Eigen::VectorXd& z) {
  constexpr double clear = 5, builds_up = 3;
  return (deviation_of("light.sites.memory.afterglow", battery, z) > clear ||
          deviation_of("light.sites.memory.persistence", battery, z) > clear ||
          deviation_of("light.sites.memory.foreglow", battery, z) > clear ||
          deviation_of("light.frames.level.first_frames", battery, z) < -builds_up ||
          deviation_of("light.sites.common.first_frames", battery, z) < -builds_up) &&
         empty_sites_hold_light(battery, z, [](const auto& one) {
           return one.observable == "lag_correlation" || one.name == "light.sites.empty.variance";
         });
}

/// Sites that hold an atom more or less often than others, or than before: loading. The light's level and its
/// noise follow, whose differences between parts of the frame may be odder; nothing behind the atoms does
/// this.
bool loading_stands_out(const std::vector<StatisticDeclaration>& battery, const Eigen::VectorXd& z) {
  constexpr double clear = 8, clear_along = 4.5, beside = 0.9, of_noise = 0.7;
  const auto noise = [](const StatisticDeclaration& one) {
    const std::string_view name = one.name;
    return is_slope_of_noise(one, false) ||
           (!one.darks && has(one, ".temporal_maps.") &&
            (name.ends_with(".crosswise") || name.ends_with(".rows") || name.ends_with(".columns")));
  };
  const auto by_site = [](const auto& one) { return has(one, ".sites.filling_by_site."); };
  const auto others = [&](const auto& one) { return !noise(one) && !by_site(one); };
  const auto along_the_stack = [](const auto& one) { return has(one, ".sites.loading."); };
  const double differ = largest(battery, z, by_site);
  return differ >
             std::max({clear, beside * largest(battery, z, others), of_noise * largest(battery, z, noise)}) ||
         foremost(battery, z, along_the_stack, clear_along);
}

/// Neighbours, rows or columns that hold atoms together more or less often than chance has it: the noise
/// slopes as they do, and may be a little odder, and no light comes and goes by site.
bool atoms_load_together(const std::vector<StatisticDeclaration>& battery, const Eigen::VectorXd& z) {
  constexpr double clear = 8, beside = 0.85;
  return stands_out(largest(battery, z, [](const auto& one) { return has(one, ".sites.pairs.occupancy_"); }),
                    z, clear, beside);
}

/// Light on one side of the images, and on the same side less than none farther out, where what is left of
/// coma makes up for it: every spot once more. Charge that trails fades away.
bool spots_double(const std::vector<StatisticDeclaration>& battery, const Eigen::VectorXd& z) {
  constexpr double clear = 8, beside = 0.9, beyond = 4;
  constexpr std::array<std::string_view, 2> sides = {"right_against_left", "down_against_up"};
  return std::any_of(sides.begin(), sides.end(), [&](std::string_view side) {
    const auto at = [&](std::string_view distance) {
      return deviation_of(std::string("light.point_spread.").append(side).append(distance), battery, z);
    };
    const double near = at(".2"), next = at(".3"), far = at(".4");
    return stands_out(std::fabs(near), z, clear, beside) && near * next < 0 && near * far < 0 &&
           std::max(std::fabs(next), std::fabs(far)) > beyond;
  });
}

/// Occupied sites whose light varies less than the shot noise of so much of it, in their images' middle and
/// in their sums or in the pixels that have most of it: no light does that. The bright values are compressed
/// or cut off, or flow over, which changes the images' shape and is odder there.
bool light_is_too_calm(const std::vector<StatisticDeclaration>& battery, const Eigen::VectorXd& z) {
  constexpr double clear = 6, beside = 0.5, beside_shape = 0.25;
  const double core = -deviation_of("light.image_noise.occupied.core", battery, z);
  const double sums = std::min(core, -deviation_of("light.sites.peak.variance_within_sites", battery, z)),
               pixels = std::min(core, -deviation_of("light.temporal_maps.by_light.5", battery, z));
  return stands_out(sums, z, clear, beside) || stands_out(pixels, z, clear, beside_shape);
}

/// Images of some sites in which one pixel answers otherwise than those around it: no lens does that.
bool pixels_answer_otherwise(const std::vector<StatisticDeclaration>& battery, const Eigen::VectorXd& z) {
  constexpr double clear = 8, beside = 0.4;
  return stands_out(deviation_of("light.point_spread.pixels.loneliest", battery, z), z, clear, beside);
}

/// Pixels with less noise than all others, where these have the light's: they do not see it.
bool pixels_are_blind(const std::vector<StatisticDeclaration>& battery, const Eigen::VectorXd& z) {
  constexpr double clear = 6, beside = 0.5;
  return stands_out(deviation_of("light.temporal_maps.quiet", battery, z), z, clear, beside);
}

/// Light far above and below the sites, in their columns: charge that is shifted while it is lit. The columns
/// it leaves are a pattern of the mean, as stray light would leave. So strong that it changes images and
/// histograms as well: above and below, not to the left and right.
bool charge_smears(const std::vector<StatisticDeclaration>& battery, const Eigen::VectorXd& z) {
  constexpr double clear = 8, beside = 0.25, across = 0.5;
  if (foremost(battery, z, [](const auto& one) { return one.observable == "column_smear"; })) return true;
  const double along = std::min(deviation_of("light.far_light.up", battery, z),
                                deviation_of("light.far_light.down", battery, z));
  const double aside = largest(battery, z, [](const auto& one) {
    return one.name == "light.far_light.left" || one.name == "light.far_light.right";
  });
  return stands_out(along, z, clear, beside) && aside < across * along;
}

/// What an image is around a site, not where it is nor the charge that trails behind it.
bool is_shape(const StatisticDeclaration& one) {
  return has(one, ".point_spread.") && stage_of_observable(one.observable, one.darks) == "optics" &&
         !has(one, ".point_spread.x.") && !has(one, ".point_spread.y.");
}

/// Pixels that differ in the mean of the frames with the shutter open, and not with it closed, each from its
/// neighbours as much as from others, in their finest waves as in all others: no light is as fine as that.
/// Images that they are seen in are a little odd with them; images of another shape make the pixels differ
/// that they fall on.
bool pixels_differ_in_light(const std::vector<StatisticDeclaration>& battery, const Eigen::VectorXd& z) {
  constexpr double clear = 6, beside = 0.4, quiet = 4, alike = 0.3, of_shape = 0.7;
  const auto spread = [&](std::string_view offsets, std::string_view charge) {
    return std::max(deviation_of(offsets, battery, z), deviation_of(charge, battery, z));
  };
  const double lit = spread("light.static_offsets.spread", "light.static_charge.spread");
  const double neighbours = std::max(deviation_of("light.static_offsets.neighbours.right_1", battery, z),
                                     deviation_of("light.static_offsets.neighbours.down_1", battery, z));
  return spread("dark.static_offsets.spread", "dark.static_charge.spread") < quiet &&
         stands_out(lit, z, clear, beside) && neighbours < alike * lit &&
         deviation_of("light.static_offsets.high", battery, z) > -alike * lit &&
         lit > of_shape * largest(battery, z, is_shape);
}

/// A smooth pattern in the mean of the frames with the shutter open, and not with it closed, and nothing
/// odder: light falls where it should not.
bool light_is_uneven(const std::vector<StatisticDeclaration>& battery, const Eigen::VectorXd& z) {
  constexpr double quiet = 4;
  const auto pattern = [&](bool darks) {
    return [darks](const StatisticDeclaration& one) {
      const std::string_view name = one.name;
      return one.darks == darks && name.find(".static_") != name.npos &&
             (name.ends_with(".saddle") || name.ends_with(".diagonal") || name.ends_with(".radial") ||
              name.ends_with(".gradient_x") || name.ends_with(".gradient_y"));
    };
  };
  return largest(battery, z, pattern(true)) < quiet && foremost(battery, z, pattern(false));
}

/// A wave across the mean of the frames with the shutter open, and not with it closed: light that interferes.
/// The sites' brightness follows, and may be odder.
bool light_waves(const std::vector<StatisticDeclaration>& battery, const Eigen::VectorXd& z) {
  constexpr double clear = 6, beside = 0.35, quiet = 4;
  const auto wave = [&](bool darks) {
    return largest(battery, z,
                   [&](const auto& one) { return one.darks == darks && has(one, ".static_offsets.peak_"); });
  };
  return wave(true) < quiet && stands_out(wave(false), z, clear, beside);
}

/// Lit pixels go together as far as images reach, dark ones do not, and the sites brighten and fade together:
/// a lens that changes from frame to frame. Charge that leaks goes to the next pixels.
bool images_change_together(const std::vector<StatisticDeclaration>& battery, const Eigen::VectorXd& z) {
  constexpr double clear = 8, as_far = 0.6, quiet = 0.2;
  const auto lit = [&](std::string_view way) {
    return neighbours_in_light(".neighbours.all.", way, battery, z);
  };
  const double far = std::min(lit("right_2"), lit("down_2"));
  const double dark = largest(battery, z, [](const auto& one) { return has(one, ".neighbours.dark."); });
  return far > std::max(clear, as_far * std::max(lit("right_1"), lit("down_1"))) && dark < quiet * far &&
         deviation_of("light.sites.common.variance", battery, z) > clear;
}

/// The shape of images far more than anything else. Where nothing is as odd, the sites' brightness may follow
/// it, and the lines that answer to it; if images change from frame to frame, whatever they fall on.
bool images_change_shape(const std::vector<StatisticDeclaration>& battery, const Eigen::VectorXd& z) {
  constexpr double clear = 15, beside = 1.5;
  const bool changing = images_change_together(battery, z);
  const auto follows_shape = [changing](const auto& one) {
    return stage_of_observable(one.observable, one.darks) == "scene" || has(one, ".response_") ||
           (changing && !one.darks);
  };
  const bool most = foremost(battery, z, is_shape);
  const double others = largest(battery, z, [&](const auto& one) {
    return stage_of_observable(one.observable, one.darks) != "optics" && !(most && follows_shape(one));
  });
  return largest(battery, z, is_shape) > std::max(clear, beside * others);
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

/// A deviation of the dark frames that goes against that of the light frames: what light does was taken for a
/// noise of the sensor, and calibrated to a compromise between the two.
bool makes_up_for_light(const StatisticDeclaration& one, double deviation,
                        const std::vector<StatisticDeclaration>& battery, const Eigen::VectorXd& z) {
  if (!one.darks) return false;
  const double light = deviation_of("light" + one.name.substr(one.name.find('.')), battery, z);
  return std::fabs(light) > odd && light * deviation < 0;
}

/// Noise and counts that the light brings along, whatever it is that is odd about the light.
bool follows_light(const StatisticDeclaration& one) {
  return !one.darks && (one.observable == "variance_map" || one.observable == "pixel_histogram");
}

/// What tells the stage by itself.
struct Sign {
  std::string_view stage;
  bool (*shows)(const std::vector<StatisticDeclaration>& battery, const Eigen::VectorXd& z);
  bool both = false;  // only against frames with the shutter closed
};

/// The first that shows decides.
// clang-format off
constexpr Sign signs[] = {
    {"sensor", pixels_share_noise, true},
    {"optics", far_halo_stands_out},
    {"optics", light_leaves_images},
    {"sensor", all_light_flashes, true},
    {"optics", light_flashes, true},
    {"sensor", gain_flickers},
    {"sensor", all_light_goes_along, true},
    {"optics", light_flickers, true},
    {"scene", atoms_load_together},
    {"scene", loading_stands_out},
    {"sensor", halves_differ},
    {"optics", light_slopes, true},
    {"optics", light_ripples, true},
    {"sensor", charge_smears},
    {"sensor", light_is_too_calm},
    {"sensor", pixels_answer_otherwise},
    {"sensor", pixels_are_blind},
    {"sensor", lines_differ},
    {"sensor", pixels_differ_in_light, true},
    {"optics", light_is_uneven, true},
    {"optics", light_waves, true},
    {"sensor", empty_sites_remember},
    {"optics", empty_sites_glow},
    {"optics", spots_double},
    {"optics", images_change_shape},
    {"optics", light_reaches_far},
    {"optics", images_move_together},
    {"scene", images_move_each},
    {"scene", light_gathers, true},
    {"scene", light_comes_and_goes, true},
    {"scene", images_come_and_go, true},
    {"optics", field_is_displaced},
    {"scene", sites_are_displaced},
};
// clang-format on

}  // namespace

std::string stage_of_differences(const std::vector<StatisticDeclaration>& battery, const Eigen::VectorXd& z,
                                 const std::vector<Hypothesis>& hypotheses) {
  std::map<std::string, double> votes = {{"scene", 0}, {"optics", 0}, {"sensor", 0}};
  // Light and dark frames are compared only where there are both.
  const bool both = std::any_of(battery.begin(), battery.end(), [](const auto& one) { return one.darks; });
  const bool field = width_follows_field(battery, z);
  double darks = 0, all = 0;
  for (std::size_t k = 0; k < battery.size(); ++k) {
    const double deviation = z(static_cast<Eigen::Index>(k)), size = std::fabs(deviation);
    if (size < odd || makes_up_for_light(battery[k], deviation, battery, z)) continue;
    const double weight = std::log1p(size - 3) * (both && follows_light(battery[k]) ? 0.5 : 1);
    const bool of_the_field = field && has(battery[k], ".sites.by_site.");
    votes[of_the_field ? "optics" : stage_of_observable(battery[k].observable, battery[k].darks)] += weight;
    all += weight;
    if (battery[k].darks) darks += weight;
  }
  // What shows with the shutter closed is the sensor's.
  if (darks > 0.2 * all && darks > 1) return "sensor";
  for (const Sign& sign : signs)
    if ((both || !sign.both) && sign.shows(battery, z)) return std::string(sign.stage);
  if (!hypotheses.empty()) {
    // The stage of the known effects that come closest, as far as these take anything away; not the more of
    // them there are.
    std::set<std::vector<std::string>> not_seen;
    for (const Hypothesis& one : hypotheses)
      if (one.not_seen) not_seen.insert(one.effects);
    const auto counts = [&](const Hypothesis& one) {
      return one.effects.size() == 1 && one.log_evidence > 0 && !not_seen.contains(one.effects);
    };
    double best = 0, share = 0;
    for (const Hypothesis& one : hypotheses)
      if (counts(one) && one.log_evidence > best) best = one.log_evidence, share = one.share;
    const double trust = 2 * std::max(1.0, all) * std::pow(std::min(1.0, 2 * share), 3);
    std::map<std::string, double> closest;
    for (const Hypothesis& one : hypotheses)
      if (counts(one)) {
        double& of_stage = closest[stage_of(one.effects.front())];
        of_stage = std::max(of_stage, trust * std::pow(one.log_evidence / best, 4));
      }
    for (const auto& [stage, weight] : closest) votes[stage] += weight;
  }
  return std::max_element(votes.begin(), votes.end(),
                          [](const auto& a, const auto& b) { return a.second < b.second; })
      ->first;
}

}  // namespace atomcam
