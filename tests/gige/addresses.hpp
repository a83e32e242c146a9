#pragma once
// Addresses that no other process of the tests uses at the same time.

#include <unistd.h>

#include <string>

namespace atomcam::test {

inline std::string own_address(int number) {
  const int process = static_cast<int>(::getpid());
  return "127." + std::to_string(64 + (process >> 8 & 127)) + "." + std::to_string(process & 255) + "." +
         std::to_string(number);
}

}  // namespace atomcam::test
