#include "effects/effect.hpp"
namespace atomcam {
EffectDeclaration serial_cic();
std::span<const EffectDeclaration> effect_catalogue() {
  static const EffectDeclaration all[] = {serial_cic()};
  return all;
}
const EffectDeclaration* find_effect(std::string_view name) {
  for (auto& e : effect_catalogue())
    if (e.name == name) return &e;
  return nullptr;
}
}  // namespace atomcam
