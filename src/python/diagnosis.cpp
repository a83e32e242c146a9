#include "diagnosis/diagnosis.hpp"

#include <fmt/format.h>
#include <pybind11/stl.h>

#include <algorithm>
#include <map>
#include <thread>

#include "base/error.hpp"
#include "data/output_files.hpp"
#include "diagnosis/against.hpp"
#include "diagnosis/diagnosis_json.hpp"
#include "diagnosis/report_folder.hpp"
#include "python/bindings.hpp"
#include "python/long_work.hpp"
#include "simulation/parallel.hpp"

namespace atomcam {
namespace {

using Frames = std::shared_ptr<FrameSequence>;

constexpr double for_diagnosis = 0.96;  // of the time; the rest is for the report, if there is one

/// What goes in: its role ("frames", "darks", "against", "notes"), name and SHA-256, and the frames if it is
/// a stack.
using Input = std::tuple<std::string, std::string, std::string, Frames>;

/// With what it was made from: its report goes through the frames once more.
struct Diagnosed {
  Diagnosis diagnosis;
  DiagnosisInputs inputs;
  std::map<std::string, Frames> stacks;
  int threads = 1;
  std::filesystem::path cache;

  /// Null if there is none.
  const FrameSequence* stack(const std::string& role) const {
    const auto found = stacks.find(role);
    return found == stacks.end() ? nullptr : found->second.get();
  }
  void write(const std::string& folder, const std::function<void(double)>& progress) const {
    write_diagnosis(folder, diagnosis, inputs, *stack("frames"), stack("darks"), stack("against"), threads,
                    cache, progress);
  }
};

/// `folder`: where the files go; empty: nowhere.
std::unique_ptr<Diagnosed> diagnose_frames(const std::vector<Input>& in, const Notes& notes,
                                           double background_exposure_s,
                                           const std::vector<double>& flat_exposures,
                                           const std::vector<std::string>& exclude,
                                           const std::vector<std::string>& include, std::uint64_t seed,
                                           int threads, bool where_only, bool all_frames,
                                           const std::string& cache, const std::string& command,
                                           const std::string& folder, const py::object& progress) {
  auto made = std::make_unique<Diagnosed>();
  made->threads = thread_count(threads);
  made->cache = cache;
  for (const auto& [role, name, sha256, stack] : in) {
    made->inputs.files.push_back(
        {role, name, sha256, stack ? stack->frames() : 0, stack ? stack->shape() : Shape{}});
    if (stack) made->stacks[role] = stack;
  }
  if (!made->stack("frames")) throw Error("frames", "there are none");
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
    options.beside.background = made->stack("background");
    options.beside.background_exposure_s = background_exposure_s;
    for (std::size_t n = 0; const FrameSequence* flats = made->stack(fmt::format("flats_{}", n + 1)); ++n)
      options.beside.flats.push_back({flats, n < flat_exposures.size() ? flat_exposures[n] : 0});
    options.seed = seed;
    options.threads = made->threads;
    options.where_only = where_only;
    options.all_frames = all_frames;
    options.cache = cache;
    options.progress = [&](std::string_view step, double done) { work.tell(step, done * share); };
    options.check_in = [&] { work.check_in(); };
    const FrameSequence &frames = *made->stack("frames"), *darks = made->stack("darks"),
                        *against = made->stack("against");
    made->diagnosis = against ? diagnose_against(notes, frames, *against, darks, options)
                              : diagnose(notes, frames, darks, options);
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
  module.def(
      "diagnose", &diagnose_frames, py::arg("inputs"), py::arg("notes"), py::arg("background_exposure_s"),
      py::arg("flat_exposures"), py::arg("exclude"), py::arg("include"), py::arg("seed"), py::arg("threads"),
      py::arg("where_only"), py::arg("all_frames"), py::arg("cache"), py::arg("command"), py::arg("folder"),
      py::arg("progress"), "Real against simulated frames, or against others; the interpreter runs on.");
}

}  // namespace atomcam
