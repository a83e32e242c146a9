#pragma once
// SHA-256 of whatever is added, in pieces.

#include <nettle/sha2.h>

#include <array>
#include <cstddef>
#include <cstdint>
#include <string>

namespace atomcam {

class Sha256 {
 public:
  Sha256() { sha256_init(&state_); }
  void add(const void* bytes, std::size_t size) {
    sha256_update(&state_, size, static_cast<const std::uint8_t*>(bytes));
  }
  /// 64 hexadecimal digits; starts anew.
  std::string digits() {
    std::array<std::uint8_t, SHA256_DIGEST_SIZE> digest;
    sha256_digest(&state_, digest.size(), digest.data());
    constexpr char hexadecimal[] = "0123456789abcdef";
    std::string text;
    for (const std::uint8_t byte : digest) {
      text += hexadecimal[byte >> 4];
      text += hexadecimal[byte & 15];
    }
    return text;
  }

 private:
  sha256_ctx state_;
};

}  // namespace atomcam
