#pragma once
// From emitters to photo-electrons on the sensor. Each emitter's electrons are drawn as one Poisson number
// and each lands at a place drawn around the emitter: the law of independent Poisson pixels, and every atom's
// detected electrons are known (Kingman, "Poisson Processes", 1993, marking and displacement theorems).

#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <span>
#include <utility>
#include <vector>

#include "effects/effect.hpp"
#include "optics/optics.hpp"
#include "sensor/sensor.hpp"
#include "simulation/exposure.hpp"

namespace atomcam {

/// Point-spread functions of one optical setting by extra defocus and loss at the pupil's edge, each built on
/// first use and kept; labs with the same optics share them.
class PointSpreadFunctions {
 public:
  PointSpreadFunctions(const OpticsDescription& optics, double blur_um)
      : optics_(optics), blur_um_(blur_um) {}
  /// The function for the nearest multiples of 0.002 um rms of extra defocus and of 0.004 of loss.
  const PointSpreadFunction& at(double defocus_um, double pupil_edge_loss) const;

 private:
  OpticsDescription optics_;
  double blur_um_;
  mutable std::mutex mutex_;
  mutable std::map<std::pair<int, int>, std::shared_ptr<const PointSpreadFunction>> made_;
};

/// Where light falls and how much of it counts.
struct Landing {
  const PointSpreadFunctions* point_spread = nullptr;
  const LightField* light = nullptr;
  Region region;      // physical pixels
  int binning_x = 1;  // of the plane that is filled
  int binning_y = 1;
  ExposureWindow window;
  double electrons_per_photon = 0;  // collected fraction x transmission x quantum efficiency
  double pixels_per_um = 0;         // object plane to sensor
  std::uint64_t seed = 0;
  std::uint64_t frame = 0;

  Shape plane() const { return {region.height / binning_y, region.width / binning_x}; }
  /// Expected electrons of one emitter, wherever they land, before any response map.
  double expected_electrons(const Emitter& emitter) const;
  /// Electrons of every emitter. `detected` gets the number that fell into the region, by emitter; smear is
  /// not among them.
  PhotoElectrons draw(std::span<std::int64_t> detected, int threads) const;
  /// Adds the expected electrons of every emitter to `image` (of plane()).
  void add_expected(PhotonImage& image) const;
};

/// Adds the smear of the frame's shift to the light that the exposure itself brings, per pixel of the plane.
void add_smear(std::span<float> pixels, Shape shape, const LightField& light);

}  // namespace atomcam
