// The one list of a lab's scalars. A line here is all that a scalar needs to be read, checked, written, set
// on the command line, overridden by a camera and (if live) shown as a feature.

#include <array>
#include <cctype>
#include <cmath>
#include <string>
#include <type_traits>
#include <unordered_map>
#include <utility>

#include "optics/zernike.hpp"
#include "simulation/lab.hpp"
#include "simulation/lab_figures.hpp"

namespace atomcam {
namespace {

/// "row_noise" -> "RowNoise"
std::string cap_words(std::string_view snake) {
  std::string words;
  bool start = true;
  for (const char letter : snake) {
    if (letter == '_') {
      start = true;
    } else {
      words += start ? static_cast<char>(std::toupper(static_cast<unsigned char>(letter))) : letter;
      start = false;
    }
  }
  return words;
}

class ParameterList {
 public:
  class Entry {
   public:
    explicit Entry(LabParameter& parameter) : parameter_(parameter) {}
    Entry& live(std::string feature) {
      parameter_.live = true;
      parameter_.feature = std::move(feature);
      return *this;
    }
    Entry& logarithmic() {
      parameter_.declaration.scale = ParameterScale::logarithmic;
      return *this;
    }
    /// The sites have to be placed again after a change.
    Entry& moves_sites() {
      parameter_.set = [set = parameter_.set](Lab& lab, double value) {
        set(lab, value);
        lab.place_sites();
      };
      return *this;
    }
    Entry& written_if(bool (*condition)(const Lab&)) {
      parameter_.written = condition;
      return *this;
    }

   private:
    LabParameter& parameter_;
  };

  /// `reference` is a generic lambda from a lab to the field.
  template <class Reference>
  Entry add(std::string key, std::string unit, double minimum, double maximum, std::string meaning,
            Reference reference) {
    using Field = std::remove_cvref_t<decltype(reference(std::declval<Lab&>()))>;
    Entry entry = add_accessors(
        std::move(key), std::move(unit), minimum, maximum, std::move(meaning),
        [reference](const Lab& lab) { return static_cast<double>(reference(lab)); },
        [reference](Lab& lab, double value) { reference(lab) = static_cast<Field>(value); });
    parameters.back().boolean = std::is_same_v<Field, bool>;
    parameters.back().declaration.integer = std::is_integral_v<Field>;
    return entry;
  }

  Entry add_accessors(std::string key, std::string unit, double minimum, double maximum, std::string meaning,
                      std::function<double(const Lab&)> get, std::function<void(Lab&, double)> set) {
    LabParameter parameter;
    parameter.declaration.key = std::move(key);
    parameter.declaration.unit = std::move(unit);
    parameter.declaration.minimum = minimum;
    parameter.declaration.maximum = maximum;
    parameter.declaration.meaning = std::move(meaning);
    parameter.get = std::move(get);
    parameter.set = std::move(set);
    parameters.push_back(std::move(parameter));
    return Entry(parameters.back());
  }

  std::vector<LabParameter> parameters;
};

// A grid is kept in the coordinates it was given in. Asked in the other ones it answers converted; set in the
// other ones it changes over as a whole, so that what was set is kept exactly.

bool has_grid(const Lab& lab) {
  return std::holds_alternative<SiteGrid>(lab.layout);
}
bool has_object_grid(const Lab& lab) {
  return has_grid(lab) && std::get<SiteGrid>(lab.layout).object_plane;
}
bool has_sensor_grid(const Lab& lab) {
  return has_grid(lab) && !std::get<SiteGrid>(lab.layout).object_plane;
}

SiteGrid grid_in(const Lab& lab, bool object_plane) {
  const auto* held = std::get_if<SiteGrid>(&lab.layout);
  SiteGrid grid = held ? *held : SiteGrid{};
  if (grid.object_plane == object_plane) return grid;
  const Shape shape = lab.sensor_shape();
  const double centre_x_px = (shape.columns - 1) * 0.5;
  const double centre_y_px = (shape.rows - 1) * 0.5;
  const double pixel_um = std::visit([](const auto& sensor) { return sensor.pixel_um; }, lab.sensor);
  const double pixels_per_um = lab.optics.magnification / pixel_um;
  if (object_plane) {
    grid.spacing_x /= pixels_per_um;
    grid.spacing_y /= pixels_per_um;
    grid.offset_x = (grid.offset_x - centre_x_px) / pixels_per_um;
    grid.offset_y = (grid.offset_y - centre_y_px) / pixels_per_um;
  } else {
    grid.spacing_x *= pixels_per_um;
    grid.spacing_y *= pixels_per_um;
    grid.offset_x = centre_x_px + grid.offset_x * pixels_per_um;
    grid.offset_y = centre_y_px + grid.offset_y * pixels_per_um;
  }
  grid.object_plane = object_plane;
  return grid;
}

/// Setting any of these on a lab with listed sites gives it a grid.
void add_grid_length(ParameterList& list, const std::string& name, bool object_plane, double minimum,
                     double maximum, std::string meaning, double SiteGrid::*field) {
  list.add_accessors(
          "atoms.grid." + name + (object_plane ? "_um" : "_px"), object_plane ? "um" : "px", minimum, maximum,
          std::move(meaning), [=](const Lab& lab) { return grid_in(lab, object_plane).*field; },
          [=](Lab& lab, double value) {
            SiteGrid grid = grid_in(lab, object_plane);
            grid.*field = value;
            lab.layout = grid;
          })
      .written_if(object_plane ? has_object_grid : has_sensor_grid)
      .moves_sites();
}

template <class Field>
void add_grid_field(ParameterList& list, const char* key, const char* unit, double minimum, double maximum,
                    const char* meaning, Field SiteGrid::*field) {
  list.add_accessors(
          key, unit, minimum, maximum, meaning,
          [field](const Lab& lab) {
            const auto* grid = std::get_if<SiteGrid>(&lab.layout);
            return static_cast<double>((grid ? *grid : SiteGrid{}).*field);
          },
          [field](Lab& lab, double value) {
            if (!has_grid(lab)) lab.layout = SiteGrid{};
            std::get<SiteGrid>(lab.layout).*field = static_cast<Field>(value);
          })
      .written_if(has_grid)
      .moves_sites();
  list.parameters.back().declaration.integer = std::is_integral_v<Field>;
}

void add_top(ParameterList& list) {
  // Up to 2^53 - 1: every seed is exact as a number of JSON and as a camera's feature.
  list.add(
          "seed", "1", 0, 9007199254740991.0, "all that is random follows from it and the frame's number",
          [](auto& lab) -> auto& { return lab.seed; })
      .live("SimSeed");
}

void add_camera(ParameterList& list, CameraKind kind) {
  const bool emccd = kind == CameraKind::emccd;
  list.add(
          "camera.exposure_s", "s", emccd ? 1e-6 : 7.2e-6, emccd ? 10000 : 1800, "exposure time",
          [](auto& lab) -> auto& { return lab.settings.exposure_s; })
      .logarithmic();
  list.add(
          "camera.frame_interval_s", "s", 1e-6, 20000,
          "start of a frame to start of the next, for frames rendered without a camera",
          [](auto& lab) -> auto& { return lab.settings.frame_interval_s; })
      .logarithmic();
  list.add(
      "camera.offset_x_px", "px", 0, 16383, "left edge of the region that is read",
      [](auto& lab) -> auto& { return lab.settings.region.offset_x; });
  list.add(
      "camera.offset_y_px", "px", 0, 16383, "top edge of the region that is read",
      [](auto& lab) -> auto& { return lab.settings.region.offset_y; });
  list.add(
      "camera.width_px", "px", 1, 16384, "width of the region in sensor pixels, before binning",
      [](auto& lab) -> auto& { return lab.settings.region.width; });
  list.add(
      "camera.height_px", "px", 1, 16384, "height of the region in sensor pixels, before binning",
      [](auto& lab) -> auto& { return lab.settings.region.height; });
  const char* binning = emccd ? "sensor pixels summed on the chip, before noise"
                              : "sensor pixels summed after conversion (1, 2 or 4)";
  list.add(
      "camera.binning_x", "1", 1, emccd ? 16 : 4, binning,
      [](auto& lab) -> auto& { return lab.settings.binning_x; });
  list.add(
      "camera.binning_y", "1", 1, emccd ? 16 : 4, binning,
      [](auto& lab) -> auto& { return lab.settings.binning_y; });
  list.add(
      "camera.shutter_open", "1", 0, 1, "false: no light reaches the sensor",
      [](auto& lab) -> auto& { return lab.settings.shutter_open; });
  list.add(
      "camera.bias_counts", "counts", 0, 10000, "counts of a pixel without charge",
      [](auto& lab) -> auto& { return lab.settings.bias_counts; });
  list.add(
      "camera.sensor_temperature_c", "C", emccd ? -120 : -40, 40, "sensor temperature",
      [](auto& lab) -> auto& { return lab.settings.sensor_temperature_c; });
  if (emccd) {
    list.add(
            "camera.em_gain", "1", 1, 1000, "mean gain of the multiplication register; 1 is off",
            [](auto& lab) -> auto& { return lab.settings.em_gain; })
        .logarithmic();
    list.add(
            "camera.vertical_shift_s", "s", 1e-7, 1e-4, "time to shift the image by one row",
            [](auto& lab) -> auto& { return lab.settings.vertical_shift_s; })
        .logarithmic();
    list.add(
        "camera.frame_transfer", "1", 0, 1, "true: the next exposure runs during the readout",
        [](auto& lab) -> auto& { return lab.settings.frame_transfer; });
  } else {
    list.add(
        "camera.photon_number_resolving", "1", 0, 1, "true: pixels are whole numbers of photo-electrons",
        [](auto& lab) -> auto& { return lab.settings.photon_number_resolving; });
    list.add(
        "camera.defect_correction", "1", 0, 1, "true: the camera replaces its hot pixels",
        [](auto& lab) -> auto& { return lab.settings.defect_correction; });
    list.add(
        "camera.pulsed_light", "1", 0, 1, "true: the light is on only while every row of the region exposes",
        [](auto& lab) -> auto& { return lab.settings.pulsed_light; });
  }
}

void add_atoms(ParameterList& list) {
  list.add(
          "atoms.scattering_rate_hz", "Hz", 0, 1e9,
          "photons that an atom of brightness 1 emits into all directions",
          [](auto& lab) -> auto& { return lab.scene.scattering_rate_hz; })
      .live("SimScatteringRate");
  list.add(
          "atoms.filling", "1", 0, 1, "probability that a site is filled when a shot begins",
          [](auto& lab) -> auto& { return lab.scene.filling; })
      .live("SimFilling");
  list.add(
          "atoms.survival", "1", 1e-6, 1,
          "probability that an atom survives an exposure of reference_exposure_s",
          [](auto& lab) -> auto& { return lab.scene.survival; })
      .live("SimSurvival");
  list.add(
          "atoms.reference_exposure_s", "s", 1e-6, 10000,
          "exposure that survival refers to; kept as a rate of loss",
          [](auto& lab) -> auto& { return lab.scene.reference_exposure_s; })
      .logarithmic();
  list.add(
      "atoms.images_per_shot", "1", 1, 1e6, "frames that show the same atoms; survivors carry over",
      [](auto& lab) -> auto& { return lab.scene.images_per_shot; });
  list.add(
          "atoms.atom_extent_um", "um", 0, 10, "rms extent of an atom along each axis of the atom plane",
          [](auto& lab) -> auto& { return lab.scene.atom_extent_um; })
      .live("SimAtomExtent");
  list.add(
      "atoms.dead_time_s", "s", 0, 10000, "dark time between the images of a shot",
      [](auto& lab) -> auto& { return lab.scene.dead_time_s; });
  add_grid_field(list, "atoms.grid.columns", "1", 1, 1000, "sites along x", &SiteGrid::columns);
  add_grid_field(list, "atoms.grid.rows", "1", 1, 1000, "sites along y", &SiteGrid::rows);
  for (const bool object_plane : {true, false}) {
    const char* from = object_plane ? "first site's place, from the sensor's centre in the atom plane"
                                    : "first site's place, from the centre of the top left pixel";
    add_grid_length(list, "spacing_x", object_plane, 0, 1e5, "distance of columns", &SiteGrid::spacing_x);
    add_grid_length(list, "spacing_y", object_plane, 0, 1e5, "distance of rows", &SiteGrid::spacing_y);
    add_grid_length(list, "offset_x", object_plane, -1e5, 1e5, from, &SiteGrid::offset_x);
    add_grid_length(list, "offset_y", object_plane, -1e5, 1e5, from, &SiteGrid::offset_y);
  }
  add_grid_field(list, "atoms.grid.angle_x_deg", "deg", -360, 360, "turns the rows of sites from x towards y",
                 &SiteGrid::angle_x_deg);
  add_grid_field(list, "atoms.grid.angle_y_deg", "deg", -360, 360,
                 "turns the columns of sites from y towards -x", &SiteGrid::angle_y_deg);
}

void add_optics(ParameterList& list) {
  list.add(
      "optics.wavelength_um", "um", 0.1, 5, "wavelength of the fluorescence",
      [](auto& lab) -> auto& { return lab.optics.wavelength_um; });
  list.add(
      "optics.numerical_aperture", "1", 0.01, 0.99, "of the objective",
      [](auto& lab) -> auto& { return lab.optics.numerical_aperture; });
  list.add(
          "optics.magnification", "1", 0.01, 10000, "atom plane to sensor",
          [](auto& lab) -> auto& { return lab.optics.magnification; })
      .logarithmic()
      .moves_sites();
  list.add(
          "optics.transmission", "1", 0, 1,
          "of everything between an atom and the sensor, for the light collected",
          [](auto& lab) -> auto& { return lab.optics.transmission; })
      .live("SimTransmission");
  list.add(
      "optics.apodisation", "1", 0, 1,
      "true: amplitude in the pupil after the sine condition of a high-NA objective",
      [](auto& lab) -> auto& { return lab.optics.apodisation; });
  for (std::size_t index = 0; index < zernike_terms; ++index) {
    const ZernikeTerm& term = zernike_catalogue()[index];
    std::string meaning =
        std::string(term.name) + ", rms wavefront (Noll Z" + std::to_string(term.noll) + ")";
    if (term.degree == 0) meaning += "; without effect on the image";
    if (term.degree == 1) meaning += term.frequency > 0 ? "; shifts along x" : "; shifts along y";
    list.add(
            "optics.zernike." + std::string(term.key) + "_um", "um", -2, 2,
            meaning, [index](auto& lab) -> auto& { return lab.optics.zernike_um[index]; })
        .live("SimZernike" + cap_words(term.key));
  }
  list.add(
          "light.stray_light_photons_per_s", "1/s", 0, 1e8, "stray light that reaches each sensor pixel",
          [](auto& lab) -> auto& { return lab.stray_light_photons_per_s; })
      .live("SimStrayLight");
}

template <class Description>
void add_sensor(ParameterList& list) {
  const auto field = [&list](const char* key, const char* unit, double minimum, double maximum,
                             const char* meaning, auto member) {
    return list.add(
        std::string("sensor.") + key, unit, minimum, maximum,
        meaning, [member](auto& lab) -> auto& { return std::get<Description>(lab.sensor).*member; });
  };
  list.add(
          "sensor.columns", "px", 1, 16384, "pixels along x",
          [](auto& lab) -> auto& { return std::get<Description>(lab.sensor).shape.columns; })
      .moves_sites();
  list.add(
          "sensor.rows", "px", 1, 16384, "pixels along y",
          [](auto& lab) -> auto& { return std::get<Description>(lab.sensor).shape.rows; })
      .moves_sites();
  field("pixel_um", "um", 0.5, 100, "pixel pitch", &Description::pixel_um).moves_sites();
  field("quantum_efficiency", "1", 0, 1, "photo-electrons per photon at the wavelength",
        &Description::quantum_efficiency);
  field("adc_bits", "1", 8, 16, "bits of the converter", &Description::adc_bits);
  field("dark_rate_e_per_s", "1/s", 0, 1e6, "mean dark current of a sensor pixel at dark_reference_c",
        &Description::dark_rate_e_per_s);
  field("dark_reference_c", "C", -150, 60, "temperature that dark_rate_e_per_s is given at",
        &Description::dark_reference_c);
  if constexpr (std::is_same_v<Description, EmccdDescription>) {
    field("register_stages", "1", 1, 10000, "stages of the multiplication register",
          &Description::register_stages);
    field("dark_activation_k", "K", 0, 20000,
          "dark current goes with the temperature T as exp(-dark_activation_k / T)",
          &Description::dark_activation_k);
    field("clock_induced_charge_e", "e", 0, 100, "parallel clock-induced charges per sensor pixel and frame",
          &Description::clock_induced_charge_e);
    field("pixel_full_well_e", "e", 1, 1e9, "most electrons of a pixel", &Description::pixel_full_well_e);
    field("register_full_well_e", "e", 1, 1e9, "most electrons of a stage of the register",
          &Description::register_full_well_e);
  } else {
    field("full_well_e", "e", 1, 1e9, "most electrons of a pixel", &Description::full_well_e);
    field("dark_gamma_shape", "1", 1e-3, 1e3, "shape of the gamma law that the pixels' dark currents follow",
          &Description::dark_gamma_shape)
        .logarithmic();
    field("dark_doubling_c", "C", 0.1, 100, "warming that doubles the dark current",
          &Description::dark_doubling_c);
    field("offset_sigma_counts", "counts", 0, 1000, "spread of the pixels' fixed offsets (normal)",
          &Description::offset_sigma_counts);
    field("column_gumbel_counts", "counts", 0, 1000, "scale of the columns' fixed offsets (Gumbel)",
          &Description::column_gumbel_counts);
    field("row_offset_sigma_counts", "counts", 0, 1000, "spread of the rows' fixed offsets (normal)",
          &Description::row_offset_sigma_counts);
    field("gain_sigma", "1", 0, 0.5, "relative spread of the pixels' conversion gain (normal)",
          &Description::gain_sigma);
    field("read_noise_log_sigma", "1", 0, 3, "spread of the logarithm of the pixels' read noise (normal)",
          &Description::read_noise_log_sigma);
    field("row_noise_e", "e", 0, 1000, "noise common to a row of a frame (normal)",
          &Description::row_noise_e);
    field("flicker_noise_e", "e", 0, 1000, "noise of a pixel from frame to frame (scale of a Gumbel law)",
          &Description::flicker_noise_e);
    field("line_time_s", "s", 1e-7, 1, "time per row in the standard scan", &Description::line_time_s)
        .logarithmic();
    field("line_time_ultra_quiet_s", "s", 1e-7, 1, "time per row in the ultra-quiet scan",
          &Description::line_time_ultra_quiet_s)
        .logarithmic();
  }
}

/// An effect that the lab does not mention has strength zero and otherwise its declared defaults.
ParameterValues values_of_absent(const EffectDeclaration& effect) {
  ParameterValues values;
  for (const ParameterDeclaration& parameter : effect.parameters) values.push_back(parameter.default_value);
  if (!values.empty()) values[0] = 0;
  return values;
}

void add_effects(ParameterList& list, CameraKind kind) {
  for (const EffectDeclaration& effect : effect_catalogue()) {
    if (!effect.on(kind)) continue;
    for (std::size_t i = 0; i < effect.parameters.size(); ++i) {
      const ParameterDeclaration& parameter = effect.parameters[i];
      list.add_accessors(
              "effects." + effect.name + "." + parameter.key, parameter.unit,
              i == 0 ? std::min(0.0, parameter.minimum) : parameter.minimum, parameter.maximum,
              parameter.meaning,
              [&effect, i](const Lab& lab) {
                const auto found = lab.effects.find(effect.name);
                return found != lab.effects.end() ? found->second.at(i) : values_of_absent(effect)[i];
              },
              [&effect, i](Lab& lab, double value) {
                auto found = lab.effects.find(effect.name);
                if (found == lab.effects.end()) {
                  if (i == 0 && value == 0) return;
                  found = lab.effects.emplace(effect.name, values_of_absent(effect)).first;
                }
                found->second.at(i) = value;
              })
          .live("Sim" + cap_words(effect.name) + cap_words(parameter.key));
      list.parameters.back().declaration.scale = parameter.scale;
      list.parameters.back().declaration.integer = parameter.integer;
      list.parameters.back().written = [&effect](const Lab& lab) {
        return lab.effects.contains(effect.name);
      };
    }
  }
}

std::vector<LabParameter> make_list(CameraKind kind) {
  ParameterList list;
  add_top(list);
  add_camera(list, kind);
  add_atoms(list);
  add_optics(list);
  kind == CameraKind::emccd ? add_sensor<EmccdDescription>(list) : add_sensor<QcmosDescription>(list);
  add_effects(list, kind);
  return std::move(list.parameters);
}

std::vector<LabParameter> with_defaults(CameraKind kind) {
  const auto bare = lab_parameters_without_defaults(kind);
  std::vector<LabParameter> parameters(bare.begin(), bare.end());
  const Lab lab = preset((kind == CameraKind::emccd ? ixon_ultra_897() : orca_quest()).name);
  for (LabParameter& parameter : parameters) parameter.declaration.default_value = parameter.get(lab);
  return parameters;
}

using Index = std::unordered_map<std::string_view, const LabParameter*>;

Index index_of(std::span<const LabParameter> parameters) {
  Index index;
  for (const LabParameter& parameter : parameters) index.emplace(parameter.declaration.key, &parameter);
  return index;
}

}  // namespace

std::span<const LabParameter> lab_parameters_without_defaults(CameraKind kind) {
  static const std::vector<LabParameter> emccd = make_list(CameraKind::emccd);
  static const std::vector<LabParameter> qcmos = make_list(CameraKind::qcmos);
  return kind == CameraKind::emccd ? emccd : qcmos;
}

std::span<const LabParameter> lab_parameters(CameraKind kind) {
  static const std::vector<LabParameter> emccd = with_defaults(CameraKind::emccd);
  static const std::vector<LabParameter> qcmos = with_defaults(CameraKind::qcmos);
  return kind == CameraKind::emccd ? emccd : qcmos;
}

const LabParameter* find_lab_parameter(CameraKind kind, std::string_view key) {
  static const Index emccd = index_of(lab_parameters(CameraKind::emccd));
  static const Index qcmos = index_of(lab_parameters(CameraKind::qcmos));
  const Index& index = kind == CameraKind::emccd ? emccd : qcmos;
  const auto found = index.find(key);
  return found == index.end() ? nullptr : found->second;
}

}  // namespace atomcam
