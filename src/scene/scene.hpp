#pragma once
// Atoms: where they sit, which sites are filled, how long each survives, how many photons it emits
// (paper, sections "Stage 1" and "Atoms Lost During Imaging").

#include <cstdint>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "base/random.hpp"

namespace atomcam {

/// A trap site in physical sensor pixels of the full sensor: x along columns, y along rows, pixel centres at
/// integers.
struct Site {
  double x_px = 0;
  double y_px = 0;
  double brightness = 1;  // relative scattering rate of an atom here
};

/// A grid of sites: position(i, j) = offset + i * spacing_x * (cos a, sin a) + j * spacing_y * (-sin b, cos
/// b), with a = angle_x_deg and b = angle_y_deg. In sensor pixels or, if object_plane, in um of the atom
/// plane (times magnification / pixel size about the sensor's centre).
struct SiteGrid {
  int columns = 18;
  int rows = 17;
  double spacing_x = 0;
  double spacing_y = 0;
  double offset_x = 0;
  double offset_y = 0;
  double angle_x_deg = 0;
  double angle_y_deg = 0;
  bool object_plane = false;
};

/// Row by row: site j * columns + i is position(i, j). `pixels_per_um`: magnification / pixel size;
/// `centre_*_px`: sensor centre; both used by object-plane grids only.
std::vector<Site> grid_sites(const SiteGrid& grid, double pixels_per_um, double centre_x_px,
                             double centre_y_px);

struct SceneDescription {
  std::vector<Site> sites;
  double scattering_rate_hz = 30000;  // photons emitted into 4 pi per second by an atom of brightness 1
  double filling = 0.5;               // probability that a site is filled at the start of a shot
  double survival = 0.97;  // probability to survive one exposure of reference_exposure_s (1: no loss,
                           // 0: every atom is lost as its first exposure begins, without light)
  double reference_exposure_s = 0.08;  // kept as the rate -ln(survival) / reference_exposure_s
  int images_per_shot = 1;             // frames that show the same atoms; survivors carry over
  double atom_extent_um = 0;           // rms extent of an atom in the object plane (Gaussian, per axis)
  double dead_time_s = 0;              // dark time between the images of a shot (no light, no loss)
};

inline constexpr double never = std::numeric_limits<double>::infinity();

/// One atom during one frame.
struct Atom {
  int site = 0;
  bool present_at_start = false;
  bool present_at_end = false;
  double loss_time_s = never;  // since the exposure began; `never` if it survives
  double photons_emitted = 0;  // expected number into 4 pi during its life within the exposure
};

/// A stretch of light: an atom (or part of its life) at one place. Effects may move, dim, split or add
/// emitters.
struct Emitter {
  int site = -1;    // -1: no site of the lab (stray atom)
  double x_px = 0;  // sensor pixels
  double y_px = 0;
  double start_s = 0;  // within the exposure; light is even between start and end
  double end_s = 0;
  double rate_hz = 0;        // photons emitted into 4 pi per second
  double defocus_um = 0;     // extra rms wavefront of defocus (Zernike Z2^0), added to the global one
  double blur_major_um = 0;  // extra rms Gaussian blur in the object plane along blur_angle_deg
  double blur_minor_um = 0;
  double blur_angle_deg = 0;
  double emitted() const { return rate_hz * (end_s - start_s); }
};

struct SceneFrame {
  std::vector<Atom> atoms;        // one per site, in site order
  std::vector<Emitter> emitters;  // at least one per atom with light
};

/// Occupancy of every site at the start of a frame.
using Occupancy = std::vector<std::uint8_t>;

/// Draws frame `frame` of the scene. Pure: shot s = frame / images_per_shot; the survivors of the earlier
/// images of the shot are found by drawing those images' losses again. All images of a shot use `exposure_s`.
/// `given`: the shot's initial occupancy; otherwise each site is filled with probability `filling`
/// (0 gives none, 1 gives all). Stream names: "scene/filling" at (shot, site), "scene/loss" at (frame, site).
/// With the shutter closed atoms still live and die; the caller drops the light.
SceneFrame draw_scene(const SceneDescription& scene, double exposure_s, std::uint64_t seed,
                      std::uint64_t frame, const Occupancy* given = nullptr);

}  // namespace atomcam
