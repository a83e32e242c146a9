#pragma once
// From a lab to the stack model the battery measures with: where each site's light falls and how to weigh it.

#include "analysis/stack_model.hpp"
#include "calibration/atom_fit.hpp"
#include "optics/optics.hpp"
#include "simulation/lab.hpp"

namespace atomcam {

/// Only what a pixel is expected to see and to add, without the sites' images and the law of counts.
StackModel stack_figures(const Lab& lab);

/// The stack model of a lab's plain part (its effects are left out), in the pixels of its region.
/// `point_spread`: that of the lab's optics, where it is known already.
StackModel stack_model(const Lab& lab, const PointSpreadFunction* point_spread = nullptr);

/// What one atom in a site under test would be measured with.
struct SiteNoise {
  double empty_variance = 0, empty_third = 0;  // cumulants of an empty site's estimate, e
  double variance_per_e = 0, third_per_e = 0;  // added per electron of the atom
};
SiteNoise site_noise(const StackModel& model);

/// How the light of one site shows in the estimates of the others and in what is left over.
struct Leakage {
  /// Of a site: others and the part of an electron there that its own estimate takes for its own.
  struct From {
    std::size_t site = 0;
    double part = 0;
  };
  std::vector<std::vector<From>> into;
  /// sum over sites of variance_e2[site] * (an electron's image less the estimates' images)^2, per pixel.
  std::vector<double> rest_variance;
};
Leakage leakage(const StackModel& model, const PointSpreadFunction& point_spread,
                const std::vector<double>& site_variance_e2);

/// Mean and variance that the neighbours' being there or not gives an empty site's estimate, in a few
/// classes.
std::vector<Surroundings> surroundings(const StackModel& model, const Leakage& leaks, double empty_variance);

}  // namespace atomcam
