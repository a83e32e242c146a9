#pragma once
// diagnosis.json: a diagnosis for programs. Its keys are stable; docs/diagnosis.md explains them.

#include <cstdint>
#include <string>
#include <vector>

#include "diagnosis/diagnosis.hpp"

namespace atomcam {

/// What a diagnosis was made from, so that it can be made again.
struct DiagnosisInputs {
  struct File {
    std::string role;  // "frames", "darks", "notes"
    std::string path;
    std::string sha256;
    std::size_t frames = 0;  // 0: not a stack
    Shape shape;
  };
  std::vector<File> files;
  std::vector<std::string> exclude, include;
  std::uint64_t seed = 1;
  std::string version;
  std::string command;
};

std::string diagnosis_json(const Diagnosis& diagnosis, const DiagnosisInputs& inputs);

}  // namespace atomcam
