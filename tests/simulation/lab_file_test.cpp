// Lab files as people write them, well and badly: every error names the place, the key, the value and what is
// allowed.

#include <filesystem>
#include <fstream>

#include <unistd.h>

#include <fmt/format.h>
#include <gtest/gtest.h>

#include "base/error.hpp"
#include "base/random.hpp"
#include "simulation/lab.hpp"

namespace atomcam {
namespace {

std::string error_of(std::string_view text, bool json = false) {
  try {
    parse_lab(text, json ? "bad.json" : "bad.toml", json);
  } catch (const Error& error) {
    return error.what();
  }
  return "no error";
}

/// A folder that goes with the test.
class Folder {
 public:
  Folder() : path_(std::filesystem::path(::testing::TempDir()) / fmt::format("atomcam_lab_{}", ::getpid())) {
    std::filesystem::create_directories(path_);
  }
  ~Folder() {
    std::error_code ignored;
    std::filesystem::remove_all(path_, ignored);
  }
  std::filesystem::path write(const std::string& name, std::string_view text) const {
    std::ofstream(path_ / name, std::ios::binary) << text;
    return path_ / name;
  }
  const std::filesystem::path& path() const { return path_; }

 private:
  std::filesystem::path path_;
};

std::string read_error(const std::filesystem::path& file) {
  try {
    read_lab(file);
  } catch (const Error& error) {
    return error.what();
  }
  return "no error";
}

TEST(LabFile, AnEmptyFileIsThePreset) {
  EXPECT_EQ(write_lab(parse_lab("", "empty.toml")), write_lab(preset("ixon-ultra-897")));
  EXPECT_EQ(write_lab(parse_lab("{}", "empty.json", true)), write_lab(preset("ixon-ultra-897")));
  EXPECT_EQ(write_lab(parse_lab("[camera]\npreset = \"orca-quest\"", "orca.toml")),
            write_lab(preset("orca-quest")));
}

TEST(LabFile, TomlAndJsonSayTheSame) {
  const Lab toml = parse_lab(R"(
name = "mine"
seed = 42
[camera]
preset = "ixon-ultra-897"
readout_rate_hz = 17e6
preamp = "1x"
exposure_s = 0.01
frame_transfer = false
[atoms]
filling = 0.75
[atoms.grid]
columns = 3
rows = 2
[optics.zernike]
defocus_um = 0
[effects]
serial_cic = 0.02
)",
                             "a.toml");
  const Lab json = parse_lab(R"({"name": "mine", "seed": 42,
    "camera": {"preset": "ixon-ultra-897", "readout_rate_hz": 17e6, "preamp": "1x", "exposure_s": 0.01,
               "frame_transfer": false},
    "atoms": {"filling": 0.75, "grid": {"columns": 3, "rows": 2}},
    "optics": {"zernike": {"defocus_um": 0}},
    "effects": {"serial_cic": 0.02}})",
                             "a.json", true);
  EXPECT_EQ(write_lab(toml), write_lab(json));
  EXPECT_EQ(toml.name, "mine");
  EXPECT_EQ(toml.seed, 42u);
  EXPECT_EQ(toml.scene.filling, 0.75);
  EXPECT_EQ(toml.scene.sites.size(), 6u);
  EXPECT_EQ(toml.optics.zernike_um[3], 0);
  EXPECT_FALSE(toml.settings.frame_transfer);
  EXPECT_EQ(toml.effects.at("serial_cic")[0], 0.02);
  const auto& sensor = std::get<EmccdDescription>(toml.sensor);
  EXPECT_EQ(sensor.readout_modes.at(toml.settings.readout_mode).read_noise_e, 240);
}

TEST(LabFile, UnknownKeysNameTheNearest) {
  EXPECT_EQ(error_of("sede = 1"), "bad.toml:1: unknown key 'sede'; the nearest is 'seed'");
  EXPECT_EQ(error_of("[camra]\nexposure_s = 1"), "bad.toml:1: unknown key 'camra'; the nearest is 'camera'");
  EXPECT_EQ(error_of("[camera]\n\nexposure_ms = 80"),
            "bad.toml:3: unknown key 'camera.exposure_ms'; the nearest is 'camera.exposure_s'");
  EXPECT_EQ(error_of("[atoms.grid]\ncolums = 4"),
            "bad.toml:2: unknown key 'atoms.grid.colums'; the nearest is 'atoms.grid.columns'");
  EXPECT_EQ(error_of("[optics]\nzernike.defocus = 0.1"),
            "bad.toml:2: unknown key 'optics.zernike.defocus'; the nearest is 'optics.zernike.defocus_um'");
  EXPECT_EQ(error_of("[effects.serial_ccd]\nevents = 1"),
            "bad.toml:1: unknown key 'effects.serial_ccd'; the nearest is 'effects.serial_cic'");
  const std::string parameter = find_effect("serial_cic")->parameters.at(0).key;
  EXPECT_EQ(error_of(fmt::format("[effects.serial_cic]\n{}x = 1", parameter)),
            fmt::format(
                "bad.toml:2: unknown key 'effects.serial_cic.{0}x'; the nearest is 'effects.serial_cic.{0}'",
                parameter));
  EXPECT_EQ(
      error_of("[[sensor.readout_mode]]\npreamps = \"1x\""),
      "bad.toml:2: unknown key 'sensor.readout_mode.preamps'; the nearest is 'sensor.readout_mode.preamp'");
  EXPECT_EQ(error_of("[[atoms.site]]\nx_px = 1\ny_um = 2"),
            "bad.toml:3: unknown key 'atoms.site.y_um'; the nearest is 'atoms.site.y_px'");
  // The right key in the wrong table, or on the wrong camera.
  EXPECT_EQ(error_of("exposure_s = 1"),
            "bad.toml:1: unknown key 'exposure_s'; the nearest is 'camera.exposure_s'");
  EXPECT_EQ(error_of("[camera]\npreset = \"orca-quest\"\nem_gain = 300"),
            "bad.toml:3: 'camera.em_gain' does not exist on a qCMOS");
  EXPECT_EQ(error_of("[camera]\nscan = \"standard\""),
            "bad.toml:2: 'camera.scan' does not exist on an EMCCD");
  EXPECT_EQ(
      error_of("[camera]\npreset = \"orca\""),
      "bad.toml:2: camera.preset: the text 'orca'; allowed 'ixon-ultra-897', 'orca-quest'; the nearest is "
      "'orca-quest'");
  // JSON too, with the line.
  EXPECT_EQ(error_of("{\n \"camera\": {\n  \"exposre_s\": 1}}", true),
            "bad.json:3: unknown key 'camera.exposre_s'; the nearest is 'camera.exposure_s'");
  Lab lab = preset("ixon-ultra-897");
  for (const auto& [key, near] : {std::pair{"atoms.fill", "atoms.filling"},
                                  {"filling", "atoms.filling"},
                                  {"effects.serial_ci", "effects.serial_cic"}}) {
    try {
      set_parameter(lab, key, "1");
      ADD_FAILURE() << key;
    } catch (const Error& error) {
      EXPECT_EQ(error.what(), fmt::format("--set: unknown key '{}'; the nearest is '{}'", key, near));
    }
  }
}

TEST(LabFile, AWrongTypeSaysWhatItIsAndWhatIsAllowed) {
  EXPECT_EQ(error_of("[atoms]\nfilling = \"half\""),
            "bad.toml:2: atoms.filling: the text 'half' instead of a number; allowed 0 to 1");
  EXPECT_EQ(error_of("[atoms]\nfilling = true"),
            "bad.toml:2: atoms.filling: true instead of a number; allowed 0 to 1");
  EXPECT_EQ(error_of("[atoms]\nfilling = [1]"),
            "bad.toml:2: atoms.filling: a list instead of a number; allowed 0 to 1");
  EXPECT_EQ(error_of("[atoms]\nfilling = 1979-05-27"),
            "bad.toml:2: atoms.filling: a date or time instead of a number; allowed 0 to 1");
  EXPECT_EQ(error_of("{\"atoms\": {\"filling\": null}}", true),
            "bad.json:1: atoms.filling: null instead of a number; allowed 0 to 1");
  EXPECT_EQ(error_of("[camera]\nframe_transfer = 1"),
            "bad.toml:2: camera.frame_transfer: the number 1; allowed true or false");
  EXPECT_EQ(error_of("[camera]\nserial = 12"), "bad.toml:2: camera.serial: the number 12 instead of a text");
  EXPECT_EQ(error_of("[camera]\nreadout_rate_hz = \"17e6\""),
            "bad.toml:2: camera.readout_rate_hz: the text '17e6' instead of a number");
  EXPECT_EQ(error_of("atoms = 3"), "bad.toml:1: atoms: the number 3 instead of a table");
  EXPECT_EQ(error_of("[effects]\nserial_cic = \"on\""),
            "bad.toml:2: effects.serial_cic: the text 'on' instead of a table or a number");
  EXPECT_EQ(error_of("[1, 2]", true), "bad.json:1: a list instead of a table of keys");
  EXPECT_EQ(error_of("7", true), "bad.json:1: the number 7 instead of a table of keys");
}

TEST(LabFile, ARangeIsNamed) {
  EXPECT_EQ(error_of("[atoms]\nfilling = 1.5"), "bad.toml:2: atoms.filling: value 1.5; allowed 0 to 1");
  EXPECT_EQ(error_of("[atoms]\nfilling = nan"), "bad.toml:2: atoms.filling: value nan; allowed 0 to 1");
  EXPECT_EQ(error_of("[camera]\nexposure_s = inf"),
            "bad.toml:2: camera.exposure_s: value inf; allowed 1e-6 to 10000 s");
  EXPECT_EQ(error_of("[camera]\nbinning_x = 2.5"),
            "bad.toml:2: camera.binning_x: value 2.5; allowed whole numbers from 1 to 16");
  EXPECT_EQ(error_of("seed = -1"),
            "bad.toml:1: seed: value -1; allowed whole numbers from 0 to 9007199254740991");
  EXPECT_EQ(error_of("[camera]\npreamp = \"5x\"").substr(0, 47),
            "bad.toml:2: camera: no readout mode '5x'; allow");
  EXPECT_EQ(error_of("[camera]\nreadout_rate_hz = 17e6\namplifier = \"conventional\"").substr(0, 30),
            "bad.toml:2: camera: no readout");
  EXPECT_EQ(error_of("[camera]\nwidth_px = 600"),
            "bad.toml: region from 0, 600 px along x; allowed within the sensor's 512 px");
  EXPECT_EQ(error_of("[camera]\noffset_y_px = 1\nheight_px = 510"),
            "bad.toml: region from 1, 510 px along y; allowed multiples of the binning, 2");
  EXPECT_EQ(error_of("[camera]\npreset = \"orca-quest\"\nbinning_x = 3\nwidth_px = 3"),
            "bad.toml: binning 3 of a qCMOS; allowed 1, 2, 4");
}

TEST(LabFile, WhatIsMissingIsNamed) {
  EXPECT_EQ(error_of("[[atoms.site]]\nx_px = 1"), "bad.toml:1: atoms.site: 'y_px' is missing");
  EXPECT_EQ(
      error_of(
          "[[sensor.readout_mode]]\namplifier = \"conventional\"\nreadout_rate_hz = 1e6\npreamp = \"1x\"\n"
          "read_noise_e = 3"),
      "bad.toml:1: sensor.readout_mode: 'electrons_per_count' is missing");
  EXPECT_EQ(error_of("[sensor]\nreadout_mode = []"),
            "bad.toml:2: sensor.readout_mode: a list; allowed a list of at least one table");
}

TEST(LabFile, OneGridOrOneListInOneUnit) {
  EXPECT_EQ(error_of("[atoms.grid]\nspacing_x_px = 10\noffset_x_um = 1"),
            "bad.toml:2: atoms.grid.spacing_x_px: in px, but another length of the grid is in um (line 3); "
            "allowed one "
            "of them");
  EXPECT_EQ(error_of("[atoms.grid]\ncolumns = 2\n[[atoms.site]]\nx_px = 1\ny_px = 1"),
            "bad.toml:2: atoms.grid.columns: a grid beside a list of sites; allowed one of them");
}

TEST(LabFile, AGridInPixelsStandsWhereItSays) {
  const Lab lab = parse_lab(
      "[atoms.grid]\ncolumns = 3\nrows = 2\nspacing_x_px = 10.5\nspacing_y_px = 8\noffset_x_px = "
      "15.2\noffset_y_px = 20",
      "px.toml");
  ASSERT_EQ(lab.scene.sites.size(), 6u);
  EXPECT_DOUBLE_EQ(lab.scene.sites[0].x_px, 15.2);
  EXPECT_DOUBLE_EQ(lab.scene.sites[0].y_px, 20);
  EXPECT_DOUBLE_EQ(lab.scene.sites[5].x_px, 36.2);
  EXPECT_DOUBLE_EQ(lab.scene.sites[5].y_px, 28);
}

TEST(LabFile, AGridInTheAtomPlaneFollowsTheMagnification) {
  // The magnification stands behind the grid in the file and counts all the same.
  const Lab lab = parse_lab(
      "[atoms.grid]\ncolumns = 2\nrows = 1\nspacing_x_um = 3\nspacing_y_um = 3\noffset_x_um = "
      "-1.5\noffset_y_um = 0\n"
      "[optics]\nmagnification = 160\n[sensor]\ncolumns = 101\nrows = 51",
      "um.toml");
  ASSERT_EQ(lab.scene.sites.size(), 2u);
  EXPECT_DOUBLE_EQ(lab.scene.sites[0].x_px, 50 - 15);
  EXPECT_DOUBLE_EQ(lab.scene.sites[1].x_px, 50 + 15);
  EXPECT_DOUBLE_EQ(lab.scene.sites[0].y_px, 25);
  // A smaller sensor is read in full, as far as the binning divides it.
  EXPECT_EQ(lab.settings.region, (Region{0, 0, 100, 50}));
}

TEST(LabFile, ListedSitesHaveABrightness) {
  const Lab lab =
      parse_lab("[[atoms.site]]\nx_px = 1\ny_px = 2\n[[atoms.site]]\nx_px = 3.5\ny_px = 4\nbrightness = 0.5",
                "sites.toml");
  ASSERT_EQ(lab.scene.sites.size(), 2u);
  EXPECT_EQ(lab.scene.sites[0].brightness, 1);
  EXPECT_EQ(lab.scene.sites[1].x_px, 3.5);
  EXPECT_EQ(lab.scene.sites[1].brightness, 0.5);
}

TEST(LabFile, OccupanciesComeOneAShot) {
  const std::string grid = "[atoms.grid]\ncolumns = 2\nrows = 2\n[atoms]\n";
  const Lab lab = parse_lab(grid + "occupancy = [\"10 01\", \"1111\"]", "list.toml");
  EXPECT_EQ(lab.given_occupancies, (std::vector<Occupancy>{{1, 0, 0, 1}, {1, 1, 1, 1}}));
  EXPECT_EQ(error_of(grid + "occupancy = [\"101\"]"),
            "bad.toml:5: atoms.occupancy: 3 digits; allowed one for each of the 4 sites");
  EXPECT_EQ(
      error_of(grid + "occupancy = [\"10x1\"]"),
      "bad.toml:5: atoms.occupancy: value '10x1'; allowed the digits 0 and 1, one for each site, and blanks");
  EXPECT_EQ(error_of(grid + "occupancy = \"1001\""),
            "bad.toml:5: atoms.occupancy: the text '1001' instead of a list of texts");

  const Folder folder;
  folder.write("shots.txt", "1000\n\n0001\r\n0 1 1 0\n");
  const auto file = folder.write("lab.toml", grid + "occupancy_file = \"shots.txt\"");
  EXPECT_EQ(read_lab(file).given_occupancies,
            (std::vector<Occupancy>{{1, 0, 0, 0}, {0, 0, 0, 1}, {0, 1, 1, 0}}));
  folder.write("shots.txt", "1000\n10\n");
  EXPECT_NE(read_error(file).find("shots.txt:2: 2 digits"), std::string::npos) << read_error(file);
  std::filesystem::remove(folder.path() / "shots.txt");
  EXPECT_NE(read_error(file).find("no such file"), std::string::npos) << read_error(file);
}

TEST(LabFile, AReadoutTableReplacesThePresets) {
  const Lab lab = parse_lab(
      "[camera]\npreamp = \"low\"\n[[sensor.readout_mode]]\namplifier = \"conventional\"\nreadout_rate_hz = "
      "5e5\n"
      "preamp = \"high\"\nelectrons_per_count = 1\nread_noise_e = 3\n[[sensor.readout_mode]]\n"
      "amplifier = \"electron_multiplying\"\nreadout_rate_hz = 5e5\npreamp = \"low\"\nelectrons_per_count = "
      "2\n"
      "read_noise_e = 7",
      "modes.toml");
  EXPECT_EQ(std::get<EmccdDescription>(lab.sensor).readout_modes.size(), 2u);
  EXPECT_EQ(lab.settings.readout_mode, 1);
}

TEST(LabFile, BrokenTextNamesTheLine) {
  EXPECT_EQ(error_of("seed = 1\nname = \"x").substr(0, 20), "bad.toml:2: not TOML");
  EXPECT_EQ(error_of("[camera]\n[camera]").substr(0, 20), "bad.toml:2: not TOML");
  EXPECT_EQ(error_of("seed = 1\nseed = 2").substr(0, 20), "bad.toml:2: not TOML");
  EXPECT_EQ(error_of("seed = 99999999999999999999").substr(0, 20), "bad.toml:1: not TOML");
  EXPECT_EQ(error_of("name = \"\xff\"").substr(0, 20), "bad.toml:1: not TOML");
  EXPECT_EQ(error_of("{\n\"seed\": 1,\n}", true).substr(0, 20), "bad.json:3: not JSON");
  EXPECT_EQ(error_of("", true).substr(0, 20), "bad.json:1: not JSON");
  EXPECT_EQ(error_of("{\"name\": \"\xff\"}", true).substr(0, 20), "bad.json:1: not JSON");
  EXPECT_EQ(error_of("{\"seed\": 1} x", true).substr(0, 20), "bad.json:1: not JSON");
  EXPECT_EQ(error_of("{\"seed\": 1e999}", true).substr(0, 20), "bad.json:1: not JSON");
  EXPECT_EQ(error_of("{\"seed\": 1,\n\"seed\": 2}", true), "bad.json:2: key 'seed' twice");
}

TEST(LabFile, DepthHasALimit) {
  // Dots that nest nothing do no harm.
  EXPECT_EQ(error_of("name = \"" + std::string(150, '.') + "\" # " + std::string(150, '.')), "no error");
  EXPECT_EQ(error_of("name = \"\\\"" + std::string(150, '.') + "\""), "no error");
  EXPECT_EQ(error_of("name = '" + std::string(150, '.') + "'\nseed = 1"), "no error");
  EXPECT_EQ(error_of("name = \"\"\"" + std::string(150, '.') + "\"\"\""), "no error");
  for (const int depth : {100, 1000, 1000000}) {
    const std::string open(depth, '[');
    EXPECT_EQ(error_of("seed = " + open).substr(0, 20), "bad.toml:1: not TOML") << depth;
    EXPECT_EQ(error_of("{\"seed\": " + open, true), "bad.json:1: nested deeper than 64 levels") << depth;
    std::string dots = "a";
    for (int i = 0; i < depth; ++i) dots += ".a";
    for (const std::string& text :
         {dots + " = 1", "[" + dots + "]", "seed = {" + dots + " = 1}", "name = '#'\n\"#\"." + dots + " = 1",
          "x = {a = \"\"\"b\"\"\"\"\", " + dots + " = 1}"}) {
      EXPECT_NE(error_of(text).find("nested deeper than 64 levels"), std::string::npos)
          << depth << error_of(text);
    }
  }
}

TEST(LabFile, MegabytesOfGarbageGiveOneShortLine) {
  RandomStream random(1, stream_id("tests/garbage"), 0, 0);
  std::string bytes(10'000'000, ' ');
  for (char& byte : bytes) byte = static_cast<char>(random());
  const std::string letters(10'000'000, 'a');
  for (const std::string& text :
       {bytes, letters, letters + " = 1", "{\"" + letters + "\": 1}", "\"" + letters + "\"",
        std::string(10'000'000, '\0'), std::string(10'000'000, '{')}) {
    for (const bool json : {false, true}) {
      const std::string error = error_of(text, json);
      EXPECT_NE(error, "no error");
      EXPECT_LT(error.size(), 400u) << error.substr(0, 400);
    }
  }
}

TEST(LabFile, AMutatedLabIsReadOrRefused) {
  const std::string base = write_lab(preset("ixon-ultra-897"), true);
  const std::string base_json = write_lab_json(preset("orca-quest"));
  RandomStream random(3, stream_id("tests/mutation"), 0, 0);
  int refused = 0;
  constexpr int rounds = 600;
  for (int round = 0; round < rounds; ++round) {
    const bool json = round % 2 == 1;
    std::string text = json ? base_json : base;
    for (unsigned change = 0; change <= random() % 4; ++change) {
      const std::size_t at = random() % text.size();
      switch (random() % 3) {
        case 0:
          text[at] = static_cast<char>(random());
          break;
        case 1:
          text.erase(at, random() % 20);
          break;
        default:
          text.insert(at, text.substr(random() % text.size(), random() % 40));
          break;
      }
    }
    try {
      check_lab(parse_lab(text, "mutated", json), "mutated");
    } catch (const Error&) {
      ++refused;
    }
  }
  EXPECT_GT(refused, rounds / 4);
  EXPECT_LT(refused, rounds);
}

TEST(LabFile, FilesThatAreNoneSaySo) {
  const Folder folder;
  const std::string path = folder.path().string();
  EXPECT_EQ(read_error(folder.path() / "absent.toml"), path + "/absent.toml: no such file");
  EXPECT_EQ(read_error(folder.path()), path + ": is a directory; allowed a file");
  EXPECT_EQ(read_error(folder.write("lab.yaml", "seed: 1")),
            path + "/lab.yaml: extension '.yaml'; allowed .toml, .json");
  EXPECT_EQ(read_error(folder.write("lab.toml", "seed = x")).substr(0, path.size() + 12),
            path + "/lab.toml:1:");
  EXPECT_EQ(read_lab(folder.write("lab.json", "{\"seed\": 9}")).seed, 9u);
}

TEST(LabFile, TheExamplesAreGood) {
  int examples = 0;
  for (const auto& entry : std::filesystem::directory_iterator(ATOMCAM_SOURCE_DIR "/labs")) {
    SCOPED_TRACE(entry.path().string());
    EXPECT_NO_THROW(read_lab(entry.path()));
    ++examples;
  }
  EXPECT_GE(examples, 2);
}

}  // namespace
}  // namespace atomcam
