#include "diagnosis/diagnosis_json.hpp"

#include <cmath>
#include <nlohmann/json.hpp>

#include "calibration/calibration_json.hpp"

namespace atomcam {
namespace {

using Json = nlohmann::ordered_json;

Json number(double value) {
  return std::isfinite(value) ? Json(value) : Json(nullptr);
}

Json effects_of(const Diagnosis& diagnosis) {
  Json effects = Json::array();
  for (const FoundEffect& effect : diagnosis.effects) {
    Json parameters = Json::object();
    for (const FoundParameter& p : effect.parameters)
      parameters[p.name] = {{"value", number(p.value)},
                            {"error", number(p.error())},
                            {"interval", {number(p.low), number(p.high)}},
                            {"unit", p.unit}};
    effects.push_back({{"name", effect.name},
                       {"stage", effect.stage},
                       {"parameters", std::move(parameters)},
                       {"probability", number(effect.probability)},
                       {"confusable_with", effect.confusable_with}});
  }
  return effects;
}

Json where_of(const Diagnosis& diagnosis) {
  Json where = Json::array();
  for (const Difference& one : diagnosis.where)
    where.push_back({{"stage", one.stage},
                     {"observable", one.observable},
                     {"statistic", one.statistic},
                     {"axis", one.axis},
                     {"place", one.place},
                     {"z", number(one.z)},
                     {"q", number(one.q)},
                     {"z_after", number(one.z_after)}});
  return where;
}

/// Null if it does not exist.
Json figure(const Figure& figure) {
  if (!std::isfinite(figure.value)) return nullptr;
  return {{"value", figure.value}, {"error", number(figure.error)}};
}

Json second_opinions_of(const SecondOpinions& opinions) {
  Json metrics = Json::array();
  for (const SecondOpinion& one : opinions.metrics)
    metrics.push_back({{"metric", one.metric},
                       {"before", figure(one.before)},
                       {"after", figure(one.after)},
                       {"floor", figure(one.floor)},
                       {"closed", number(one.closed)},
                       {"sees", one.sees},
                       {"blind_to", one.blind_to}});
  return metrics;
}

Json detection_of(const SecondOpinions& opinions) {
  const auto of = [](const DetectorOpinion::OfFrames& frames) -> Json {
    return {{"fidelity", figure(frames.fidelity)},
            {"separation", figure(frames.separation)},
            {"true_fidelity", figure(frames.truly)}};
  };
  Json detectors = Json::array();
  for (const DetectorOpinion& one : opinions.detectors)
    detectors.push_back({{"detector", one.detector},
                         {"real", of(one.real)},
                         {"before", of(one.before)},
                         {"after", of(one.after)}});
  return detectors;
}

Json gap_of_diagnosis(const Diagnosis& diagnosis) {
  const GapClosed& gap = diagnosis.gap;
  Json steps = Json::array();
  for (const GapStep& step : gap.steps) steps.push_back({{"effect", step.effect}, {"gap", number(step.gap)}});
  Json by_observable = Json::array();
  for (const ObservableGap& one : gap.by_observable)
    by_observable.push_back({{"observable", one.observable},
                             {"before", number(one.before)},
                             {"after", number(one.after)},
                             {"floor", number(one.floor)},
                             {"closed", number(one.closed)}});
  return {{"metric", gap.metric},
          {"before", number(gap.before)},
          {"after", number(gap.after)},
          {"floor", number(gap.floor)},
          {"closed", number(gap.closed)},
          {"closed_interval", {number(gap.closed_low), number(gap.closed_high)}},
          {"p_before", number(diagnosis.p_gap)},
          {"p_after", number(diagnosis.p_after)},
          {"by_observable", std::move(by_observable)},
          {"explains", gap.explains},
          {"part_closed", gap.explains.empty() ? Json(nullptr) : number(gap.part_closed)},
          {"part_closed_interval", gap.explains.empty()
                                       ? Json(nullptr)
                                       : Json{number(gap.part_closed_low), number(gap.part_closed_high)}},
          {"steps", std::move(steps)},
          {"second_opinions", second_opinions_of(gap.second_opinions)},
          {"detection", detection_of(gap.second_opinions)}};
}

Json hypotheses_of(const Diagnosis& diagnosis) {
  Json list = Json::array();
  for (const Hypothesis& one : diagnosis.hypotheses) {
    const bool fitted = one.p_value >= 0;
    list.push_back({{"effects", one.effects},
                    {"log_evidence", number(one.log_evidence)},
                    {"share", fitted ? Json(nullptr) : number(one.share)},
                    {"p_value", fitted ? number(one.p_value) : Json(nullptr)},
                    {"closed", fitted ? number(one.closed) : Json(nullptr)},
                    {"imitates", one.imitates >= 0 ? number(one.imitates) : Json(nullptr)},
                    {"why_not", one.why_not}});
  }
  return list;
}

Json inputs_of(const DiagnosisInputs& inputs, const Diagnosis& diagnosis) {
  Json out = Json::object();
  for (const DiagnosisInputs::File& file : inputs.files) {
    Json one = {{"file", file.path}, {"sha256", file.sha256}};
    if (file.frames > 0) {
      one["frames"] = file.frames;
      one["shape"] = {file.shape.rows, file.shape.columns};
    }
    if (const FrameChoice choice = diagnosis.looked_at(file.role); choice.count() > 0)
      one["looked_at"] = choice.count();
    out[file.role] = std::move(one);
  }
  out["exclude"] = inputs.exclude;
  out["include"] = inputs.include;
  out["seed"] = inputs.seed;
  out["version"] = inputs.version;
  out["command"] = inputs.command;
  return out;
}

}  // namespace

std::string diagnosis_json(const Diagnosis& diagnosis, const DiagnosisInputs& inputs) {
  const Json calibration = calibration_json(diagnosis.calibration);
  Json out = {{"schema", 1},
              {"verdict", name_of(diagnosis.verdict)},
              {"sentence", diagnosis.sentence},
              {"effects", effects_of(diagnosis)},
              {"where", where_of(diagnosis)},
              {"gap", gap_of_diagnosis(diagnosis)},
              {"unexplained",
               {{"present", diagnosis.unexplained.present},
                {"stage", diagnosis.unexplained.stage},
                {"axis", diagnosis.unexplained.character.axis},
                {"change", diagnosis.unexplained.character.change},
                {"action", diagnosis.unexplained.character.action},
                {"period", diagnosis.unexplained.character.period},
                {"looks_like", diagnosis.unexplained.looks_like}}},
              {"hypotheses", hypotheses_of(diagnosis)},
              {"calibration", calibration.at("parameters")},
              {"warnings", calibration.at("warnings")},
              {"next_measurement", diagnosis.next_measurement},
              {"inputs", inputs_of(inputs, diagnosis)},
              {"seconds", number(diagnosis.seconds)}};
  if (calibration.contains("flats")) out["flats"] = calibration.at("flats");
  return out.dump(2, ' ', false, Json::error_handler_t::replace) + "\n";
}

}  // namespace atomcam
