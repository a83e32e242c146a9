// Hamamatsu ORCA-Quest C15550-20UP (qCMOS) with the experiment of the paper (Winklmann, Tsevas, Schulz, QCE
// 2023, doi:10.1109/QCE57702.2023.00153) in front of it, magnified to suit its pixels.

#include "simulation/lab_figures.hpp"

namespace atomcam {
namespace {

constexpr std::string_view paper = "paper";
constexpr std::string_view zernike = "paper, table of fitted Zernike coefficients";
constexpr std::string_view no_tilt = "paper: not fitted or not a property of the optics";
constexpr std::string_view sheet = "secondary quotation of the data sheet";
constexpr std::string_view published = "settings published with the paper's code";

constexpr Figure figures[] = {
    {"seed", 1, "chosen"},

    {"camera.exposure_s", 0.08, paper},
    {"camera.frame_interval_s", 0.1, "chosen"},
    {"camera.offset_x_px", 0, "full sensor"},
    {"camera.offset_y_px", 0, "full sensor"},
    {"camera.width_px", 4096, "full sensor"},
    {"camera.height_px", 2304, "full sensor"},
    {"camera.binning_x", 1, "chosen"},
    {"camera.binning_y", 1, "chosen"},
    {"camera.shutter_open", 1, "chosen"},
    {"camera.bias_counts", 200, "SCExAO VAMPIRES documentation, measured on two cameras; data sheet"},
    {"camera.sensor_temperature_c", -20, "data sheet: air cooling"},
    {"camera.photon_number_resolving", 0, "chosen"},
    {"camera.defect_correction", 1, "Hamamatsu, properties of the C15550-20UP: default"},
    {"camera.pulsed_light", 0, "chosen"},

    {"atoms.scattering_rate_hz", 33900, "paper: fitted to real frames with these Zernike coefficients"},
    {"atoms.filling", 0.6, "paper: 60.7 % of the sites occupied at first (0.243 + 0.364)"},
    {"atoms.survival", 0.99,
     "chosen: a well-tuned array (published 0.95 to 0.9999); the paper's 0.40 is loss provoked on purpose"},
    {"atoms.reference_exposure_s", 0.08, paper},
    {"atoms.images_per_shot", 1, "chosen"},
    {"atoms.atom_extent_um", 0, "paper: blur by motion is described by the defocus"},
    {"atoms.dead_time_s", 0, "chosen"},
    {"atoms.grid.columns", 18, "paper: 306 sites; arranged 18 by 17 (chosen)"},
    {"atoms.grid.rows", 17, "paper: 306 sites; arranged 18 by 17 (chosen)"},
    {"atoms.grid.spacing_x_um", 2.4, "chosen: as for the iXon"},
    {"atoms.grid.spacing_y_um", 2.4, "chosen: as for the iXon"},
    {"atoms.grid.offset_x_um", -20.4, "array centred on the sensor"},
    {"atoms.grid.offset_y_um", -19.2, "array centred on the sensor"},
    {"atoms.grid.angle_x_deg", 0, "chosen"},
    {"atoms.grid.angle_y_deg", 0, "chosen"},

    {"optics.wavelength_um", 0.461, "strontium, 5s2 1S0 to 5s5p 1P1; paper's ROI radii"},
    {"optics.numerical_aperture", 0.65, paper},
    {"optics.magnification", 22.4609375,
     "chosen: a pixel sees 0.2048 um, as a binned pixel of the paper's iXon; the array covers 200 x 188 "
     "pixels"},
    {"optics.transmission", 1, "paper: not modelled apart from the scattering rate"},
    {"optics.apodisation", 0, "paper: scalar paraxial pupil"},
    {"optics.zernike.piston_um", 0, no_tilt},
    {"optics.zernike.tilt_horizontal_um", 0, no_tilt},
    {"optics.zernike.tilt_vertical_um", 0, no_tilt},
    {"optics.zernike.defocus_um", 0.07232454, zernike},
    {"optics.zernike.astigmatism_oblique_um", 0.00087644, zernike},
    {"optics.zernike.astigmatism_vertical_um", -0.01069755, zernike},
    {"optics.zernike.coma_vertical_um", 0.00280808, zernike},
    {"optics.zernike.coma_horizontal_um", 0.00723265, zernike},
    {"optics.zernike.trefoil_vertical_um", 0.00436401, zernike},
    {"optics.zernike.trefoil_oblique_um", 0.00117688, zernike},
    {"optics.zernike.spherical_um", 0.02449155, zernike},
    {"optics.zernike.secondary_astigmatism_vertical_um", -0.00427388, zernike},
    {"optics.zernike.secondary_astigmatism_oblique_um", -0.00250116, zernike},
    {"optics.zernike.quadrafoil_vertical_um", -0.00477205, zernike},
    {"optics.zernike.quadrafoil_oblique_um", -0.00054310, zernike},
    {"light.stray_light_photons_per_s", 38.08,
     "as for the iXon: the same light on the same patch of the atom plane, four of its pixels"},

    {"sensor.columns", 4096, "data sheet"},
    {"sensor.rows", 2304, "data sheet"},
    {"sensor.pixel_um", 4.6, "data sheet"},
    {"sensor.quantum_efficiency", 0.85, "Hamamatsu catalogue of the ORCA-Quest 2, at 460 nm"},
    {"sensor.adc_bits", 16, "data sheet"},
    {"sensor.dark_rate_e_per_s", 0.006,
     "secondary quotation of the data sheet, water cooling; 0.0035 measured (VAMPIRES)"},
    {"sensor.dark_reference_c", -35, "data sheet: lowest with water cooling"},
    {"sensor.full_well_e", 7000, sheet},
    {"sensor.dark_gamma_shape", 0.016, published},
    {"sensor.dark_doubling_c", 10.6, "from the data sheet's 0.006 e-/s at -35 C and 0.016 e-/s at -20 C"},
    {"sensor.offset_sigma_counts", 0.5, "dark signal non-uniformity of 0.06 e- in all (unverified)"},
    {"sensor.column_gumbel_counts", 0.187, "settings published with the paper's code: 0.02 e-"},
    {"sensor.row_offset_sigma_counts", 0.187,
     "paper: rows stand out in the mean of closed-shutter frames; taken as large as the columns "
     "(unverified)"},
    {"sensor.gain_sigma", 0.001, "photo-response non-uniformity below 0.1 % (unverified)"},
    {"sensor.read_noise_log_sigma", 0.3,
     "published ultra-quiet frames: 10, 50, 90 % of the pixels below 0.22, 0.28, 0.46 e-"},
    {"sensor.row_noise_e", 0.02, published},
    {"sensor.flicker_noise_e", 0,
     "contained in the read noise's rms; the settings published with the paper's code have 0.01 e- on top"},
    {"sensor.line_time_s", 3.6e-6, "8.2944 ms for 2304 rows (catkit2); 120 frames per second"},
    {"sensor.line_time_ultra_quiet_s", 86.4e-6, "172.8 us per pair of rows (SCExAO VAMPIRES documentation)"},
};

const ModeFigure modes[] = {
    {{Amplifier::conventional, ScanMode::standard, 0, "", 0.107, 0.43},
     "data sheet; 0.40 e- and 0.103 e-/count measured on two cameras (VAMPIRES)"},
    {{Amplifier::conventional, ScanMode::ultra_quiet, 0, "", 0.107, 0.27},
     "data sheet; 0.22 to 0.25 e- and 0.105 e-/count measured on two cameras (VAMPIRES)"},
};

Lab blank() {
  Lab lab;
  lab.sensor = QcmosDescription{};
  SiteGrid grid;
  grid.object_plane = true;
  lab.layout = grid;
  return lab;
}

}  // namespace

const Preset& orca_quest() {
  static const Preset preset = {
      "orca-quest", "The paper's experiment, ORCA-Quest", "ORCA-0001", "orca", blank, figures, modes, 0, {}};
  return preset;
}

}  // namespace atomcam
