#pragma once
// The fit of the optics is most of a calibration; the same mean image need not be fitted again.

#include "calibration/optics_fit.hpp"
#include "data/kept_results.hpp"

namespace atomcam {

/// fit_optics from several starts, or what it gave for the same image, optics and lattice before. `kept`:
/// null to fit in any case.
OpticsFit kept_optics(const KeptResults* kept, const MeanImage& mean, const OpticsDescription& optics,
                      const Lattice& start, int threads);

}  // namespace atomcam
