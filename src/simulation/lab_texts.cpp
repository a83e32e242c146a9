// What a lab says in words: names, and choices out of a table.

#include <algorithm>
#include <array>
#include <optional>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "base/error.hpp"
#include "simulation/lab.hpp"
#include "simulation/lab_choice.hpp"
#include "simulation/lab_set.hpp"
#include "simulation/lab_text_form.hpp"

namespace atomcam {
namespace {

const std::vector<ReadoutMode>& modes_of(const Lab& lab) {
  return std::visit(
      [](const auto& sensor) -> const std::vector<ReadoutMode>& { return sensor.readout_modes; }, lab.sensor);
}

const ReadoutMode& mode_in_force(const Lab& lab) {
  static const ReadoutMode none;
  const auto& modes = modes_of(lab);
  const auto index = static_cast<std::size_t>(lab.settings.readout_mode);
  return index < modes.size() ? modes[index] : none;
}

std::string amplifier_name(Amplifier amplifier) {
  return amplifier == Amplifier::electron_multiplying ? "electron_multiplying" : "conventional";
}
std::string scan_name(ScanMode scan) {
  return scan == ScanMode::standard ? "standard" : "ultra_quiet";
}

[[noreturn]] void refuse(std::string_view place, std::string_view value,
                         const std::vector<std::string>& allowed) {
  throw Error(place, fmt::format("value {}; allowed {}", in_quotes(value), fmt::join(allowed, ", ")));
}

/// Every different value of a column of the readout modes.
template <class Column>
std::vector<std::string> different(const Lab& lab, Column column) {
  std::vector<std::string> values;
  for (const ReadoutMode& mode : modes_of(lab)) {
    const std::string value = column(mode);
    if (std::find(values.begin(), values.end(), value) == values.end()) values.push_back(value);
  }
  return values;
}

/// One column of the readout modes as a key of its own.
template <class Column>
LabText mode_column(std::string key, std::string meaning, std::optional<std::string> ReadoutWish::*wish,
                    Column column) {
  LabText text;
  text.key = std::move(key);
  text.meaning = std::move(meaning);
  text.allowed = [column](const Lab& lab) { return different(lab, column); };
  text.get = [column](const Lab& lab) { return column(mode_in_force(lab)); };
  text.set = [wish](Lab& lab, std::string_view value, std::string_view place) {
    ReadoutWish one;
    one.*wish = std::string(value);
    choose_readout_mode(lab, one, place);
  };
  return text;
}

LabText free_text(std::string key, std::string meaning, std::string Lab::*field, std::size_t longest,
                  bool ascii) {
  LabText text;
  text.key = std::move(key);
  text.meaning = std::move(meaning);
  text.get = [field](const Lab& lab) { return lab.*field; };
  text.set = [=](Lab& lab, std::string_view value, std::string_view place) {
    const bool plain = std::all_of(value.begin(), value.end(), [ascii](char letter) {
      const auto byte = static_cast<unsigned char>(letter);
      return byte >= 0x20 && byte != 0x7f && !(ascii && byte > 0x7f);
    });
    if (!plain || (ascii && value.empty()) || value.size() > longest || !is_valid_utf8(value)) {
      throw Error(place,
                  fmt::format("value {}; allowed {} {} {}", in_quotes(value), ascii ? "1 to" : "up to",
                              longest, ascii ? "printable ASCII characters" : "bytes of one line of UTF-8"));
    }
    lab.*field = value;
  };
  return text;
}

LabText model_text() {
  LabText text;
  text.key = "sensor.model";
  text.meaning = "the camera's model name";
  text.get = [](const Lab& lab) {
    return std::visit([](const auto& sensor) { return sensor.model; }, lab.sensor);
  };
  text.set = [](Lab& lab, std::string_view value, std::string_view place) {
    // Registers of a camera hold it: 31 characters and a zero.
    if (value.empty() || value.size() > 31 || !std::all_of(value.begin(), value.end(), [](char letter) {
          return letter >= 0x20 && letter < 0x7f;
        })) {
      throw Error(place,
                  fmt::format("value {}; allowed 1 to 31 printable ASCII characters", in_quotes(value)));
    }
    std::visit([value](auto& sensor) { sensor.model = value; }, lab.sensor);
  };
  return text;
}

LabText hot_pixel_text() {
  static const std::vector<std::string> names = {"minimum", "standard", "aggressive"};
  LabText text;
  text.key = "camera.hot_pixel_correction";
  text.meaning = "how many pixels the defect correction takes for hot";
  text.allowed = [](const Lab&) { return names; };
  text.get = [](const Lab& lab) {
    return names.at(static_cast<std::size_t>(lab.settings.hot_pixel_correction));
  };
  text.set = [](Lab& lab, std::string_view value, std::string_view place) {
    const auto found = std::find(names.begin(), names.end(), value);
    if (found == names.end()) refuse(place, value, names);
    lab.settings.hot_pixel_correction = static_cast<HotPixelCorrection>(found - names.begin());
  };
  return text;
}

std::vector<LabText> make_texts(CameraKind kind) {
  std::vector<LabText> texts;
  texts.push_back(free_text("name", "what this lab is called", &Lab::name, 200, false));
  texts.push_back(free_text("camera.serial", "the sensor's serial number; its pixel maps follow from it",
                            &Lab::serial, 15, true));
  texts.push_back(
      free_text("camera.user_name", "name the camera shows its clients", &Lab::user_name, 15, true));
  if (kind == CameraKind::emccd) {
    texts.push_back(mode_column("camera.amplifier", "output amplifier", &ReadoutWish::amplifier,
                                [](const ReadoutMode& mode) { return amplifier_name(mode.amplifier); }));
    texts.push_back(mode_column("camera.readout_rate_hz", "pixels read per second", &ReadoutWish::rate_hz,
                                [](const ReadoutMode& mode) { return number_text(mode.pixel_rate_hz); }));
    texts.back().number = true;
    texts.push_back(mode_column("camera.preamp",
                                "preamplifier setting; see sensor.readout_mode for its e-/count",
                                &ReadoutWish::preamp, [](const ReadoutMode& mode) { return mode.preamp; }));
  } else {
    texts.push_back(mode_column("camera.scan", "scan mode", &ReadoutWish::scan,
                                [](const ReadoutMode& mode) { return scan_name(mode.scan); }));
    texts.push_back(hot_pixel_text());
  }
  texts.push_back(model_text());
  return texts;
}

}  // namespace

void choose_readout_mode(Lab& lab, const ReadoutWish& wish, std::string_view place) {
  const auto& modes = modes_of(lab);
  const ReadoutMode& now = mode_in_force(lab);
  const auto fits = [](const std::optional<std::string>& wanted, const std::string& value) {
    return !wanted || *wanted == value;
  };
  const std::optional<double> rate_hz = wish.rate_hz ? parse_number(*wish.rate_hz) : std::nullopt;
  int best = -1;
  int best_score = -1;
  for (std::size_t i = 0; i < modes.size(); ++i) {
    const ReadoutMode& mode = modes[i];
    if (!fits(wish.amplifier, amplifier_name(mode.amplifier)) || !fits(wish.scan, scan_name(mode.scan)) ||
        !fits(wish.preamp, mode.preamp) || (wish.rate_hz && rate_hz != mode.pixel_rate_hz)) {
      continue;
    }
    // What was not asked for stays as it is if it can; the amplifier before the rate before the preamp.
    const int score = (mode.amplifier == now.amplifier) * 8 + (mode.scan == now.scan) * 4 +
                      (mode.pixel_rate_hz == now.pixel_rate_hz) * 2 + (mode.preamp == now.preamp);
    if (score > best_score) {
      best = static_cast<int>(i);
      best_score = score;
    }
  }
  if (best < 0) {
    std::string asked;
    for (const auto* part : {&wish.amplifier, &wish.scan, &wish.rate_hz, &wish.preamp}) {
      if (*part) asked += (asked.empty() ? "" : ", ") + **part;
    }
    std::vector<std::string> allowed;
    for (const ReadoutMode& mode : modes) allowed.push_back(readout_mode_name(lab.kind(), mode));
    throw Error(place,
                fmt::format("no readout mode {}; allowed {}", in_quotes(asked), fmt::join(allowed, "; ")));
  }
  lab.settings.readout_mode = best;
}

std::span<const ReadoutFigure> readout_figures() {
  static const std::array<ReadoutFigure, 2> figures = {
      {{{.key = "electrons_per_count",
         .unit = "e/count",
         .minimum = 1e-6,
         .maximum = 1e6,
         .scale = ParameterScale::logarithmic,
         .meaning = "electrons per count of the readout mode in force, without EM gain"},
        &ReadoutMode::electrons_per_count},
       {{.key = "read_noise_e",
         .unit = "e",
         .minimum = 0,
         .maximum = 1e6,
         .meaning = "read noise of the readout mode in force, rms, without EM gain"},
        &ReadoutMode::read_noise_e}}};
  return figures;
}

namespace {

const ReadoutFigure& figure_named(std::string_view name, std::string_view place) {
  std::vector<std::string> names;
  for (const ReadoutFigure& figure : readout_figures()) {
    if (figure.declaration.key == name) return figure;
    names.push_back(figure.declaration.key);
  }
  throw_unknown(place, "figure of a readout mode", name, names);
}

}  // namespace

double readout_figure(const Lab& lab, std::string_view name) {
  return mode_in_force(lab).*figure_named(name, "lab").member;
}

void set_readout_figure(Lab& lab, std::string_view name, double value, std::string_view place) {
  const ReadoutFigure& figure = figure_named(name, place);
  check_value(figure.declaration, value, fmt::format("{}: {}", place, name));
  std::visit(
      [&](auto& sensor) {
        sensor.readout_modes.at(static_cast<std::size_t>(lab.settings.readout_mode)).*figure.member = value;
      },
      lab.sensor);
}

std::string readout_mode_name(CameraKind kind, const ReadoutMode& mode) {
  if (kind == CameraKind::qcmos) return scan_name(mode.scan);
  return fmt::format("{} {} {}", amplifier_name(mode.amplifier), number_text(mode.pixel_rate_hz),
                     mode.preamp);
}

std::span<const LabText> lab_texts(CameraKind kind) {
  static const std::vector<LabText> emccd = make_texts(CameraKind::emccd);
  static const std::vector<LabText> qcmos = make_texts(CameraKind::qcmos);
  return kind == CameraKind::emccd ? emccd : qcmos;
}

}  // namespace atomcam
