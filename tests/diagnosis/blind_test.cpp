// Sealed stacks: what is drawn for them.
#include "diagnosis/blind.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <set>

#include "calibration/notes.hpp"

namespace atomcam {
namespace {

TEST(Blind, EffectsOfOneCameraAreOnIt) {
  for (const char* name : {"serial_cic", "frame_transfer_smear"}) {
    ASSERT_FALSE(find_effect(name)->qcmos) << name;
    BlindOptions options;
    options.effects = {name};
    options.none_share = options.pair_share = 0;
    for (std::uint64_t number = 0; number < 8; ++number) {
      const BlindStack stack = make_blind_stack(options, number);
      ASSERT_EQ(stack.effects.size(), 1u) << name << ", stack " << number;
      EXPECT_EQ(stack.effects.front().name, name);
      EXPECT_EQ(stack.lab.kind(), CameraKind::emccd);
    }
  }
}

TEST(Blind, SharesAreThoseAskedFor) {
  BlindOptions options;
  options.none_share = 0.3;
  options.pair_share = 0.4;
  int none = 0, pairs = 0;
  constexpr int stacks = 400;
  for (std::uint64_t number = 0; number < stacks; ++number) {
    const std::size_t count = make_blind_stack(options, number).effects.size();
    none += count == 0;
    pairs += count == 2;
  }
  // Five standard deviations.
  EXPECT_NEAR(none, 0.3 * stacks, 5 * std::sqrt(stacks * 0.3 * 0.7));
  EXPECT_NEAR(pairs, 0.4 * stacks, 5 * std::sqrt(stacks * 0.4 * 0.6));
}

TEST(Blind, LabsOfAllKindsDifferInWhatTheirNotesTell) {
  BlindOptions options;
  options.none_share = 1;
  std::set<double> exposures, gains, wavelengths;
  for (const bool any : {false, true}) {
    options.any_lab = any;
    exposures = gains = wavelengths = {};
    for (std::uint64_t number = 0; number < 40; ++number) {
      const BlindStack stack = make_blind_stack(options, number);
      const Notes notes = parse_notes(stack.notes, "blind");
      exposures.insert(notes.exposure_s);
      gains.insert(notes.em_gain);
      wavelengths.insert(notes.wavelength_um);
      EXPECT_EQ(stack.lab.settings.exposure_s, notes.exposure_s);
      EXPECT_NEAR(stack.lab.settings.em_gain / notes.em_gain, 1, 0.2);
      EXPECT_NEAR(stack.lab.settings.bias_counts, notes.bias_counts, 3);
      EXPECT_NEAR(stack.lab.scene.filling, notes.filling, 0.13);
    }
    EXPECT_EQ(exposures.size(), any ? 40u : 1u);
    EXPECT_EQ(gains.size(), any ? 6u : 2u);  // that of a qCMOS is 1
    EXPECT_EQ(wavelengths.size(), any ? 3u : 1u);
  }
}

}  // namespace
}  // namespace atomcam
