// Stacks of a known lab, calibrated: what comes back, and whether the errors are right. ATOMCAM_PULLS sets
// how many small stacks the pulls are taken over (8; 400 take some minutes).
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <map>

#include "calibration/calibrate.hpp"
#include "support/calibration_input.hpp"
#include "support/rendered.hpp"

namespace atomcam {
namespace {

Notes notes_of(bool emccd) {
  Notes notes;
  notes.place = "notes";
  notes.kind = emccd ? CameraKind::emccd : CameraKind::qcmos;
  notes.shape = {64, 64};
  notes.em_gain = emccd ? 300 : 1;
  notes.electrons_per_count = emccd ? 4.85 : 0.107;
  notes.quantum_efficiency = 0.86;
  notes.clock_induced_charge_e = emccd ? 0.005 : 0;
  notes.pixel_um = emccd ? 16 : 4.6;
  notes.magnification = emccd ? 78.125 : 30;
  notes.stray_e_per_s = 3;
  notes.scattering_rate_hz = 33900;
  notes.filling = 0.55;
  notes.survival = 0.9;
  notes.grid = NotedGrid{.rows = 4, .columns = 4, .spacing_px = 11, .first_x_px = 15, .first_y_px = 15};
  return notes;
}

constexpr std::array<double, zernike_terms> paper_zernike = {
    0,          0,          0,          0.07232454,  0.00087644,  -0.01069755, 0.00280808, 0.00723265,
    0.00436401, 0.00117688, 0.02449155, -0.00427388, -0.00250116, -0.00477205, -0.00054310};

Lab lab_of(const Notes& notes) {
  Lab lab = lab_of_notes(notes);
  lab.optics.zernike_um = paper_zernike;
  auto& grid = std::get<SiteGrid>(lab.layout);
  grid.offset_x += 0.3;
  grid.angle_x_deg = 0.3;
  if (auto* qcmos = std::get_if<QcmosDescription>(&lab.sensor)) {
    qcmos->offset_sigma_counts = 0.5;
    qcmos->column_gumbel_counts = qcmos->row_offset_sigma_counts = 0.187;
  }
  lab.place_sites();
  return lab;
}

std::map<std::string, double> truths(const Lab& lab, const Calibration& found) {
  std::map<std::string, double> out;
  const double exposure = lab.settings.exposure_s;
  double efficiency = 0, epc = 1, noise = 0;
  std::visit(
      [&](const auto& sensor) {
        efficiency = sensor.quantum_efficiency;
        epc = sensor.readout_modes[0].electrons_per_count;
        noise = sensor.readout_modes[0].read_noise_e / epc;
      },
      lab.sensor);
  for (const CalibratedParameter& one : found.parameters) {
    if (!(one.error > 0)) continue;
    if (one.key == "camera.em_gain / electrons_per_count")
      out[one.key] = lab.settings.em_gain / epc;
    else if (one.key == "sensor.read_noise_e / electrons_per_count")
      out[one.key] = noise;
    else if (one.key.starts_with("sensor.clock_induced"))
      out[one.key] = std::get<EmccdDescription>(lab.sensor).clock_induced_charge_e;
    else if (one.key == "sensor.electrons_per_count")
      out[one.key] = epc;
    else if (one.key.starts_with("light.stray"))
      out[one.key] = lab.stray_light_photons_per_s * exposure * efficiency;
    else if (one.key.starts_with("atom light"))
      out[one.key] = lab.scene.scattering_rate_hz * exposure * efficiency *
                     collected_fraction(lab.optics.numerical_aperture);
    else if (const LabParameter* known = find_lab_parameter(lab.kind(), one.key); known != nullptr)
      out[one.key] = known->get(lab);
  }
  return out;
}

// The paper's table out of as many images as the paper had, coma and trefoil with their signs.
TEST(RoundTrip, ThePapersZernikeTable) {
  const Notes notes = notes_of(true);
  const Lab lab = lab_of(notes);
  const FramesInMemory light(render(lab, 0, 2864, true)), darks(render(lab, 100000, 300, false));
  const Calibration found = calibrate(input_of(notes, light, &darks));
  for (const auto& [key, truth] : truths(lab, found))
    for (const CalibratedParameter& one : found.parameters) {
      if (one.key != key) continue;
      std::printf("%-75s truth %12.6g  found %12.6g +- %.2g  pull %+.1f\n", key.c_str(), truth, one.fitted,
                  one.error, (one.fitted - truth) / one.error);
      EXPECT_NEAR(one.fitted, truth, 5 * one.error) << key;
    }
  for (int term = 3; term < zernike_terms; ++term) {
    const double error = std::sqrt(found.optics.covariance(3 + term, 3 + term));
    EXPECT_NEAR(found.optics.zernike_um[term], paper_zernike[term], 5 * error) << term;
    EXPECT_LT(error, 0.0008) << term;  // the paper's own smallest uncertainty
  }
}

class Pulls : public testing::TestWithParam<bool> {};

TEST_P(Pulls, HaveMeanZeroAndWidthOne) {
  const char* asked = std::getenv("ATOMCAM_PULLS");
  const int stacks = asked ? std::max(4, std::atoi(asked)) : 8;
  const Notes notes = notes_of(GetParam());
  std::map<std::string, std::vector<double>> pulls;
  for (int k = 0; k < stacks; ++k) {
    Lab lab = lab_of(notes);
    lab.seed = 500 + static_cast<std::uint64_t>(k);
    lab.serial = std::to_string(k);
    const FramesInMemory light(render(lab, 0, 150, true)), darks(render(lab, 100000, 60, false));
    const Calibration found = calibrate(input_of(notes, light, &darks));
    const auto truth = truths(lab, found);
    for (const CalibratedParameter& one : found.parameters)
      if (const auto at = truth.find(one.key); at != truth.end())
        pulls[one.key].push_back((one.fitted - at->second) / one.error);
  }
  for (const auto& [key, values] : pulls) {
    const double n = static_cast<double>(values.size());
    double mean = 0, width = 0;
    for (const double pull : values) mean += pull / n;
    for (const double pull : values) width += (pull - mean) * (pull - mean) / (n - 1);
    width = std::sqrt(width);
    std::printf(
        "%-75s %4zu pulls: mean %+.3f  width %.3f%s\n", key.c_str(), values.size(), mean, width,
        std::fabs(mean) > 5 / std::sqrt(n) || std::fabs(width - 1) > 5 / std::sqrt(2 * n) ? "  *" : "");
    EXPECT_LT(std::fabs(mean), 5 / std::sqrt(n)) << key;
    EXPECT_LT(std::fabs(width - 1), 5 / std::sqrt(2 * n)) << key;
  }
}

INSTANTIATE_TEST_SUITE_P(Cameras, Pulls, testing::Bool(),
                         [](const auto& which) { return which.param ? "emccd" : "qcmos"; });

}  // namespace
}  // namespace atomcam
