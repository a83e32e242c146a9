#pragma once
// Where a camera's features lie in its register space. Every category has a block of addresses and every
// feature a slot in it, so a feature added at the end of a category moves no other.

#include <cstdint>
#include <map>
#include <span>
#include <vector>

#include "camera/feature_state.hpp"

namespace atomcam {

/// What a register of a feature holds. Numbers of integer and floating features are 8 bytes (two's
/// complement, IEEE double), of enumerations, booleans and commands 4, all big endian.
enum class RegisterPart { value, minimum, maximum, increment, entries, locked };

struct FeatureRegister {
  int feature = 0;
  RegisterPart part = RegisterPart::value;
  std::uint32_t address = 0;
  int length = 0;
};

class RegisterMap {
 public:
  explicit RegisterMap(const std::vector<Feature>& features);

  std::uint32_t address(int feature, RegisterPart part) const;
  /// Ordered by address.
  const std::map<std::uint32_t, FeatureRegister>& registers() const { return registers_; }

  /// Reads whatever registers the bytes cover; both ends aligned to four bytes.
  RegisterStatus read(const FeatureState& state, std::uint32_t address, std::span<std::uint8_t> bytes) const;
  /// The register that a write of `length` bytes hits; strings may be written in part. Null: none, see
  /// `status`.
  const FeatureRegister* writable(std::uint32_t address, std::size_t length, RegisterStatus& status) const;

 private:
  std::map<std::uint32_t, FeatureRegister> registers_;
  std::vector<std::uint32_t> slots_;  // by feature
};

int value_length(const FeatureDeclaration& declaration);

}  // namespace atomcam
