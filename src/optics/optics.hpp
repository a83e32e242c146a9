#pragma once
// The optical system: complex pupil -> point-spread function -> where photons land on the sensor and how many
// are expected per pixel (paper, section "Stage 2").

#include <array>
#include <cstdint>
#include <memory>
#include <span>

#include "base/image.hpp"

namespace atomcam {

/// Zernike terms of radial degree 0 to 4 in the paper's order; orthonormal on the unit disc (rms 1), so a
/// coefficient is an rms wavefront in um. Documented against Noll and OSA/ANSI indices in zernike.hpp.
inline constexpr int zernike_terms = 15;

struct OpticsDescription {
  double wavelength_um = 0.461;
  double numerical_aperture = 0.65;
  double magnification = 156.25;  // atom plane to sensor
  double pixel_um = 16;           // physical pixel pitch
  double transmission = 1;        // of everything between atom and sensor
  bool apodisation = false;       // sine-condition amplitude (1 - (NA rho)^2)^(-1/4) of a high-NA objective
  double pupil_edge_loss = 0;     // amplitude falls as 1 - loss rho^2 from the pupil's centre to its edge
  std::array<double, zernike_terms> zernike_um{};  // rms um
  bool operator==(const OpticsDescription&) const = default;
};

/// Gaussian blur in the object plane, rms along two axes; the major axis at `angle_deg` from +x (columns) to
/// +y (rows).
struct Blur {
  double major_um = 0;
  double minor_um = 0;
  double angle_deg = 0;
};

/// Fraction of the full solid angle collected, (1 - sqrt(1 - NA^2)) / 2 (paper, "Fitting Parameter Values").
double collected_fraction(double numerical_aperture);

/// The point-spread function as a table of probabilities on nested grids of cells, finest in the core,
/// computed once per optical setting with FFTW3 and rounded to multiples of 2^-32 so that the transform's
/// last bits do not matter. A photon's landing place is drawn from it, evenly within its cell; a pixel's
/// expected share is the exact integral of the same table, so the two agree by construction. Positive tilts
/// displace the image towards +x and +y. All light is within the table (reach about 109 wavelengths / NA,
/// beyond which an ideal lens sends less than 0.1 %; that light is kept, folded back to the other side). See
/// docs/optics.md. Copies share the table; use by several threads is safe.
class PointSpreadFunction {
 public:
  /// `defocus_um`: rms wavefront added to the global defocus; `blur_um`: rms Gaussian blur in the object
  /// plane.
  PointSpreadFunction(const OpticsDescription& optics, double defocus_um = 0, double blur_um = 0);
  PointSpreadFunction(const OpticsDescription& optics, double defocus_um, Blur blur);

  /// Displacement in pixels of a photon from the atom's geometric image, from 64 random bits.
  struct Displacement {
    float dx_px, dy_px;
  };
  Displacement draw(std::uint32_t cell_word, std::uint32_t jitter_word) const;
  /// The same for many photons: out[n] = draw(words[2 n], words[2 n + 1]).
  void draw(std::span<const std::uint32_t> words, std::span<Displacement> out) const;

  /// Adds `photons` times the pixel-integrated point-spread function of an emitter at (x_px, y_px) to
  /// `image`, whose pixel (0, 0) is the sensor's (`origin_y`, `origin_x`) and whose pixels are binning_x by
  /// binning_y sensor pixels.
  void add_expected(PhotonImage& image, double photons, double x_px, double y_px, int origin_x = 0,
                    int origin_y = 0, int binning_x = 1, int binning_y = 1) const;

  double fraction_within(double radius_px) const;  // encircled energy about the geometric image
  double reach_px() const;  // no photon lands farther than this from the geometric image, on either axis

 private:
  struct Table;
  std::shared_ptr<const Table> table_;
};

}  // namespace atomcam
