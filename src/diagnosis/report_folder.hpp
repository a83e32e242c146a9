#pragma once
// A diagnosis's files: diagnosis.json, lab.toml, report.html.

#include <filesystem>
#include <functional>

#include "diagnosis/diagnosis.hpp"
#include "diagnosis/diagnosis_json.hpp"

namespace atomcam {

/// Into a folder, which is made. The bands of the report's figures are simulated for it, on `threads`
/// threads, and the frames are gone through once more. `against`: what they were compared with; null: their
/// simulation. `cache`: folder that keeps the bands for the next time; empty: none. `progress`: how much of
/// this is done (0 to 1), from any of the threads; what it throws ends the work, and nothing is written.
void write_diagnosis(const std::filesystem::path& folder, const Diagnosis& diagnosis,
                     const DiagnosisInputs& inputs, const FrameSequence& frames, const FrameSequence* darks,
                     const FrameSequence* against, int threads, const std::filesystem::path& cache,
                     const std::function<void(double done)>& progress = {});

}  // namespace atomcam
