#pragma once
// Whether the atoms in a stack's frames stand where its truth says, as bright as it says. Every number comes
// from linear fits of the pixels, around each site, with the point-spread function of the lab at the truth's
// place.

#include <cstdint>
#include <string>
#include <vector>

#include "atomcam/stack_settings.hpp"
#include "data/stack.hpp"
#include "simulation/lab.hpp"

namespace atomcam {

struct SiteCheck {
  int site = 0;
  std::uint64_t frames = 0;     // that show its atom
  double electrons = 0;         // of its atoms, over all frames, as the truth says
  double dx_px = 0, dy_px = 0;  // measured mean position minus truth, physical pixels
  double deviation_sigma = 0;   // measured minus true electrons, in standard errors
  double empty_sigma = 0;       // the same over the frames without an atom, where the truth is 0
};

struct TruthCheck {
  std::uint64_t frames = 0, atom_images = 0;
  std::vector<SiteCheck> sites;                 // those with light enough to tell
  std::size_t dim_sites = 0;                    // too little light to tell, or at the border
  double brightness = 1, brightness_error = 0;  // measured electrons of all atoms over true ones
};

/// Truth of one frame as a stack holds it.
struct FrameAtoms {
  struct Atom {
    int site = 0;
    double x_px = 0, y_px = 0;
    double electrons = 0;
    bool lost = false;
  };
  std::uint64_t frame = 0;  // its number
  std::vector<Atom> atoms;
  std::string initial;  // '1' for every site that is filled at the start
};
/// Throws an Error that names the stack if its frame has no truth.
FrameAtoms frame_atoms(const std::string& truth, const std::string& place);

TruthCheck check_truth(StackReader& stack, const Lab& lab, const StackSettings& settings,
                       const std::string& place);

}  // namespace atomcam
