#pragma once
// What a model leaves open: parameters of the lab or of an effect, each with a centre and a width to draw it
// from.

#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "calibration/calibrate.hpp"
#include "effects/effect.hpp"
#include "simulation/lab.hpp"

namespace atomcam {

/// One number of a lab in a coordinate in which it may be drawn from a normal law: itself, or its logarithm.
struct Uncertain {
  std::string name;        // "read_noise", "effects.row_noise.sigma_counts"
  double centre = 0;       // coordinate
  double width = 0;        // 1 sigma of the draws, coordinate
  double lowest = -1e300;  // bounds of the coordinate
  double highest = 1e300;
  double least = -1e300;  // the parameter's own bounds: an effect is looked for within the others, and a fit
  double most = 1e300;    // may lead beyond them, but not beyond these
  double farthest = 1e300;  // from where calibration has it (zero): no recalibration leads beyond
  double usual = 0;         // an effect's default, coordinate
  double cycle = 0;  // > 0: an angle, in units of the coordinate; centre and draws may be beyond the bounds
  /// Drawn for a group of stacks at once: making a point-spread function takes longer than simulating a
  /// stack.
  bool shared = false;
  bool held = false;       // known better than calibrating says: no recalibration moves it, nor a fit
  double pull = 0;         // by how much the last recalibration moved the centre
  int steady = 0;          // how many before it moved it to the same side
  double usual_width = 0;  // of the draws; wider if effects make calibrations scatter more than that:
  double scatter = 0;      // by `scatters` recalibrations, mean square of what two stacks differ by, halved
  int scatters = 0;
  std::function<void(Lab&, double coordinate)> apply;
  std::function<double(double coordinate)> value;            // in the parameter's unit
  std::function<double(double in_unit)> coordinate_of = {};  // of an effect's parameter: the way back
  /// By how much a calibration says more than another, as a coordinate; empty for an effect's parameter.
  std::function<double(const Calibration& one, const Calibration& other)> offset;

  /// A parameter of one of these effects.
  bool is_of(const std::vector<std::string>& effects) const;
  /// The coordinate, no farther than the bounds; an angle goes on beyond them.
  double bounded(double coordinate) const;
  /// Where in the parameter's range a coordinate is: the same, and an angle comes round.
  double within(double coordinate) const;
  /// A calibration's parameter: two stacks of the model calibrate so differently.
  void calibrates_apart(double difference);
  /// By more than calibrations of the plain model differ: then the statistics tell better where it is.
  bool calibrates_widely() const { return width > usual_width && scatters > 0; }
  /// A calibration's parameter: the centre moves there, if not too far, and the bounds with it.
  void move_to(double coordinate);
  /// An effect's parameter: room to go there and to draw about it, as far as the parameter itself goes.
  void make_room_at(double coordinate);
};

/// What calibration leaves open of the plain model: every fitted figure, a few of its errors wide.
std::vector<Uncertain> calibration_uncertainty(const Calibration& calibration);

/// Of an EMCCD with gain: over how many stages the gain builds up, as the part by which their inverse differs
/// from the data sheet's (-1: ever more of ever smaller gain, whose law is the exponential one). Sensors do
/// not tell, and calibration does not say: the noise of the gain differs by a percent. Nothing without sites:
/// little light shows it, and charge that is born in the register would pass for it.
std::optional<Uncertain> register_uncertainty(const Calibration& calibration);

/// Of a qCMOS: its dark current, and how unevenly the pixels have it. Calibration does not say, as single
/// electrons hide beside the read noise; the statistics of `dark_pixels` (pixels times frames with the
/// shutter closed) do. Nothing where these hold too few electrons to tell any difference.
std::vector<Uncertain> dark_current_uncertainty(const Calibration& calibration, double dark_pixels);

/// The parameters of an effect over the whole range that is worth a look; the first is the strength
/// (logarithmic). Switching the effect on is part of applying any of them. No length in the image exceeds
/// `frame_px`, the frame's longer side, no period seven tenths of it, and no time twice the `frames` of the
/// stack: a pattern of which hardly one period is in view could be anything.
std::vector<Uncertain> effect_prior(const EffectDeclaration& effect, double frame_px, double frames);

/// The effect's stage: "scene", "optics" or "sensor".
std::string stage_of(std::string_view effect);

}  // namespace atomcam
