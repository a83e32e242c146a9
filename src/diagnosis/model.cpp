#include "diagnosis/model.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "base/error.hpp"
#include "simulation/parallel.hpp"

namespace atomcam {
bool Model::has(std::string_view effect) const {
  return std::find(effects.begin(), effects.end(), effect) != effects.end();
}

Model Model::unjudged() const {
  Model same;
  same.effects = effects;
  same.lab = lab;
  same.open = open;
  same.first_effect_parameter = first_effect_parameter;
  same.explains = explains;
  same.distance = distance;
  same.unlikeliness = unlikeliness;
  same.nearest = nearest;
  return same;
}

Lab Model::fitted_lab() const {
  if (estimate.size()) return lab_at(estimate);
  Eigen::VectorXd centres(static_cast<Eigen::Index>(open.size()));
  for (std::size_t k = 0; k < open.size(); ++k) centres(static_cast<Eigen::Index>(k)) = open[k].centre;
  return lab_at(centres);
}

Lab Model::lab_at(const Eigen::VectorXd& coordinates) const {
  Lab fitted = lab;
  for (std::size_t k = 0; k < open.size(); ++k)
    open[k].apply(fitted, open[k].within(coordinates(static_cast<Eigen::Index>(k))));
  fitted.place_sites();
  return fitted;
}

Standard Model::estimator(Part part) const {
  return Standard(wider.stacks() ? wider : population, part, {}, {},
                  effects.empty() ? plain_reach : effects_reach);
}

Model Model::with_first_effects(std::size_t count, const Eigen::VectorXd& coordinates) const {
  Model fewer;
  fewer.effects.assign(effects.begin(), effects.begin() + static_cast<std::ptrdiff_t>(count));
  fewer.lab = lab;
  fewer.explains = explains;
  fewer.first_effect_parameter = first_effect_parameter;
  for (std::size_t k = 0; k < open.size(); ++k) {
    Uncertain one = open[k];
    if (static_cast<Eigen::Index>(k) >= first_effect_parameter) {
      if (!one.is_of(fewer.effects)) continue;
      one.centre = one.within(coordinates(static_cast<Eigen::Index>(k)));
      one.width = 0;
    }
    fewer.open.push_back(std::move(one));
  }
  return fewer;
}

namespace {

/// How sites' images differ from each other, not what they are like: detail that all of them have hardly
/// makes any difference there.
bool compares_sites(std::string_view name) {
  constexpr std::array<std::string_view, 5> comparisons = {".spread", ".along_x", ".along_y", ".radial",
                                                           ".smooth"};
  return name.find(".point_spread.") != name.npos &&
         std::any_of(comparisons.begin(), comparisons.end(),
                     [&](std::string_view end) { return name.ends_with(end); });
}

/// Wings of the images that reach over the frame bend its mean.
bool is_bent_by_wings(std::string_view name) {
  return name == "light.static_charge.radial" || name == "light.static_offsets.radial";
}

}  // namespace

Eigen::VectorXd optical_detail(const Eigen::VectorXd& deviation, const StackPlan& plan) {
  constexpr double of_images = 1.5, between_sites = 0.5;  // at 300 frames
  const double more = std::sqrt(std::max(1.0, static_cast<double>(plan.frames.count()) / 300));
  Eigen::VectorXd detail = Eigen::VectorXd::Zero(deviation.size());
  if (plan.model.sites.empty()) return detail;
  const auto declarations = battery(plan.model, plan.dark_frames.count() > 0);
  for (Eigen::Index i = 0; i < detail.size(); ++i) {
    const StatisticDeclaration& one = declarations[static_cast<std::size_t>(i)];
    if (one.observable.starts_with("point_spread") || is_bent_by_wings(one.name))
      detail(i) = (compares_sites(one.name) ? between_sites : of_images) * more * deviation(i);
  }
  return detail;
}

Eigen::VectorXd allowed_discrepancy(const Model& plain, const BatteryValues& real, const StackPlan& plan,
                                    const std::vector<std::string>& explains) {
  constexpr double of_itself = 0.04, of_its_kind = 0.02;
  const auto declarations = battery(plan.model, plan.dark_frames.count() > 0);
  const Eigen::VectorXd& unit = plain.standard->deviation();
  const Eigen::VectorXd off = (as_vector(real.whole) - plain.standard->middle()).cwiseAbs();
  const auto deviations = [&](Eigen::Index i) {
    return unit(i) > 0 && std::isfinite(off(i)) ? off(i) / unit(i) : 0;
  };
  std::map<std::pair<std::string, bool>, double> largest;
  for (Eigen::Index i = 0; i < off.size(); ++i) {
    const StatisticDeclaration& one = declarations[static_cast<std::size_t>(i)];
    double& most = largest[{one.observable, one.darks}];
    most = std::max(most, deviations(i));
  }
  Eigen::VectorXd allowed(off.size());
  for (Eigen::Index i = 0; i < off.size(); ++i) {
    const StatisticDeclaration& one = declarations[static_cast<std::size_t>(i)];
    const bool asked =
        explains.empty() || std::find(explains.begin(), explains.end(), one.observable) != explains.end();
    allowed(i) = unit(i) * std::hypot((asked ? of_itself : 1) * deviations(i),
                                      of_its_kind * largest[{one.observable, one.darks}]);
  }
  return allowed;
}

Standard::Estimate within_draws(Standard::Estimate estimate, const std::vector<Uncertain>& open,
                                Eigen::Index first) {
  constexpr double worse = 1.5, farthest = 2;  // widths of the draws
  for (Eigen::Index k = first; k < estimate.value.size(); ++k) {
    const Uncertain& one = open[static_cast<std::size_t>(k)];
    if (estimate.error(k) > worse * one.width)
      estimate.value(k) =
          std::clamp(estimate.value(k), one.centre - farthest * one.width, one.centre + farthest * one.width);
  }
  return estimate;
}

namespace {

/// What a likelihood loses as the model is wide.
double log_width(const Standard& standard, const Correlation& correlation) {
  const Eigen::ArrayXd deviation = standard.deviation().array();
  Eigen::ArrayXd scatter = deviation;
  if (standard.discrepancy().size())
    scatter = (deviation.square() + standard.discrepancy().array().square()).sqrt();
  return 0.5 * correlation.log_determinant() + (deviation > 0).select(scatter.max(1e-12).log(), 0.0).sum();
}

}  // namespace

Eigen::MatrixXd compressed_deviations(const Standard& standard, const Eigen::MatrixXd& statistics) {
  Eigen::MatrixXd z(statistics.cols(), statistics.rows());
  for (Eigen::Index n = 0; n < statistics.rows(); ++n)
    z.col(n) = compressed(standard.tolerated(standard.judge(statistics.row(n).transpose())));
  return z;
}

Eigen::VectorXd log_likelihoods(const Model& model, const Eigen::MatrixXd& statistics) {
  const Standard& standard = *model.standard;
  return (-0.5 * model.correlation->squares(compressed_deviations(standard, statistics))).array() -
         log_width(standard, *model.correlation);
}

Eigen::VectorXd own_log_likelihoods(const Model& model) {
  const Standard& standard = *model.standard;
  const Eigen::MatrixXd& own = standard.own();
  Eigen::VectorXd all(own.rows());
  const std::vector<Correlation> without = correlations_without_each_fold(own);
  for (int fold = 0; fold < Standard::folds; ++fold) {
    const Correlation& correlation = without[static_cast<std::size_t>(fold)];
    const double width = log_width(standard, correlation);
    for (Eigen::Index n = fold; n < own.rows(); n += Standard::folds)
      all(n) = -0.5 * correlation.squares(compressed(standard.tolerated(own.row(n).transpose())))(0) - width;
  }
  return all;
}

Eigen::VectorXd Model::with_undrawn(Eigen::VectorXd discrepancy) const {
  if (undrawn.size()) discrepancy = (discrepancy.array().square() + undrawn.array().square()).sqrt();
  return discrepancy;
}

void leave_undrawn(Model& model, const Model& plain) {
  const Eigen::MatrixXd slopes = plain.standard->slopes();
  Eigen::ArrayXd square = Eigen::ArrayXd::Zero(slopes.rows());
  for (Eigen::Index k = 0; k < model.first_effect_parameter; ++k) {
    Uncertain& one = model.open[static_cast<std::size_t>(k)];
    if (!one.shared) continue;
    one.width = 0;
    square += (slopes.col(k).array() * plain.open[static_cast<std::size_t>(k)].width).square();
  }
  model.undrawn = square.sqrt();
}

Eigen::MatrixXd tolerated_own(const Model& model) {
  Eigen::MatrixXd own = model.standard->own();
  for (Eigen::Index n = 0; n < own.rows(); ++n)
    own.row(n) = model.standard->tolerated(own.row(n).transpose()).transpose();
  return own;
}

void judge(Model& model, const BatteryValues& real, int stacks, const StackPlan& plan, std::uint64_t first,
           const Model* plain, const std::function<void(int)>& progress) {
  model.population = simulate_population(model.lab, model.open, stacks, plan, first, nullptr, progress);
  const Eigen::VectorXd statistics = as_vector(real.whole);
  Eigen::VectorXd discrepancy;
  if (plain)
    discrepancy = allowed_discrepancy(*plain, real, plan, model.explains);
  else
    discrepancy = optical_detail(Standard(model.population, Part::whole).deviation(), plan);
  model.standard = std::make_unique<Standard>(model.population, Part::whole, std::vector<Eigen::Index>{},
                                              model.with_undrawn(std::move(discrepancy)),
                                              plain ? effects_reach : plain_reach);
  // The plain model's own stacks are granted the same, or frames of its kind would look better than they are.
  const Eigen::MatrixXd own = plain ? model.standard->own() : tolerated_own(model);
  model.test = std::make_unique<OmnibusTest>(
      own, model.population.unsteady, plain ? OmnibusTest::Tails::of_these : OmnibusTest::Tails::of_all_labs);
  model.z = model.standard->judge(statistics);
  if (plain) {
    model.from_plain.resize(model.population.whole.rows(), model.population.whole.cols());
    for (Eigen::Index n = 0; n < model.from_plain.rows(); ++n)
      model.from_plain.row(n) = plain->standard->judge(model.population.whole.row(n).transpose()).transpose();
  }
  const auto estimate = within_draws(model.standard->drawn_out(statistics, model.first_effect_parameter),
                                     model.open, model.first_effect_parameter);
  model.estimate = estimate.value;
  model.error = estimate.error;
  model.response = model.standard->response();
  const Eigen::VectorXd tolerated = model.standard->tolerated(model.z);
  model.p_value = model.test->p_value(tolerated);
  model.gap = gap_of(model.z);
  model.floor = Floor(model.standard->own()).at(0.5);
  model.correlation = std::make_unique<Correlation>(model.standard->own());
  model.log_likelihood = log_likelihoods(model, statistics.transpose())(0);
  const double width = log_width(*model.standard, *model.correlation);
  model.usual_log_likelihood =
      -0.5 * model.correlation->squares(compressed_rows(own).transpose()).mean() - width;
}

std::string beyond_its_law(const Model& model, Beyond by) {
  constexpr double errors = 3, least = 0.05;  // the latter: of what is allowed
  for (const std::string& name : model.effects) {
    const auto& parameters = find_effect(name)->parameters;
    for (auto p = parameters.begin() + 1; p != parameters.end(); ++p) {
      if (p->unit == "1" && p->minimum == 0 && p->maximum == 1) continue;  // a share: none beyond all
      for (Eigen::Index k = model.first_effect_parameter; k < std::ssize(model.open); ++k) {
        const Uncertain& one = model.open[static_cast<std::size_t>(k)];
        if (one.name != "effects." + name + "." + p->key || one.cycle > 0) continue;
        const double most = one.coordinate_of(p->maximum);
        const double clear = std::max(errors * model.error(k), least * (most - one.lowest));
        if (model.estimate(k) - most > (by == Beyond::clearly ? clear : 0)) return one.name;
      }
    }
  }
  return "";
}

namespace {

/// Of the same sensor as the stack of this number, other frames.
std::unique_ptr<FrameSequence> simulate_background(const Lab& lab, const RealStack& real,
                                                   const StackPlan& plan, std::uint64_t number) {
  constexpr std::uint64_t apart = 500000;  // half way to the next population's numbers
  Lab empty = lab;
  empty.scene.filling = 0;
  if (real.background_exposure_s > 0) empty.settings.exposure_s = real.background_exposure_s;
  StackPlan own = plan;
  own.frames = real.background_frames;
  return simulate_stack(empty, own, number + apart, true, number);
}

/// By how much the real stack's calibration says more than those of a few simulated ones: [parameter, stack],
/// not a number for a stack that cannot be calibrated.
Eigen::MatrixXd calibration_offsets(const Model& model, const RealStack& real, const StackPlan& plan,
                                    std::uint64_t first) {
  constexpr int stacks = 2;
  ResultKey key;
  key.add("recalibration").add(plan.seed).add(first);
  Lab lab = model.lab;
  for (const Uncertain& one : model.open) {
    one.apply(lab, one.within(one.centre));
    key.add(one.name).add(Eigen::MatrixXd::Constant(1, 1, one.centre));
  }
  if (plan.kept)
    if (auto found = plan.kept->find(key);
        found && found->size() == 1 && found->front().rows() == model.first_effect_parameter)
      return std::move(found->front());
  lab.place_sites();
  Eigen::MatrixXd offsets = Eigen::MatrixXd::Constant(model.first_effect_parameter, stacks,
                                                      std::numeric_limits<double>::quiet_NaN());
  parallel_for(stacks, plan.threads, 1, [&](int n) {
    if (plan.check_in) plan.check_in();
    const auto light = simulate_stack(lab, plan, first + static_cast<std::uint64_t>(n), true);
    const auto darks = simulate_stack(lab, plan, first + static_cast<std::uint64_t>(n), false);
    CalibrationInput input;
    input.notes = *real.notes;
    input.frames = light.get();
    if (plan.dark_frames.count() > 0) input.darks = darks.get();
    std::unique_ptr<FrameSequence> background;
    if (real.background_frames > 0) {
      background = simulate_background(lab, real, plan, first + static_cast<std::uint64_t>(n));
      input.background = background.get();
      input.background_exposure_s = real.background_exposure_s;
    }
    input.like = real.calibration;
    try {
      Calibration calibration = calibrate(input);
      if (calibration.has_sites) take_sign_of(calibration.optics, lab.optics.zernike_um);
      for (auto k = Eigen::Index{0}; k < offsets.rows(); ++k)
        offsets(k, n) = model.open[static_cast<std::size_t>(k)].offset(*real.calibration, calibration);
    } catch (const Error&) {
      // A stack that cannot be calibrated says nothing.
    }
  });
  if (plan.kept) plan.kept->keep(key, {offsets});
  return offsets;
}

/// Two stacks of one model that calibrate far apart: the one that is farther off has gone astray, and says
/// nothing.
void leave_out_the_astray(Eigen::MatrixXd& offsets, const std::vector<Uncertain>& open) {
  constexpr double far_apart = 15;  // widths
  if (offsets.cols() != 2) return;
  for (Eigen::Index k = 0; k < offsets.rows(); ++k) {
    const double width = open[static_cast<std::size_t>(k)].width;
    if (!(width > 0) || !(std::fabs(offsets(k, 0) - offsets(k, 1)) > far_apart * width)) continue;
    const Eigen::Index astray = std::fabs(offsets(k, 0)) > std::fabs(offsets(k, 1)) ? 0 : 1;
    offsets.col(astray).setConstant(std::numeric_limits<double>::quiet_NaN());
    return;
  }
}

}  // namespace

void start_at(Model& model, const std::map<std::string, double>& values) {
  for (Uncertain& one : model.open)
    if (const auto found = values.find(one.name); found != values.end())
      one.centre = std::clamp(one.coordinate_of(found->second), one.lowest, one.highest);
}

void recalibrate(Model& model, const RealStack& real, const StackPlan& plan, std::uint64_t first) {
  Eigen::MatrixXd offsets = calibration_offsets(model, real, plan, first);
  // With an effect calibrations may scatter as widely as that.
  if (model.effects.empty()) leave_out_the_astray(offsets, model.open);
  for (auto k = Eigen::Index{0}; k < model.first_effect_parameter; ++k) {
    Uncertain& one = model.open[static_cast<std::size_t>(k)];
    if (one.held) continue;
    // Optics that are drawn as widely as that would bend the statistics.
    if (const double apart = offsets(k, 0) - offsets(k, 1);
        !model.effects.empty() && !one.shared && one.width > 0 && std::isfinite(apart))
      one.calibrates_apart(apart);
    if (one.calibrates_widely()) continue;
    double sum = 0, count = 0;
    for (const double offset : offsets.row(k))
      if (std::isfinite(offset)) sum += offset, count += 1;
    if (count == 0) continue;
    double shift = sum / count;
    const double ratio = one.pull == 0 ? 0 : shift / one.pull;
    one.pull = shift;
    one.steady = ratio > 0 ? one.steady + 1 : 0;
    // Calibration may answer weakly to a parameter: steps that keep their sign are summed up at once
    // (Aitken).
    if (std::fabs(shift) > 2 * one.width && one.steady >= 2) shift /= 1 - std::min(ratio, 0.6);
    one.move_to(one.centre + shift);
  }
}

Model plain_model(const RealStack& real, int stacks, const StackPlan& plan,
                  const std::function<void(int)>& progress) {
  Model plain;
  plain.lab = real.calibration->lab;
  plain.open = calibration_uncertainty(*real.calibration);
  if (auto stages = register_uncertainty(*real.calibration)) plain.open.push_back(std::move(*stages));
  const FrameChoice& darks = plan.dark_frames.count() > 0 ? plan.dark_frames : plan.frames;
  const auto dark_pixels = static_cast<double>(darks.count() * plan.model.shape.pixels());
  for (Uncertain& one : dark_current_uncertainty(*real.calibration, dark_pixels))
    plain.open.push_back(std::move(one));
  plain.first_effect_parameter = static_cast<Eigen::Index>(plain.open.size());
  // The calibration's own bias is taken out first: simulated stacks shall calibrate as the real one did.
  recalibrate(plain, real, plan, numbers_of("plain calibration"));
  const Population about = simulate_population(plain.lab, plain.open, plain_centre_stacks, plan,
                                               numbers_of("centres"), nullptr, progress);
  const Eigen::VectorXd estimate = Standard(about, Part::whole).estimate(as_vector(real.values->whole));
  for (std::size_t k = 0; k < plain.open.size(); ++k) {
    Uncertain& one = plain.open[k];
    const double step = estimate(static_cast<Eigen::Index>(k)) - one.centre, most = 1.5 * one.width;
    one.move_to(one.centre + std::clamp(step, -most, most));
  }
  judge(plain, *real.values, stacks, plan, numbers_of("plain"), nullptr, [&progress](int done) {
    if (progress) progress(plain_centre_stacks + done);
  });
  return plain;
}

}  // namespace atomcam
