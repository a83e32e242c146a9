#include <pybind11/stl.h>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "analysis/frame_sequence.hpp"
#include "base/error.hpp"
#include "judging/detectors.hpp"
#include "judging/judgement_json.hpp"
#include "judging/stack_truth.hpp"
#include "python/bindings.hpp"
#include "python/long_work.hpp"

namespace atomcam {
namespace {

template <class Value>
using Table = py::array_t<Value, py::array::c_style | py::array::forcecast>;

/// A table's values, [frame, site].
template <class Value>
std::span<const Value> values_of(const Table<Value>& table, const char* name, py::ssize_t frames,
                                 py::ssize_t sites) {
  if (table.ndim() != 2 || table.shape(0) != frames || table.shape(1) != sites)
    throw Error(name, fmt::format("shape {}; allowed [{}, {}]",
                                  py::str(table.attr("shape")).template cast<std::string>(), frames, sites));
  return {table.data(), static_cast<std::size_t>(table.size())};
}

py::tuple judge_scores(const Table<float>& scores, const Table<bool>& filled, const Table<bool>& lost,
                       const Table<float>& loss_time_s, const Table<float>& electrons,
                       const Table<std::uint8_t>& neighbours, double threshold, double exposure_s) {
  if (scores.ndim() != 2) throw Error("scores", "allowed an array [frame, site]");
  const py::ssize_t frames = scores.shape(0), sites = scores.shape(1);
  const auto of = values_of(scores, "scores", frames, sites);
  const auto is_filled = values_of(filled, "filled", frames, sites),
             is_lost = values_of(lost, "lost", frames, sites);
  const auto loss_s = values_of(loss_time_s, "loss_time_s", frames, sites),
             light = values_of(electrons, "electrons", frames, sites);
  const auto around = values_of(neighbours, "neighbours", frames, sites);
  std::vector<SiteTruth> truth(of.size());
  for (std::size_t i = 0; i < truth.size(); ++i)
    truth[i] = {is_filled[i], is_lost[i], loss_s[i], light[i], around[i]};
  Judgement judgement;
  {
    const py::gil_scoped_release others_run;
    judgement = judge({static_cast<std::uint64_t>(frames), static_cast<std::size_t>(sites),
                       std::vector<float>(of.begin(), of.end())},
                      truth, threshold, exposure_s);
  }
  py::array_t<double> roc({static_cast<py::ssize_t>(judgement.roc.size()), py::ssize_t{3}});
  auto view = roc.mutable_unchecked<2>();
  for (py::ssize_t i = 0; i < view.shape(0); ++i) {
    const RocPoint& point = judgement.roc[static_cast<std::size_t>(i)];
    view(i, 0) = point.threshold;
    view(i, 1) = point.false_alarms;
    view(i, 2) = point.found;
  }
  return py::make_tuple(judgement_json(judgement).dump(), roc);
}

Table<std::uint8_t> filled_neighbours(const Workbench& lab, const Table<bool>& filled) {
  const std::vector<Site> sites = lab.lab().scene.sites;
  const auto count = static_cast<py::ssize_t>(sites.size());
  if (filled.ndim() != 2) throw Error("filled", "allowed an array [frame, site]");
  const auto is_filled = values_of(filled, "truth", filled.shape(0), count);
  const auto around = neighbours_of(sites);
  Table<std::uint8_t> numbers({filled.shape(0), count});
  std::uint8_t* out = numbers.mutable_data();
  for (std::size_t frame = 0; frame < is_filled.size(); frame += sites.size())
    for (const auto& others : around) {
      *out = 0;
      for (const std::size_t other : others) *out += is_filled[frame + other];
      ++out;
    }
  return numbers;
}

std::unique_ptr<ReferenceDetector> make_detector(const Workbench& bench, const std::string& kind,
                                                 int half_width_px) {
  const Lab lab = bench.lab();
  const CameraSettings& camera = lab.settings;
  return std::make_unique<ReferenceDetector>(
      lab, StackPlace{camera.region.offset_x, camera.region.offset_y, camera.binning_x, camera.binning_y},
      Shape{camera.output_height(), camera.output_width()},
      kind == "matched" ? Detector::matched : Detector::threshold, half_width_px);
}

/// Frames as a detector takes them.
ReferenceDetector::Frames frames_for(const ReferenceDetector& detector, const FrameSequence& frames,
                                     const LongWork& work) {
  const Shape shape = detector.shape();
  if (!(frames.shape() == shape))
    throw Error("frames", fmt::format("of {} x {} pixels; the lab's are {} x {}", frames.shape().rows,
                                      frames.shape().columns, shape.rows, shape.columns));
  return [&frames, &work,
          pixels = std::vector<float>(shape.pixels())](const ReferenceDetector::Visit& visit) mutable {
    frames.visit([&](std::size_t, const CountImage& frame) {
      work.check_in();
      std::ranges::copy(frame.pixels(), pixels.begin());
      visit(pixels);
    });
  };
}

void teach(ReferenceDetector& detector, const FrameSequence& frames, const Table<bool>& filled) {
  const auto is_filled = values_of(filled, "truth", static_cast<py::ssize_t>(frames.frames()),
                                   static_cast<py::ssize_t>(detector.sites()));
  std::vector<SiteTruth> truth(is_filled.size());
  for (std::size_t i = 0; i < truth.size(); ++i) truth[i].filled = is_filled[i];
  LongWork long_work;
  long_work.run(py::none(),
                [&](LongWork& work) { detector.teach(frames_for(detector, frames, work), truth); });
}

Table<float> scores(const ReferenceDetector& detector, const FrameSequence& frames) {
  if (!detector.taught()) throw Error("detector", "it has not been taught");
  Table<float> table({static_cast<py::ssize_t>(frames.frames()), static_cast<py::ssize_t>(detector.sites())});
  std::span<float> left(table.mutable_data(), static_cast<std::size_t>(table.size()));
  LongWork long_work;
  long_work.run(py::none(), [&](LongWork& work) {
    frames_for(detector, frames, work)([&](std::span<const float> frame) {
      detector.score(frame, left.first(detector.sites()));
      left = left.subspan(detector.sites());
    });
  });
  return table;
}

}  // namespace

void bind_judging(py::module_& module) {
  module.def("judge", &judge_scores, py::arg("scores"), py::arg("filled"), py::arg("lost"),
             py::arg("loss_time_s"), py::arg("electrons"), py::arg("neighbours"), py::arg("threshold"),
             py::arg("exposure_s"),
             "A judgement as JSON, and its curve [point, 3]. Arrays are [frame, site].");
  module.def("filled_neighbours", &filled_neighbours, py::arg("lab"), py::arg("filled"),
             "How many sites next to each are filled [frame, site].");
  py::class_<ReferenceDetector>(module, "Detector", "A detector to compare others with.")
      .def_static("make", &make_detector, py::arg("lab"), py::arg("kind"), py::arg("half_width_px"),
                  "threshold or matched.")
      .def("teach", &teach, py::arg("frames"), py::arg("filled"), "By frames and truth [frame, site].")
      .def("taught", &ReferenceDetector::taught, "Whether it has been.")
      .def("threshold", &ReferenceDetector::threshold, "What it has learnt.")
      .def("scores", &scores, py::arg("frames"), "Of each site in each frame [frame, site].");
}

}  // namespace atomcam
