#include "calibration/parameter_table.hpp"

#include <cmath>
#include <limits>
#include <numbers>

#include "optics/zernike.hpp"

namespace atomcam {
namespace {

constexpr double not_noted = std::numeric_limits<double>::quiet_NaN();
constexpr double degree = std::numbers::pi / 180;

class Table {
 public:
  Table(const Calibration& calibration, const Notes& notes)
      : calibration_(calibration), lab_(calibration.lab), notes_(notes) {}

  std::vector<CalibratedParameter> rows() {
    const StackModel& model = calibration_.model;
    const double gain = model.counts_per_electron;
    relative_gain_error_ = gain > 0 ? calibration_.counts_per_electron_error / gain : 0;
    if (lab_.kind() == CameraKind::emccd)
      emccd();
    else
      qcmos();
    const double background_error = calibration_.background_error > 0 || !calibration_.has_sites
                                        ? calibration_.background_error
                                        : calibration_.optics.background_error;
    fit("light.stray_light_photons_per_s x quantum_efficiency x exposure_s", "e/pixel/frame",
        notes_.stray_e_per_s * notes_.exposure_s, model.background_e,
        with_gain(background_error, model.background_e));
    split("light.stray_light_photons_per_s", "1/s", notes_.stray_e_per_s / notes_.quantum_efficiency,
          lab_.stray_light_photons_per_s);
    if (calibration_.exposures) {
      const ExposureSplit& split = *calibration_.exposures;
      fit("two exposures: clock_induced_charge_e", "e/pixel/frame", notes_.clock_induced_charge_e,
          split.offset_e, with_gain(split.offset_error, split.offset_e));
      fit("two exposures: dark_rate_e_per_s + stray light x quantum_efficiency", "e/pixel/s",
          notes_.dark_e_per_s + notes_.stray_e_per_s, split.rate_e_per_s,
          with_gain(split.rate_error_e_per_s, split.rate_e_per_s));
    }
    if (calibration_.flats) {
      const PhotonTransfer& flats = *calibration_.flats;
      fit("flats: em_gain / electrons_per_count", "counts/e", notes_.em_gain / notes_.electrons_per_count,
          flats.slope / model.excess_noise, flats.slope_error / model.excess_noise);
      if (flats.linearity_error > 0)
        fit("flats: mean deviation from a line (EMVA 1288)", "1", not_noted, flats.linearity_error, 0);
    }
    if (calibration_.has_sites) {
      atoms();
      lattice();
      zernike();
    }
    return std::move(rows_);
  }

 private:
  void fit(std::string key, std::string unit, double noted, double fitted, double error) {
    rows_.push_back(
        {std::move(key), std::move(unit), noted, fitted, std::isfinite(error) ? error : 0, false});
  }
  void spread(std::string key, std::string unit, const Spread& of) {
    fit(std::move(key), std::move(unit), not_noted, of.value(), of.error());
  }
  /// A factor of the product above: the frames do not tell it apart.
  void split(std::string key, std::string unit, double noted, double value) {
    rows_.push_back({std::move(key), std::move(unit), noted, value, 0, true});
  }
  double with_gain(double error, double value) const {
    return std::hypot(error, value * relative_gain_error_);
  }

  void emccd() {
    const auto& sensor = std::get<EmccdDescription>(lab_.sensor);
    const ReadoutMode& mode = sensor.readout_modes.front();
    const CountFit& counts = calibration_.counts;
    const bool multiplied = notes_.em_gain > 1;
    fit("camera.bias_counts", "counts", notes_.bias_counts, lab_.settings.bias_counts, counts.bias_error);
    fit("sensor.read_noise_e / electrons_per_count", "counts", notes_.read_noise_counts,
        calibration_.model.read_noise_counts, counts.read_noise_error);
    if (multiplied) {
      fit("camera.em_gain / electrons_per_count", "counts/e", notes_.em_gain / notes_.electrons_per_count,
          calibration_.model.counts_per_electron, calibration_.counts_per_electron_error);
      split("camera.em_gain", "1", notes_.em_gain, lab_.settings.em_gain);
      split("sensor.electrons_per_count", "e/count", notes_.electrons_per_count, mode.electrons_per_count);
    } else {
      electrons_per_count(mode.electrons_per_count);
    }
    const double dark = calibration_.model.dark_e;
    fit("sensor.clock_induced_charge_e + dark_rate_e_per_s x exposure_s", "e/pixel/frame",
        notes_.clock_induced_charge_e + notes_.dark_e_per_s * notes_.exposure_s, dark,
        counts.events_error.empty() ? 0 : counts.events_error.front());
    if (counts.serial_error > 0)
      fit("effects.serial_cic.events", "e", notes_.serial_cic_events, counts.law.serial_events,
          counts.serial_error);
    split("sensor.clock_induced_charge_e", "e/pixel/frame", notes_.clock_induced_charge_e,
          sensor.clock_induced_charge_e);
    split("sensor.dark_rate_e_per_s", "e/pixel/s", notes_.dark_e_per_s, sensor.dark_rate_e_per_s);
  }

  void qcmos() {
    const auto& sensor = std::get<QcmosDescription>(lab_.sensor);
    const QcmosDarkFit& maps = calibration_.dark_maps;
    fit("camera.bias_counts", "counts", notes_.bias_counts, lab_.settings.bias_counts, maps.bias_error);
    fit("sensor.read_noise_e / electrons_per_count", "counts", notes_.read_noise_counts,
        calibration_.model.read_noise_counts, maps.read_noise_error);
    electrons_per_count(sensor.readout_modes.front().electrons_per_count);
    spread("sensor.read_noise_log_sigma", "1", maps.read_noise_log_sigma);
    spread("sensor.offset_sigma_counts", "counts", maps.offset_sigma_counts);
    spread("sensor.column_gumbel_counts", "counts", maps.column_gumbel_counts);
    spread("sensor.row_offset_sigma_counts", "counts", maps.row_offset_sigma_counts);
    split("sensor.dark_rate_e_per_s", "e/pixel/s", notes_.dark_e_per_s, sensor.dark_rate_e_per_s);
  }

  void electrons_per_count(double fitted) {
    // Photon transfer needs light; without sites the note stands.
    if (calibration_.counts_per_electron_error > 0)
      fit("sensor.electrons_per_count", "e/count", notes_.electrons_per_count, fitted,
          fitted * relative_gain_error_);
    else
      split("sensor.electrons_per_count", "e/count", notes_.electrons_per_count, fitted);
  }

  void atoms() {
    const AtomFit& atoms = calibration_.atoms;
    const double collected = collected_fraction(notes_.numerical_aperture) * notes_.exposure_s;
    fit("atom light: scattering_rate_hz x transmission x quantum_efficiency x collected x exposure_s",
        "e/atom/frame",
        notes_.scattering_rate_hz * notes_.transmission * notes_.quantum_efficiency * collected, atoms.atom_e,
        with_gain(atoms.atom_error, atoms.atom_e));
    split("atoms.scattering_rate_hz", "1/s", notes_.scattering_rate_hz, lab_.scene.scattering_rate_hz);
    split("optics.transmission", "1", notes_.transmission, lab_.optics.transmission);
    split("sensor.quantum_efficiency", "1", notes_.quantum_efficiency, notes_.quantum_efficiency);
    fit("atoms.filling", "1", notes_.filling, atoms.filling, atoms.filling_error);
    fit("atoms.survival", "1", notes_.survival, atoms.survival, atoms.survival_error);
  }

  /// 1-sigma error of weights . (middle x, middle y, a x, a y, b x, b y).
  double error_of(const Eigen::Matrix<double, 6, 1>& weights) const {
    const Eigen::MatrixXd& covariance = calibration_.optics.covariance;
    if (covariance.rows() < 6) return 0;
    return std::sqrt(std::max(0.0, weights.dot(covariance.topLeftCorner(6, 6) * weights)));
  }

  void lattice() {
    const Lattice& found = calibration_.optics.lattice;
    const NotedGrid& noted = *notes_.grid;
    const double i = (found.columns - 1) / 2.0, j = (found.rows - 1) / 2.0;
    using Weights = Eigen::Matrix<double, 6, 1>;
    Weights weights;
    weights << 1, 0, -i, 0, -j, 0;
    fit("atoms.grid.offset_x_px", "px", noted.first_x_px, found.origin_x, error_of(weights));
    weights << 0, 1, 0, -i, 0, -j;
    fit("atoms.grid.offset_y_px", "px", noted.first_y_px, found.origin_y, error_of(weights));
    const auto along = [&](const char* axis, double x, double y, int first, double angle, double per_x,
                           double per_y) {
      const double length = std::hypot(x, y);
      if (length == 0) return;
      weights.setZero();
      weights(first) = x / length;
      weights(first + 1) = y / length;
      fit(std::string("atoms.grid.spacing_") + axis + "_px", "px", noted.spacing_px, length,
          error_of(weights));
      weights.setZero();
      weights(first) = per_x / (length * length * degree);
      weights(first + 1) = per_y / (length * length * degree);
      fit(std::string("atoms.grid.angle_") + axis + "_deg", "deg", noted.angle_deg, angle / degree,
          error_of(weights));
    };
    if (found.columns > 1)
      along("x", found.a_x, found.a_y, 2, std::atan2(found.a_y, found.a_x), -found.a_y, found.a_x);
    if (found.rows > 1)
      along("y", found.b_x, found.b_y, 4, std::atan2(-found.b_x, found.b_y), -found.b_y, found.b_x);
  }

  void zernike() {
    const OpticsFit& optics = calibration_.optics;
    for (int term = 3; term < zernike_terms; ++term) {
      const Eigen::Index at = 6 + term - 3;
      const double error =
          at < optics.covariance.rows() ? std::sqrt(std::max(0.0, optics.covariance(at, at))) : 0;
      fit("optics.zernike." + std::string(zernike_catalogue()[static_cast<std::size_t>(term)].key) + "_um",
          "um", not_noted, optics.zernike_um[static_cast<std::size_t>(term)], error);
    }
  }

  const Calibration& calibration_;
  const Lab& lab_;
  const Notes& notes_;
  double relative_gain_error_ = 0;
  std::vector<CalibratedParameter> rows_;
};

}  // namespace

std::vector<CalibratedParameter> parameter_table(const Calibration& calibration, const Notes& notes) {
  return Table(calibration, notes).rows();
}

}  // namespace atomcam
