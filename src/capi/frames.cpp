#include "base/error.hpp"
#include "capi/lab_handle.hpp"
#include "capi/status.hpp"
#include "simulation/frame_range.hpp"
#include "simulation/point_spread_image.hpp"

using namespace atomcam;

namespace {

std::size_t pixels_of(const CameraSettings& settings) {
  return Shape{settings.output_height(), settings.output_width()}.pixels();
}

TruthArrays arrays_of(const atomcam_truth* truth) {
  if (!truth) return {};
  // An older caller's structure is shorter: what it does not know of is not wanted.
  atomcam_truth known{};
  known.size = sizeof(known);
  const std::size_t size = truth->size < sizeof(known) ? truth->size : sizeof(known);
  std::char_traits<char>::copy(reinterpret_cast<char*>(&known), reinterpret_cast<const char*>(truth), size);
  return {.present_at_start = known.present_at_start,
          .present_at_end = known.present_at_end,
          .x_px = known.x_px,
          .y_px = known.y_px,
          .loss_time_s = known.loss_time_s,
          .photons_emitted = known.photons_emitted,
          .electrons_expected = known.electrons_expected,
          .electrons_detected = known.electrons_detected,
          .shift_x_px = known.shift_x_px,
          .shift_y_px = known.shift_y_px,
          .background_e = known.background_e};
}

int size_argument(std::size_t value, std::string_view name) {
  if (value > 1u << 20) throw Error(name, std::to_string(value) + " pixels, which is too many");
  return static_cast<int>(value);
}

}  // namespace

int atomcam_lab_frame_shape(const atomcam_lab* lab, size_t* rows, size_t* columns) {
  return guarded([&] {
    require(lab, "lab");
    const CameraSettings settings = lab->bench.lab().settings;
    if (rows) *rows = static_cast<std::size_t>(settings.output_height());
    if (columns) *columns = static_cast<std::size_t>(settings.output_width());
  });
}

int atomcam_lab_render(const atomcam_lab* lab, uint64_t first, uint64_t frames, int threads, uint16_t* counts,
                       size_t length, const atomcam_truth* truth) {
  return guarded([&] {
    require(lab, "lab");
    require(counts, "counts");
    const auto simulation = lab->bench.simulation();
    const CameraSettings& settings = simulation->lab().settings;
    const std::size_t pixels = pixels_of(settings);
    if (frames > length / pixels) require_room(length / pixels, frames, "counts, in frames");
    render_frames(*simulation, settings, {first, frames}, {counts, static_cast<std::size_t>(frames) * pixels},
                  arrays_of(truth), threads);
  });
}

int atomcam_lab_expected_electrons(const atomcam_lab* lab, uint64_t frame, float* image, size_t length) {
  return guarded([&] {
    require(lab, "lab");
    require(image, "image");
    const auto simulation = lab->bench.simulation();
    require_room(length, pixels_of(simulation->lab().settings), "image");
    const PhotonImage expected = simulation->expected_electrons(frame, simulation->lab().settings);
    std::ranges::copy(expected.pixels(), image);
  });
}

int atomcam_lab_point_spread_function(const atomcam_lab* lab, size_t rows, size_t columns, double x_px,
                                      double y_px, int oversampling, float* image, size_t length) {
  return guarded([&] {
    require(lab, "lab");
    require(image, "image");
    const PointSpreadView view{.shape = {size_argument(rows, "rows"), size_argument(columns, "columns")},
                               .x_px = x_px,
                               .y_px = y_px,
                               .oversampling = oversampling};
    require_room(length, view.shape.pixels(), "image");
    const PhotonImage function = point_spread_image(lab->bench.lab(), view);
    std::ranges::copy(function.pixels(), image);
  });
}
