#pragma once
// Setting scalars with their checks; used by set_parameter and the reader alike.

#include "simulation/lab.hpp"

namespace atomcam {

/// Range and wholeness; throws an Error at `place` with what is allowed.
void check_value(const ParameterDeclaration& declaration, double value, std::string_view place);
std::string allowed_text(const ParameterDeclaration& declaration);
/// Every key that --set and a file know for this kind of camera, without those inside lists.
const std::vector<std::string>& lab_keys(CameraKind kind);
/// nullptr if unknown; "effects.row_noise" stands for its strength.
const LabParameter* find_scalar(CameraKind kind, std::string_view key);
[[noreturn]] void throw_unknown_key(std::string_view place, std::string_view key, CameraKind kind);

}  // namespace atomcam
