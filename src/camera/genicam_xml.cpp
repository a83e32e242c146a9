#include "camera/genicam_xml.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <map>

#include "base/random.hpp"

namespace atomcam {

namespace {

std::string escaped(std::string_view text) {
  std::string out;
  for (const char letter : text) {
    switch (letter) {
      case '&':
        out += "&amp;";
        break;
      case '<':
        out += "&lt;";
        break;
      case '>':
        out += "&gt;";
        break;
      case '"':
        out += "&quot;";
        break;
      default:
        out += letter;
    }
  }
  return out;
}

// A name that starts with a letter and goes on with letters, digits and underscores.
std::string identifier(std::string_view text) {
  std::string name;
  for (const char letter : text) {
    const bool plain = std::isalnum(static_cast<unsigned char>(letter)) != 0;
    if (plain)
      name += letter;
    else if (!name.empty() && name.back() != '_')
      name += '_';
  }
  while (!name.empty() && name.back() == '_') name.pop_back();
  return name.empty() || !std::isalpha(static_cast<unsigned char>(name[0])) ? "C" + name : name;
}

// Same text, same identifier, on every machine.
std::string guid_of(std::string_view text) {
  const std::uint64_t high = stream_id(text);
  const std::uint64_t low = stream_id(std::string(text) + "#");
  return fmt::format("{:08x}-{:04x}-{:04x}-{:04x}-{:012x}", high >> 32, high >> 16 & 0xffff, high & 0xffff,
                     low >> 48, low & 0xffffffffffff);
}

std::string integer_text(double value) {
  return fmt::format("{}", static_cast<std::int64_t>(value));
}
std::string float_text(double value) {
  return fmt::format("{}", value);
}

const char* visibility_name(Visibility visibility) {
  switch (visibility) {
    case Visibility::beginner:
      return "Beginner";
    case Visibility::expert:
      return "Expert";
    case Visibility::guru:
      return "Guru";
    case Visibility::invisible:
      return "Invisible";
  }
  return "";
}

const char* access_name(Access access) {
  return access == Access::read_only ? "RO" : access == Access::write_only ? "WO" : "RW";
}

/// What a declaration needs to become nodes: its registers, or none for a constant.
struct Source {
  const FeatureDeclaration& declaration;
  std::uint64_t address = 0;  // 0 with no chunk: a constant
  int length = 0;
  bool changes = true;  // by others or by itself: not to be cached
  std::uint64_t minimum = 0, maximum = 0, increment = 0, entries = 0, locked = 0;  // addresses; 0: none
  bool commands_can_lock = false;
};

class Writer {
 public:
  std::string take() { return std::move(text_); }

  void line(int depth, std::string_view text) {
    text_.append(static_cast<std::size_t>(2 * depth), ' ');
    text_ += text;
    text_ += '\n';
  }
  void element(int depth, std::string_view tag, std::string_view value) {
    if (!value.empty()) line(depth, fmt::format("<{0}>{1}</{0}>", tag, escaped(value)));
  }

  void feature(const Source& source, std::span<const std::string> selected) {
    const FeatureDeclaration& d = source.declaration;
    switch (d.type) {
      case FeatureType::integer:
        return integer(source, selected);
      case FeatureType::floating:
        return floating(source);
      case FeatureType::boolean:
        return boolean(source);
      case FeatureType::enumeration:
        return enumeration(source, selected);
      case FeatureType::command:
        return command(source);
      case FeatureType::string:
        return string(source);
    }
  }

  void register_node(const std::string& name, std::uint64_t address, int length, std::string_view access,
                     std::string_view port, bool floating, bool cached, int lsb = -1, int msb = -1) {
    const std::string tag = floating ? "FloatReg" : lsb >= 0 ? "MaskedIntReg" : "IntReg";
    line(1, fmt::format("<{} Name=\"{}\" NameSpace=\"Custom\">", tag, name));
    element(2, "Visibility", "Invisible");
    place(address, length, access, port, cached);
    if (lsb >= 0) {
      // In a big-endian register GenApi counts bits from the most significant one.
      element(2, "LSB", integer_text(31 - lsb));
      element(2, "MSB", integer_text(31 - msb));
    }
    if (!floating) element(2, "Sign", length == 8 ? "Signed" : "Unsigned");
    element(2, "Endianess", "BigEndian");
    line(1, fmt::format("</{}>", tag));
  }

 private:
  void open(const Source& source, const char* tag) {
    const FeatureDeclaration& d = source.declaration;
    line(1, fmt::format("<{} Name=\"{}\" NameSpace=\"{}\">", tag, d.name, d.custom ? "Custom" : "Standard"));
    element(2, "ToolTip", d.tooltip);
    element(2, "Visibility", visibility_name(d.visibility));
    if (d.chunk_id != 0) element(2, "pIsAvailable", "ChunkModeActive");
    if (source.locked != 0)
      element(2, "pIsLocked", d.name + "_Locked");
    else if (d.locked_while_acquiring)
      element(2, "pIsLocked", "ParametersLocked");
    if (constant(source) && d.type != FeatureType::command) element(2, "ImposedAccessMode", "RO");
  }
  void close(const char* tag) { line(1, fmt::format("</{}>", tag)); }

  static bool constant(const Source& source) {
    return source.address == 0 && source.declaration.chunk_id == 0;
  }
  static std::string port(const FeatureDeclaration& d) {
    return d.chunk_id == 0 ? "Device" : d.name + "_Port";
  }

  void place(std::uint64_t address, int length, std::string_view access, std::string_view port_name,
             bool cached) {
    element(2, "Address", fmt::format("0x{:x}", address));
    element(2, "Length", integer_text(length));
    element(2, "AccessMode", access);
    element(2, "pPort", port_name);
    element(2, "Cachable", cached ? "WriteThrough" : "NoCache");
  }

  void value_register(const Source& source) {
    const FeatureDeclaration& d = source.declaration;
    if (constant(source)) return;
    register_node(d.name + "_Value", source.address, source.length, access_name(d.access), port(d),
                  d.type == FeatureType::floating, !source.changes, d.lsb, d.msb);
  }
  void companions(const Source& source) {
    const FeatureDeclaration& d = source.declaration;
    const bool floats = d.type == FeatureType::floating;
    const auto one = [&](const char* suffix, std::uint64_t address, int length, bool floating) {
      if (address != 0) register_node(d.name + suffix, address, length, "RO", "Device", floating, false);
    };
    one("_Min", source.minimum, 8, floats);
    one("_Max", source.maximum, 8, floats);
    if (!floats) one("_Inc", source.increment, 8, false);
    one("_Entries", source.entries, 8, false);
    one("_Locked", source.locked, 4, false);
  }
  void streamable(const FeatureDeclaration& d) {
    if (d.access == Access::read_write) element(2, "Streamable", "Yes");
  }
  void selections(std::span<const std::string> selected) {
    for (const std::string& name : selected) element(2, "pSelected", name);
  }

  void integer(const Source& source, std::span<const std::string> selected) {
    const FeatureDeclaration& d = source.declaration;
    open(source, "Integer");
    streamable(d);
    if (constant(source))
      element(2, "Value", integer_text(d.default_value));
    else
      element(2, "pValue", d.name + "_Value");
    if (source.minimum != 0) {
      element(2, "pMin", d.name + "_Min");
      element(2, "pMax", d.name + "_Max");
      element(2, "pInc", d.name + "_Inc");
    } else if (d.minimum <= d.maximum && (d.minimum != 0 || d.maximum != 0)) {
      // Bounds beyond what a double holds exactly mean no bounds.
      if (std::fabs(d.minimum) < 9e15) element(2, "Min", integer_text(d.minimum));
      if (std::fabs(d.maximum) < 9e15) element(2, "Max", integer_text(d.maximum));
      if (d.increment > 1) element(2, "Inc", integer_text(d.increment));
    }
    element(2, "Unit", d.unit);
    element(2, "Representation", d.logarithmic ? "Logarithmic" : "");
    selections(selected);
    close("Integer");
    value_register(source);
    companions(source);
  }

  void floating(const Source& source) {
    const FeatureDeclaration& d = source.declaration;
    open(source, "Float");
    streamable(d);
    if (constant(source))
      element(2, "Value", float_text(d.default_value));
    else
      element(2, "pValue", d.name + "_Value");
    if (source.minimum != 0) {
      element(2, "pMin", d.name + "_Min");
      element(2, "pMax", d.name + "_Max");
    } else if (d.minimum != 0 || d.maximum != 0) {
      element(2, "Min", float_text(d.minimum));
      element(2, "Max", float_text(d.maximum));
    }
    element(2, "Unit", d.unit);
    element(2, "Representation", d.logarithmic ? "Logarithmic" : "");
    close("Float");
    value_register(source);
    companions(source);
  }

  void boolean(const Source& source) {
    const FeatureDeclaration& d = source.declaration;
    open(source, "Boolean");
    streamable(d);
    if (constant(source)) {
      element(2, "Value", d.default_value != 0 ? "true" : "false");
    } else {
      element(2, "pValue", d.name + "_Value");
      element(2, "OnValue", "1");
      element(2, "OffValue", "0");
    }
    close("Boolean");
    value_register(source);
    companions(source);
  }

  void enumeration(const Source& source, std::span<const std::string> selected) {
    const FeatureDeclaration& d = source.declaration;
    open(source, "Enumeration");
    streamable(d);
    for (const EnumEntry& entry : d.entries) {
      line(2, fmt::format("<EnumEntry Name=\"{}\" NameSpace=\"{}\">", entry.name,
                          d.custom ? "Custom" : "Standard"));
      element(3, "ToolTip", entry.tooltip);
      if (source.entries != 0) element(3, "pIsAvailable", entry_name(d, entry));
      element(3, "Value", fmt::format("{}", entry.value));
      line(2, "</EnumEntry>");
    }
    if (constant(source))
      element(2, "Value", integer_text(d.default_value));
    else
      element(2, "pValue", d.name + "_Value");
    selections(selected);
    close("Enumeration");
    value_register(source);
    companions(source);
    if (source.entries == 0) return;
    for (std::size_t i = 0; i < d.entries.size(); ++i) {
      line(1, fmt::format("<IntSwissKnife Name=\"{}\" NameSpace=\"Custom\">", entry_name(d, d.entries[i])));
      element(2, "Visibility", "Invisible");
      line(2, fmt::format("<pVariable Name=\"ENTRIES\">{}_Entries</pVariable>", d.name));
      element(2, "Formula", fmt::format("(ENTRIES >> {}) & 1", i));
      line(1, "</IntSwissKnife>");
    }
  }
  static std::string entry_name(const FeatureDeclaration& d, const EnumEntry& entry) {
    return d.name + "_" + entry.name + "_Available";
  }

  void command(const Source& source) {
    const FeatureDeclaration& d = source.declaration;
    open(source, "Command");
    if (constant(source))
      element(2, "Value", "0");
    else
      element(2, "pValue", d.name + "_Value");
    element(2, "CommandValue", integer_text(d.default_value != 0 ? d.default_value : 1));
    close("Command");
    value_register(source);
    companions(source);
  }

  void string(const Source& source) {
    const FeatureDeclaration& d = source.declaration;
    if (constant(source)) {
      open(source, "String");
      line(2, fmt::format("<Value>{}</Value>", escaped(d.default_string)));
      close("String");
      return;
    }
    open(source, "StringReg");
    streamable(d);
    place(source.address, source.length, access_name(d.access), port(d), !source.changes);
    close("StringReg");
    companions(source);
  }

  std::string text_;
};

Source source_of(const Feature& feature, int index, const RegisterMap& map) {
  const FeatureDeclaration& d = feature.declaration;
  Source source{.declaration = d};
  source.length = value_length(d);
  if (d.chunk_id != 0) return source;
  source.address = map.address(index, RegisterPart::value);
  // Whatever can be written can change with something else: another feature, a user set, another client.
  source.changes = d.access != Access::read_only || feature.computed() || !d.selector.empty();
  if (feature.range) {
    source.minimum = map.address(index, RegisterPart::minimum);
    source.maximum = map.address(index, RegisterPart::maximum);
    source.increment = map.address(index, RegisterPart::increment);
  }
  if (feature.entries) source.entries = map.address(index, RegisterPart::entries);
  if (feature.locked) source.locked = map.address(index, RegisterPart::locked);
  return source;
}

Source source_of(const FeatureDeclaration& d) {
  Source source{.declaration = d};
  source.address = d.address;
  source.length = d.length > 0 ? d.length : value_length(d);
  return source;
}

}  // namespace

std::string genicam_xml(const CameraModel& model, const std::vector<Feature>& features,
                        const RegisterMap& map, std::span<const FeatureDeclaration> transport_features) {
  // Categories in the order of their appearance; those the SFNC does not know lie below SimulationControl.
  std::vector<std::string> categories;
  std::map<std::string, std::vector<std::string>> members;
  std::map<std::string, std::vector<std::string>> selected;
  const auto enlist = [&](const FeatureDeclaration& d) {
    if (members[d.category].empty()) categories.push_back(d.category);
    members[d.category].push_back(d.name);
    if (!d.selector.empty()) selected[d.selector].push_back(d.name);
  };
  for (const Feature& feature : features) enlist(feature.declaration);
  for (const FeatureDeclaration& declaration : transport_features) enlist(declaration);

  std::vector<std::string> top, below;
  for (const std::string& category : categories)
    (category.ends_with("Control") ? top : below).push_back(category);

  Writer writer;
  writer.line(1, "<Category Name=\"Root\" NameSpace=\"Standard\">");
  for (const std::string& category : top) writer.element(2, "pFeature", category);
  writer.line(1, "</Category>");
  for (const std::string& category : categories) {
    const bool standard = category.ends_with("Control") && category != "SimulationControl";
    writer.line(1, fmt::format("<Category Name=\"{}\" NameSpace=\"{}\">", category,
                               standard ? "Standard" : "Custom"));
    for (const std::string& name : members[category]) writer.element(2, "pFeature", name);
    if (category == "SimulationControl")
      for (const std::string& name : below) writer.element(2, "pFeature", name);
    writer.line(1, "</Category>");
  }
  for (std::size_t i = 0; i < features.size(); ++i)
    writer.feature(source_of(features[i], static_cast<int>(i), map), selected[features[i].declaration.name]);
  for (const FeatureDeclaration& declaration : transport_features)
    writer.feature(source_of(declaration), selected[declaration.name]);
  writer.line(1, "<Port Name=\"Device\" NameSpace=\"Standard\"></Port>");
  for (const Feature& feature : features) {
    const FeatureDeclaration& d = feature.declaration;
    if (d.chunk_id == 0) continue;
    writer.line(1, fmt::format("<Port Name=\"{}_Port\" NameSpace=\"Custom\">", d.name));
    writer.element(2, "ChunkID", fmt::format("{:08X}", d.chunk_id));
    writer.line(1, "</Port>");
  }
  const std::string nodes = writer.take();

  std::string xml = "<?xml version=\"1.0\" encoding=\"utf-8\"?>\n";
  xml += fmt::format(
      "<RegisterDescription ModelName=\"{}\" VendorName=\"{}\" ToolTip=\"{}\" StandardNameSpace=\"{}\"\n"
      "    SchemaMajorVersion=\"1\" SchemaMinorVersion=\"1\" SchemaSubMinorVersion=\"0\" MajorVersion=\"1\" "
      "MinorVersion=\"0\" SubMinorVersion=\"0\"\n"
      "    ProductGuid=\"{}\" VersionGuid=\"{}\"\n"
      "    xmlns=\"http://www.genicam.org/GenApi/Version_1_1\" "
      "xmlns:xsi=\"http://www.w3.org/2001/XMLSchema-instance\"\n"
      "    xsi:schemaLocation=\"http://www.genicam.org/GenApi/Version_1_1 GenApiSchema_Version_1_1.xsd\">\n",
      identifier(model.model), identifier(model.vendor), escaped(model.model),
      transport_features.empty() ? "None" : "GEV", guid_of(model.vendor + "/" + model.model), guid_of(nodes));
  return xml + nodes + "</RegisterDescription>\n";
}

}  // namespace atomcam
