#include "gige/bootstrap.hpp"

namespace atomcam::gige {

void BootstrapRegisters::declare_string(std::uint32_t address, std::size_t bytes, std::string_view text) {
  for (std::size_t at = 0; at < bytes; at += 4) declare(address + static_cast<std::uint32_t>(at), 0);
  set_string(address, bytes, text);
}

void BootstrapRegisters::set_string(std::uint32_t address, std::size_t bytes, std::string_view text) {
  text = text.substr(0, bytes);
  for (std::size_t at = 0; at < bytes; at += 4) {
    std::uint32_t word = 0;
    for (std::size_t i = at; i < at + 4; ++i)
      word = word << 8 | (i < text.size() ? static_cast<std::uint8_t>(text[i]) : 0u);
    set(address + static_cast<std::uint32_t>(at), word);
  }
}

Status BootstrapRegisters::read(std::uint32_t address, std::uint32_t& value) const {
  const Word& word = words_[address / 4];
  if (!word.readable) return word.writable ? Status::access_denied : Status::invalid_address;
  value = word.value;
  return Status::success;
}

Status BootstrapRegisters::read(std::uint32_t address, std::size_t bytes,
                                std::vector<std::uint8_t>& out) const {
  if (address + bytes > reg::end) return Status::invalid_address;
  bool any = false;
  for (std::uint32_t at = address; at < address + bytes; at += 4) {
    any = any || exists(at);
    append32(out, readable(at) ? value(at) : 0);
  }
  return any ? Status::success : Status::invalid_address;
}

}  // namespace atomcam::gige
