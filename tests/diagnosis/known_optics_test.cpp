#include "diagnosis/known_optics.hpp"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>

#include "calibration/pupil_image.hpp"
#include "effects/effect.hpp"
#include "optics/zernike.hpp"

namespace atomcam {
namespace {

// Under a tilt calibration sees hardly any of the astigmatism: what the sites' own images say holds.
TEST(KnownOptics, ZernikeTermsComeFromTheSitesAndAreHeld) {
  Calibration calibration;
  calibration.lab = preset("ixon-ultra-897");
  Model model;
  for (int term = first_fitted_zernike; term < zernike_terms; ++term) {
    Uncertain one;
    one.name = fmt::format("zernike_{}", zernike_catalogue()[term].key);
    model.open.push_back(one);
  }
  Uncertain gain;
  gain.name = "em_gain";
  model.open.push_back(gain);
  model.first_effect_parameter = static_cast<Eigen::Index>(model.open.size());
  for (Uncertain& one : effect_prior(*find_effect(field_focus_effect), 96, 300)) model.open.push_back(one);
  const std::size_t effect = static_cast<std::size_t>(model.first_effect_parameter);

  FieldFocus field;
  start_at_field_focus(model, field, calibration);
  EXPECT_TRUE(std::none_of(model.open.begin(), model.open.end(), [](auto& one) { return one.held; }))
      << "no tilt, nothing to know better";

  field.x_um = -0.03;
  field.y_um = 0.04;
  field.zernike_um[first_fitted_zernike + 1] = 0.005;
  start_at_field_focus(model, field, calibration);
  EXPECT_NEAR(model.open[effect].value(model.open[effect].centre), 0.05, 1e-9);
  EXPECT_NEAR(model.open[1].centre, 0.005, 1e-12);
  EXPECT_TRUE(model.open[0].held);
  EXPECT_TRUE(model.open[1].held);
  EXPECT_FALSE(model.open[effect - 1].held) << "em_gain";
  EXPECT_FALSE(model.open[effect].held);
}

TEST(KnownOptics, TermsAreOthersWhereOneIsClearlyNotAsCalibrated) {
  Calibration calibration;
  Model model;
  Uncertain defocus;
  defocus.name = fmt::format("zernike_{}", zernike_catalogue()[first_fitted_zernike].key);
  defocus.width = 0.01;
  model.open.push_back(defocus);
  std::array<double, zernike_terms> zernike_um = calibration.optics.zernike_um;
  EXPECT_FALSE(are_others(model, zernike_um, calibration));
  zernike_um[first_fitted_zernike] -= 0.02;
  EXPECT_FALSE(are_others(model, zernike_um, calibration));
  zernike_um[first_fitted_zernike] -= 0.02;
  EXPECT_TRUE(are_others(model, zernike_um, calibration));
}

}  // namespace
}  // namespace atomcam
