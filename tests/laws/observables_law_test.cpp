// Every effect of the catalogue, on every camera that it declares, moves what it claims to move and nothing
// else first. Frames: 80 pairs each with atoms, with empty traps and in the dark.

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <memory>
#include <set>

#include "base/observable.hpp"
#include "laws/measures.hpp"

namespace atomcam::laws {
namespace {

using Moves = std::map<std::string, double, std::less<>>;
constexpr double seen = 5;  // standard errors

/// The camera without effects.
struct Reference {
  explicit Reference(CameraKind kind)
      : simulation(law_lab(kind)), statistics(measure(render_stacks(simulation.lab(), &simulation))) {}
  Simulation simulation;
  std::vector<Statistic> statistics;
};

const Reference& reference(CameraKind kind) {
  static std::map<CameraKind, std::unique_ptr<Reference>> kept;
  auto& one = kept[kind];
  if (!one) one = std::make_unique<Reference>(kind);
  return *one;
}

Moves moves(const Lab& lab) {
  const Reference& plain = reference(lab.kind());
  return compare(plain.statistics, measure(render_stacks(lab, &plain.simulation)));
}

/// The effect's other parameters as declared. Atoms and noise of their own: the two stacks are independent.
Moves moves(CameraKind kind, const EffectDeclaration& effect, double strength) {
  Lab lab = law_lab(kind);
  lab.seed += 1;
  lab.effects[effect.name] = declared_values(effect, strength);
  return moves(lab);
}

double largest(const Moves& moves, const std::vector<std::string>& claimed) {
  double value = 0;
  for (const std::string& name : claimed)
    if (const auto it = moves.find(name); it != moves.end()) value = std::max(value, it->second);
  return value;
}

/// What is wrong with a declaration, in words. At a strength at which what it claims moves by little more
/// than can be seen, nothing else may move; and each observable that it claims must move at some strength.
std::vector<std::string> complaints(CameraKind kind, const EffectDeclaration& effect,
                                    const std::vector<std::string>& claimed) {
  const ParameterDeclaration& parameter = effect.parameters.front();
  const double maximum = parameter.maximum;
  std::set<std::string> still(claimed.begin(), claimed.end());
  const auto try_strength = [&](double strength) {
    Moves here = moves(kind, effect, strength);
    std::erase_if(still, [&](const std::string& name) { return here.contains(name) && here[name] > seen; });
    return here;
  };
  double below = 0, strength = parameter.default_value, weakest = 0;
  Moves at_weakest;
  for (;;) {
    const Moves here = try_strength(strength);
    const double most = largest(here, claimed);
    if (most > seen) {
      weakest = strength;
      at_weakest = here;
      if (most < 2 * seen || weakest <= 2 * below) break;
      const double too_much = most / seen;
      strength = below > 0       ? std::sqrt(below * strength)
                 : too_much > 50 ? strength / 16
                 : too_much > 5  ? strength / 4
                                 : strength / 2;
    } else {
      if (weakest == 0 && strength >= maximum) break;
      below = strength;
      if (weakest > 0 && weakest <= 2 * below) break;
      strength = weakest > 0 ? std::sqrt(below * weakest) : std::min((most < 2 ? 4 : 2) * strength, maximum);
    }
  }
  std::vector<std::string> result;
  if (weakest == 0) result.push_back("moves nothing that it claims");
  for (const auto& [name, value] : at_weakest)
    if (value > seen && std::find(claimed.begin(), claimed.end(), name) == claimed.end())
      result.push_back(fmt::format(
          "moves {} by {:.1f} standard errors at {} = {:.3g}, which it does not claim; what it claims "
          "moves by {:.1f}",
          name, value, parameter.key, weakest, largest(at_weakest, claimed)));
  for (strength = weakest; !still.empty() && weakest > 0 && strength < maximum;) {
    strength = std::min(2 * strength, maximum);
    try_strength(strength);
  }
  for (const std::string& name : still)
    result.push_back(fmt::format("claims {}, which it does not move", name));
  if (std::getenv("ATOMCAM_VERBOSE")) {
    fmt::print("{} {} = {:.3g}:", effect.name, parameter.key, weakest);
    for (const auto& [name, value] : at_weakest)
      if (value > 3) fmt::print(" {} {:.1f}", name, value);
    fmt::print("{}{:.3g}\n", strength > weakest ? "; all it claims by " : "; at most ", strength);
  }
  return result;
}

class EveryEffect : public testing::TestWithParam<Case> {};
INSTANTIATE_TEST_SUITE_P(Catalogue, EveryEffect, testing::ValuesIn(cases()),
                         [](const auto& one) { return case_name(one.param); });

TEST_P(EveryEffect, MovesWhatItClaims) {
  const auto& [effect, kind] = GetParam();
  for (const std::string& complaint : complaints(kind, *effect, effect->observables))
    ADD_FAILURE() << effect->name << " " << complaint;
}

TEST(Rig, MeasuresEveryObservable) {
  std::set<std::string_view> measured;
  for (const Statistic& statistic : reference(CameraKind::emccd).statistics)
    measured.insert(statistic.observable);
  EXPECT_EQ(measured, std::set<std::string_view>(observables.begin(), observables.end()));
}

TEST(Rig, SeesNothingInAnotherSeed) {
  for (const CameraKind kind : {CameraKind::emccd, CameraKind::qcmos}) {
    Lab lab = law_lab(kind);
    lab.seed += 2;
    for (const auto& [name, value] : moves(lab)) EXPECT_LT(value, seen) << name;
  }
}

TEST(Rig, ObjectsToAWrongDeclaration) {
  const EffectDeclaration& effect = *find_effect("row_noise");
  const auto text = [&](const std::vector<std::string>& claimed) {
    std::string all;
    for (const std::string& complaint : complaints(CameraKind::emccd, effect, claimed))
      all += complaint + "\n";
    return all;
  };
  // Something else than what it moves; too little; too much.
  EXPECT_NE(text({"point_spread_width"}).find("claims point_spread_width"), std::string::npos);
  EXPECT_NE(text({"horizontal_correlation"}).find("moves row_means"), std::string::npos);
  EXPECT_NE(text({"row_means", "horizontal_correlation", "lag_correlation"}).find("claims lag_correlation"),
            std::string::npos);
}

}  // namespace
}  // namespace atomcam::laws
