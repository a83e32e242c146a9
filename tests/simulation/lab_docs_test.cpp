// The tables in the documents are what the code says. ATOMCAM_UPDATE_DOCS=1 in the environment writes them
// anew.

#include <cstdlib>
#include <fstream>
#include <sstream>

#include <fmt/format.h>
#include <gtest/gtest.h>

#include "simulation/lab.hpp"
#include "simulation/lab_set.hpp"
#include "simulation/lab_text_form.hpp"

namespace atomcam {
namespace {

std::string value_text(const LabParameter& parameter, const Lab& lab) {
  const double value = parameter.get(lab);
  return parameter.boolean ? (value != 0 ? "true" : "false") : number_text(value);
}

bool shown(const LabParameter& parameter, const Lab& lab) {
  return !parameter.declaration.key.starts_with("effects.") && (!parameter.written || parameter.written(lab));
}

std::string figures(const std::string& preset_name) {
  const Lab lab = preset(preset_name);
  std::string table = "| key | value | source |\n| --- | --- | --- |\n";
  for (const LabParameter& parameter : lab_parameters(lab.kind())) {
    const std::string& key = parameter.declaration.key;
    const std::string_view source = figure_source(lab.kind(), key);
    if (!shown(parameter, lab) && source.empty()) continue;
    // An effect stands for its strength.
    const std::string name = key.starts_with("effects.") ? key.substr(0, key.rfind('.')) : key;
    table += fmt::format("| `{}` | {} | {} |\n", name, value_text(parameter, lab), source);
  }
  return table;
}

std::string modes(const std::string& name) {
  const Lab lab = preset(name);
  const auto rows = std::visit([](const auto& sensor) { return sensor.readout_modes; }, lab.sensor);
  const bool emccd = lab.kind() == CameraKind::emccd;
  std::string table = emccd ? "| amplifier | rate, MHz | preamp | e-/count | read noise, e- | source |\n"
                              "| --- | --- | --- | --- | --- | --- |\n"
                            : "| scan | e-/count | read noise, e- | source |\n| --- | --- | --- | --- |\n";
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const ReadoutMode& mode = rows[i];
    if (emccd) {
      table +=
          fmt::format("| {} | {} | {} ",
                      mode.amplifier == Amplifier::conventional ? "conventional" : "electron multiplying",
                      number_text(mode.pixel_rate_hz / 1e6), mode.preamp);
    } else {
      table += fmt::format("| {} ", mode.scan == ScanMode::standard ? "standard" : "ultra-quiet");
    }
    table += fmt::format("| {} | {} | {} |\n", number_text(mode.electrons_per_count),
                         number_text(mode.read_noise_e), readout_mode_source(lab.kind(), i));
  }
  return table;
}

std::string cell(const LabParameter* parameter, const Lab& lab) {
  return parameter && shown(*parameter, lab) ? value_text(*parameter, lab) : "";
}

/// Keys of both kinds of camera, in the order of the EMCCD with the qCMOS's own at the end of their table.
std::string keys(std::string_view section) {
  const Lab ixon = preset("ixon-ultra-897");
  const Lab orca = preset("orca-quest");
  std::string table =
      "| key | meaning | allowed | iXon preset | ORCA preset |\n| --- | --- | --- | --- | --- |\n";
  const auto belongs = [&](const std::string& key) {
    return key.substr(0, std::min(key.find('.'), key.size())) == section ||
           (section.empty() && key.find('.') == std::string::npos);
  };
  const auto add_texts = [&](const Lab& lab, bool only_new) {
    for (const LabText& text : lab_texts(lab.kind())) {
      if (!belongs(text.key)) continue;
      std::string values[2];
      bool known = false;
      for (const LabText& one : lab_texts(CameraKind::emccd)) {
        if (one.key == text.key) values[0] = one.get(ixon), known = true;
      }
      if (only_new && known) continue;
      for (const LabText& one : lab_texts(CameraKind::qcmos)) {
        if (one.key == text.key) values[1] = one.get(orca);
      }
      std::string allowed = text.allowed ? "" : "text";
      for (const std::string& one : text.allowed ? text.allowed(lab) : std::vector<std::string>{}) {
        allowed += (allowed.empty() ? "" : ", ") + one;
      }
      table += fmt::format("| `{}` | {} | {} | {} | {} |\n", text.key, text.meaning, allowed, values[0],
                           values[1]);
    }
  };
  const auto add = [&](CameraKind kind, bool only_new) {
    for (const LabParameter& parameter : lab_parameters(kind)) {
      const ParameterDeclaration& declaration = parameter.declaration;
      if (!belongs(declaration.key)) continue;
      const LabParameter* in_emccd = find_lab_parameter(CameraKind::emccd, declaration.key);
      if (only_new && in_emccd) continue;
      const std::string star = parameter.live ? " *" : "";
      table +=
          fmt::format("| `{}`{} | {} | {} | {} | {} |\n", declaration.key, star, declaration.meaning,
                      parameter.boolean ? "true, false" : allowed_text(declaration), cell(in_emccd, ixon),
                      cell(find_lab_parameter(CameraKind::qcmos, declaration.key), orca));
    }
  };
  add_texts(ixon, false);
  add_texts(orca, true);
  add(CameraKind::emccd, false);
  add(CameraKind::qcmos, true);
  return table;
}

/// Compares what stands between "<!-- name -->" and "<!-- end -->".
void expect_block(const std::string& file, const std::string& name, const std::string& expected) {
  const std::string path = std::string(ATOMCAM_SOURCE_DIR "/docs/") + file;
  std::stringstream read;
  read << std::ifstream(path).rdbuf();
  std::string text = read.str();
  const std::string open = "<!-- " + name + " -->\n";
  const auto begin = text.find(open);
  ASSERT_NE(begin, std::string::npos) << path << " has no " << open;
  const auto end = text.find("<!-- end -->", begin);
  ASSERT_NE(end, std::string::npos) << path;
  const auto from = begin + open.size();
  if (std::getenv("ATOMCAM_UPDATE_DOCS")) {
    text.replace(from, end - from, expected);
    std::ofstream(path) << text;
    return;
  }
  EXPECT_EQ(text.substr(from, end - from), expected) << path << ", " << name;
}

TEST(LabDocs, FiguresOfTheCamerasAreThePresets) {
  for (const std::string& name : preset_names()) {
    expect_block("cameras.md", "figures " + name, figures(name));
    expect_block("cameras.md", "readout modes " + name, modes(name));
  }
}

TEST(LabDocs, TheExampleIsALab) {
  std::stringstream text;
  text << std::ifstream(ATOMCAM_SOURCE_DIR "/docs/lab_file.md").rdbuf();
  const std::string open = "```toml\n";
  const auto begin = text.str().find(open);
  ASSERT_NE(begin, std::string::npos);
  const auto end = text.str().find("```", begin + open.size());
  const Lab lab = parse_lab(text.str().substr(begin + open.size(), end - begin - open.size()), "lab_file.md");
  EXPECT_EQ(lab.name, "my lab");
  EXPECT_TRUE(lab.effects.contains("row_noise"));
}

TEST(LabDocs, KeysAreTheReadersOwn) {
  for (const char* section : {"", "camera", "atoms", "optics", "light", "sensor"}) {
    expect_block("lab_file.md", fmt::format("keys {}", *section ? section : "top"), keys(section));
  }
}

}  // namespace
}  // namespace atomcam
