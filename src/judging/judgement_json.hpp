#pragma once
// A judgement for programs, as `atomcam score --json` prints it (docs/data.md).

#include <nlohmann/json_fwd.hpp>

#include "judging/judgement.hpp"

namespace atomcam {

/// Shares as {"value", "error", "part", "number"}, null where there is nothing to share; without the curve.
nlohmann::ordered_json judgement_json(const Judgement& judgement);

}  // namespace atomcam
