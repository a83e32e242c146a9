#include <pybind11/stl.h>

#include <nlohmann/json.hpp>

#include "calibration/calibrate.hpp"
#include "calibration/calibration_json.hpp"
#include "calibration/report_folder.hpp"
#include "data/output_files.hpp"
#include "python/bindings.hpp"
#include "python/long_work.hpp"

namespace atomcam {
namespace {

using Frames = std::shared_ptr<FrameSequence>;

/// With what it was made from: its report goes through the frames once more.
struct Calibrated {
  Calibration calibration;
  CalibrationInput input;
  std::vector<Frames> stacks;
};

std::unique_ptr<Calibrated> calibrate_frames(const Frames& frames, const Notes& notes, const Frames& darks,
                                             const Frames& background, double background_exposure_s,
                                             const std::vector<Frames>& flats,
                                             const std::vector<double>& flat_exposures, bool full,
                                             const py::object& progress) {
  auto made = std::make_unique<Calibrated>();
  made->stacks = {frames, darks, background};
  made->stacks.insert(made->stacks.end(), flats.begin(), flats.end());
  CalibrationInput& input = made->input;
  input.notes = notes;
  input.frames = frames.get();
  input.darks = darks.get();
  input.background = background.get();
  input.background_exposure_s = background_exposure_s;
  for (std::size_t n = 0; n < flats.size(); ++n)
    input.flats.push_back({flats[n].get(), flat_exposures.empty() ? 0 : flat_exposures[n]});
  input.full = full;
  LongWork long_work;
  long_work.run(progress, [&](LongWork& work) {
    input.progress = [&](std::string_view step, double done) { work.tell(step, done); };
    // All frames; asked for each of them, it also ends the work in the midst of a long stack.
    input.use = [&](std::size_t) {
      work.check_in();
      return true;
    };
    made->calibration = calibrate(input);
  });
  input.progress = {};
  input.use = {};
  return made;
}

py::array_t<double> array_of(const Image<double, unit::counts>& map) {
  py::array_t<double> array({map.rows(), map.columns()});
  std::ranges::copy(map.pixels(), array.mutable_data());
  return array;
}

py::dict maps(const Calibrated& made) {
  const PixelMaps& maps = made.calibration.maps;
  py::dict arrays;
  const auto put = [&](const char* name, const Image<double, unit::counts>& map) {
    if (!map.empty()) arrays[name] = array_of(map);
  };
  put("offset_counts", maps.offset);
  put("offset_error_counts", maps.offset_error);
  put("noise_counts", maps.noise);
  put("noise_error_counts", maps.noise_error);
  return arrays;
}

py::array_t<double> sites(const Calibrated& made) {
  const std::vector<SiteImage>& list = made.calibration.model.sites;
  py::array_t<double> array({static_cast<py::ssize_t>(list.size()), py::ssize_t{2}});
  auto view = array.mutable_unchecked<2>();
  for (py::ssize_t s = 0; s < view.shape(0); ++s) {
    view(s, 0) = list[static_cast<std::size_t>(s)].x_px;
    view(s, 1) = list[static_cast<std::size_t>(s)].y_px;
  }
  return array;
}

}  // namespace

void bind_calibration(py::module_& module) {
  py::class_<Calibrated>(module, "Calibration", "What a calibration found.")
      .def(
          "lab", [](const Calibrated& made) { return std::make_unique<Workbench>(made.calibration.lab); },
          "The lab at the fitted values.")
      .def(
          "json", [](const Calibrated& made) { return calibration_json(made.calibration).dump(); },
          "calibration.json.")
      .def("sites", &sites, "x_px, y_px [site, 2] in pixels of the frames.")
      .def(
          "position_error_px",
          [](const Calibrated& made) { return made.calibration.optics.position_error_px; },
          "Of a site in the middle.")
      .def("maps", &maps, "Maps of pixels by their names.")
      .def(
          "write",
          [](const Calibrated& made, const std::string& folder, const std::string& command) {
            make_folder(folder, "folder");
            write_calibration(folder, made.calibration, made.input, command);
          },
          py::arg("folder"), py::arg("command"), py::call_guard<py::gil_scoped_release>(),
          "Writes report, table and maps.");
  module.def("calibrate", &calibrate_frames, py::arg("frames"), py::arg("notes"), py::arg("darks"),
             py::arg("background"), py::arg("background_exposure_s"), py::arg("flats"),
             py::arg("flat_exposures"), py::arg("full"), py::arg("progress"),
             "The plain or the full model fitted to frames; the interpreter runs on.");
}

}  // namespace atomcam
