#pragma once
// Stacks that nothing can be concluded from: clipped, without noise, not what they are said to be.

#include <string_view>

#include "calibration/notes.hpp"
#include "calibration/optics_fit.hpp"
#include "calibration/sensor_fit.hpp"

namespace atomcam {

/// Throws an Error at `place` if values pile up at the largest one, if all frames are the same, or if a tenth
/// of the frames have one value throughout.
void check_stack(const StackSums& sums, std::string_view place);

/// Throws an Error at "darks" if they are brighter than the frames by more than a drift of the baseline.
void check_darks(const StackSums& darks, const StackSums& light);

/// Throws an Error at "frames" if what was taken for dark counts, without dark frames, lies far above the
/// noted bias and is far wider than the noted read noise: it is light.
void check_dark_level(const CountLaw& dark, const Notes& notes);

/// Throws an Error at "frames" if the sites are no brighter than a lattice laid over noise would find them.
void check_site_light(const MeanImage& mean, const OpticsFit& fitted);

/// Throws an Error at "frames" if the mean image is hardly better explained with sites than by even light, or
/// if the light there does not have the shape of sites.
void check_site_images(const MeanImage& mean, const OpticsFit& fitted);

}  // namespace atomcam
