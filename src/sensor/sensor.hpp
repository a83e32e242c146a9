#pragma once
// What the two sensors share: the electrons that light left in pixels, row by row, and the steps of a
// readout. Every step works on one output row with its own random streams, keyed by the row. The plain path
// runs all steps of a row while it is in cache; with an effect that needs a whole plane, the same steps run
// plane by plane. Same bits.

#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "base/camera_settings.hpp"
#include "base/image.hpp"

namespace atomcam {

/// Photo-electrons of the atoms: sparse, sorted by row of the readout's plane (plane_shape: an EMCCD's binned
/// pixels, a qCMOS's physical ones). A column may appear more than once. Empty: no atoms.
struct PhotoElectrons {
  std::vector<std::uint32_t> row_begin;  // plane rows + 1
  std::vector<std::uint16_t> columns;    // plane columns, one entry per electron
  std::span<const std::uint16_t> row(int r) const {
    return std::span(columns).subspan(row_begin[r], row_begin[r + 1] - row_begin[r]);
  }
};

/// All light of one frame as the sensor gets it.
struct SensorLight {
  PhotoElectrons atoms;
  double background_e = 0;  // mean photo-electrons of uniform stray light per physical pixel
  std::shared_ptr<const RatioMap>
      background_ratio;  // per pixel of the plane, multiplies background_e; null: 1
};

struct EmccdDescription {
  std::string model = "iXon Ultra 897";
  Shape shape{512, 512};
  double pixel_um = 16;
  double quantum_efficiency = 0.86;
  int register_stages = 536;
  double dark_rate_e_per_s = 3e-4;  // at dark_reference_c
  double dark_reference_c = -80;
  double dark_activation_k = 1372.8;       // rate ~ exp(-dark_activation_k / T)
  double clock_induced_charge_e = 0.0018;  // events per physical pixel and frame
  double pixel_full_well_e = 180000;
  double register_full_well_e = 800000;
  int adc_bits = 16;
  std::vector<ReadoutMode> readout_modes;
  bool operator==(const EmccdDescription&) const = default;
};

struct QcmosDescription {
  std::string model = "ORCA-Quest";
  Shape shape{2304, 4096};
  double pixel_um = 4.6;
  double quantum_efficiency = 0.85;
  double full_well_e = 7000;
  int adc_bits = 16;
  double dark_rate_e_per_s = 0.006;  // mean; per-pixel gamma law
  double dark_gamma_shape = 1;
  double dark_reference_c = -35;
  double dark_doubling_c = 6.5;        // degrees per factor two
  double offset_sigma_counts = 0;      // per-pixel normal offsets
  double column_gumbel_counts = 0;     // scale of the column offsets
  double row_offset_sigma_counts = 0;  // fixed row offsets, normal
  double gain_sigma = 0;               // relative per-pixel gain
  double read_noise_log_sigma = 0.3;   // log-normal spread of the per-pixel read noise about the mode's value
  double row_noise_e = 0;              // temporal, per row and frame, normal
  double flicker_noise_e = 0;          // temporal, per pixel and frame, Gumbel scale (paper)
  double line_time_s = 3.6e-6;         // standard scan; ultra quiet from the camera's timing
  double line_time_ultra_quiet_s = 86.4e-6;
  std::vector<ReadoutMode> readout_modes;
  bool operator==(const QcmosDescription&) const = default;
};

/// A sensor with a serial number: its pixel maps are drawn once from it and persist.
class Sensor {
 public:
  virtual ~Sensor() = default;
  virtual CameraKind kind() const = 0;
  virtual Shape shape() const = 0;
  virtual double quantum_efficiency() const = 0;
  virtual double pixel_um() const = 0;
  virtual std::span<const ReadoutMode> readout_modes() const = 0;

  /// One frame's readout under settings; cheap after the first with the same settings (tables are cached,
  /// thread safe). Rows may be asked for in any order and by several threads.
  class Readout {
   public:
    virtual ~Readout() = default;
    virtual Shape plane_shape()
        const = 0;  // of the planes below: output pixels (EMCCD: binned; qCMOS: physical)
    /// Electrons before any multiplication: atoms + background + dark + clock-induced charge, clipped at the
    /// well.
    virtual void collect(int row, std::span<std::int32_t> electrons) const = 0;
    /// EMCCD: the register (gain); qCMOS and conventional amplifier: a copy. Clipped at the register's well.
    virtual void multiply(int row, std::span<const std::int32_t> electrons,
                          std::span<float> output_e) const = 0;
    /// Adds `events` serial clock-induced charges per pixel (mean), each born at a uniformly chosen stage.
    virtual void add_serial_clock_induced_charge(int row, double events, std::span<float> output_e) const = 0;
    /// To counts before rounding: bias or offset map, preamp gain, read noise and, for a qCMOS, pixel maps.
    virtual void amplify(int row, std::span<const float> output_e, std::span<float> analog_counts) const = 0;
    /// The read noise that amplify adds to each pixel of a row, in electrons.
    virtual void read_noise(int row, std::span<float> noise_e) const = 0;
    /// Rounds and clips to the converter's range; a photon-number-resolving qCMOS converts to electrons.
    virtual void digitise(int row, std::span<const float> analog_counts,
                          std::span<std::uint16_t> counts) const = 0;
    /// Steps collect to digitise in one pass over the row, as fast as this machine can; the same bits.
    virtual void read_row(int row, std::span<std::uint16_t> counts) const = 0;
    /// What follows conversion: qCMOS defect correction and digital binning (plane_shape -> output shape).
    virtual CountImage finish(CountImage converted) const = 0;
    /// Whether finish() does anything: if not, the converted rows are the frame's.
    virtual bool finishes() const = 0;
  };
  /// `light.atoms` and the sensor are used until the Readout is gone.
  virtual std::unique_ptr<Readout> begin(const CameraSettings& settings, const SensorLight& light,
                                         std::uint64_t seed, std::uint64_t frame) const = 0;
};

std::shared_ptr<const Sensor> make_emccd(EmccdDescription description, std::string serial);
std::shared_ptr<const Sensor> make_qcmos(QcmosDescription description, std::string serial);

}  // namespace atomcam
