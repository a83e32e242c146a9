#include <fmt/format.h>

#include "simulation/simulation.hpp"

namespace atomcam {

std::string FrameTruth::to_json() const {
  fmt::memory_buffer text;
  auto out = std::back_inserter(text);
  fmt::format_to(
      out,
      R"({{"frame":{},"seed":{},"shift_x_px":{:.4g},"shift_y_px":{:.4g},"background_e":{:.6g},"initial":")",
      frame, seed, shift_x_px, shift_y_px, background_e);
  for (const AtomTruth& atom : atoms) text.push_back(atom.present_at_start ? '1' : '0');
  fmt::format_to(out, R"(","final":")");
  for (const AtomTruth& atom : atoms) text.push_back(atom.present_at_end ? '1' : '0');
  fmt::format_to(out, R"(","atoms":[)");
  bool first = true;
  for (const AtomTruth& atom : atoms) {
    if (!atom.present_at_start) continue;
    fmt::format_to(out, R"({}{{"site":{},"x_px":{:.3f},"y_px":{:.3f},)", first ? "" : ",", atom.site,
                   atom.x_px, atom.y_px);
    if (atom.loss_time_s < never) fmt::format_to(out, R"("loss_s":{:.6g},)", atom.loss_time_s);
    fmt::format_to(out, R"("emitted":{:.1f},"expected_e":{:.2f},"detected_e":{}}})", atom.photons_emitted,
                   atom.electrons_expected, atom.electrons_detected);
    first = false;
  }
  fmt::format_to(out, "]}}");
  return fmt::to_string(text);
}

}  // namespace atomcam
