#include "diagnosis/report_folder.hpp"

#include <optional>

#include "data/output_files.hpp"
#include "diagnosis/kept_profiles.hpp"
#include "diagnosis/profiles.hpp"
#include "diagnosis/report.hpp"

namespace atomcam {

void write_diagnosis(const std::filesystem::path& folder, const Diagnosis& diagnosis,
                     const DiagnosisInputs& inputs, const FrameSequence& all_frames,
                     const FrameSequence* all_darks, const FrameSequence* against, int threads,
                     const std::filesystem::path& cache, const std::function<void(double)>& progress) {
  std::optional<KeptResults> kept;
  if (!cache.empty()) kept.emplace(cache, write_lab(diagnosis.calibration.lab));
  const ChosenFrames frames(all_frames, diagnosis.frames);
  std::optional<ChosenFrames> darks;
  if (all_darks && !against) darks.emplace(*all_darks, diagnosis.dark_frames);  // or they were not compared
  StackPlan plan;
  plan.model = diagnosis.calibration.model;
  plan.frames = frames.choice();
  if (darks) plan.dark_frames = darks->choice();
  plan.seed = inputs.seed;
  plan.threads = threads;
  const int stacks = report_stacks(frames.frames(), frames.shape().pixels());
  const bool fixed = !diagnosis.effects.empty();
  const auto tell = [&](int done) {
    if (progress) progress(static_cast<double>(done) / (fixed ? 2 * stacks : stacks));
  };
  ReportProfiles profiles;
  const auto simulate = [&](const Lab& lab, int before) {
    ResultKey key;
    for (const FrameChoice& choice : {plan.frames, plan.dark_frames})
      key.add(choice.all()).add(choice.count());
    key.add("profiles").add(inputs.seed).add(write_lab(lab));
    return kept_profiles(kept ? &*kept : nullptr, key, profiles.real, stacks, [&] {
      return simulate_profiles(lab, plan, stacks, numbers_of("report"),
                               [&](int done) { tell(before + done); });
    });
  };
  tell(0);
  profiles.real = measure_profiles(plan.model, frames, darks ? &*darks : nullptr);
  profiles.plain = simulate(diagnosis.plain_lab, 0);
  if (against) {
    const ChosenFrames other(*against, diagnosis.against_frames);
    scatter_about(measure_profiles(plan.model, other, nullptr), profiles.plain);
    profiles.other = "other stack";
  }
  if (fixed) profiles.fixed = simulate(diagnosis.lab, stacks);
  if (kept) kept->trim();
  const std::string page = diagnosis_report(diagnosis, inputs, profiles);
  make_folder(folder, "folder");
  write_text(folder / "diagnosis.json", diagnosis_json(diagnosis, inputs));
  write_text(folder / "report.html", page);
  write_text(folder / "lab.toml", write_lab(diagnosis.lab));
}

}  // namespace atomcam
