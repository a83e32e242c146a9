// The fit of sites and optics against images that the simulation's own point-spread table makes, without
// noise: what comes back wrong is the model's error, and must be small beside the error of a stack.
#include "calibration/optics_fit.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <filesystem>

#include "calibration/kept_optics.hpp"
#include "support/temporary_folder.hpp"

namespace atomcam {
namespace {

constexpr double site_e = 145, background_e = 0.14, frames = 300, excess = 2;

OpticsDescription emccd_optics() {
  OpticsDescription optics;
  optics.pixel_um = 16;
  optics.magnification = 78.125;
  return optics;
}

/// What a stack's mean would be without noise, and the noise that it would have.
MeanImage mean_image_of(const PointSpreadFunction& table, const Lattice& lattice, Shape shape) {
  PhotonImage sites(shape);
  for (int j = 0; j < lattice.rows; ++j)
    for (int i = 0; i < lattice.columns; ++i)
      table.add_expected(sites, site_e, lattice.x(i, j), lattice.y(i, j));
  MeanImage mean;
  mean.electrons = mean.variance = mean.dark_variance = Image<double, unit::electrons>(shape);
  mean.variance_per_e = excess / frames;
  for (std::size_t n = 0; n < sites.pixels().size(); ++n) {
    const double light = static_cast<double>(sites.pixels()[n]) + background_e;
    mean.electrons.pixels()[n] = light;
    mean.dark_variance.pixels()[n] = 0.01 / frames;
    mean.variance.pixels()[n] = 0.01 / frames + mean.variance_per_e * light;
  }
  return mean;
}

MeanImage mean_image_of(const OpticsDescription& optics, const Lattice& lattice, Shape shape) {
  return mean_image_of(PointSpreadFunction(optics), lattice, shape);
}

/// The same with optics that differ from site to site.
template <class OpticsAt>
MeanImage mean_image_with(const OpticsAt& optics_at, const Lattice& lattice, Shape shape) {
  MeanImage all;
  for (int j = 0; j < lattice.rows; ++j)
    for (int i = 0; i < lattice.columns; ++i) {
      Lattice alone = lattice;
      alone.columns = alone.rows = 1;
      alone.origin_x = lattice.x(i, j);
      alone.origin_y = lattice.y(i, j);
      MeanImage one = mean_image_of(optics_at(alone.origin_x, alone.origin_y), alone, shape);
      if (i + j == 0) {
        all = std::move(one);
        continue;
      }
      for (std::size_t n = 0; n < one.electrons.pixels().size(); ++n) {
        const double light = one.electrons.pixels()[n] - background_e;
        all.electrons.pixels()[n] += light;
        all.variance.pixels()[n] += all.variance_per_e * light;
      }
    }
  return all;
}

TEST(OpticsFit, ModelErrsLessThanAStackKnows) {
  OpticsDescription optics = emccd_optics();
  optics.zernike_um = {0,       0,       0,      0.0667,  0.0196, -0.0035, 0.0143, 0.0013,
                       -0.0101, -0.0025, 0.0202, -0.0171, 0.0060, 0.0058,  0.0159};
  Lattice truth{.columns = 7,
                .rows = 7,
                .origin_x = 14.7,
                .origin_y = 15.3,
                .a_x = 10.96,
                .a_y = 0.08,
                .b_x = -0.11,
                .b_y = 10.91};
  const MeanImage mean = mean_image_of(optics, truth, {96, 96});
  Lattice start = truth;
  start.origin_x += 0.3;
  start.origin_y -= 0.2;
  const OpticsFit fit = fit_optics(mean, optics, start);
  ASSERT_TRUE(fit.converged);
  const auto in_errors = [&](double difference, int at) {
    return difference / std::sqrt(fit.covariance(at, at));
  };
  double worst = 0;
  for (int term = 3; term < zernike_terms; ++term) {
    const double off = in_errors(fit.zernike_um[term] - optics.zernike_um[term], 3 + term);
    worst = std::max(worst, std::fabs(off));
    RecordProperty("zernike_" + std::to_string(term), std::to_string(off));
    EXPECT_LT(std::fabs(off), 1) << term;
  }
  EXPECT_LT(std::fabs(fit.lattice.x(3, 3) - truth.x(3, 3)) / fit.position_error_px, 1);
  EXPECT_LT(std::fabs(fit.lattice.y(3, 3) - truth.y(3, 3)) / fit.position_error_px, 1);
  EXPECT_LT(std::fabs(fit.background_e - background_e) / fit.background_error, 1);
  double total = 0;
  for (const double e : fit.site_e) total += e / truth.sites();
  std::printf(
      "worst Zernike term %.3f, background %.3f of its error; site light %+.2e relative; chi square %.2f\n",
      worst, (fit.background_e - background_e) / fit.background_error, total / site_e - 1, fit.chi_square);
  EXPECT_LT(std::fabs(total / site_e - 1), std::sqrt(excess / (site_e * frames * truth.sites())));
}

// Two sets of even terms have the same image: what is known beforehand says which it is.
TEST(OpticsFit, TakesTheSignOfTheEvenTermsFromWhatIsKnown) {
  OpticsDescription optics = emccd_optics();
  optics.zernike_um[3] = -0.004;
  optics.zernike_um[7] = 0.01;
  optics.zernike_um[10] = -0.03;
  const Lattice lattice{.columns = 4, .rows = 4, .origin_x = 10, .origin_y = 10, .a_x = 11, .b_y = 11};
  const MeanImage mean = mean_image_of(optics, lattice, {54, 54});
  OpticsFit fit = fit_optics(mean, optics, lattice);
  EXPECT_NEAR(fit.zernike_um[10], 0.03, 0.003);
  EXPECT_GE(fit.zernike_um[3], 0);
  fit = fit_optics(mean, optics, lattice, &optics.zernike_um);
  EXPECT_NEAR(fit.zernike_um[10], -0.03, 0.003);
  auto other = optics.zernike_um;
  for (const int term : {3, 10}) other[term] = -other[term];
  take_sign_of(fit, other);
  EXPECT_NEAR(fit.zernike_um[10], 0.03, 0.003);
  EXPECT_NEAR(fit.zernike_um[7], 0.01, 0.003);
}

// Spots of 3.8 px rms, 10.5 px apart: a lattice that is too narrow gathers more light than the true one.
TEST(OpticsFit, LatticeIsFoundWhereImagesOverlap) {
  OpticsDescription optics = emccd_optics();
  optics.wavelength_um = 0.78;
  optics.numerical_aperture = 0.55;
  optics.magnification = 172;
  optics.zernike_um[3] = 0.05;
  const Lattice truth{.columns = 6,
                      .rows = 6,
                      .origin_x = 21.7,
                      .origin_y = 20.6,
                      .a_x = 10.52,
                      .a_y = 0.05,
                      .b_x = -0.05,
                      .b_y = 10.52};
  Lattice noted = truth;
  noted.origin_x = noted.origin_y = 21.2;
  noted.a_x = noted.b_y = 10.54;
  noted.a_y = noted.b_x = 0;
  const double spot_px = 0.25 * 0.78 / 0.55 * 172 / 16;
  const Lattice found = find_lattice(mean_image_of(optics, truth, {96, 96}), noted, spot_px);
  for (const int i : {0, 5})
    for (const int j : {0, 5})
      EXPECT_LT(std::hypot(found.x(i, j) - truth.x(i, j), found.y(i, j) - truth.y(i, j)), 0.5 * spot_px)
          << i << " " << j;
}

// An image in focus with astigmatism: fits that start from a defocus end at another, beside the truth (one of
// forty such images drawn by chance did).
TEST(OpticsFit, FocusWithAstigmatismIsNoDefocus) {
  OpticsDescription optics;
  optics.pixel_um = 4.6;
  optics.magnification = 30;
  optics.zernike_um[3] = 0.0010;
  optics.zernike_um[4] = -0.0107;
  optics.zernike_um[5] = 0.0019;
  optics.zernike_um[6] = -0.0049;
  optics.zernike_um[7] = -0.0015;
  optics.zernike_um[10] = 0.0136;
  const Lattice truth{.columns = 6,
                      .rows = 4,
                      .origin_x = 8.764,
                      .origin_y = 9.07,
                      .a_x = 8.959,
                      .a_y = -0.031,
                      .b_x = 0.03,
                      .b_y = 8.959};
  Lattice start = truth;
  start.origin_x -= 0.6372;
  start.origin_y -= 0.1976;
  start.a_x += 0.02;
  start.b_y += 0.02;
  const OpticsFit fit = fit_optics(mean_image_of(optics, truth, {46, 64}), optics, start);
  for (int term = 3; term < zernike_terms; ++term)
    EXPECT_NEAR(fit.zernike_um[term], optics.zernike_um[term], 0.001) << term;
}

TEST(KeptOptics, AreThoseThatWereFitted) {
  const OpticsDescription optics = emccd_optics();
  const Lattice lattice{
      .columns = 3, .rows = 2, .origin_x = 8, .origin_y = 8.2, .a_x = 9, .a_y = 0, .b_x = 0, .b_y = 9};
  const MeanImage mean = mean_image_of(optics, lattice, {26, 35});
  const TemporaryFolder folder;
  const KeptResults kept(folder.path(), "");
  const OpticsFit fit = kept_optics(&kept, mean, optics, lattice, 2);
  const std::filesystem::path file = std::filesystem::directory_iterator(folder.path())->path();
  const auto long_ago = std::filesystem::file_time_type::clock::now() - std::chrono::hours(1);
  std::filesystem::last_write_time(file, long_ago);
  const OpticsFit again = kept_optics(&kept, mean, optics, lattice, 2);
  EXPECT_GT(std::filesystem::last_write_time(file), long_ago) << "it was fitted again";
  for (const OpticsFit& one : {again, fit_optics(mean, optics, lattice)}) {
    EXPECT_EQ(one.zernike_um, fit.zernike_um);
    EXPECT_EQ(one.site_e, fit.site_e);
    EXPECT_EQ(one.covariance, fit.covariance);
    EXPECT_EQ(one.lattice.columns, fit.lattice.columns);
    EXPECT_EQ(one.lattice.rows, fit.lattice.rows);
    EXPECT_EQ(one.lattice.x(1, 2), fit.lattice.x(1, 2));
    EXPECT_EQ(one.lattice.y(2, 1), fit.lattice.y(2, 1));
    EXPECT_EQ(one.background_e, fit.background_e);
    EXPECT_EQ(one.background_error, fit.background_error);
    EXPECT_EQ(one.chi_square, fit.chi_square);
    EXPECT_EQ(one.degrees_of_freedom, fit.degrees_of_freedom);
    EXPECT_EQ(one.converged, fit.converged);
    EXPECT_EQ(one.position_error_px, fit.position_error_px);
  }
  MeanImage other = mean;
  other.electrons(3, 3) += 0.01;
  OpticsDescription wider = optics;
  wider.numerical_aperture += 0.01;
  Lattice moved = lattice;
  moved.b_y += 0.01;
  kept_optics(&kept, other, optics, lattice, 2);
  kept_optics(&kept, mean, wider, lattice, 2);
  kept_optics(&kept, mean, optics, moved, 2);
  EXPECT_EQ(4, std::distance(std::filesystem::directory_iterator(folder.path()), {}));
}

// The image wanders by half a pixel along one axis while the stack is taken: to optics alone, astigmatism.
TEST(OpticsFit, AMovingImageIsToldFromAberrations) {
  OpticsDescription optics = emccd_optics();
  optics.zernike_um[3] = 0.010;
  optics.zernike_um[4] = 0.004;
  optics.zernike_um[5] = -0.006;
  optics.zernike_um[6] = 0.008;
  optics.zernike_um[10] = -0.005;
  const Lattice lattice{
      .columns = 5, .rows = 5, .origin_x = 10.2, .origin_y = 9.7, .a_x = 9.9, .a_y = 0, .b_x = 0, .b_y = 9.9};
  ImageMotion motion;
  const PointSpreadFunction table(optics);
  constexpr int places = 40;
  for (int k = 0; k < places; ++k) {
    const double along = (k - (places - 1) / 2.0) / (places / 2.0);
    motion.x_px.push_back(0.3 * std::sin(1.7 * k));
    motion.y_px.push_back(0.9 * along);
  }
  double x_mean = 0;
  for (const double x : motion.x_px) x_mean += x / places;
  for (double& x : motion.x_px) x -= x_mean;
  MeanImage mean = mean_image_of(table, lattice, {60, 60});
  for (auto* sum : {&mean.electrons, &mean.variance}) std::ranges::fill(sum->pixels(), 0.0);
  for (int k = 0; k < places; ++k) {
    Lattice there = lattice;
    there.origin_x += motion.x_px[static_cast<std::size_t>(k)];
    there.origin_y += motion.y_px[static_cast<std::size_t>(k)];
    const MeanImage one = mean_image_of(table, there, {60, 60});
    for (std::size_t n = 0; n < one.electrons.pixels().size(); ++n) {
      mean.electrons.pixels()[n] += one.electrons.pixels()[n] / places;
      mean.variance.pixels()[n] += one.variance.pixels()[n] / places;
    }
  }
  const OpticsFit still = fit_optics(mean, optics, lattice);
  EXPECT_GT(std::fabs(still.zernike_um[5] - optics.zernike_um[5]), 0.005);
  const OpticsFit moving = fit_optics(mean, optics, lattice, nullptr, &motion);
  EXPECT_LT(moving.chi_square, 0.02 * still.chi_square);
  for (int term = 3; term < zernike_terms; ++term)
    EXPECT_NEAR(moving.zernike_um[term], optics.zernike_um[term], 0.001) << term;
}

// One focus for all sites sees no astigmatism where it turns with the defocus' sign across the field.
TEST(OpticsFit, ATiltIsToldFromCommonTerms) {
  OpticsDescription optics = emccd_optics();
  optics.zernike_um[3] = 0.002;
  optics.zernike_um[4] = -0.002;
  optics.zernike_um[5] = -0.011;
  optics.zernike_um[10] = 0.004;
  const double tilt_x = -0.036, tilt_y = 0.028, curvature = 0.006;
  const auto optics_at = [&](double x, double y) {
    OpticsDescription there = optics;
    const double u = (x - 29.5) / 30, v = (y - 29.5) / 30;
    there.zernike_um[3] += tilt_x * u + tilt_y * v + curvature * (u * u + v * v);
    return there;
  };
  const Lattice lattice{
      .columns = 5, .rows = 5, .origin_x = 10.2, .origin_y = 9.7, .a_x = 9.9, .a_y = 0, .b_x = 0, .b_y = 9.9};
  const MeanImage mean = mean_image_with(optics_at, lattice, {60, 60});
  const OpticsFit common = fit_optics(mean, optics, lattice);
  EXPECT_GT(common.zernike_um[3], 0.01);
  EXPECT_LT(std::fabs(common.zernike_um[5]), 0.006);
  const FieldFocus field = fit_field_focus(mean, optics, common);
  EXPECT_GT(field.gain, 100);
  // All even terms at once may have the other sign.
  const double sign = field.x_um < 0 ? 1 : -1;
  EXPECT_NEAR(sign * field.x_um, tilt_x, 0.001);
  EXPECT_NEAR(sign * field.y_um, tilt_y, 0.001);
  EXPECT_NEAR(sign * field.curvature_um, curvature, 0.001);
  EXPECT_NEAR(sign * field.zernike_um[3], optics.zernike_um[3], 0.001);
  EXPECT_NEAR(sign * field.zernike_um[4], optics.zernike_um[4], 0.001);
  EXPECT_NEAR(sign * field.zernike_um[5], optics.zernike_um[5], 0.001);
}

// Of a strong one common terms make aberrations of all kinds, from which no step leads back.
TEST(OpticsFit, AStrongTiltIsFoundThoughCommonTermsAreFarOff) {
  OpticsDescription optics = emccd_optics();
  optics.zernike_um[3] = 0.1;
  const double tilt_x = -0.14, tilt_y = -0.07;
  const auto optics_at = [&](double x, double y) {
    OpticsDescription there = optics;
    there.zernike_um[3] += tilt_x * (x - 29.5) / 30 + tilt_y * (y - 29.5) / 30;
    return there;
  };
  const Lattice lattice{
      .columns = 5, .rows = 5, .origin_x = 10.2, .origin_y = 9.7, .a_x = 9.9, .a_y = 0, .b_x = 0, .b_y = 9.9};
  const MeanImage mean = mean_image_with(optics_at, lattice, {60, 60});
  const OpticsFit common = fit_optics(mean, optics, lattice);
  EXPECT_GT(std::fabs(common.zernike_um[7]), 0.02);
  const FieldFocus field = fit_field_focus(mean, optics, common);
  const double sign = field.x_um < 0 ? 1 : -1;
  EXPECT_NEAR(sign * field.x_um, tilt_x, 0.001);
  EXPECT_NEAR(sign * field.y_um, tilt_y, 0.001);
  EXPECT_NEAR(sign * field.zernike_um[3], optics.zernike_um[3], 0.001);
}

}  // namespace
}  // namespace atomcam
