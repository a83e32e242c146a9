#pragma once
// The frames in which the laws look for an effect: pairs of successive frames, far apart from pair to pair,
// so that what is fast and what is slow both show in few frames. Each with atoms, with empty traps and in the
// dark.

#include <algorithm>
#include <cstdint>
#include <string>
#include <vector>

#include "simulation/simulation.hpp"

namespace atomcam::laws {

inline constexpr int side_px = 96;
inline constexpr int sites_per_side = 8;
inline constexpr double spacing_px = 11.6;
inline constexpr double first_site_px = 7.4;
inline constexpr int pairs = 80;
inline constexpr int pairs_per_block = 4;
inline constexpr int blocks = pairs / pairs_per_block;

struct SitePlace {
  double x_px, y_px;
};
inline SitePlace site_place(int site) {
  return {first_site_px + spacing_px * (site % sites_per_side),
          first_site_px + spacing_px * (site / sites_per_side)};
}
inline constexpr int site_count = sites_per_side * sites_per_side;

/// Shots take turns: the even sites of the chequerboard are filled, then the odd ones. A shot has two images.
inline bool filled(int site, int pair) {
  return ((site % sites_per_side) + (site / sites_per_side) + pair) % 2 == 0;
}

/// The preset's camera, small, with bright atoms and stray light and without effects; two frames a shot.
Lab law_lab(CameraKind kind);

inline ParameterValues declared_values(const EffectDeclaration& effect, double strength) {
  ParameterValues values;
  for (const ParameterDeclaration& parameter : effect.parameters) values.push_back(parameter.default_value);
  values.front() = strength;
  return values;
}

/// An effect on a camera that it is declared for.
struct Case {
  const EffectDeclaration* effect;
  CameraKind kind;
};
/// All of them; a new effect of the catalogue is among them.
std::vector<Case> cases();
inline std::string case_name(const Case& one) {
  return one.effect->name + (one.kind == CameraKind::emccd ? "_emccd" : "_qcmos");
}

struct Stack {
  std::vector<CountImage> frames;  // 2 * pairs: first and second of each pair
  const CountImage& at(int pair, int image) const {
    return frames[static_cast<std::size_t>(2 * pair + image)];
  }
};

struct Stacks {
  Stack atoms, empty, dark;
  double bias_counts = 0;
  double counts_per_electron = 1;
  double read_noise_counts = 0;
};

/// `like`: what is dear to make is taken from it.
Stacks render_stacks(const Lab& lab, const Simulation* like = nullptr);

}  // namespace atomcam::laws
