#pragma once
// The report of a diagnosis, one self-contained page.

#include <string>
#include <vector>

#include "diagnosis/diagnosis.hpp"
#include "diagnosis/diagnosis_json.hpp"
#include "diagnosis/profiles.hpp"

namespace atomcam {

/// What is drawn: the real frames, the plain model (or another stack in its place), the model with the found
/// effects (empty: none found).
struct ReportProfiles {
  Profiles real;
  std::vector<Profiles> plain, fixed;
  std::string other = "plain model";  // what `plain` is called
};

/// How many simulated stacks a band is drawn from: fewer for large stacks.
int report_stacks(std::size_t frames, std::size_t pixels);

std::string diagnosis_report(const Diagnosis& diagnosis, const DiagnosisInputs& inputs,
                             const ReportProfiles& profiles);

}  // namespace atomcam
