#include "diagnosis/diagnosis.hpp"

#include <pybind11/stl.h>

#include <algorithm>
#include <thread>

#include "data/output_files.hpp"
#include "diagnosis/diagnosis_json.hpp"
#include "diagnosis/report_folder.hpp"
#include "python/bindings.hpp"
#include "python/long_work.hpp"

namespace atomcam {
namespace {

using Frames = std::shared_ptr<FrameSequence>;

constexpr double for_diagnosis = 0.96;  // of the time; the rest is for the report, if there is one

/// With what it was made from: its report goes through the frames once more.
struct Diagnosed {
  Diagnosis diagnosis;
  DiagnosisInputs inputs;
  Frames frames, darks;
  int threads = 1;

  void write(const std::string& folder, const std::function<void(double)>& progress) const {
    write_diagnosis(folder, diagnosis, inputs, *frames, darks.get(), nullptr, threads, progress);
  }
};

/// `files`: role, name and SHA-256 of what goes in, with the role of the argument for frames and darks.
/// `folder`: where the files go; empty: nowhere.
std::unique_ptr<Diagnosed> diagnose_frames(
    const Frames& frames, const Notes& notes, const Frames& darks,
    const std::vector<std::tuple<std::string, std::string, std::string>>& files,
    const std::vector<std::string>& exclude, const std::vector<std::string>& include, std::uint64_t seed,
    int threads, bool where_only, const std::string& cache, const std::string& command,
    const std::string& folder, const py::object& progress) {
  auto made = std::make_unique<Diagnosed>();
  made->frames = frames;
  made->darks = darks;
  made->threads = threads > 0 ? threads : static_cast<int>(std::max(1u, std::thread::hardware_concurrency()));
  for (const auto& [role, name, sha256] : files) {
    const Frames stack = role == "frames" ? frames : role == "darks" ? darks : nullptr;
    made->inputs.files.push_back(
        {role, name, sha256, stack ? stack->frames() : 0, stack ? stack->shape() : Shape{}});
  }
  made->inputs.exclude = exclude;
  made->inputs.include = include;
  made->inputs.seed = seed;
  made->inputs.version = ATOMCAM_VERSION;
  made->inputs.command = command;
  if (!folder.empty()) check_folder(folder, "out");
  const double share = folder.empty() ? 1 : for_diagnosis;
  LongWork long_work;
  long_work.run(progress, [&](LongWork& work) {
    DiagnosisOptions options;
    options.exclude = exclude;
    options.include = include;
    options.seed = seed;
    options.threads = made->threads;
    options.where_only = where_only;
    options.cache = cache;
    options.progress = [&](std::string_view step, double done) { work.tell(step, done * share); };
    options.check_in = [&] { work.check_in(); };
    made->diagnosis = diagnose(notes, *frames, darks.get(), options);
    if (!folder.empty())
      made->write(folder, [&](double done) { work.tell("report", share + (1 - share) * done); });
    work.tell("done", 1);
  });
  return made;
}

void write(const Diagnosed& made, const std::string& folder, const py::object& progress) {
  check_folder(folder, "folder");
  LongWork long_work;
  long_work.run(progress,
                [&](LongWork& work) { made.write(folder, [&](double done) { work.tell("report", done); }); });
}

}  // namespace

void bind_diagnosis(py::module_& module) {
  py::class_<Diagnosed>(module, "Diagnosis", "What a diagnosis found.")
      .def(
          "json", [](const Diagnosed& made) { return diagnosis_json(made.diagnosis, made.inputs); },
          "diagnosis.json.")
      .def(
          "lab", [](const Diagnosed& made) { return std::make_unique<Workbench>(made.diagnosis.lab); },
          "The calibrated lab with the found effects.")
      .def(
          "plain_lab",
          [](const Diagnosed& made) { return std::make_unique<Workbench>(made.diagnosis.plain_lab); },
          "The calibrated lab without effects.")
      .def("write", &write, py::arg("folder"), py::arg("progress"),
           "Writes the report, diagnosis.json and lab.toml; the interpreter runs on.");
  module.def("diagnose", &diagnose_frames, py::arg("frames"), py::arg("notes"), py::arg("darks"),
             py::arg("files"), py::arg("exclude"), py::arg("include"), py::arg("seed"), py::arg("threads"),
             py::arg("where_only"), py::arg("cache"), py::arg("command"), py::arg("folder"),
             py::arg("progress"), "Real against simulated frames; the interpreter runs on.");
}

}  // namespace atomcam
