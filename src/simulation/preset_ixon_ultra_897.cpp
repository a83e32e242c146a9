// Andor iXon Ultra 897 (EMCCD, CCD97) with the experiment of the paper (Winklmann, Tsevas, Schulz, QCE 2023,
// doi:10.1109/QCE57702.2023.00153) in front of it.

#include "simulation/lab_figures.hpp"

namespace atomcam {
namespace {

constexpr std::string_view paper = "paper";
constexpr std::string_view zernike = "paper, table of fitted Zernike coefficients";
constexpr std::string_view no_tilt = "paper: not fitted or not a property of the optics";

constexpr Figure figures[] = {
    {"seed", 1, "chosen"},

    {"camera.exposure_s", 0.08, paper},
    {"camera.frame_interval_s", 0.14, "chosen: reading 256 x 256 binned pixels at 1 MHz takes 0.133 s"},
    {"camera.offset_x_px", 0, "full sensor"},
    {"camera.offset_y_px", 0, "full sensor"},
    {"camera.width_px", 512, "full sensor"},
    {"camera.height_px", 512, "full sensor"},
    {"camera.binning_x", 2, "settings published with the paper's code"},
    {"camera.binning_y", 2, "settings published with the paper's code"},
    {"camera.shutter_open", 1, "chosen"},
    {"camera.bias_counts", 200, "iXon Ultra hardware guide: baseline clamp"},
    {"camera.sensor_temperature_c", -80, "chosen; the brochure gives -95 to -100 C as the lowest"},
    {"camera.em_gain", 300, paper},
    {"camera.vertical_shift_s", 0.5e-6, "one of the camera's speeds (unverified)"},
    {"camera.frame_transfer", 1, "chosen: the next exposure runs during the readout"},

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
    {"atoms.grid.spacing_x_um", 2.4, "chosen: fits the field; not published"},
    {"atoms.grid.spacing_y_um", 2.4, "chosen: fits the field; not published"},
    {"atoms.grid.offset_x_um", -20.4, "array centred on the sensor"},
    {"atoms.grid.offset_y_um", -19.2, "array centred on the sensor"},
    {"atoms.grid.angle_x_deg", 0, "chosen"},
    {"atoms.grid.angle_y_deg", 0, "chosen"},

    {"optics.wavelength_um", 0.461, "strontium, 5s2 1S0 to 5s5p 1P1; paper's ROI radii"},
    {"optics.numerical_aperture", 0.65, paper},
    {"optics.magnification", 156.25,
     "paper; with 2x2 binning a pixel sees 0.2048 um, an Airy radius 2.12 pixels"},
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
    {"light.stray_light_photons_per_s", 9.52,
     "paper: 2.62 charges per binned pixel in 0.08 s, 0.655 e- per pixel, over the quantum efficiency"},

    {"sensor.columns", 512, "iXon Ultra 897 brochure"},
    {"sensor.rows", 512, "iXon Ultra 897 brochure"},
    {"sensor.pixel_um", 16, "iXon Ultra 897 brochure"},
    {"sensor.quantum_efficiency", 0.86, "paper, at 461 nm"},
    {"sensor.adc_bits", 16, "iXon Ultra 897 brochure"},
    {"sensor.dark_rate_e_per_s", 3e-4,
     "secondary quotation of the data sheet, -80 C; 2.5e-4 in another, 2.9e-4 in the paper's published "
     "settings"},
    {"sensor.dark_reference_c", -80, "belongs to the dark current"},
    {"sensor.register_stages", 536,
     "CCD97; Hirsch et al., PLoS ONE 8, e53671 (2013); settings published with the paper's code"},
    {"sensor.dark_activation_k", 1372.8,
     "fit 0.305 exp(-1372.8 K / T) e-/s to the catalogue's dark current, -80 to -100 C"},
    {"sensor.clock_induced_charge_e", 0.00037,
     "settings published with the paper's code; with serial_cic it gives the data sheet's 0.0018 events"},
    {"sensor.pixel_full_well_e", 180000, "secondary quotation of the data sheet"},
    {"sensor.register_full_well_e", 800000, "secondary quotation of the data sheet"},
};

constexpr std::string_view preamp_table = "published dynamic-range calculator quoting Andor's tables";
constexpr std::string_view same_preamp =
    "noise: published dynamic-range calculator quoting Andor's tables; e-/count taken over from 17 MHz "
    "(unverified)";
constexpr std::string_view scaled =
    "scaled with the preamp noise of an iXon Ultra 888's performance sheet (unverified)";
constexpr std::string_view guessed = "interpolated between the sheets of the 897 and the 888 (unverified)";

constexpr auto em = Amplifier::electron_multiplying;
constexpr auto conventional = Amplifier::conventional;

const ModeFigure modes[] = {
    {{em, ScanMode::standard, 17e6, "1x", 15, 240}, preamp_table},
    {{em, ScanMode::standard, 17e6, "2x", 7.5, 120}, preamp_table},
    {{em, ScanMode::standard, 17e6, "3x", 5, 80},
     "published dynamic-range calculator; typical 89 e- elsewhere"},
    {{em, ScanMode::standard, 10e6, "1x", 15, 130}, same_preamp},
    {{em, ScanMode::standard, 10e6, "2x", 7.5, 80}, same_preamp},
    {{em, ScanMode::standard, 10e6, "3x", 5, 60}, same_preamp},
    {{em, ScanMode::standard, 5e6, "1x", 15, 67}, same_preamp},
    {{em, ScanMode::standard, 5e6, "2x", 7.5, 44}, same_preamp},
    {{em, ScanMode::standard, 5e6, "3x", 5, 37}, same_preamp},
    {{em, ScanMode::standard, 1e6, "1x", 15, 25}, scaled},
    {{em, ScanMode::standard, 1e6, "2x", 7.5, 17}, scaled},
    {{em, ScanMode::standard, 1e6, "3x", 4.85, 15},
     "e-/count: paper; noise: secondary quotation of the data sheet; that the paper's frames were read at 1 "
     "MHz is "
     "assumed"},
    {{conventional, ScanMode::standard, 3e6, "1x", 3.8, 13}, preamp_table},
    {{conventional, ScanMode::standard, 3e6, "2x", 3.0, 11}, preamp_table},
    {{conventional, ScanMode::standard, 3e6, "3x", 1.4, 9}, preamp_table},
    {{conventional, ScanMode::standard, 1e6, "1x", 3.8, 8}, guessed},
    {{conventional, ScanMode::standard, 1e6, "2x", 3.0, 7}, guessed},
    {{conventional, ScanMode::standard, 1e6, "3x", 1.4, 6}, guessed},
    {{conventional, ScanMode::standard, 80e3, "1x", 3.8, 6}, guessed},
    {{conventional, ScanMode::standard, 80e3, "2x", 3.0, 5}, guessed},
    {{conventional, ScanMode::standard, 80e3, "3x", 1.4, 3.5}, guessed},
};

constexpr EffectFigure effects[] = {
    {"serial_cic", 0.01072,
     "settings published with the paper's code: 2e-5 for each of 536 stages; 1.07 % of the pixels of a "
     "frame"},
};

Lab blank() {
  Lab lab;
  lab.sensor = EmccdDescription{};
  SiteGrid grid;
  grid.object_plane = true;
  lab.layout = grid;
  return lab;
}

}  // namespace

const Preset& ixon_ultra_897() {
  static const Preset preset = {"ixon-ultra-897",
                                "The paper's experiment, iXon Ultra 897",
                                "IXON-0001",
                                "ixon",
                                blank,
                                figures,
                                modes,
                                11,
                                effects};
  return preset;
}

}  // namespace atomcam
