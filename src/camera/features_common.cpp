// Features that both kinds of camera have.

#include <algorithm>
#include <array>
#include <cmath>

#include "camera/declare.hpp"

namespace atomcam {

namespace {

void add_device_control(FeatureTable& table, const CameraModel& model) {
  table.category("DeviceControl");
  table.add(
      Declare::enumeration("DeviceType", "What the device does.", {{"Transmitter", 0, ""}}).read_only());
  table.add(
      Declare::enumeration("DeviceScanType", "Geometry of the sensor.", {{"Areascan", 0, ""}}).read_only());
  table.add(Declare::label("DeviceVendorName", "Name of the maker.", model.vendor));
  table.add(Declare::label("DeviceModelName", "Name of the simulated model.", model.model));
  table.add(Declare::label("DeviceManufacturerInfo", "About the device.", "simulated camera"));
  table.add(Declare::label("DeviceVersion", "Version of the device.", model.version));
  table.add(Declare::label("DeviceFirmwareVersion", "Version of the firmware.", model.version));
  table.add(Declare::label("DeviceSerialNumber", "Serial number; the sensor's pixel maps follow from it.",
                           model.serial));
  Declare user_id(FeatureType::string, "DeviceUserID", "Name that the user gives the camera.");
  Feature feature = user_id.length(16).not_saved().take("DeviceControl");
  feature.declaration.default_string = model.user_name.substr(0, 16);
  table.add(std::move(feature));
  table.add(Declare::integer("DeviceSFNCVersionMajor", "Standard Features Naming Convention, major version.")
                .within(2, 2)
                .initially(2)
                .read_only()
                .expert());
  table.add(Declare::integer("DeviceSFNCVersionMinor", "Standard Features Naming Convention, minor version.")
                .within(7, 7)
                .initially(7)
                .read_only()
                .expert());
  table.add(
      Declare::integer("DeviceSFNCVersionSubMinor", "Standard Features Naming Convention, sub-minor version.")
          .within(0, 0)
          .read_only()
          .expert());
  table.add(Declare::integer("DeviceStreamChannelCount", "Number of stream channels.")
                .within(1, 1)
                .initially(1)
                .read_only()
                .expert());
  table.add(Declare::command("TimestampReset", "Sets the device's clock to zero.").expert());
  table.add(Declare::command("TimestampLatch", "Copies the device's clock to TimestampLatchValue.").expert());
  table.add(Declare::integer("TimestampLatchValue", "The device's clock when it was latched.")
                .unit("ns")
                .expert()
                .integer_value([](const FeatureState& s) {
                  return static_cast<std::int64_t>(s.live.timestamp_latch_ns);
                }));
  table.add(Declare::enumeration("DeviceTemperatureSelector", "Place whose temperature is read.",
                                 {{"Sensor", 0, ""}})
                .expert());
  table.add(Declare::floating("DeviceTemperature", "Temperature of the sensor.")
                .unit("C")
                .within(-150, 100)
                .read_only()
                .selected_by("DeviceTemperatureSelector")
                .number([](const FeatureState& s) { return s.live.temperature_c; }));
  if (model.kind == CameraKind::emccd)
    add_emccd_cooling(table, model);
  else
    add_qcmos_cooling(table, model);
  table.add(Declare::enumeration(
                "SensorCoolingStatus", "Whether the sensor has reached its temperature.",
                {{"Off", 0, "the cooler is off"}, {"NotReached", 1, "on its way"}, {"Stabilised", 2, ""}})
                .custom()
                .read_only()
                .number([](const FeatureState& s) {
                  if (s.number("SensorCooling") == 0) return 0.0;
                  return s.live.temperature_stable ? 2.0 : 1.0;
                }));
}

void add_image_format(FeatureTable& table, const CameraModel& model) {
  table.category("ImageFormatControl");
  table.add(Declare::integer("SensorWidth", "Columns of the sensor.")
                .unit("px")
                .within(model.sensor.columns, model.sensor.columns)
                .initially(model.sensor.columns)
                .read_only()
                .expert());
  table.add(Declare::integer("SensorHeight", "Rows of the sensor.")
                .unit("px")
                .within(model.sensor.rows, model.sensor.rows)
                .initially(model.sensor.rows)
                .read_only()
                .expert());
  table.add(Declare::floating("SensorPixelWidth", "Width of a physical pixel.")
                .unit("um")
                .within(model.pixel_um, model.pixel_um)
                .initially(model.pixel_um)
                .read_only()
                .expert());
  table.add(Declare::floating("SensorPixelHeight", "Height of a physical pixel.")
                .unit("um")
                .within(model.pixel_um, model.pixel_um)
                .initially(model.pixel_um)
                .read_only()
                .expert());
  if (model.kind == CameraKind::emccd)
    add_emccd_image_format(table, model);
  else
    add_qcmos_image_format(table, model);
  table.add(Declare::enumeration("PixelSize", "Bits of a pixel in the stream.",
                                 {{"Bpp8", 8, ""}, {"Bpp12", 12, ""}, {"Bpp16", 16, ""}})
                .read_only()
                .expert()
                .number([](const FeatureState& s) {
                  return static_cast<double>(
                      bits_per_pixel(static_cast<PixelFormat>(s.integer(s.index("PixelFormat")))));
                }));
}

void add_acquisition_control(FeatureTable& table, const CameraModel& model) {
  const CameraSettings& power_up = model.power_up;
  table.category("AcquisitionControl");
  table.add(Declare::enumeration("AcquisitionMode", "How many frames an acquisition takes.",
                                 {{"Continuous", 0, "until stopped"},
                                  {"SingleFrame", 1, "one"},
                                  {"MultiFrame", 2, "AcquisitionFrameCount"}})
                .held_while_acquiring());
  table.add(Declare::command("AcquisitionStart", "Starts an acquisition."));
  table.add(
      Declare::command("AcquisitionStop", "Ends the acquisition at once; the frame under way is discarded."));
  table.add(Declare::command("AcquisitionAbort", "Ends the acquisition at once.").expert());
  table.add(Declare::integer("AcquisitionFrameCount", "Frames of a MultiFrame acquisition.")
                .within(1, 1000000000)
                .initially(1)
                .held_while_acquiring());
  table.add(Declare::enumeration("AcquisitionStatusSelector", "Signal that AcquisitionStatus reads.",
                                 {{"AcquisitionActive", 0, "an acquisition runs"},
                                  {"FrameTriggerWait", 1, "a frame trigger would be accepted"},
                                  {"FrameActive", 2, "a frame exposes or is read out"},
                                  {"ExposureActive", 3, "a frame exposes"}})
                .expert()
                .not_saved());
  table.add(Declare::boolean("AcquisitionStatus", "State of the selected signal.")
                .expert()
                .read_only()
                .selected_by("AcquisitionStatusSelector")
                .number([](const FeatureState& s) {
                  const LiveValues& live = s.live;
                  const bool states[] = {live.acquiring, live.waiting_for_trigger, live.frame_active,
                                         live.exposing};
                  return states[s.entry_position("AcquisitionStatusSelector")] ? 1.0 : 0.0;
                }));
  table.add(Declare::enumeration("ExposureMode", "What ends an exposure.", {{"Timed", 0, "ExposureTime"}}));
  table.add(
      Declare::floating("ExposureTime",
                        "Exposure time; written values are rounded to the nearest that the sensor can do.")
          .unit("us")
          .within(1, 3600e6)
          .initially(power_up.exposure_s * 1e6)
          .logarithmic()
          .range([](const FeatureState& s) {
            return FeatureRange{s.timing().minimum_exposure_s * 1e6,
                                s.model().kind == CameraKind::emccd ? 3600e6 : 1800e6, 0};
          })
          .on_write(
              [](FeatureState& s, double us) { return s.timing().realised_exposure_s(us / 1e6) * 1e6; }));
  table.add(Declare::enumeration("ExposureAuto", "Automatic exposure: none.", {{"Off", 0, ""}}));
  const double given_rate = power_up.frame_interval_s > 0 ? 1 / power_up.frame_interval_s : 10;
  table.add(
      Declare::boolean("AcquisitionFrameRateEnable",
                       "Whether AcquisitionFrameRate sets the pace; else frames follow each other as fast as "
                       "exposure and readout allow.")
          .initially(power_up.frame_interval_s > 0));
  table.add(Declare::floating(
                "AcquisitionFrameRate",
                "Frames per second asked for. A value that becomes too fast for the exposure is kept and "
                "comes back when the exposure allows it.")
                .unit("Hz")
                .within(1e-4, 1e6)
                .initially(given_rate)
                .range([](const FeatureState& s) {
                  const double maximum = s.maximum_frame_rate_hz();
                  return FeatureRange{std::min(1e-4, maximum), maximum, 0};
                })
                .number([](const FeatureState& s) {
                  return std::min(s.selected_number("AcquisitionFrameRate", 0), s.maximum_frame_rate_hz());
                }));
  table.add(Declare::floating(
                "AcquisitionResultingFrameRate",
                "Frames per second as exposure, readout, AcquisitionFrameRate and the simulated line make "
                "them; of other triggers the fastest that are accepted.")
                .unit("Hz")
                .within(0, 1e6)
                .read_only()
                .number([](const FeatureState& s) { return 1 / s.frame_interval_s(); }));
  table.add(Declare::floating("SensorReadoutTime", "Time from the end of an exposure to the last pixel.")
                .unit("us")
                .within(0, 1e9)
                .read_only()
                .expert()
                .custom()
                .number([](const FeatureState& s) { return s.timing().readout_s * 1e6; }));
  table.add(Declare::enumeration("TriggerSelector", "Trigger that is configured.",
                                 {{"FrameStart", 0, "starts a frame"}}));
  table.add(Declare::enumeration("TriggerMode", "Whether frames wait for the trigger.",
                                 {{"Off", 0, ""}, {"On", 1, ""}})
                .selected_by("TriggerSelector")
                .held_while_acquiring());
  table.add(Declare::command("TriggerSoftware", "Fires the trigger if its source is Software."));
  table.add(Declare::enumeration("TriggerSource", "Where triggers come from.",
                                 {{"Software", 0, "TriggerSoftware"},
                                  {"Line0", 1, "the simulated input line, see LineTriggerRate"},
                                  {"Action0", 2, "action signal 0"},
                                  {"Action1", 3, "action signal 1"}})
                .selected_by("TriggerSelector")
                .held_while_acquiring());
  table.add(Declare::enumeration("TriggerActivation", "Edge of the line that counts.",
                                 {{"RisingEdge", 0, ""}, {"FallingEdge", 1, ""}})
                .selected_by("TriggerSelector")
                .held_while_acquiring());
  table.add(Declare::enumeration(
                "TriggerOverlap",
                "Whether a trigger is accepted while the frame before is read out; it is on an EMCCD "
                "only with frame transfer.",
                {{"Off", 0, "triggers during readout are missed"},
                 {"ReadOut", 1, "if the exposure ends after that readout"}})
                .selected_by("TriggerSelector")
                .held_while_acquiring());
  table.add(Declare::floating("TriggerDelay", "From the trigger to the start of the exposure.")
                .unit("us")
                .within(0, 10e6)
                .selected_by("TriggerSelector"));
  table.add(Declare::enumeration(
                "ShutterMode", "Shutter in the light path.",
                {{"Auto", 0, "open while frames expose"}, {"Open", 1, ""}, {"Closed", 2, "dark frames"}})
                .custom()
                .initially(power_up.shutter_open ? 0 : 2));
  table.add(Declare::enumeration("SensorShutterMode", "How the rows expose.",
                                 {{"Global", 0, "all rows together"}, {"Rolling", 1, "row after row"}})
                .read_only()
                .expert()
                .initially(model.kind == CameraKind::qcmos ? 1 : 0));
  table.add(
      Declare::integer("LateFrameCount", "Frames that came later than exposure and readout would have them.")
          .custom()
          .expert()
          .integer_value([](const FeatureState& s) {
            return static_cast<std::int64_t>(s.live.statistics.late_frames);
          }));
  table.add(
      Declare::integer("LostFrameCount", "Frames that the transport dropped or that could not be rendered.")
          .custom()
          .expert()
          .integer_value([](const FeatureState& s) {
            return static_cast<std::int64_t>(s.live.statistics.lost_frames);
          }));
  table.add(Declare::integer("MissedTriggerCount", "Triggers that came while the camera could not take them.")
                .custom()
                .expert()
                .integer_value([](const FeatureState& s) {
                  return static_cast<std::int64_t>(s.live.statistics.missed_triggers);
                }));
}

void add_digital_io(FeatureTable& table) {
  table.category("DigitalIOControl");
  table.add(Declare::enumeration("LineSelector", "Line that is configured.",
                                 {{"Line0", 0, "trigger input, simulated"},
                                  {"Line1", 1, "output"},
                                  {"Line2", 2, "output"},
                                  {"Line3", 3, "output"}})
                .not_saved());
  table.add(Declare::enumeration("LineMode", "Direction of the line.", {{"Input", 0, ""}, {"Output", 1, ""}})
                .read_only()
                .expert()
                .selected_by("LineSelector")
                .initially({0, 1, 1, 1}));
  table.add(
      Declare::boolean("LineInverter", "Whether the line is inverted.").expert().selected_by("LineSelector"));
  table.add(Declare::enumeration("LineSource", "Signal on an output line.",
                                 {{"Off", 0, "low"},
                                  {"ExposureActive", 1, "a frame exposes"},
                                  {"FrameActive", 2, "a frame exposes or is read out"},
                                  {"FrameTriggerWait", 3, "a trigger would be accepted"}})
                .selected_by("LineSelector")
                .initially({0, 1, 2, 3})
                .locked_if([](const FeatureState& s) { return s.is("LineSelector", "Line0"); }));
  const auto status = [](const FeatureState& s, int line) {
    const LiveValues& live = s.live;
    const bool signals[] = {false, live.exposing, live.frame_active, live.waiting_for_trigger};
    const bool level =
        line == 0 ? live.line_input : signals[static_cast<int>(s.selected_number("LineSource", line))];
    return level != (s.selected_number("LineInverter", line) != 0);
  };
  table.add(Declare::boolean("LineStatus", "Level of the line.")
                .expert()
                .read_only()
                .selected_by("LineSelector")
                .number([status](const FeatureState& s) {
                  return status(s, s.entry_position("LineSelector")) ? 1.0 : 0.0;
                }));
  table.add(Declare::integer("LineStatusAll", "Levels of all lines, line 0 in bit 0.")
                .expert()
                .integer_value([status](const FeatureState& s) {
                  std::int64_t all = 0;
                  for (int line = 0; line < 4; ++line) all |= std::int64_t{status(s, line)} << line;
                  return all;
                })
                .within(0, 15));
  table.add(
      Declare::floating(
          "LineTriggerRate",
          "Rate of the square wave on line 0 that stands for a laboratory's trigger; below 0.001: none.")
          .custom()
          .unit("Hz")
          .within(0, 10000)
          .on_write([](FeatureState&, double rate) { return rate < 0.001 ? 0 : rate; }));
}

void add_chunk_data(FeatureTable& table, const CameraModel& model, const FrameSource& source) {
  table.category("ChunkDataControl");
  const bool gain = model.kind == CameraKind::emccd;
  table.add(
      Declare::boolean("ChunkModeActive", "Whether frames carry chunks.").expert().held_while_acquiring());
  std::vector<EnumEntry> entries = {{"FrameID", static_cast<int>(Chunk::frame_id), ""},
                                    {"Timestamp", static_cast<int>(Chunk::timestamp), ""},
                                    {"ExposureTime", static_cast<int>(Chunk::exposure_time), ""}};
  if (gain) entries.push_back({"Gain", static_cast<int>(Chunk::gain), ""});
  entries.push_back({"Seed", static_cast<int>(Chunk::seed), ""});
  entries.push_back({"GroundTruth", static_cast<int>(Chunk::ground_truth), "what the frame shows"});
  const std::vector<double> enabled(entries.size(), 1);
  table.add(Declare::enumeration("ChunkSelector", "Chunk that is configured.", std::move(entries))
                .expert()
                .not_saved());
  table.add(Declare::boolean("ChunkEnable", "Whether frames carry the selected chunk.")
                .expert()
                .selected_by("ChunkSelector")
                .initially(enabled)
                .held_while_acquiring());
  constexpr double large = 9.2e18;
  table.add(Declare::integer("ChunkFrameID", "Number of the frame since the camera was opened.")
                .expert()
                .within(0, large)
                .in_chunk(Chunk::frame_id));
  table.add(Declare::integer("ChunkTimestamp", "Start of the exposure on the device's clock.")
                .expert()
                .unit("ns")
                .within(0, large)
                .in_chunk(Chunk::timestamp));
  table.add(Declare::floating("ChunkExposureTime", "Exposure time of the frame.")
                .expert()
                .unit("us")
                .within(0, 3600e6)
                .in_chunk(Chunk::exposure_time));
  if (gain)
    table.add(Declare::floating("ChunkGain", "EM gain of the frame.")
                  .expert()
                  .within(1, 1000)
                  .in_chunk(Chunk::gain));
  table.add(Declare::integer("ChunkSeed", "Seed of the simulation.")
                .expert()
                .custom()
                .within(-large, large)
                .in_chunk(Chunk::seed));
  const auto capacity = static_cast<int>((source.truth_capacity() + 3) / 4 * 4);
  Declare truth(FeatureType::string, "ChunkGroundTruth", "What the frame shows, as JSON; padded with NUL.");
  table.add(truth.expert().custom().length(capacity).in_chunk(Chunk::ground_truth));
}

void add_event_control(FeatureTable& table) {
  table.category("EventControl");
  table.add(Declare::enumeration(
                "EventSelector", "Event that is configured.",
                {{"ExposureEnd", 0, "an exposure has ended"}, {"FrameLost", 1, "a frame was lost"}})
                .expert()
                .not_saved());
  table.add(
      Declare::enumeration("EventNotification", "Whether the event is sent.", {{"Off", 0, ""}, {"On", 1, ""}})
          .expert()
          .selected_by("EventSelector"));
  const auto add_data = [&](const std::string& event, int id, auto frame, auto time) {
    table.add(Declare::integer("Event" + event, "Identifier of the event.")
                  .expert()
                  .within(id, id)
                  .initially(id)
                  .read_only());
    table.add(Declare::integer("Event" + event + "FrameID", "Frame of the last such event.")
                  .expert()
                  .integer_value(
                      [frame](const FeatureState& s) { return static_cast<std::int64_t>(s.live.*frame); }));
    table.add(Declare::integer("Event" + event + "Timestamp", "Time of the last such event.")
                  .expert()
                  .unit("ns")
                  .integer_value(
                      [time](const FeatureState& s) { return static_cast<std::int64_t>(s.live.*time); }));
  };
  add_data("ExposureEnd", event_id(CameraEvent::Kind::exposure_end), &LiveValues::exposure_end_frame,
           &LiveValues::exposure_end_ns);
  add_data("FrameLost", event_id(CameraEvent::Kind::frame_lost), &LiveValues::lost_frame,
           &LiveValues::lost_ns);
}

void add_user_sets(FeatureTable& table) {
  table.category("UserSetControl");
  table.add(Declare::enumeration("UserSetSelector", "User set to load or save.",
                                 {{"Default", 0, "as at power-up"}, {"UserSet1", 1, ""}, {"UserSet2", 2, ""}})
                .not_saved());
  table.add(Declare::command("UserSetLoad", "Loads the selected set.").held_while_acquiring());
  table.add(Declare::command("UserSetSave", "Saves to the selected set, until the camera is closed.")
                .held_while_acquiring()
                .locked_if([](const FeatureState& s) { return s.is("UserSetSelector", "Default"); }));
  table.add(Declare::enumeration("UserSetDefault", "Set that is in force at power-up.", {{"Default", 0, ""}})
                .read_only()
                .expert());
}

void add_transport_layer(FeatureTable& table) {
  table.category("TransportLayerControl");
  table.add(Declare::integer("PayloadSize", "Bytes of a frame, chunks included.")
                .unit("B")
                .expert()
                .integer_value([](const FeatureState& s) {
                  return static_cast<std::int64_t>(s.layout().payload_size());
                })
                .within(1, 4e9));
  table.add(Declare::integer("TLParamsLocked", "1 holds what the stream depends on; acquiring does so too.")
                .within(0, 1)
                .invisible()
                .not_saved());
  table.add(Declare::integer("ParametersLocked", "1 while acquiring or held by TLParamsLocked.")
                .invisible()
                .custom()
                .integer_value([](const FeatureState& s) { return std::int64_t{s.parameters_locked()}; })
                .within(0, 1));
}

void add_simulation(FeatureTable& table, const CameraModel& model, const FrameSource& source,
                    const std::vector<SourceControl>& controls) {
  table.category("SimulationControl");
  const auto seed = static_cast<std::int64_t>(source.seed());
  std::string control_of_seed;
  for (const SourceControl& control : controls)
    if (control.key == "seed") control_of_seed = control.feature.name;
  table.add(Declare::integer("SimulationSeed", "Seed of every random draw.")
                .custom()
                .integer_value([seed, control_of_seed](const FeatureState& s) {
                  return control_of_seed.empty() ? seed : s.integer(s.index(control_of_seed));
                }));
  table.add(
      Declare::floating("SimCoolingTimeConstant", "Time constant with which the sensor cools and warms.")
          .custom()
          .unit("s")
          .within(0.001, 3600)
          .initially(20)
          .logarithmic());
  if (model.kind == CameraKind::qcmos)
    table.add(
        Declare::boolean("PulsedLight", "Whether the light is on only while all rows of the image expose.")
            .custom()
            .initially(model.power_up.pulsed_light));
  for (const SourceControl& control : controls) {
    Feature feature;
    feature.declaration = control.feature;
    feature.declaration.custom = true;
    feature.override_key = control.key;
    feature.selected_defaults = control.selected_defaults;
    feature.saved = true;
    table.add(std::move(feature));
  }
}

}  // namespace

double cooling_target_c(const FeatureState& state) {
  return state.number("SensorCooling") == 0 ? ambient_temperature_c
                                            : state.number("SensorTemperatureSetpoint");
}

void add_region(FeatureTable& table, const CameraModel& model, int step_px, int minimum_px) {
  struct Axis {
    const char *size, *offset, *binning, *maximum, *along;
    int pixels;
  };
  const auto axes = std::to_array<Axis>(
      {{"Width", "OffsetX", "BinningHorizontal", "WidthMax", "columns", model.sensor.columns},
       {"Height", "OffsetY", "BinningVertical", "HeightMax", "rows", model.sensor.rows}});
  const auto step = [step_px](const FeatureState& s, const char* binning) {
    return std::max(1.0, step_px / s.number(binning));
  };
  for (const Axis& axis : axes) {
    table.add(
        Declare::integer(axis.maximum, std::string("Largest image in ") + axis.along + ", after binning.")
            .unit("px")
            .expert()
            .integer_value([axis](const FeatureState& s) {
              return static_cast<std::int64_t>(axis.pixels / s.number(axis.binning));
            })
            .within(1, axis.pixels));
  }
  for (const Axis& axis : axes) {
    const Region& region = model.power_up.region;
    const bool horizontal = axis.size[0] == 'W';
    const int binning = horizontal ? model.power_up.binning_x : model.power_up.binning_y;
    table.add(Declare::integer(axis.size, std::string("Image size in ") + axis.along + ", after binning.")
                  .unit("px")
                  .within(1, axis.pixels, 1)
                  .held_while_acquiring()
                  .initially((horizontal ? region.width : region.height) / binning)
                  .range([axis, step, minimum_px](const FeatureState& s) {
                    const double by = step(s, axis.binning);
                    const double room = s.number(axis.maximum) - s.number(axis.offset);
                    const double least = std::max(by, std::ceil(minimum_px / s.number(axis.binning)));
                    return FeatureRange{least, least + std::floor((room - least) / by) * by, by};
                  }));
  }
  for (const Axis& axis : axes) {
    const Region& region = model.power_up.region;
    const bool horizontal = axis.size[0] == 'W';
    const int binning = horizontal ? model.power_up.binning_x : model.power_up.binning_y;
    table.add(Declare::integer(axis.offset, std::string("First of the ") + axis.along + ", in binned pixels.")
                  .unit("px")
                  .within(0, axis.pixels - 1, 1)
                  .held_while_acquiring()
                  .initially((horizontal ? region.offset_x : region.offset_y) / binning)
                  .range([axis, step](const FeatureState& s) {
                    const double by = step(s, axis.binning);
                    const double room = s.number(axis.maximum) - s.number(axis.size);
                    return FeatureRange{0, std::floor(room / by) * by, by};
                  }));
  }
}

std::vector<Feature> make_features(const CameraModel& model, const FrameSource& source,
                                   const std::vector<SourceControl>& controls) {
  FeatureTable table;
  add_device_control(table, model);
  add_image_format(table, model);
  // Before the acquisition: the bounds of exposure and frame rate follow from the readout.
  table.category("AnalogControl");
  if (model.kind == CameraKind::emccd)
    add_emccd_readout(table, model);
  else
    add_qcmos_readout(table, model);
  add_acquisition_control(table, model);
  add_digital_io(table);
  add_chunk_data(table, model, source);
  add_event_control(table);
  add_user_sets(table);
  add_transport_layer(table);
  add_simulation(table, model, source, controls);
  return table.take();
}

}  // namespace atomcam
