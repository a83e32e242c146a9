#include "calibration/calibrate.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <optional>

#include "base/error.hpp"
#include "calibration/count_start.hpp"
#include "calibration/input_check.hpp"
#include "calibration/kept_optics.hpp"
#include "calibration/line_pattern.hpp"
#include "calibration/parameter_table.hpp"
#include "calibration/selected_frames.hpp"
#include "calibration/single_parts.hpp"
#include "calibration/site_model.hpp"
#include "calibration/site_transfer.hpp"
#include "calibration/stack_check.hpp"
#include "effects/effect.hpp"

namespace atomcam {
namespace {

class Calibrator {
 public:
  explicit Calibrator(const CalibrationInput& input)
      : input_(input), notes_(input.notes), frames_(*input.frames, input.use) {
    check_input(input, frames_.frames(), notes_);
    notes_.shape = frames_.shape();
    if (input.darks) selected_darks_.emplace(*input.darks, input.use);
  }

  Calibration run() {
    result_.lab = lab_of_notes(notes_);
    result_.has_sites = notes_.grid.has_value();
    tell("reading frames", 0);
    const double noted_gain = notes_.em_gain / notes_.electrons_per_count;
    light_ = sum_stack_without_strikes(frames_, noted_gain);
    if (input_.darks) dark_ = sum_stack_without_strikes(used_darks(), noted_gain);
    if (!input_.like) {
      check_stack(light_, "frames");
      if (input_.darks) {
        check_stack(dark_, "darks");
        check_darks(dark_, light_);
      }
      tell_of_lost_rows();
    }
    tell("sensor", 0.2);
    fit_sensor();
    if (result_.has_sites) {
      fit_sites();
      refine_gain();
      tell("atoms", 0.8);
      fit_atom_light();
    } else {
      no_sites();
    }
    use_background();
    use_flats();
    if (input_.full) {
      if (result_.has_sites && !brightness_.empty()) add_site_brightness(result_, brightness_, atom_e_);
      if (input_.darks) result_.maps = pixel_maps(dark_, odd_pixels());
    }
    write_lab_values();
    result_.model = input_.like ? stack_figures(result_.lab) : current_model();
    result_.counts_per_electron_error =
        counts_per_electron() * std::hypot(gain_error_ / em_gain_, epc_error_ / electrons_per_count_);
    result_.parameters = parameter_table(result_, notes_);
    tell("done", 1);
    return std::move(result_);
  }

 private:
  bool emccd() const { return notes_.kind == CameraKind::emccd; }
  bool multiplied() const { return emccd() && notes_.em_gain > 1; }
  int stages() const {
    const auto* sensor = std::get_if<EmccdDescription>(&result_.lab.sensor);
    return sensor ? sensor->register_stages : 0;
  }
  double excess() const { return multiplied() ? excess_noise_factor(em_gain_, stages()) : 1; }
  double counts_per_electron() const { return em_gain_ / electrons_per_count_; }
  void tell(std::string_view step, double done) const {
    if (input_.progress) input_.progress(step, done);
  }

  const FrameSequence& used_darks() const {
    return selected_darks_->frames() >= 4 ? static_cast<const FrameSequence&>(*selected_darks_)
                                          : *input_.darks;
  }

  /// How often the dark frames have each count, or the darkest pixels of the others.
  std::vector<std::uint64_t> dark_occurrences() {
    if (!input_.darks && result_.has_sites) return darkest_pixels();
    const StackSums& sums = input_.darks ? dark_ : light_;
    const auto pattern = emccd() ? wide_line_pattern(sums) : std::nullopt;
    if (!pattern) return sums.occurrences;
    result_.warnings.push_back(
        fmt::format("{}: rows and columns stand at levels {:.3g} counts apart (1 sigma), more than the noise "
                    "of a pixel: taken off before the read noise is fitted",
                    input_.darks ? "darks" : "frames", pattern->sigma_counts));
    return occurrences_without(*pattern, input_.darks ? used_darks() : frames_);
  }

  void fit_sensor() {
    electrons_per_count_ = notes_.electrons_per_count;
    em_gain_ = notes_.em_gain;
    const std::vector<std::uint64_t> occurrences = dark_occurrences();
    const CountStart seen = count_start(occurrences, std::max(0.5, notes_.read_noise_counts));
    bias_ = seen.bias_counts;
    noise_ = seen.read_noise_counts;
    if (emccd()) {
      CountLaw start;
      start.bias_counts = bias_;
      start.read_noise_counts = noise_;
      start.electrons_per_count = electrons_per_count_;
      start.em_gain = em_gain_;
      start.serial_events = notes_.serial_cic_events;
      start.stages = stages();
      CountFitOptions options;
      options.gain = multiplied();
      options.serial = input_.full && multiplied();
      result_.counts =
          fit_dark_law(histogram_about(occurrences, seen, counts_per_electron()), start, options);
      if (!input_.like && !input_.darks) check_dark_level(result_.counts.law, notes_);
      bias_ = result_.counts.law.bias_counts;
      noise_ = result_.counts.law.read_noise_counts;
      em_gain_ = result_.counts.law.em_gain;
      dark_e_ = result_.counts.events_e[0];
      bias_error_ = result_.counts.bias_error;
      noise_error_ = result_.counts.read_noise_error;
      gain_error_ = result_.counts.em_gain_error;
      if (options.serial) {
        const CountFit& fit = result_.counts;
        if (fit.law.serial_events > 2 * fit.serial_error)
          result_.lab.effects["serial_cic"] = {
              std::min(find_effect("serial_cic")->parameters.front().maximum, fit.law.serial_events)};
        else
          result_.lab.effects.erase("serial_cic");
      }
    } else {
      result_.dark_maps = fit_qcmos_darks(input_.darks ? dark_ : light_);
      const double dark_counts = notes_.dark_e_per_s * notes_.exposure_s / electrons_per_count_;
      bias_ = result_.dark_maps.bias_counts - (input_.darks ? dark_counts : 0);
      noise_ = result_.dark_maps.read_noise_counts;
      bias_error_ = result_.dark_maps.bias_error;
      noise_error_ = result_.dark_maps.read_noise_error;
      dark_e_ = notes_.dark_e_per_s * notes_.exposure_s;
    }
  }

  /// Where something else bends the law of the dark counts beyond belief, the gain is left to the notes and
  /// to the light.
  CountFit fit_dark_law(const CountHistogram& histogram, const CountLaw& start, CountFitOptions options) {
    constexpr double believed = 2, noted_error = 0.3;
    CountFit fit = fit_counts({histogram}, true, start, options);
    const double factor = fit.law.em_gain / start.em_gain;
    if (!options.gain || (factor > 1 / believed && factor < believed)) return fit;
    result_.warnings.push_back(fmt::format(
        "dark counts have a tail as of an EM gain of {:.3g}, {:.3g} is noted: not taken for the gain",
        fit.law.em_gain, start.em_gain));
    options.gain = false;
    fit = fit_counts({histogram}, true, start, options);
    fit.em_gain_error = noted_error * start.em_gain;
    return fit;
  }

  std::vector<std::uint64_t> darkest_pixels() const {
    const std::size_t pixels = light_.sum.pixels().size();
    std::vector<double> means;
    for (std::size_t i = 0; i < pixels; ++i) means.push_back(light_.mean(i));
    std::vector<double> sorted = means;
    const auto cut = sorted.begin() + static_cast<std::ptrdiff_t>(pixels / 5);
    std::nth_element(sorted.begin(), cut, sorted.end());
    std::vector<std::uint64_t> occurrences(65536, 0);
    frames_.visit([&](std::size_t, const CountImage& frame) {
      for (std::size_t i = 0; i < pixels; ++i)
        if (means[i] <= *cut) ++occurrences[frame.pixels()[i]];
    });
    return occurrences;
  }

  double dark_level(std::size_t pixel) const {
    if (!emccd() && input_.darks) return dark_.mean(pixel);
    return bias_ + dark_e_ * counts_per_electron();
  }

  std::vector<double> dark_levels() const {
    std::vector<double> levels(light_.sum.pixels().size());
    for (std::size_t i = 0; i < levels.size(); ++i) levels[i] = dark_level(i);
    return levels;
  }

  MeanImage light_image() const {
    const double n = static_cast<double>(light_.frames), read_e = noise_ / counts_per_electron();
    double dark_variance_e2 = (excess() * dark_e_ + read_e * read_e) / n;
    if (!emccd())
      dark_variance_e2 +=
          input_.darks ? read_e * read_e / static_cast<double>(dark_.frames)
                       : std::pow(result_.dark_maps.offset_sigma_counts.value() / counts_per_electron(), 2);
    return mean_image(light_, dark_levels(), counts_per_electron(), excess(), dark_variance_e2);
  }

  void fit_sites() {
    tell("sites and optics", 0.3);
    result_.mean_image = light_image();
    const MeanImage& mean = result_.mean_image;
    const double pixel_um = notes_.pixel_um / notes_.magnification;
    const double spot =
        std::clamp(0.25 * notes_.wavelength_um / notes_.numerical_aperture / pixel_um, 0.7, 4.0);
    if (input_.like)
      result_.optics =
          fit_optics(mean, result_.lab.optics, input_.like->optics.lattice, &input_.like->optics.zernike_um);
    else
      result_.optics = kept_optics(input_.kept, mean, result_.lab.optics,
                                   find_lattice(mean, lattice_of(*notes_.grid), spot), input_.threads);
    mean_site_e_ = result_.optics.mean_site_e();
    check_site_light(mean, result_.optics);
    if (!input_.like) check_site_images(mean, result_.optics);
    for (const double e : result_.optics.site_e) result_.site_brightness.push_back(e / mean_site_e_);
    place_lattice();
  }

  void place_lattice() {
    const SiteGrid grid = grid_of(result_.optics.lattice);
    if (!input_.like) check_spacing(grid);
    result_.lab.layout = grid;
    result_.lab.optics.zernike_um = result_.optics.zernike_um;
    result_.lab.place_sites();
  }

  void check_spacing(const SiteGrid& grid) {
    constexpr double noted_to = 0.1;  // spacings are noted well
    const double noted = notes_.grid->spacing_px;
    const auto far = [&](double spacing) { return std::fabs(spacing / noted - 1) > noted_to; };
    if (far(grid.spacing_x) || far(grid.spacing_y))
      result_.warnings.push_back(
          fmt::format("sites fit best {:.4g} x {:.4g} px apart, {:.4g} is noted: are its rows, columns and "
                      "first site right, and the optics?",
                      grid.spacing_x, grid.spacing_y, noted));
  }

  // A stack model with the figures known so far.
  StackModel current_model() {
    write_lab_values();
    if (result_.has_sites && !point_spread_)
      point_spread_.emplace(result_.lab.optics, 0, result_.lab.scene.atom_extent_um);
    return stack_model(result_.lab, point_spread_ ? &*point_spread_ : nullptr);
  }

  void tell_of_lost_rows() {
    for (const auto& [sums, place] : {std::pair{&light_, "frames"}, std::pair{&dark_, "darks"}})
      if (sums->lost_rows > 0)
        result_.warnings.push_back(fmt::format(
            "{}: {} of {} rows have one value throughout, far from all others: lost on the way from the "
            "camera?",
            place, sums->lost_rows, sums->frames * static_cast<std::size_t>(sums->sum.rows())));
  }

  /// Whether the light's noise, in units of what the notes' gain gives it, cannot be that of their camera.
  /// Frames that were damaged on the way have noise that says nothing; images that differ from site to site
  /// may even leave less than none.
  bool excluded(double ratio, double error) const {
    return light_.lost_rows + dark_.lost_rows == 0 && ratio + 3 * error > 0 &&
           (ratio - 3 * error > 10 || ratio + 3 * error < 0.1);
  }

  std::string of_light(double ratio) const {
    return fmt::format("light varies {:.3g} times as much as {:.3g} counts per electron say", ratio,
                       counts_per_electron());
  }
  Error other_settings(double ratio, std::string_view or_else = "") const {
    return Error(notes_.place + ": settings",
                 fmt::format("{}: notes of another camera or other settings?{}", of_light(ratio), or_else));
  }

  /// Gain from light: the temporal variance of what the sites' least-squares fit leaves over.
  void refine_gain() {
    tell("gain", 0.6);
    background_e_ = std::max(0.0, result_.optics.background_e);
    atom_e_ = mean_site_e_ / std::max(0.05, notes_.filling);
    const StackModel model = current_model();
    SiteTransfer transfer = site_transfer(frames_, model, *point_spread_, transfer_ground());
    brightness_ = std::move(transfer.brightness_e);
    leaks_ = std::move(transfer.leaks);
    // In units of the gain so far: 1 if it was right.
    const double ratio = transfer.variance_per_e / excess(), ratio_error = transfer.error / excess();
    if (!(ratio > 0.3 && ratio < 3)) {
      if (!input_.like && excluded(ratio, ratio_error))
        throw other_settings(ratio,
                             emccd() || input_.darks
                                 ? ""
                                 : " Or darks are missing: without them the noise of a qCMOS cannot be "
                                   "told from the light's.");
      result_.warnings.push_back(of_light(ratio));
      return;
    }
    double correction = ratio;
    if (multiplied()) {
      // Together with the tail of the histogram, each by its own error.
      const double tail_error = std::max(1e-6, gain_error_ / em_gain_);
      const double a = 1 / (tail_error * tail_error), b = 1 / (ratio_error * ratio_error);
      correction = (a + b * ratio) / (a + b);
      improve_gain(correction, 1 / std::sqrt(a + b));
    } else {
      electrons_per_count_ /= ratio;
      epc_error_ = electrons_per_count_ * ratio_error;
    }
    share_error_of_background();
    for (float& e : brightness_) e = static_cast<float>(e / correction);
    mean_site_e_ /= correction;
    background_e_ /= correction;
  }

  TransferGround transfer_ground() const {
    TransferGround ground;
    const double k = counts_per_electron();
    ground.counts_per_electron = k;
    ground.background_e = background_e_;
    ground.mean_site_e = mean_site_e_;
    ground.dark_counts = dark_levels();
    const std::size_t pixels = light_.sum.pixels().size();
    const bool own_noise = !emccd() && input_.darks;  // of every pixel, from the dark frames
    if (own_noise) ground.dark_frames = dark_.frames;
    // The frames' photon transfer leaves out what whole frames have in common; so do the darks' figures.
    double drift = 0;
    if (input_.darks) {
      double due = 0;
      for (std::size_t i = 0; i < pixels; ++i) due += dark_.variance(i);
      const double all = static_cast<double>(pixels);
      drift = drift_variance(dark_.frame_mean, due / (all * all));
    }
    for (std::size_t i = 0; i < pixels; ++i) {
      const double variance = own_noise ? dark_.variance(i) : noise_ * noise_ + 1.0 / 12;
      ground.dark_variance_e2.push_back(std::max(0.0, variance - drift) / (k * k) +
                                        (emccd() ? excess() * dark_e_ : 0));
    }
    ground.odd = odd_pixels();
    return ground;
  }

  /// The background in electrons is a light over the gain, and the gain a variance over nearly the same
  /// light. Behind an EM register the variance fluctuates with the light, half of whose pixels are in both:
  /// that much cancels. Noise of the read-out is in the light only and counts twice.
  void share_error_of_background() {
    double& error = result_.optics.background_error;
    if (multiplied()) {
      error *= std::sqrt(0.5);
      return;
    }
    const double frames = static_cast<double>(light_.frames), read_e = noise_ * electrons_per_count_;
    const double read =
        read_e * read_e * (1 / frames + (input_.darks ? 1 / static_cast<double>(dark_.frames) : 0));
    const double shot = std::max(0.0, background_e_) / frames;
    error *= std::sqrt(1 + 2 * read / (read + shot + 1e-12));
  }

  /// Pixels that are much noisier or brighter in the dark than the others.
  std::vector<std::uint8_t> odd_pixels() const {
    const std::size_t pixels = light_.sum.pixels().size();
    std::vector<std::uint8_t> odd(pixels, 0);
    if (!input_.darks) return odd;
    const double variance = dark_.median_variance(), level = dark_.median_mean();
    const double step = emccd() ? 1.0 * counts_per_electron() : 8 * noise_;
    // Far outside the population's law: a limit within it would leave out what the dark frames took for noisy
    // and keep what they took for quiet, so that the dark variance of the others came out too small.
    constexpr double noisy = 10;
    for (std::size_t i = 0; i < pixels; ++i)
      odd[i] = (!emccd() && dark_.variance(i) > noisy * variance) || dark_.mean(i) > level + step;
    return odd;
  }

  void fit_atom_light() {
    // From the 90 % quantile: close to the light of an atom that stays.
    std::vector<float> sorted = brightness_;
    const auto at = sorted.begin() + static_cast<std::ptrdiff_t>(static_cast<double>(sorted.size()) * 0.9);
    std::nth_element(sorted.begin(), at, sorted.end());
    const double filling_seen =
        std::clamp(mean_site_e_ / std::max(1e-6, static_cast<double>(*at)), 0.02, 0.98);
    atom_e_ = std::max(1e-3, static_cast<double>(*at));
    const StackModel model = current_model();
    const SiteNoise noise = site_noise(model);
    BrightnessNoise expected;
    expected.empty_variance = noise.empty_variance;
    expected.empty_skewness = noise.empty_third / std::pow(noise.empty_variance, 1.5);
    expected.variance_per_e = noise.variance_per_e;
    expected.third_per_e = noise.third_per_e;
    if (leaks_.into.size() == model.sites.size()) {
      StackModel filled = model;
      filled.filling = filling_seen;
      expected.surroundings = surroundings(filled, leaks_, noise.empty_variance);
    }
    result_.atoms = fit_atoms(brightness_, expected, std::clamp(filling_seen, 0.05, 0.95),
                              std::clamp(notes_.survival, 0.3, 0.995), atom_e_,
                              input_.like ? &input_.like->atoms : nullptr);
    atom_e_ = result_.atoms.atom_e;
  }

  void no_sites() {
    // Uniform light, if any: what lies above the dark frames.
    atom_e_ = 0;
    if (!input_.darks) {
      background_e_ = emccd() ? std::max(0.0, result_.counts.events_e[0] - noted_dark_e()) : 0;
      dark_e_ = emccd() ? result_.counts.events_e[0] - background_e_ : dark_e_;
      return;
    }
    const FlatLevel level = flat_level(frames_, *input_.darks);
    if (level.variance_counts > 10 * level.variance_error && level.signal_counts > 0) take_gain_of(level);
    background_e_ = std::max(0.0, level.signal_counts / counts_per_electron());
  }

  /// Gain from even light, together with the tail of the dark frames unless the two exclude each other: what
  /// else makes charge in the dark bends the tail.
  void take_gain_of(const FlatLevel& level) {
    const double ratio = level.variance_counts / (level.signal_counts * counts_per_electron() * excess());
    const double ratio_error = ratio * level.variance_error / level.variance_counts;
    if (!input_.like && excluded(ratio, ratio_error)) throw other_settings(ratio);
    if (!multiplied()) {
      electrons_per_count_ /= ratio;
      epc_error_ = electrons_per_count_ * ratio_error / ratio;
      return;
    }
    const double tail_error = std::max(1e-6, gain_error_ / em_gain_);
    const bool agree = std::fabs(ratio - 1) < 5 * std::hypot(tail_error, ratio_error);
    const double a = agree ? 1 / (tail_error * tail_error) : 0, b = 1 / (ratio_error * ratio_error);
    improve_gain((a + b * ratio) / (a + b), 1 / std::sqrt(a + b));
  }

  /// The gain is known better than from the dark frames' histogram: their events follow as the histogram
  /// says, which has their number and not only the counts' sum.
  void improve_gain(double factor, double relative_error) {
    const double before = gain_error_ / em_gain_, by_gain = result_.counts.events_by_gain;
    em_gain_ *= factor;
    gain_error_ = em_gain_ * relative_error;
    dark_e_ *= std::pow(factor, by_gain);
    if (result_.counts.events_error.empty()) return;
    double& error = result_.counts.events_error[0];
    const double of_gain = by_gain * dark_e_;
    error = std::sqrt(std::max(
        0.0, error * error + of_gain * of_gain * (relative_error * relative_error - before * before)));
  }
  /// Of the dark events; a qCMOS has them from the notes.
  double dark_error() const {
    return result_.counts.events_error.empty() ? 0 : result_.counts.events_error[0];
  }

  /// Frames without atoms: the light in them, and with another exposure what does not grow with it.
  void use_background() {
    if (!input_.background) return;
    const StackSums sums = sum_stack(*input_.background);
    const std::vector<std::uint8_t> odd = odd_pixels();
    const double k = counts_per_electron(), n = static_cast<double>(sums.frames);
    double level = 0, variance = 0, used = 0;
    for (std::size_t i = 0; i < odd.size(); ++i) {
      if (odd[i]) continue;
      level += (sums.mean(i) - dark_level(i)) / k + dark_e_;
      variance += sums.variance(i) / n / (k * k);
      used += 1;
    }
    level /= used;
    // Means of frames scatter more than their pixels say if the light or the baseline does.
    double mean = 0, spread = 0;
    for (const double value : sums.frame_mean) mean += value / n;
    for (const double value : sums.frame_mean)
      spread += (value - mean) * (value - mean) / (n - 1) / n / (k * k);
    const double error = std::sqrt(std::max(variance / (used * used), spread) + std::pow(bias_error_ / k, 2));
    const double exposure =
        input_.background_exposure_s > 0 ? input_.background_exposure_s : notes_.exposure_s;
    if (std::fabs(exposure - notes_.exposure_s) < 1e-9) {
      background_e_ = std::max(0.0, level - dark_e_);
      result_.background_error = std::hypot(error, dark_error());
      return;
    }
    const double of_frames = dark_e_ + background_e_;
    const double frames_error =
        std::hypot(result_.has_sites ? result_.optics.background_error : 0, dark_error());
    const double apart = notes_.exposure_s - exposure;
    ExposureSplit split;
    split.rate_e_per_s = (of_frames - level) / apart;
    split.rate_error_e_per_s = std::hypot(frames_error, error) / std::fabs(apart);
    split.offset_e = (level * notes_.exposure_s - of_frames * exposure) / apart;
    split.offset_error = std::hypot(error * notes_.exposure_s, frames_error * exposure) / std::fabs(apart);
    result_.exposures = split;
    // Without darks the two exposures alone tell charge from light; with them the darks know it better.
    if (!input_.darks && emccd()) {
      dark_e_ = std::max(0.0, split.offset_e) + notes_.dark_e_per_s * notes_.exposure_s;
      background_e_ = std::max(0.0, of_frames - dark_e_);
    }
  }

  void use_flats() {
    if (input_.flats.empty()) return;
    tell("flats", 0.9);
    std::vector<FlatLevel> levels;
    for (const CalibrationInput::Flats& flats : input_.flats)
      levels.push_back(flat_level(*flats.frames, *input_.darks, flats.exposure));
    result_.flats = photon_transfer(std::move(levels));
    const double fitted = counts_per_electron() * excess(), slope = result_.flats->slope;
    const double error =
        std::hypot(result_.flats->slope_error,
                   fitted * std::hypot(gain_error_ / em_gain_, epc_error_ / electrons_per_count_));
    if (std::fabs(slope - fitted) > std::max(5 * error, 0.05 * fitted))
      result_.warnings.push_back(fmt::format(
          "flats vary by {:.3g} counts per count of signal, the frames' fit says {:.3g}: other settings?",
          slope, fitted));
  }

  double noted_dark_e() const {
    return notes_.dark_e_per_s * notes_.exposure_s + notes_.clock_induced_charge_e;
  }

  void write_lab_values() {
    Lab& lab = result_.lab;
    lab.settings.bias_counts = bias_;
    lab.settings.em_gain = em_gain_;
    const double collected = collected_fraction(lab.optics.numerical_aperture) * lab.optics.transmission *
                             notes_.quantum_efficiency * notes_.exposure_s;
    lab.scene.scattering_rate_hz = collected > 0 ? atom_e_ / collected : notes_.scattering_rate_hz;
    if (result_.atoms.atom_e > 0) {
      lab.scene.filling = result_.atoms.filling;
      lab.scene.survival = result_.atoms.survival;
    }
    lab.stray_light_photons_per_s =
        notes_.exposure_s > 0 ? background_e_ / notes_.quantum_efficiency / notes_.exposure_s : 0;
    if (auto* sensor = std::get_if<EmccdDescription>(&lab.sensor)) {
      ReadoutMode& mode = sensor->readout_modes.front();
      mode.electrons_per_count = electrons_per_count_;
      mode.read_noise_e = noise_ * electrons_per_count_;
      const double thermal = std::min(sensor->dark_rate_e_per_s * notes_.exposure_s, dark_e_);
      sensor->dark_rate_e_per_s = notes_.exposure_s > 0 ? thermal / notes_.exposure_s : 0;
      sensor->clock_induced_charge_e = std::max(0.0, dark_e_ - thermal);
      share_gain(lab);
    } else {
      auto& qcmos = std::get<QcmosDescription>(lab.sensor);
      ReadoutMode& mode = qcmos.readout_modes.front();
      mode.electrons_per_count = electrons_per_count_;
      mode.read_noise_e = noise_ * electrons_per_count_;
      qcmos.read_noise_log_sigma = result_.dark_maps.read_noise_log_sigma.value();
      qcmos.offset_sigma_counts = result_.dark_maps.offset_sigma_counts.value();
      qcmos.column_gumbel_counts = result_.dark_maps.column_gumbel_counts.value();
      qcmos.row_offset_sigma_counts = result_.dark_maps.row_offset_sigma_counts.value();
    }
  }

  const CalibrationInput& input_;
  Notes notes_;
  SelectedFrames frames_;
  std::optional<SelectedFrames> selected_darks_;
  Calibration result_;
  StackSums light_, dark_;
  std::vector<float> brightness_;
  Leakage leaks_;
  std::optional<PointSpreadFunction> point_spread_;  // once the optics are known
  double bias_ = 0, noise_ = 1, em_gain_ = 1, electrons_per_count_ = 1, dark_e_ = 0, background_e_ = 0,
         atom_e_ = 0, mean_site_e_ = 0;
  double bias_error_ = 0, noise_error_ = 0, gain_error_ = 0, epc_error_ = 0;
};

}  // namespace

Calibration calibrate(const CalibrationInput& input) {
  return Calibrator(input).run();
}

}  // namespace atomcam
