// Laws of bits: an effect of no strength is not there, an effect leaves the draws of all others as they were,
// and the number of threads does not matter.

#include <gtest/gtest.h>

#include <map>
#include <memory>

#include "laws/stacks.hpp"

namespace atomcam::laws {
namespace {

/// Every effect that this camera has, at the declared strength.
Lab with_all_effects(CameraKind kind) {
  Lab lab = law_lab(kind);
  for (const auto& [effect, camera] : cases())
    if (camera == kind)
      lab.effects[effect->name] = declared_values(*effect, effect->parameters.front().default_value);
  return lab;
}

class EveryEffectsBits : public testing::TestWithParam<Case> {};
INSTANTIATE_TEST_SUITE_P(Catalogue, EveryEffectsBits, testing::ValuesIn(cases()),
                         [](const auto& one) { return case_name(one.param); });

/// Of the camera with all effects: what is dear to make is taken from it.
const Simulation& kept(CameraKind kind) {
  static std::map<CameraKind, std::unique_ptr<Simulation>> all;
  auto& one = all[kind];
  if (!one) one = std::make_unique<Simulation>(with_all_effects(kind));
  return *one;
}

void expect_same(const Lab& a, const Lab& b, const std::string& what) {
  const Simulation one(a, kept(a.kind())), other(b, kept(b.kind()));
  for (const std::uint64_t frame : {7u, 1001u}) {
    const Frame first = one.render(frame), second = other.render(frame);
    EXPECT_TRUE(first.counts == second.counts) << what << ", frame " << frame;
    for (std::size_t site = 0; site < first.truth.atoms.size(); ++site)
      EXPECT_EQ(first.truth.atoms[site].electrons_detected, second.truth.atoms[site].electrons_detected)
          << what << ", frame " << frame << ", site " << site;
  }
}

TEST_P(EveryEffectsBits, OfZeroStrengthChangesNothing) {
  const auto& [effect, kind] = GetParam();
  const Lab plain = law_lab(kind);
  Lab with = plain;
  with.effects[effect->name] = declared_values(*effect, 0);
  expect_same(plain, with, effect->name);
}

TEST_P(EveryEffectsBits, LeavesAllOtherDrawsAsTheyWere) {
  // So weak that it draws and acts without a trace among all others: had it touched another's draw, it would
  // show.
  const auto& [effect, kind] = GetParam();
  Lab without = with_all_effects(kind);
  without.effects.erase(effect->name);
  Lab with = without;
  with.effects[effect->name] = declared_values(*effect, 1e-12);
  expect_same(without, with, effect->name);
}

TEST(AllEffects, GiveTheSameBitsOnAnyNumberOfThreads) {
  for (const CameraKind kind : {CameraKind::emccd, CameraKind::qcmos}) {
    const Lab lab = with_all_effects(kind);
    const Simulation simulation(lab);
    CameraSettings part = lab.settings;
    part.region = {8, 16, 64, 48};
    part.binning_x = part.binning_y = 2;
    for (const CameraSettings& settings : {lab.settings, part}) {
      const Frame one = simulation.render(5, settings, 1);
      EXPECT_FALSE(one.counts == Simulation(law_lab(kind)).render(5, settings, 1).counts);
      for (const int threads : {2, 3, 8}) {
        const Frame many = simulation.render(5, settings, threads);
        EXPECT_TRUE(one.counts == many.counts) << threads;
        EXPECT_EQ(one.truth.to_json(), many.truth.to_json()) << threads;
      }
    }
  }
}

}  // namespace
}  // namespace atomcam::laws
