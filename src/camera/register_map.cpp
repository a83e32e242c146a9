#include "camera/register_map.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cstring>

#include "base/error.hpp"
#include "camera/big_endian.hpp"

namespace atomcam {

namespace {

// The order is part of the addresses: append only.
constexpr std::array<std::string_view, 9> categories = {
    "DeviceControl", "ImageFormatControl", "AcquisitionControl",
    "AnalogControl", "DigitalIOControl",   "ChunkDataControl",
    "EventControl",  "UserSetControl",     "TransportLayerControl"};
constexpr std::uint32_t category_bytes = 0x2000;
// Simulation controls, and the categories below them in the order of their appearance.
constexpr std::uint32_t simulation_address = 0x40000;
constexpr std::uint32_t simulation_category_bytes = 0x1000;
constexpr std::uint32_t end_address = 0x100000;
constexpr std::uint32_t slot_bytes = 0x40;

constexpr std::uint32_t offset(RegisterPart part) {
  return 8 * static_cast<std::uint32_t>(part);
}

std::uint32_t round_up(std::uint32_t bytes) {
  return (bytes + slot_bytes - 1) / slot_bytes * slot_bytes;
}

void store_register(const FeatureState& state, const FeatureRegister& entry, std::uint8_t* bytes) {
  const Feature& feature = state.features()[static_cast<std::size_t>(entry.feature)];
  const bool floating = feature.declaration.type == FeatureType::floating;
  const auto store = [&](double value) {
    if (floating)
      store_big_endian(value, bytes);
    else
      store_big_endian(static_cast<std::int64_t>(value), bytes);
  };
  switch (entry.part) {
    case RegisterPart::minimum:
      return store(state.range(entry.feature).minimum);
    case RegisterPart::maximum:
      return store(state.range(entry.feature).maximum);
    case RegisterPart::increment:
      return store(state.range(entry.feature).increment);
    case RegisterPart::entries:
      return store_big_endian(state.entries(entry.feature), bytes);
    case RegisterPart::locked:
      return store_big_endian(static_cast<std::uint32_t>(state.locked(entry.feature)), bytes);
    case RegisterPart::value:
      break;
  }
  switch (feature.declaration.type) {
    case FeatureType::floating:
      return store_big_endian(state.number(entry.feature), bytes);
    case FeatureType::integer:
      return store_big_endian(state.integer(entry.feature), bytes);
    case FeatureType::boolean:
    case FeatureType::enumeration:
      return store_big_endian(static_cast<std::int32_t>(state.integer(entry.feature)), bytes);
    case FeatureType::command:
      return store_big_endian(std::int32_t{0}, bytes);
    case FeatureType::string: {
      std::memset(bytes, 0, static_cast<std::size_t>(entry.length));
      const std::string text = state.text(entry.feature);
      std::memcpy(bytes, text.data(), std::min(text.size(), static_cast<std::size_t>(entry.length)));
      return;
    }
  }
}

}  // namespace

int value_length(const FeatureDeclaration& declaration) {
  switch (declaration.type) {
    case FeatureType::integer:
    case FeatureType::floating:
      return 8;
    case FeatureType::string:
      return declaration.string_length;
    default:
      return 4;
  }
}

RegisterMap::RegisterMap(const std::vector<Feature>& features) {
  std::map<std::string, std::uint32_t, std::less<>> next;
  std::map<std::string, std::uint32_t, std::less<>> end;
  for (std::size_t i = 0; i < categories.size(); ++i) {
    const auto start = TransportCamera::first_address + static_cast<std::uint32_t>(i) * category_bytes;
    next.emplace(categories[i], start);
    end.emplace(categories[i], start + category_bytes);
  }
  std::uint32_t next_category = simulation_address;
  for (std::size_t i = 0; i < features.size(); ++i) {
    const FeatureDeclaration& declaration = features[i].declaration;
    slots_.push_back(0);
    if (declaration.chunk_id != 0) continue;
    if (next.emplace(declaration.category, next_category).second) {
      next_category += simulation_category_bytes;
      end.emplace(declaration.category, next_category);
    }
    const std::uint32_t slot = next[declaration.category];
    const int length = value_length(declaration);
    next[declaration.category] = slot + std::max(slot_bytes, round_up(static_cast<std::uint32_t>(length)));
    if (next[declaration.category] > std::min(end[declaration.category], end_address))
      throw Error(declaration.name,
                  fmt::format("no room for it among the addresses of {}", declaration.category));
    slots_.back() = slot;
    const auto add = [&](RegisterPart part, int bytes) {
      const std::uint32_t address = slot + offset(part);
      registers_[address] = {static_cast<int>(i), part, address, bytes};
    };
    add(RegisterPart::value, length);
    if (features[i].range)
      for (const RegisterPart part : {RegisterPart::minimum, RegisterPart::maximum, RegisterPart::increment})
        add(part, 8);
    if (features[i].entries) add(RegisterPart::entries, 8);
    if (features[i].locked) add(RegisterPart::locked, 4);
  }
}

std::uint32_t RegisterMap::address(int feature, RegisterPart part) const {
  return slots_[static_cast<std::size_t>(feature)] + offset(part);
}

RegisterStatus RegisterMap::read(const FeatureState& state, std::uint32_t address,
                                 std::span<std::uint8_t> bytes) const {
  if (address % 4 != 0 || bytes.size() % 4 != 0) return RegisterStatus::bad_alignment;
  std::vector<std::uint8_t> whole;
  while (!bytes.empty()) {
    auto found = registers_.upper_bound(address);
    if (found == registers_.begin()) return RegisterStatus::invalid_address;
    const FeatureRegister& entry = (--found)->second;
    const std::uint32_t within = address - entry.address;
    const auto length = static_cast<std::uint32_t>(entry.length + 3) / 4 * 4;
    if (within >= length) return RegisterStatus::invalid_address;
    whole.assign(length, 0);
    store_register(state, entry, whole.data());
    const std::size_t count = std::min<std::size_t>(bytes.size(), length - within);
    std::memcpy(bytes.data(), whole.data() + within, count);
    bytes = bytes.subspan(count);
    address += static_cast<std::uint32_t>(count);
  }
  return RegisterStatus::ok;
}

const FeatureRegister* RegisterMap::writable(std::uint32_t address, std::size_t length,
                                             RegisterStatus& status) const {
  status = RegisterStatus::bad_alignment;
  if (address % 4 != 0 || length % 4 != 0 || length == 0) return nullptr;
  status = RegisterStatus::invalid_address;
  auto found = registers_.upper_bound(address);
  if (found == registers_.begin()) return nullptr;
  const FeatureRegister& entry = (--found)->second;
  if (address - entry.address >= static_cast<std::uint32_t>(entry.length)) return nullptr;
  status = RegisterStatus::write_protect;
  if (entry.part != RegisterPart::value) return nullptr;
  status = RegisterStatus::invalid_parameter;  // half a number
  if (address != entry.address || length > static_cast<std::size_t>(entry.length)) return nullptr;
  if (length != static_cast<std::size_t>(entry.length) && entry.length <= 8) return nullptr;
  status = RegisterStatus::ok;
  return &entry;
}

}  // namespace atomcam
