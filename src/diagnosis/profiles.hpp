#pragma once
// What a physicist would plot of a stack: curves and maps, measured in real and simulated frames alike. They
// illustrate a diagnosis; its numbers come from the battery.

#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <vector>

#include "analysis/frame_sequence.hpp"
#include "analysis/stack_model.hpp"
#include "diagnosis/population.hpp"
#include "simulation/lab.hpp"

namespace atomcam {

struct Curve {
  std::string key;  // "light.pixel_histogram"
  std::string title, x_label, y_label;
  bool log_y = false;
  std::vector<double> x, y;  // y: NaN where there is nothing
};

struct ProfileMap {
  std::string key, title, unit;
  bool diverging = false;
  Image<double, unit::counts> values;
};

/// The same curves and maps, in the same order, for every stack that `model` measures.
struct Profiles {
  std::vector<Curve> curves;
  std::vector<ProfileMap> maps;
};
Profiles measure_profiles(const StackModel& model, const FrameSequence& frames, const FrameSequence* darks);

/// The profiles of simulated stacks of `lab`, of these numbers on.
std::vector<Profiles> simulate_profiles(const Lab& lab, const StackPlan& plan, int stacks,
                                        std::uint64_t first,
                                        const std::function<void(int done)>& progress = {});

/// Moves simulated stacks so that their mean is another real stack, and widens them to the scatter of a
/// difference of two stacks: what is within their band does not differ from it. Maps become the other
/// stack's.
void scatter_about(const Profiles& real, std::vector<Profiles>& simulated);

/// Mean and standard deviation of a curve over stacks, point by point. The deviation is smoothed over
/// neighbouring points: a few stacks say little about one point.
struct CurveBand {
  std::vector<double> mean, deviation;
};
CurveBand band_of(std::span<const Profiles> stacks, std::size_t curve);

/// Mean square deviation of a curve from the band, in its standard deviations, each point clipped at 20; for
/// a curve of the band's own stacks about 1.
double distance(const Curve& curve, const CurveBand& band);

}  // namespace atomcam
