#include <pybind11/stl.h>

#include <array>

#include <fmt/format.h>

#include "base/error.hpp"
#include "python/bindings.hpp"
#include "simulation/frame_range.hpp"
#include "simulation/lab_choice.hpp"
#include "simulation/lab_text_form.hpp"
#include "simulation/point_spread_image.hpp"

namespace atomcam {
namespace {

using Counts = py::array_t<std::uint16_t, py::array::c_style>;
using Numbers = py::array_t<double, py::array::c_style | py::array::forcecast>;
using Flags = py::array_t<std::uint8_t, py::array::c_style | py::array::forcecast>;

/// Python's bool, int, float, str and NumPy's scalars; nothing is taken for what it is not.
KeyValue value_of(const std::string& key, const py::handle& value) {
  const py::object numbers = py::module_::import("numbers");
  if (PyBool_Check(value.ptr()) || py::isinstance(value, py::module_::import("numpy").attr("bool_")))
    return value.cast<py::bool_>().cast<bool>();
  if (PyUnicode_Check(value.ptr())) return value.cast<std::string>();
  if (py::isinstance(value, numbers.attr("Integral"))) {
    const long long whole = PyLong_AsLongLong(py::int_(value.cast<py::object>()).ptr());
    if (!PyErr_Occurred()) return static_cast<std::int64_t>(whole);
    PyErr_Clear();
  }
  if (py::isinstance(value, numbers.attr("Real"))) return py::float_(value.cast<py::object>()).cast<double>();
  throw Error(key, fmt::format("value {} of type {}; allowed a number, a bool or a text",
                               py::repr(value).cast<std::string>(),
                               py::str(py::type::handle_of(value).attr("__name__")).cast<std::string>()));
}

/// An array of `type` of this shape whose memory may be written straight to.
template <class Value>
Value* memory_of(const py::handle& object, const std::vector<py::ssize_t>& shape, const std::string& name) {
  if (!py::isinstance<py::array_t<Value, py::array::c_style>>(object))
    throw Error(name, fmt::format("allowed a NumPy array of {}, contiguous in C order",
                                  py::str(py::dtype::of<Value>()).template cast<std::string>()));
  auto array = py::reinterpret_borrow<py::array>(object);
  if (!std::equal(shape.begin(), shape.end(), array.shape(), array.shape() + array.ndim()))
    throw Error(name,
                fmt::format("shape {}; allowed {}", py::str(array.attr("shape")).template cast<std::string>(),
                            py::str(py::tuple(py::cast(shape))).template cast<std::string>()));
  if (!array.writeable()) throw Error(name, "it cannot be written to");
  return static_cast<Value*>(array.mutable_data());
}

CameraSettings settings_of(const Simulation& simulation, const std::optional<std::uint64_t>& seed) {
  CameraSettings settings = simulation.lab().settings;
  if (seed && *seed != simulation.lab().seed) settings.overrides = {{"seed", static_cast<double>(*seed)}};
  return settings;
}

std::vector<py::ssize_t> shape_of(const CameraSettings& settings) {
  return {settings.output_height(), settings.output_width()};
}

py::array_t<float> array_of(const PhotonImage& image) {
  py::array_t<float> array({image.rows(), image.columns()});
  std::ranges::copy(image.pixels(), array.mutable_data());
  return array;
}

/// Truth by the names of its members. A bool of NumPy is one byte, 0 or 1.
TruthArrays truth_arrays(const py::dict& arrays, py::ssize_t frames, py::ssize_t sites) {
  const std::vector<py::ssize_t> by_site{frames, sites}, by_frame{frames};
  const auto flags = [&](const char* name) {
    return reinterpret_cast<std::uint8_t*>(memory_of<bool>(arrays[name], by_site, name));
  };
  const auto numbers = [&](const char* name, const auto& shape) {
    return memory_of<double>(arrays[name], shape, name);
  };
  return {.present_at_start = flags("present_at_start"),
          .present_at_end = flags("present_at_end"),
          .x_px = numbers("x_px", by_site),
          .y_px = numbers("y_px", by_site),
          .loss_time_s = numbers("loss_time_s", by_site),
          .photons_emitted = numbers("photons_emitted", by_site),
          .electrons_expected = numbers("electrons_expected", by_site),
          .electrons_detected =
              memory_of<std::int64_t>(arrays["electrons_detected"], by_site, "electrons_detected"),
          .shift_x_px = numbers("shift_x_px", by_frame),
          .shift_y_px = numbers("shift_y_px", by_frame),
          .background_e = numbers("background_e", by_frame)};
}

void render_into(const Workbench& bench, const py::object& counts, const py::dict& truth, std::uint64_t first,
                 const std::optional<std::uint64_t>& seed, int threads) {
  std::shared_ptr<const Simulation> simulation;
  {
    py::gil_scoped_release others_run;
    simulation = bench.simulation();
  }
  const CameraSettings settings = settings_of(*simulation, seed);
  if (!py::isinstance<py::array>(counts) || py::cast<py::array>(counts).ndim() != 3)
    throw Error("out", "allowed a NumPy array [frame, row, column]");
  const auto frames = py::cast<py::array>(counts).shape(0);
  const std::vector<py::ssize_t> shape{frames, settings.output_height(), settings.output_width()};
  std::uint16_t* memory = memory_of<std::uint16_t>(counts, shape, "out");
  const TruthArrays arrays =
      truth_arrays(truth, frames, static_cast<py::ssize_t>(simulation->lab().scene.sites.size()));
  const auto look_for_interrupts = [] {
    py::gil_scoped_acquire hold;
    if (PyErr_CheckSignals() != 0) throw py::error_already_set();
  };
  py::gil_scoped_release others_run;
  render_frames(*simulation, settings, {first, static_cast<std::uint64_t>(frames)},
                {memory, static_cast<std::size_t>(shape[0] * shape[1] * shape[2])}, arrays, threads,
                look_for_interrupts);
}

py::array_t<float> expected_electrons(const Workbench& bench, std::uint64_t frame,
                                      const std::optional<std::uint64_t>& seed) {
  PhotonImage image;
  {
    py::gil_scoped_release others_run;
    const auto simulation = bench.simulation();
    image = simulation->expected_electrons(frame, settings_of(*simulation, seed));
  }
  return array_of(image);
}

py::array_t<float> point_spread_function(const Workbench& bench, std::array<int, 2> shape, double x_px,
                                         double y_px, int oversampling) {
  PhotonImage image;
  {
    py::gil_scoped_release others_run;
    image = point_spread_image(bench.lab(), {{shape[0], shape[1]}, x_px, y_px, oversampling});
  }
  return array_of(image);
}

py::array_t<double> sites(const Workbench& bench) {
  const std::vector<Site> list = bench.lab().scene.sites;
  py::array_t<double> array({static_cast<py::ssize_t>(list.size()), py::ssize_t{3}});
  auto view = array.mutable_unchecked<2>();
  for (py::ssize_t i = 0; i < view.shape(0); ++i) {
    const Site& site = list[static_cast<std::size_t>(i)];
    view(i, 0) = site.x_px;
    view(i, 1) = site.y_px;
    view(i, 2) = site.brightness;
  }
  return array;
}

void put_sites(Workbench& bench, const Numbers& array) {
  if (array.ndim() != 2 || (array.shape(1) != 2 && array.shape(1) != 3))
    throw Error("sites", "allowed an array [site, 2] of x_px, y_px or [site, 3] with the brightness");
  std::vector<Site> list;
  const auto view = array.unchecked<2>();
  for (py::ssize_t i = 0; i < view.shape(0); ++i)
    list.push_back({view(i, 0), view(i, 1), view.shape(1) == 3 ? view(i, 2) : 1});
  bench.change([&](Lab& lab) { set_sites(lab, std::move(list)); });
}

py::array_t<bool> occupancies(const Workbench& bench) {
  const Lab lab = bench.lab();
  py::array_t<bool> array({lab.given_occupancies.size(), lab.scene.sites.size()});
  bool* out = array.mutable_data();
  for (const Occupancy& shot : lab.given_occupancies) out = std::copy(shot.begin(), shot.end(), out);
  return array;
}

void put_occupancies(Workbench& bench, const Flags& array) {
  if (array.ndim() != 2) throw Error("occupancies", "allowed an array [shot, site] of bool, 0 or 1");
  std::vector<Occupancy> list;
  for (py::ssize_t shot = 0; shot < array.shape(0); ++shot)
    list.emplace_back(array.data(shot), array.data(shot) + array.shape(1));
  bench.change([&](Lab& lab) { set_occupancies(lab, std::move(list)); });
}

void put(Workbench& bench, const py::dict& values) {
  std::vector<std::pair<std::string, std::string>> texts;
  for (const auto& [key, value] : values) {
    const auto name = key.cast<std::string>();
    texts.emplace_back(name, text_of(value_of(name, value)));
  }
  bench.change([&](Lab& lab) {
    for (const auto& [key, text] : texts) set_parameter(lab, key, text, "lab");
  });
}

py::dict readout_mode(const Workbench& bench) {
  const Lab lab = bench.lab();
  py::dict figures;
  for (const ReadoutFigure& figure : readout_figures())
    figures[py::str(figure.declaration.key)] = readout_figure(lab, figure.declaration.key);
  return figures;
}

void put_readout_figure(Workbench& bench, const std::string& name, const py::object& value) {
  const std::string text = text_of(value_of(name, value));
  const std::optional<double> number = parse_number(text);
  if (!number) throw Error("lab: " + name, fmt::format("value {} is not a number", in_quotes(text)));
  bench.change([&](Lab& lab) { set_readout_figure(lab, name, *number, "lab"); });
}

py::list keys(const Workbench& bench) {
  py::list all;
  for (const KeyInfo& info : list_keys(bench.lab())) all.append(dictionary_of(info));
  return all;
}

}  // namespace

void bind_lab(py::module_& module) {
  py::class_<Workbench>(module, "Lab", "A lab with the simulation that belongs to it.")
      .def_static(
          "load", [](const std::string& name) { return std::make_unique<Workbench>(load_lab(name)); },
          py::arg("name"), "A preset or a lab file.")
      .def_static(
          "parse",
          [](const std::string& text, bool json) {
            return std::make_unique<Workbench>(parse_lab(text, "text", json));
          },
          py::arg("text"), py::arg("json"), "The text of a lab file.")
      .def(
          "copy", [](const Workbench& bench) { return std::make_unique<Workbench>(bench); },
          "The same lab again.")
      .def(
          "text",
          [](const Workbench& bench, bool json, bool commented) {
            return json ? write_lab_json(bench.lab()) : write_lab(bench.lab(), commented);
          },
          py::arg("json"), py::arg("commented"), "The text of its file.")
      .def(
          "save", [](const Workbench& bench, const std::string& file) { save_lab(bench.lab(), file); },
          py::arg("file"), "Writes a lab file.")
      .def(
          "kind",
          [](const Workbench& bench) { return bench.lab().kind() == CameraKind::emccd ? "emccd" : "qcmos"; },
          "emccd or qcmos.")
      .def("keys", &keys, "Every key as a dictionary.")
      .def(
          "get", [](const Workbench& bench, const std::string& key) { return bench.get(key); },
          py::arg("key"), "The value of a key.")
      .def("put", &put, py::arg("values"), "Sets several keys; all or none.")
      .def(
          "check", [](const Workbench& bench) { check_lab(bench.lab(), "lab"); },
          "Whether the keys fit together.")
      .def(
          "frame_shape",
          [](const Workbench& bench) { return py::tuple(py::cast(shape_of(bench.lab().settings))); },
          "Rows and columns.")
      .def("readout_mode", &readout_mode, "Figures of the readout mode in force.")
      .def("put_readout_figure", &put_readout_figure, py::arg("name"), py::arg("value"),
           "Changes a figure of the readout mode in force.")
      .def("sites", &sites, "x_px, y_px, brightness [site, 3].")
      .def("put_sites", &put_sites, py::arg("sites"), "Sites in a list.")
      .def("occupancies", &occupancies, "Given occupancies [shot, site].")
      .def("put_occupancies", &put_occupancies, py::arg("occupancies"),
           "Gives occupancies; none: drawn by chance.")
      .def(
          "use_camera",
          [](Workbench& bench, const Workbench& camera) {
            const Lab other = camera.lab();
            bench.change([&](Lab& lab) { lab = with_camera_of(lab, other); });
          },
          py::arg("camera"), "Takes sensor, set-points and the effects behind the light of another lab.")
      .def("render_into", &render_into, py::arg("counts"), py::arg("truth"), py::arg("first"),
           py::arg("seed"), py::arg("threads"), "Renders into the memory of arrays; the interpreter runs on.")
      .def("expected_electrons", &expected_electrons, py::arg("frame"), py::arg("seed"),
           "Expected photo-electrons [row, column].")
      .def("point_spread_function", &point_spread_function, py::arg("shape"), py::arg("x_px"),
           py::arg("y_px"), py::arg("oversampling"), "Share of an atom's light [row, column].");
}

}  // namespace atomcam
