// diagnosis.json, the page and its profiles.

#include "diagnosis/report.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <set>

#include "calibration/site_model.hpp"
#include "diagnosis/kept_profiles.hpp"
#include "support/markup.hpp"
#include "support/small_array.hpp"
#include "support/temporary_folder.hpp"

namespace atomcam {
namespace {

/// A diagnosis as none is: every field filled, with texts that markup must not take literally.
Diagnosis everything() {
  Diagnosis d;
  d.verdict = Verdict::partly_explained;
  d.sentence = "a < b & \"c\"";
  d.frames = FrameChoice(300, 64, 16);
  d.effects = {{.name = "row_noise",
                .stage = "sensor",
                .parameters = {{"sigma_counts", "counts", 2.5, 2.4, 2.6}},
                .probability = 0.9,
                .confusable_with = {"<other>"}}};
  d.where = {{"sensor", "light.lines.rows.variance", "row_means", "time", "rows", 14.2, 1e-20, 0.4},
             {"scene", "dark.x", "site_brightness", "site", "all <sites>", -2, 0.4, -2}};
  d.gap.before = 100, d.gap.after = 10, d.gap.floor = 5, d.gap.closed = 0.95;
  d.gap.closed_low = 0.9, d.gap.closed_high = std::numeric_limits<double>::quiet_NaN();
  d.gap.by_observable = {{"row_means", 80, 9, 4, 0.93}};
  d.gap.explains = {"row_means"};
  d.gap.part_closed = 0.93, d.gap.part_closed_low = 0.9, d.gap.part_closed_high = 0.95;
  d.gap.steps = {{"row_noise", 10}};
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const DetectorOpinion::OfFrames simulated = {{0.99, 0.001}, {8, 0.1}, {0.991, 0.002}};
  d.gap.second_opinions = {{{"classifier_auc",
                             "means <of> patches",
                             "where & when",
                             {0.9, 0.01},
                             {0.52, 0.02},
                             {0.5, 0.03},
                             0.95}},
                           {{"threshold", {{0.98, 0.001}, {7, 0.1}, {nan, nan}}, simulated, simulated}},
                           100};
  d.unexplained = {true, "optics", {"space", "static", "additive", "2 rows"}, "<script>alert(1)</script>"};
  d.next_measurement = {"darks & flats"};
  d.hypotheses.resize(3);
  d.hypotheses[0].effects = d.hypotheses[1].effects = {"row_noise"};
  d.hypotheses[0].log_evidence = d.hypotheses[1].log_evidence = 120;
  d.hypotheses[1].p_value = 0.3, d.hypotheses[1].closed = 0.95;
  d.hypotheses[2].effects = {"bias_drift"};
  d.hypotheses[2].log_evidence = 3, d.hypotheses[2].p_value = 1e-6, d.hypotheses[2].closed = 0.1;
  d.hypotheses[2].why_not = "leaves a < b at +9 sigma";
  d.calibration.parameters = {{"camera.bias_counts", "counts", 200, 201, 0.1, false}};
  d.calibration.warnings = {"a & b"};
  d.seconds = 12;
  return d;
}

DiagnosisInputs inputs() {
  DiagnosisInputs in;
  in.files = {{"frames", "a&b.tif", "00", 300, {96, 96}}, {"notes", "n.json", "11", 0, {}}};
  in.version = "1";
  in.command = "atomcam diagnose --frames 'a&b.tif'";
  return in;
}

void paths(const nlohmann::json& json, const std::string& at, std::set<std::string>& to) {
  if (json.is_object())
    for (const auto& [key, value] : json.items()) paths(value, at + "." + key, to);
  else if (json.is_array() && !json.empty())
    paths(json.front(), at + "[]", to);
  else
    to.insert(at.substr(1));
}

TEST(DiagnosisJson, KeysAreStable) {
  std::set<std::string> found;
  paths(nlohmann::json::parse(diagnosis_json(everything(), inputs())), "", found);
  const std::set<std::string> expected = {"schema",
                                          "verdict",
                                          "sentence",
                                          "effects[].name",
                                          "effects[].stage",
                                          "effects[].parameters.sigma_counts.value",
                                          "effects[].parameters.sigma_counts.error",
                                          "effects[].parameters.sigma_counts.interval[]",
                                          "effects[].parameters.sigma_counts.unit",
                                          "effects[].probability",
                                          "effects[].confusable_with[]",
                                          "where[].stage",
                                          "where[].observable",
                                          "where[].statistic",
                                          "where[].axis",
                                          "where[].place",
                                          "where[].z",
                                          "where[].q",
                                          "where[].z_after",
                                          "gap.metric",
                                          "gap.before",
                                          "gap.after",
                                          "gap.floor",
                                          "gap.closed",
                                          "gap.closed_interval[]",
                                          "gap.p_before",
                                          "gap.p_after",
                                          "gap.by_observable[].observable",
                                          "gap.by_observable[].before",
                                          "gap.by_observable[].after",
                                          "gap.by_observable[].floor",
                                          "gap.by_observable[].closed",
                                          "gap.explains[]",
                                          "gap.part_closed",
                                          "gap.part_closed_interval[]",
                                          "gap.steps[].effect",
                                          "gap.steps[].gap",
                                          "gap.second_opinions[].metric",
                                          "gap.second_opinions[].before.value",
                                          "gap.second_opinions[].before.error",
                                          "gap.second_opinions[].after.value",
                                          "gap.second_opinions[].after.error",
                                          "gap.second_opinions[].floor.value",
                                          "gap.second_opinions[].floor.error",
                                          "gap.second_opinions[].closed",
                                          "gap.second_opinions[].sees",
                                          "gap.second_opinions[].blind_to",
                                          "gap.detection[].detector",
                                          "gap.detection[].real.fidelity.value",
                                          "gap.detection[].real.fidelity.error",
                                          "gap.detection[].real.separation.value",
                                          "gap.detection[].real.separation.error",
                                          "gap.detection[].real.true_fidelity",
                                          "gap.detection[].before.fidelity.value",
                                          "gap.detection[].before.fidelity.error",
                                          "gap.detection[].before.separation.value",
                                          "gap.detection[].before.separation.error",
                                          "gap.detection[].before.true_fidelity.value",
                                          "gap.detection[].before.true_fidelity.error",
                                          "gap.detection[].after.fidelity.value",
                                          "gap.detection[].after.fidelity.error",
                                          "gap.detection[].after.separation.value",
                                          "gap.detection[].after.separation.error",
                                          "gap.detection[].after.true_fidelity.value",
                                          "gap.detection[].after.true_fidelity.error",
                                          "unexplained.present",
                                          "unexplained.stage",
                                          "unexplained.axis",
                                          "unexplained.change",
                                          "unexplained.action",
                                          "unexplained.period",
                                          "unexplained.looks_like",
                                          "hypotheses[].effects[]",
                                          "hypotheses[].log_evidence",
                                          "hypotheses[].share",
                                          "hypotheses[].p_value",
                                          "hypotheses[].closed",
                                          "hypotheses[].imitates",
                                          "hypotheses[].why_not",
                                          "calibration[].key",
                                          "calibration[].unit",
                                          "calibration[].noted",
                                          "calibration[].fitted",
                                          "calibration[].error",
                                          "calibration[].pull",
                                          "calibration[].from_notes",
                                          "warnings[]",
                                          "next_measurement[]",
                                          "inputs.frames.file",
                                          "inputs.frames.sha256",
                                          "inputs.frames.frames",
                                          "inputs.frames.shape[]",
                                          "inputs.frames.looked_at",
                                          "inputs.notes.file",
                                          "inputs.notes.sha256",
                                          "inputs.exclude",
                                          "inputs.include",
                                          "inputs.seed",
                                          "inputs.version",
                                          "inputs.command",
                                          "seconds"};
  EXPECT_EQ(found, expected);
}

TEST(DiagnosisJson, ValuesAreThoseOfTheDiagnosis) {
  const auto json = nlohmann::json::parse(diagnosis_json(everything(), inputs()));
  EXPECT_EQ(json.at("verdict"), "partly_explained");
  EXPECT_EQ(json.at("effects")[0].at("parameters").at("sigma_counts").at("value"), 2.5);
  EXPECT_EQ(json.at("gap").at("closed_interval")[0], 0.9);
  EXPECT_TRUE(json.at("gap").at("closed_interval")[1].is_null());  // not a number
  EXPECT_TRUE(json.at("hypotheses")[0].at("p_value").is_null());   // not fitted
  EXPECT_EQ(json.at("hypotheses")[1].at("p_value"), 0.3);
  EXPECT_EQ(json.at("gap").at("second_opinions")[0].at("before").at("value"), 0.9);
  EXPECT_EQ(json.at("gap").at("detection")[0].at("before").at("true_fidelity").at("value"), 0.991);
  EXPECT_TRUE(json.at("gap").at("detection")[0].at("real").at("true_fidelity").is_null());
  EXPECT_EQ(json.at("inputs").at("frames").at("looked_at"), 64);
}

struct Stacks {
  Notes notes = small_notes();
  Lab lab = lab_of_notes(notes), noisy = lab;
  StackModel model = stack_model(lab);
  static constexpr double sigma = 4;  // counts
  static constexpr int frames = 40, darks = 20;
  /// Profiles of so many stacks.
  std::vector<Profiles> simulate(const Lab& of, int count, std::uint64_t first, std::size_t light = frames,
                                 std::size_t closed = darks, int threads = 1) const {
    StackPlan plan;
    plan.model = model;
    plan.frames = light;
    plan.dark_frames = closed;
    plan.threads = threads;
    return simulate_profiles(of, plan, count, first);
  }
  Stacks() { noisy.effects["row_noise"] = {sigma}; }
};

TEST(Profiles, RowNoiseIsSeenInFull) {
  const Stacks it;
  const auto curve = [](const Profiles& profiles) -> const Curve& {
    for (const Curve& one : profiles.curves)
      if (one.key == "dark.row_noise") return one;
    throw std::runtime_error("no such curve");
  };
  const auto plain = it.simulate(it.lab, 1, 3, 4, 400), noisy = it.simulate(it.noisy, 1, 3, 4, 400);
  double sum = 0, n = 0;
  const Curve &a = curve(plain.front()), &b = curve(noisy.front());
  for (std::size_t r = 0; r < a.y.size(); ++r) sum += b.y[r] * b.y[r] - a.y[r] * a.y[r], n += 1;
  // Rows share the frame's level, which is taken off: of R rows' variance (R - 1) / R is left. The variance
  // of R * 400 normal draws has the relative error sqrt(2 / (400 R)); that of the plain rows adds little.
  const double expected = it.sigma * it.sigma * (n - 1) / n;
  EXPECT_NEAR(sum / n / expected, 1, 5 * std::sqrt(2 / (400 * n)));
}

TEST(Profiles, DistanceTellsAnotherModelFromTheSame) {
  const Stacks it;
  const auto stacks = it.simulate(it.lab, 8, 100, it.frames, it.darks, 2), same = it.simulate(it.lab, 1, 900),
             other = it.simulate(it.noisy, 1, 900);
  std::size_t strongest = 0;
  double largest = 0;
  for (std::size_t k = 0; k < same.front().curves.size(); ++k) {
    const CurveBand band = band_of(stacks, k);
    const double far = distance(other.front().curves[k], band);
    if (far > largest) largest = far, strongest = k;
  }
  const std::string key = other.front().curves[strongest].key;
  EXPECT_TRUE(key.find("row_noise") != std::string::npos || key.find("spectrum") != std::string::npos ||
              key.find("horizontal") != std::string::npos)
      << key;
  const CurveBand band = band_of(stacks, strongest);
  EXPECT_GT(largest, 10 * distance(same.front().curves[strongest], band));
}

TEST(Profiles, ThreadsDoNotChangeThem) {
  const Stacks it;
  const auto one = it.simulate(it.lab, 3, 7, 8, 8), two = it.simulate(it.lab, 3, 7, 8, 8, 2);
  for (std::size_t n = 0; n < one.size(); ++n)
    for (std::size_t k = 0; k < one[n].curves.size(); ++k)
      for (std::size_t i = 0; i < one[n].curves[k].y.size(); ++i) {
        const double a = one[n].curves[k].y[i], b = two[n].curves[k].y[i];
        ASSERT_TRUE(a == b || (std::isnan(a) && std::isnan(b))) << one[n].curves[k].key;
      }
}

TEST(Profiles, KeptOnesAreThoseThatWereSimulated) {
  const Stacks it;
  const FramesInMemory frames = small_frames(it.noisy, 8, true, 5),
                       darks = small_frames(it.noisy, 8, false, 5);
  const Profiles real = measure_profiles(it.model, frames, &darks);
  const TemporaryFolder folder;
  const KeptResults kept(folder.path(), "");
  int simulated = 0;
  const auto ask = [&](std::uint64_t seed) {
    ResultKey key;
    key.add(seed);
    return kept_profiles(&kept, key, real, 2, [&] {
      ++simulated;
      return it.simulate(it.lab, 2, seed, 8, 8, 2);
    });
  };
  const auto fresh = ask(1), again = ask(1);
  EXPECT_EQ(simulated, 1);
  const auto equal = [](const auto& a, const auto& b) {
    return std::equal(a.begin(), a.end(), b.begin(), b.end(), [](double one, double other) {
      return one == other || (std::isnan(one) && std::isnan(other));
    });
  };
  for (std::size_t n = 0; n < 2; ++n) {
    for (std::size_t k = 0; k < fresh[n].curves.size(); ++k) {
      EXPECT_EQ(fresh[n].curves[k].key, again[n].curves[k].key);
      EXPECT_EQ(fresh[n].curves[k].title, again[n].curves[k].title);
      EXPECT_TRUE(equal(fresh[n].curves[k].x, again[n].curves[k].x)) << fresh[n].curves[k].key;
      EXPECT_TRUE(equal(fresh[n].curves[k].y, again[n].curves[k].y)) << fresh[n].curves[k].key;
    }
    for (std::size_t k = 0; k < fresh[n].maps.size(); ++k) {
      EXPECT_EQ(fresh[n].maps[k].key, again[n].maps[k].key);
      EXPECT_TRUE(equal(fresh[n].maps[k].values.pixels(), again[n].maps[k].values.pixels()));
    }
  }
  ask(2);
  EXPECT_EQ(simulated, 2);
}

TEST(DiagnosisReport, StandsAlone) {
  const Stacks it;
  ReportProfiles profiles;
  const FramesInMemory frames = small_frames(it.noisy, it.frames, true, 5),
                       darks = small_frames(it.noisy, it.darks, false, 5);
  profiles.real = measure_profiles(it.model, frames, &darks);
  profiles.plain = it.simulate(it.lab, 3, 1, it.frames, it.darks, 2);
  for (const bool fixed : {false, true}) {
    if (fixed) profiles.fixed = it.simulate(it.noisy, 3, 1, it.frames, it.darks, 2);
    const std::string page = diagnosis_report(everything(), inputs(), profiles);
    EXPECT_EQ(markup_fault(page), "");
    EXPECT_EQ(outside_reference(page), "");
    EXPECT_NE(page.find("a &lt; b &amp; &quot;c&quot;"), std::string::npos);
    EXPECT_NE(page.find("<td>classifier auc</td><td class=\"number\">0.900 ± 0.010</td>"), std::string::npos);
    EXPECT_NE(page.find("atomcam diagnose --frames 'a&amp;b.tif'"), std::string::npos);
    // A hypothesis that was fitted after the scan stands there once.
    const auto first = page.find("<td>row_noise</td><td class=\"number\">120.0");
    EXPECT_NE(first, std::string::npos);
    EXPECT_EQ(page.find("<td>row_noise</td><td class=\"number\">120.0", first + 1), std::string::npos);
  }
}

TEST(DiagnosisReport, ADiagnosisWithoutAnythingHasAPage) {
  const std::string page = diagnosis_report({}, {}, {});
  EXPECT_EQ(markup_fault(page), "");
  EXPECT_EQ(outside_reference(page), "");
}

}  // namespace
}  // namespace atomcam
