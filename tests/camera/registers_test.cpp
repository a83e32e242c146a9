// The register space, the XML and the features by name are three views of one table.

#include <gtest/gtest.h>

#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <map>
#include <sstream>

#include "camera/big_endian.hpp"
#include "fixtures.hpp"

namespace atomcam::test {
namespace {

std::vector<SourceControl> example_controls() {
  FeatureDeclaration rate;
  rate.name = "SimScatteringRate";
  rate.category = "SimulationControl";
  rate.type = FeatureType::floating;
  rate.minimum = 0;
  rate.maximum = 1e7;
  rate.default_value = 1e5;
  FeatureDeclaration selector;
  selector.name = "SimZernikeSelector";
  selector.category = "SimulationControl";
  selector.type = FeatureType::enumeration;
  selector.entries = {{"tilt", 0, ""}, {"defocus", 1, ""}, {"coma", 2, ""}};
  FeatureDeclaration zernike;
  zernike.name = "SimZernike";
  zernike.category = "SimulationControl";
  zernike.type = FeatureType::floating;
  zernike.minimum = -1;
  zernike.maximum = 1;
  zernike.selector = selector.name;
  FeatureDeclaration noise;
  noise.name = "SimRowNoise";
  noise.category = "RowNoise";
  noise.type = FeatureType::floating;
  noise.minimum = 0;
  noise.maximum = 10;
  return {{rate, "atoms.scattering_rate_per_s", {}},
          {selector, "", {}},
          {zernike, "optics.zernike_um.*", {0, 0.01, 0}},
          {noise, "effects.row_noise.sigma_e", {}}};
}

std::vector<FeatureDeclaration> example_transport() {
  FeatureDeclaration size;
  size.name = "GevSCPSPacketSize";
  size.category = "TransportLayerControl";
  size.minimum = 220;
  size.maximum = 16404;
  size.increment = 4;
  size.address = 0xd04;
  size.length = 4;
  size.lsb = 0;
  size.msb = 15;
  FeatureDeclaration fire;
  fire.name = "GevSCPSFireTestPacket";
  fire.category = "TransportLayerControl";
  fire.type = FeatureType::command;
  fire.address = 0xd04;
  fire.length = 4;
  fire.lsb = 31;
  fire.msb = 31;
  FeatureDeclaration type;
  type.name = "DeviceTLType";
  type.category = "DeviceControl";
  type.type = FeatureType::enumeration;
  type.access = Access::read_only;
  type.entries = {{"GigEVision", 0, ""}};
  return {size, fire, type};
}

struct Model {
  const char* name;
  CameraModel (*make)();
};
void PrintTo(const Model& model, std::ostream* os) {
  *os << model.name;
}

class EachModel : public testing::TestWithParam<Model> {};
INSTANTIATE_TEST_SUITE_P(Models, EachModel,
                         testing::Values(Model{"ixon", ixon_model}, Model{"orca", orca_model}),
                         [](const auto& each) { return each.param.name; });

std::vector<std::uint8_t> read(Camera& camera, std::uint64_t address, int length) {
  std::vector<std::uint8_t> bytes(static_cast<std::size_t>((length + 3) / 4 * 4));
  EXPECT_EQ(camera.read(static_cast<std::uint32_t>(address), bytes), RegisterStatus::ok)
      << std::hex << address;
  return bytes;
}

TEST_P(EachModel, EveryFeatureReadsTheSameByNameAndByRegister) {
  Bench bench(GetParam().make(), example_controls());
  int checked = 0;
  for (const FeatureDeclaration& d : bench.camera->features()) {
    if (d.chunk_id != 0 || d.type == FeatureType::command) continue;
    SCOPED_TRACE(d.name);
    const auto bytes = read(*bench.camera, d.address, d.length);
    const FeatureValue value = bench.camera->get(d.name);
    switch (d.type) {
      case FeatureType::floating:
        EXPECT_EQ(load_big_endian<double>(bytes.data()), std::get<double>(value));
        break;
      case FeatureType::integer:
        EXPECT_EQ(load_big_endian<std::int64_t>(bytes.data()), std::get<std::int64_t>(value));
        break;
      case FeatureType::boolean:
        EXPECT_EQ(load_big_endian<std::int32_t>(bytes.data()) == 1, std::get<bool>(value));
        break;
      case FeatureType::enumeration: {
        const auto number = load_big_endian<std::int32_t>(bytes.data());
        const auto entry = std::find_if(d.entries.begin(), d.entries.end(),
                                        [&](const EnumEntry& e) { return e.value == number; });
        ASSERT_NE(entry, d.entries.end());
        EXPECT_EQ(entry->name, std::get<std::string>(value));
        break;
      }
      case FeatureType::string:
        EXPECT_EQ(std::string(reinterpret_cast<const char*>(bytes.data())), std::get<std::string>(value));
        break;
      case FeatureType::command:
        break;
    }
    ++checked;
  }
  EXPECT_GT(checked, 80);
}

// A small reader of the XML: node name -> its child elements' texts, in order.
struct Node {
  std::string tag;
  std::multimap<std::string, std::string> children;
  std::string child(const std::string& name) const {
    const auto found = children.find(name);
    return found == children.end() ? "" : found->second;
  }
};
std::map<std::string, Node> parse(const std::string& xml) {
  std::map<std::string, Node> nodes;
  std::istringstream lines(xml);
  std::string line, name;
  const auto between = [&](const std::string& from, const std::string& to) {
    const auto start = line.find(from) + from.size();
    return line.substr(start, line.find(to, start) - start);
  };
  while (std::getline(lines, line)) {
    const std::size_t depth = line.find('<');
    if (depth == 2 && line[3] != '/') {
      name = between("Name=\"", "\"");
      EXPECT_TRUE(nodes.emplace(name, Node{between("<", " "), {}}).second) << "two nodes named " << name;
    } else if (depth == 4 && line.find("</") != std::string::npos && line.find("</") != depth) {
      std::string tag = between("<", ">");
      nodes[name].children.emplace(tag.substr(0, tag.find(' ')), between(">", "</"));
    }
  }
  return nodes;
}

TEST_P(EachModel, XmlTellsTheAddressesOfTheRegisters) {
  Bench bench(GetParam().make(), example_controls());
  const auto transport = example_transport();
  const auto nodes = parse(bench.camera->genicam_xml(transport));
  const std::map<FeatureType, std::string> tags = {
      {FeatureType::integer, "Integer"}, {FeatureType::floating, "Float"},
      {FeatureType::boolean, "Boolean"}, {FeatureType::enumeration, "Enumeration"},
      {FeatureType::command, "Command"}, {FeatureType::string, "StringReg"}};
  for (const FeatureDeclaration& d : bench.camera->features()) {
    SCOPED_TRACE(d.name);
    ASSERT_TRUE(nodes.contains(d.name));
    const Node& node = nodes.at(d.name);
    EXPECT_EQ(node.tag, tags.at(d.type));
    EXPECT_FALSE(node.child("ToolTip").empty() && d.category != "SimulationControl" &&
                 d.category != "RowNoise");
    const Node& place = d.type == FeatureType::string ? node : nodes.at(node.child("pValue"));
    if (d.chunk_id == 0) {
      EXPECT_EQ(std::stoull(place.child("Address"), nullptr, 16), d.address);
      EXPECT_EQ(place.child("pPort"), "Device");
    } else {
      EXPECT_EQ(std::stoul(place.child("Address"), nullptr, 16), 0u);
      EXPECT_EQ(std::stoul(nodes.at(place.child("pPort")).child("ChunkID"), nullptr, 16), d.chunk_id);
    }
    EXPECT_EQ(std::stoi(place.child("Length")), d.length);
    EXPECT_EQ(place.child("AccessMode"), d.access == Access::read_only    ? "RO"
                                         : d.access == Access::write_only ? "WO"
                                                                          : "RW");
    // Companion registers are where the XML says, and hold the range.
    if (d.dynamic_range) {
      const FeatureRange range = bench.camera->range(d.name);
      for (const auto& [tag, expected] : {std::pair{"pMin", range.minimum}, {"pMax", range.maximum}}) {
        const Node& companion = nodes.at(node.child(tag));
        const auto bytes = read(*bench.camera, std::stoull(companion.child("Address"), nullptr, 16), 8);
        EXPECT_EQ(d.type == FeatureType::floating
                      ? load_big_endian<double>(bytes.data())
                      : static_cast<double>(load_big_endian<std::int64_t>(bytes.data())),
                  expected);
      }
    }
  }
  // Every reference leads to a node.
  for (const auto& [name, node] : nodes)
    for (const auto& [tag, text] : node.children)
      if (tag[0] == 'p' && std::isupper(static_cast<unsigned char>(tag[1]))) {
        EXPECT_TRUE(nodes.contains(text)) << name << " " << tag << " " << text;
      }
  // Bit fields of the transport's registers count from the most significant bit.
  EXPECT_EQ(nodes.at("GevSCPSPacketSize_Value").child("LSB"), "31");
  EXPECT_EQ(nodes.at("GevSCPSPacketSize_Value").child("MSB"), "16");
  EXPECT_EQ(nodes.at("GevSCPSFireTestPacket_Value").child("LSB"), "0");
}

std::string output_of(const std::string& command) {
  std::string output;
  if (FILE* pipe = popen((command + " 2>&1").c_str(), "r")) {
    char buffer[4096];
    while (std::fgets(buffer, sizeof buffer, pipe) != nullptr) output += buffer;
    const int status = pclose(pipe);
    return status == 0 ? output : "FAILED: " + output;
  }
  return "FAILED: popen";
}

// The schema is not ours to ship: a path in ATOMCAM_GENAPI_SCHEMA, or what the installed Aravis library
// holds.
std::string find_schema() {
  if (const char* given = std::getenv("ATOMCAM_GENAPI_SCHEMA")) return given;
  const std::string library = "/usr/lib/x86_64-linux-gnu/libaravis-0.8.so";
  std::istringstream list(output_of("gresource list " + library));
  std::string resource;
  while (std::getline(list, resource)) {
    if (resource.find("GenApiSchema_Version_1_1") == std::string::npos) continue;
    const std::string file = testing::TempDir() + "GenApiSchema_Version_1_1.xsd";
    output_of("gresource extract " + library + " " + resource + " > " + file);
    return file;
  }
  return "";
}

TEST_P(EachModel, XmlFollowsTheSchema) {
  const std::string schema = find_schema();
  if (schema.empty())
    GTEST_SKIP() << "no GenApi schema: set ATOMCAM_GENAPI_SCHEMA to GenApiSchema_Version_1_1.xsd";
  Bench bench(GetParam().make(), example_controls());
  const std::string file = testing::TempDir() + "atomcam-" + GetParam().name + ".xml";
  const auto transport = example_transport();
  std::ofstream(file) << bench.camera->genicam_xml(transport);
  EXPECT_EQ(output_of("xmllint --noout --schema " + schema + " " + file).find("FAILED"), std::string::npos)
      << output_of("xmllint --noout --schema " + schema + " " + file);
}

TEST_P(EachModel, XmlIsTheOneThatWasReviewed) {
  Bench bench(GetParam().make());
  const std::string name = std::string(GetParam().name) == "ixon" ? "ixon-ultra-897.xml" : "orca-quest.xml";
  const std::string path = std::string(ATOMCAM_SOURCE_DIR) + "/genicam/" + name;
  const std::string xml = bench.camera->genicam_xml({});
  if (std::getenv("ATOMCAM_UPDATE_GOLDEN") != nullptr) std::ofstream(path) << xml;
  std::ifstream file(path);
  std::stringstream golden;
  golden << file.rdbuf();
  EXPECT_TRUE(golden.str() == xml) << "differs from " << path
                                   << "; rewrite it with ATOMCAM_UPDATE_GOLDEN=1 and review";
}

}  // namespace
}  // namespace atomcam::test
