#pragma once
// Frames for the sensors' tests.

#include <vector>

#include "sensor/sensor.hpp"

namespace atomcam {

inline CameraSettings whole(const Sensor& sensor) {
  CameraSettings settings;
  settings.region = {0, 0, sensor.shape().columns, sensor.shape().rows};
  settings.defect_correction = false;
  return settings;
}

inline CountImage read(const Sensor& sensor, const CameraSettings& settings, const SensorLight& light,
                       std::uint64_t frame = 0, std::uint64_t seed = 11) {
  const auto readout = sensor.begin(settings, light, seed, frame);
  CountImage image(readout->plane_shape());
  for (int r = 0; r < image.rows(); ++r) readout->read_row(r, image.row(r));
  return readout->finish(std::move(image));
}

inline SensorLight uniform_light(double background_e) {
  SensorLight light;
  light.background_e = background_e;
  return light;
}

/// `electrons` at one pixel of the plane.
inline SensorLight one_pixel(Shape plane, int row, int column, int electrons) {
  SensorLight light;
  for (int r = 0; r <= plane.rows; ++r)
    light.atoms.row_begin.push_back(r <= row ? 0 : static_cast<std::uint32_t>(electrons));
  light.atoms.columns.assign(static_cast<std::size_t>(electrons), static_cast<std::uint16_t>(column));
  return light;
}

/// The same readout by its steps, a plane at a time.
inline CountImage read_in_steps(const Sensor& sensor, const CameraSettings& settings,
                                const SensorLight& light, std::uint64_t frame = 0, std::uint64_t seed = 11) {
  const auto readout = sensor.begin(settings, light, seed, frame);
  const Shape plane = readout->plane_shape();
  ElectronImage electrons(plane);
  RegisterImage output(plane), analog(plane);
  CountImage counts(plane);
  // Each step in another order of the rows: nothing may depend on it.
  for (int r = plane.rows - 1; r >= 0; --r) readout->collect(r, electrons.row(r));
  for (int r = 0; r < plane.rows; ++r) readout->multiply(r, electrons.row(r), output.row(r));
  for (int r = plane.rows - 1; r >= 0; --r) readout->amplify(r, output.row(r), analog.row(r));
  for (int r = 0; r < plane.rows; ++r) readout->digitise(r, analog.row(r), counts.row(r));
  return readout->finish(std::move(counts));
}

}  // namespace atomcam
