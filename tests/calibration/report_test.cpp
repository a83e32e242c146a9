// The table and the page of a calibration.

#include "calibration/report.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <random>

#include "calibration/calibration_json.hpp"
#include "calibration/parameter_table.hpp"
#include "calibration/report_page.hpp"
#include "support/markup.hpp"
#include "support/small_array.hpp"

namespace atomcam {
namespace {

const CalibratedParameter& row(const std::vector<CalibratedParameter>& rows, std::string_view key) {
  for (const CalibratedParameter& one : rows)
    if (one.key == key) return one;
  ADD_FAILURE() << "no row " << key;
  return rows.front();
}

struct Calibrated {
  Notes notes = small_notes();
  FramesInMemory frames = small_frames(lab_of_notes(notes), 60, true),
                 darks = small_frames(lab_of_notes(notes), 30, false);
  CalibrationInput input{.notes = notes, .frames = &frames, .darks = &darks, .use = {}, .progress = {}};
  Calibration calibration = calibrate(input);
};

const Calibrated& calibrated() {
  static const Calibrated one;
  return one;
}

TEST(CalibrationReport, StandsAlone) {
  const Calibrated& it = calibrated();
  const std::string page = calibration_report(it.calibration, it.input, "atomcam calibrate --lab '<a&b>'");
  EXPECT_EQ(markup_fault(page), "");
  EXPECT_EQ(outside_reference(page), "");
  EXPECT_NE(page.find("&lt;a&amp;b&gt;"), std::string::npos);
}

TEST(CalibrationReport, AFaultyPageIsSeen) {
  const std::string page = report::page("title", "<p>text</p>");
  EXPECT_EQ(markup_fault(page), "");
  EXPECT_NE(markup_fault(report::page("t", "<p>text")), "");
  EXPECT_NE(markup_fault(report::page("t", "<p>a & b</p>")), "");
  EXPECT_NE(markup_fault(report::page("t", "<p>\x01</p>")), "");
  EXPECT_NE(outside_reference(report::page("t", "<img src=\"map.png\"/>")), "");
  EXPECT_NE(outside_reference(report::page("t", "<p style=\"background: url(x)\">a</p>")), "");
}

TEST(CalibrationReport, ProductsComeWithTheirSplit) {
  const Calibrated& it = calibrated();
  const auto& rows = it.calibration.parameters;
  const CalibratedParameter& product = row(rows, "camera.em_gain / electrons_per_count");
  EXPECT_FALSE(product.from_notes);
  EXPECT_GT(product.error, 0);
  const CalibratedParameter &gain = row(rows, "camera.em_gain"),
                            &per_count = row(rows, "sensor.electrons_per_count");
  EXPECT_TRUE(gain.from_notes && per_count.from_notes);
  EXPECT_DOUBLE_EQ(gain.fitted / per_count.fitted, product.fitted);
  // The frames are those of the notes: what was fitted lies within 5 of its errors.
  EXPECT_LT(std::fabs(product.pull()), 5);
  EXPECT_LT(std::fabs(row(rows, "camera.bias_counts").pull()), 5);
  EXPECT_LT(std::fabs(row(rows, "atoms.grid.spacing_x_px").pull()), 5);
  EXPECT_TRUE(std::isnan(row(rows, "optics.zernike.defocus_um").noted));
}

// Spacing, angle and first site follow from the middle and two vectors with a given covariance.
TEST(CalibrationReport, LatticeErrorsAreThoseOfTheFit) {
  Calibration calibration = calibrated().calibration;
  Lattice& lattice = calibration.optics.lattice;
  lattice.a_x = 10.2, lattice.a_y = 1.4, lattice.b_x = -0.9, lattice.b_y = 11.3;
  std::mt19937 random(5);
  std::normal_distribution<double> normal;
  Eigen::MatrixXd root(6, 6);
  for (Eigen::Index i = 0; i < root.size(); ++i) root(i) = 1e-3 * normal(random);
  calibration.optics.covariance = Eigen::MatrixXd::Zero(18, 18);
  calibration.optics.covariance.topLeftCorner(6, 6) = root * root.transpose();
  const auto rows = parameter_table(calibration, calibrated().notes);
  constexpr int draws = 20000;
  const char* keys[] = {"atoms.grid.offset_x_px", "atoms.grid.offset_y_px",  "atoms.grid.spacing_x_px",
                        "atoms.grid.angle_x_deg", "atoms.grid.spacing_y_px", "atoms.grid.angle_y_deg"};
  double sum[6] = {}, squares[6] = {};
  const double i = (lattice.columns - 1) / 2.0, j = (lattice.rows - 1) / 2.0;
  for (int n = 0; n < draws; ++n) {
    Eigen::VectorXd p(6);
    for (Eigen::Index k = 0; k < 6; ++k) p(k) = normal(random);
    p = root * p;
    const double ax = lattice.a_x + p(2), ay = lattice.a_y + p(3), bx = lattice.b_x + p(4),
                 by = lattice.b_y + p(5);
    const double degree = std::acos(-1.0) / 180;
    const double values[] = {p(0) - i * p(2) - j * p(4), p(1) - i * p(3) - j * p(5),
                             std::hypot(ax, ay),         std::atan2(ay, ax) / degree,
                             std::hypot(bx, by),         std::atan2(-bx, by) / degree};
    for (int k = 0; k < 6; ++k) sum[k] += values[k], squares[k] += values[k] * values[k];
  }
  for (int k = 0; k < 6; ++k) {
    const double mean = sum[k] / draws, sigma = std::sqrt(squares[k] / draws - mean * mean);
    // A standard deviation of n normal draws has the relative error 1 / sqrt(2 n).
    EXPECT_NEAR(row(rows, keys[k]).error / sigma, 1, 5 / std::sqrt(2.0 * draws)) << keys[k];
  }
}

TEST(CalibrationReport, JsonSaysNullWhereThereIsNothing) {
  const auto json = calibration_json(calibrated().calibration);
  for (const auto& one : json.at("parameters")) {
    if (one.at("key") == "optics.zernike.coma_vertical_um") {
      EXPECT_TRUE(one.at("noted").is_null() && one.at("pull").is_null());
    }
    if (one.at("from_notes") == true) {
      EXPECT_TRUE(one.at("error").is_null());
    }
  }
}

TEST(CalibrationReport, NumbersForReaders) {
  EXPECT_EQ(report::with_error(1.23456, 0.0123), "1.235 ± 0.012");
  EXPECT_EQ(report::with_error(-12345, 67), "−12345 ± 67");
  EXPECT_EQ(report::short_number(std::nan("")), "–");
  EXPECT_EQ(report::short_number(15123, 3), "15100");
  EXPECT_EQ(report::short_number(4.32e-60, 2), "4.3 × 10⁻⁶⁰");
  EXPECT_EQ(report::escaped("a<b>&\"\x02"), "a&lt;b&gt;&amp;&quot; ");
}

}  // namespace
}  // namespace atomcam
