#pragma once
// A family of statistics: looks at the frames twice, keeps what it needs in sums of either part, and says its
// numbers for a part or for the whole stack.

#include <array>
#include <memory>
#include <vector>

#include "analysis/layout.hpp"
#include "analysis/sheet.hpp"

namespace atomcam::analysis {

enum class Part { whole, first, second };

/// What of every frame all families share; complete after the second visit.
struct Record {
  explicit Record(const Layout& of) : layout(of) {}

  const Layout& layout;
  std::size_t frames = 0;
  std::vector<std::uint8_t> part;    // of each frame: 0 or 1
  Floats brightness;                 // [frame][site], of an atom
  std::vector<double> level;         // clipped mean of the quiet pixels, in dark scales
  std::vector<double> linear_level;  // mean of the dark pixels above the bias, counts
  std::vector<double> noise;         // mean square of the clipped residual
  std::vector<double> repeat;  // correlation of the clipped residual with the frame before; NaN for the first
  std::array<Plane, 2> sum;    // of counts above the pedestal without the sites' light
  std::array<Plane, 2> clipped_sum;  // of the same, clipped, in scales
  std::array<std::size_t, 2> in_part{};

  std::size_t sites() const { return layout.packed.size(); }
  double bright(std::size_t frame, std::size_t site) const {
    return static_cast<double>(brightness[frame * sites() + site]);
  }
  bool holds(Part which, std::size_t frame) const {
    return which == Part::whole || part[frame] == (which == Part::first ? 0 : 1);
  }
  std::size_t count(Part which) const {
    return which == Part::whole ? in_part[0] + in_part[1] : in_part[which == Part::first ? 0 : 1];
  }
};

struct FirstLook {
  std::size_t frame = 0;
  int part = 0;
  const CountImage& counts;
};

struct SecondLook {
  std::size_t frame = 0;
  int part = 0;
  const CountImage& counts;
  const Plane& light;                    // counts above the pedestal without the sites' light
  const Plane& mean;                     // of `light` over the stack
  const Plane& scaled;                   // light * inverse_scale, not clipped
  const Plane& residual;                 // clipped at +-3 scales, its mean over the stack taken away
  const Plane& quiet;                    // residual * layout.quiet
  const Plane* before = nullptr;         // residual one frame earlier, where that is in the same part
  const Plane* before_that = nullptr;    // two frames earlier
  const Plane* scaled_before = nullptr;  // `scaled` one frame earlier
  const Plane* scaled_before_that = nullptr;
  std::span<const float> brightness;
  std::span<const float> mean_brightness;
};

class Family {
 public:
  virtual ~Family() = default;
  virtual void first_look(const FirstLook&) {}
  virtual void second_look(const SecondLook&) {}
  virtual void summarise(Part which, const Record& record, Sheet& sheet) const = 0;
};

/// Sums kept for either part.
template <class Sums>
struct Halves {
  explicit Halves(const Sums& zero = {}) : half{zero, zero} {}
  Sums& operator[](int part) { return half[static_cast<std::size_t>(part)]; }
  Sums of(Part which) const {
    if (which != Part::whole) return half[which == Part::first ? 0 : 1];
    Sums sum = half[0];
    sum += half[1];
    return sum;
  }
  std::array<Sums, 2> half;
};

/// Plain numbers that add up.
struct Numbers : std::vector<double> {
  using std::vector<double>::vector;
  Numbers& operator+=(const Numbers& other) {
    for (std::size_t i = 0; i < size(); ++i) (*this)[i] += other[i];
    return *this;
  }
};

std::unique_ptr<Family> make_pixel_histogram(const Layout&);
std::unique_ptr<Family> make_static_maps(const Layout&);
std::unique_ptr<Family> make_temporal_maps(const Layout&);
std::unique_ptr<Family> make_lines(const Layout&);
std::unique_ptr<Family> make_readout_spectrum(const Layout&);
std::unique_ptr<Family> make_neighbours(const Layout&);
std::unique_ptr<Family> make_trailing(const Layout&);
std::unique_ptr<Family> make_frame_series(const Layout&);
std::unique_ptr<Family> make_clusters(const Layout&);
// Only with sites.
std::unique_ptr<Family> make_site_brightness(const Layout&);
std::unique_ptr<Family> make_point_spread(const Layout&);
std::unique_ptr<Family> make_far_light(const Layout&);

}  // namespace atomcam::analysis
