#pragma once
// Atoms from the brightness of sites: filling, survival and the light of an atom, from the histogram's three
// components - empty, there to the end, lost on the way.

#include <vector>

#include "calibration/maximise.hpp"

namespace atomcam {

/// A way in which the neighbours may be filled: what they add to a site.
struct Surroundings {
  double share = 1;            // of all sites and frames
  double shift_e = 0;          // of the estimate's mean
  double variance_factor = 1;  // of empty_variance
};

/// What is known of a site's estimated light before the fit, in electrons.
struct BrightnessNoise {
  double empty_variance = 1;  // of an empty site
  double empty_skewness = 0;
  double variance_per_e = 1;  // added per electron of the atom: excess noise times sum of weight^2 share
  double third_per_e = 0;     // third cumulant added per electron
  std::vector<Surroundings> surroundings = {{}};
};

struct AtomFit {
  double filling = 0, filling_error = 0;
  double survival = 1, survival_error = 0;
  double atom_e = 0, atom_error = 0;                        // electrons of an atom that stays
  double empty_e = 0;                                       // offset of the empty peak
  double empty_variance_ratio = 1;                          // measured over expected
  double atom_variance_ratio = 1, atom_variance_error = 0;  // of variance_per_e
  double chi_square = 0;
  int bins = 0;
  bool converged = false;
  BrightnessNoise noise;  // as it was given
};

/// Brightness values of all sites and frames, e. A lost atom's light is a part u of the whole, with the
/// density of the exponential loss law; each component has its own variance and skewness (Pearson III), the
/// lost ones their own shot noise at each u (the paper takes the unoccupied and occupied noise only).
/// `like`: a fit to start from, of values much like these.
AtomFit fit_atoms(const std::vector<float>& brightness, const BrightnessNoise& noise, double filling,
                  double survival, double atom_e, const AtomFit* like = nullptr);

}  // namespace atomcam
