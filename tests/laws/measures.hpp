#pragma once
// Plain estimators of the observables of base/observable.hpp. Each observable is one or more numbers, each
// known once per block of frames (or per tile of the sensor, where it takes all frames of a pixel): their
// mean and its standard error follow from the scatter of the blocks.

#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "laws/stacks.hpp"

namespace atomcam::laws {

/// A number once per block.
struct Statistic {
  std::string observable;
  std::string what;
  std::vector<double> values;
};

std::vector<Statistic> measure(const Stacks& stacks);

/// Difference of the means in standard errors of the difference. Infinite if both are without scatter, yet
/// differ.
double sigmas(const Statistic& a, const Statistic& b);

/// By observable: the largest difference of its statistics, in standard errors.
std::map<std::string, double, std::less<>> compare(const std::vector<Statistic>& reference,
                                                   const std::vector<Statistic>& changed);

}  // namespace atomcam::laws
