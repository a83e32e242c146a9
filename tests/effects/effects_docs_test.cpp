// docs/effects.md is the catalogue in words. ATOMCAM_UPDATE_DOCS=1 in the environment writes it anew.

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <fstream>
#include <sstream>

#include "effects/effect.hpp"

namespace atomcam {
namespace {

std::string_view plane_title(Plane plane) {
  switch (plane) {
    case Plane::scene:
      return "Scene: what the atoms do";
    case Plane::photons:
      return "Photons: on the way to the sensor";
    case Plane::electrons:
      return "Electrons: in the pixels";
    case Plane::electron_register:
      return "Register: at the end of the EM register, or of the pixels where there is none";
    case Plane::counts:
      return "Counts: before they are rounded";
  }
  return "";
}

std::string cameras(const EffectDeclaration& effect) {
  return effect.emccd && effect.qcmos ? "EMCCD, qCMOS" : effect.emccd ? "EMCCD" : "qCMOS";
}

std::string section(const EffectDeclaration& effect) {
  std::string text = fmt::format("### {}\n\n{}\n\n| key | meaning | unit | allowed | default |\n",
                                 effect.name, effect.summary);
  text += "| --- | --- | --- | --- | --- |\n";
  for (const ParameterDeclaration& parameter : effect.parameters)
    text += fmt::format("| `effects.{}.{}` | {} | {} | {:g} to {:g}{}{} | {:g} |\n", effect.name,
                        parameter.key, parameter.meaning, parameter.unit, parameter.minimum,
                        parameter.maximum, parameter.integer ? ", whole numbers" : "",
                        parameter.scale == ParameterScale::logarithmic ? ", logarithmic" : "",
                        parameter.default_value);
  text += fmt::format("\nCameras: {}. Moves {}. Source: {}.\n\n", cameras(effect),
                      fmt::join(effect.observables, ", "), effect.reference);
  return text;
}

std::string effects_document() {
  std::string text =
      "# Effects\n\n"
      "Physical effects beyond the plain model of atoms, optics and sensor. Each is off unless a lab file or "
      "`--set` "
      "switches\nit on, by its strength (`effects.row_noise = 0.5`) or by its parameters (a table "
      "`[effects.row_noise]`); the strength is the\nfirst parameter, and at zero the effect is absent, bit "
      "for bit. "
      "Effects apply in the order of this page, whatever the\norder in a file. What an effect moves is what "
      "can be "
      "measured in a stack of frames; `tests/laws` holds each to it.\n\n"
      "This page is written from the declarations in `src/effects`.\n\n";
  text += "| effect | what it is | cameras |\n| --- | --- | --- |\n";
  for (const EffectDeclaration& effect : effect_catalogue())
    text += fmt::format("| [{0}](#{0}) | {1} | {2} |\n", effect.name, effect.summary, cameras(effect));
  text += "\n";
  for (const Plane plane :
       {Plane::scene, Plane::photons, Plane::electrons, Plane::electron_register, Plane::counts}) {
    text += fmt::format("## {}\n\n", plane_title(plane));
    for (const EffectDeclaration& effect : effect_catalogue())
      if (effect.plane == plane) text += section(effect);
  }
  while (text.ends_with("\n\n")) text.pop_back();
  return text;
}

TEST(EffectsDocs, PageIsTheCatalogue) {
  const std::string path = ATOMCAM_SOURCE_DIR "/docs/effects.md";
  const std::string expected = effects_document();
  if (std::getenv("ATOMCAM_UPDATE_DOCS")) std::ofstream(path) << expected;
  std::stringstream read;
  read << std::ifstream(path).rdbuf();
  EXPECT_EQ(read.str(), expected) << path << "; ATOMCAM_UPDATE_DOCS=1 writes it anew";
}

}  // namespace
}  // namespace atomcam
