#pragma once
// The declaration of one camera feature in the sense of GenICam: name after the SFNC, type, range, access.
// The camera's register, its place in the XML, its checks and its documentation follow from it.

#include <cstdint>
#include <string>
#include <vector>

namespace atomcam {

enum class FeatureType { integer, floating, boolean, enumeration, string, command };
enum class Access { read_only, read_write, write_only };
enum class Visibility { beginner, expert, guru, invisible };

struct EnumEntry {
  std::string name;  // "Continuous"
  std::int64_t value = 0;
  std::string tooltip;
};

struct FeatureDeclaration {
  std::string name;      // SFNC name: "ExposureTime"
  std::string category;  // "AcquisitionControl"
  FeatureType type = FeatureType::integer;
  Access access = Access::read_write;
  Visibility visibility = Visibility::beginner;
  std::string tooltip;  // one sentence; with the reference where it is not the SFNC's own meaning
  std::string unit;     // SFNC unit: "us", "Hz"
  double minimum = 0;   // static bounds; a camera may narrow them at run time where `dynamic_range`
  double maximum = 0;
  double increment = 0;  // integers; 0: 1
  bool dynamic_range = false;
  bool logarithmic = false;  // representation
  std::vector<EnumEntry> entries;
  int string_length = 64;  // bytes of the register
  std::string selector;    // name of the enumeration feature that selects this one's value; empty: none
  bool locked_while_acquiring = false;  // refused while TLParamsLocked / acquiring, as on the real camera
  double default_value = 0;             // number, boolean or enumeration value
  std::string default_string;
  std::uint64_t address = 0;  // 0: the camera assigns one; else a register that already exists (transport)
  int length = 0;             // bytes of that register
  int lsb = -1;               // bit field of a 4-byte register, bit 31 = most significant; -1: whole
  int msb = -1;
  std::uint32_t chunk_id = 0;  // not 0: no register, the value travels in this chunk of a frame
  bool custom = false;         // not a name of the SFNC
};

}  // namespace atomcam
