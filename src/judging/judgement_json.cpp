#include "judging/judgement_json.hpp"

#include <cmath>
#include <nlohmann/json.hpp>

namespace atomcam {
namespace {

nlohmann::ordered_json json_of(const Share& share) {
  nlohmann::ordered_json json;
  if (share.number == 0) return json;
  json["value"] = share.value();
  json["error"] = share.error;
  json["part"] = share.part;
  json["number"] = share.number;
  return json;
}

nlohmann::ordered_json json_of(const std::vector<Confusion>& rows) {
  auto list = nlohmann::ordered_json::array();
  for (const Confusion& row : rows)
    list.push_back({{"of", row.of},
                    {"from", row.from},
                    {"to", std::isfinite(row.to) ? nlohmann::ordered_json(row.to) : nlohmann::ordered_json()},
                    {"found", json_of(row.found)},
                    {"false_alarms", json_of(row.false_alarms)}});
  return list;
}

}  // namespace

nlohmann::ordered_json judgement_json(const Judgement& judgement) {
  nlohmann::ordered_json json;
  json["frames"] = judgement.frames;
  json["sites"] = judgement.sites;
  json["threshold"] = judgement.threshold;
  json["fidelity"] = json_of(judgement.fidelity);
  json["found"] = json_of(judgement.found);
  json["false_alarms"] = json_of(judgement.false_alarms);
  json["auc"] = {{"value", judgement.auc}, {"error", judgement.auc_error}};
  json["best_threshold"] = judgement.best_threshold;
  json["best_fidelity"] = judgement.best_fidelity;
  json["by_brightness"] = json_of(judgement.by_brightness);
  json["by_loss"] = json_of(judgement.by_loss);
  json["by_neighbours"] = json_of(judgement.by_neighbours);
  return json;
}

}  // namespace atomcam
