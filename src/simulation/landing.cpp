#include "simulation/landing.hpp"

#include <algorithm>
#include <cmath>

#include "base/math.hpp"
#include "base/samplers.hpp"
#include "simulation/parallel.hpp"

namespace atomcam {
namespace {

constexpr double defocus_step_um = 0.002;
constexpr std::size_t batch = 1024;  // photons whose random words are drawn at once

float largest(const RatioMap* map) {
  if (!map) return 1;
  const auto pixels = map->pixels();
  return pixels.empty() ? 1 : std::max(0.0f, *std::max_element(pixels.begin(), pixels.end()));
}

/// A Gaussian blur with its principal axes, in sensor pixels.
struct BlurAxes {
  double major_px, minor_px, cosine, sine;
  BlurAxes(const Emitter& emitter, double pixels_per_um)
      : major_px(emitter.blur_major_um * pixels_per_um),
        minor_px(emitter.blur_minor_um * pixels_per_um),
        cosine(math::cos_turns(emitter.blur_angle_deg / 360)),
        sine(math::sin_turns(emitter.blur_angle_deg / 360)) {}
  bool none() const { return major_px == 0 && minor_px == 0; }
};

/// Draws where the electrons of one emitter land, as keys row << 16 | column of the filled plane.
class EmitterLanding {
 public:
  EmitterLanding(const Landing& landing, float largest_response)
      : landing_(landing),
        largest_response_(largest_response),
        keys_{stream_key(landing.seed, stream_id("optics/electrons")),
              stream_key(landing.seed, stream_id("optics/landing")),
              stream_key(landing.seed, stream_id("optics/blur")),
              stream_key(landing.seed, stream_id("optics/halo")),
              stream_key(landing.seed, stream_id("optics/time")),
              stream_key(landing.seed, stream_id("optics/response"))} {}

  void draw(int index, std::vector<std::uint32_t>& landed) const {
    const Emitter& emitter = (*landing_.light->emitters)[index];
    const auto block = static_cast<std::uint32_t>(index);
    const double mean = emitter.emitted() * landing_.electrons_per_photon * largest_response_;
    if (!(mean > 0)) return;
    RandomStream count_stream(keys_.electrons, landing_.frame, block);
    const std::int64_t count = sample_poisson(count_stream, mean);
    landed.reserve(static_cast<std::size_t>(count));

    const PointSpreadFunction& point_spread = landing_.point_spread->at(emitter.defocus_um);
    const LightField& light = *landing_.light;
    const double centre_x = emitter.x_px + light.shift_x_px, centre_y = emitter.y_px + light.shift_y_px;
    const BlurAxes blur(emitter, landing_.pixels_per_um);
    RandomStream blur_stream(keys_.blur, landing_.frame, block);
    RandomStream halo_stream(keys_.halo, landing_.frame, block);
    RandomStream time_stream(keys_.time, landing_.frame, block);
    RandomStream response_stream(keys_.response, landing_.frame, block);

    const Region& region = landing_.region;
    const int plane_rows = landing_.plane().rows, plane_columns = landing_.plane().columns;
    const bool binned = landing_.binning_x != 1 || landing_.binning_y != 1;
    std::vector<std::uint32_t> words(2 * std::min<std::size_t>(static_cast<std::size_t>(count), batch));
    std::vector<PointSpreadFunction::Displacement> displacements(words.size() / 2);
    RandomStream landing_stream(keys_.landing, landing_.frame, block);
    for (std::int64_t first = 0; first < count; first += static_cast<std::int64_t>(batch)) {
      const auto photons = std::min<std::size_t>(batch, static_cast<std::size_t>(count - first));
      if (count <= static_cast<std::int64_t>(batch))
        fill_random(keys_.landing, landing_.frame, block, std::span(words).first(2 * photons));
      else
        for (std::size_t i = 0; i < 2 * photons; ++i) words[i] = landing_stream();
      point_spread.draw(std::span(words).first(2 * photons), std::span(displacements).first(photons));
      for (std::size_t i = 0; i < photons; ++i) {
        double x = centre_x + static_cast<double>(displacements[i].dx_px);
        double y = centre_y + static_cast<double>(displacements[i].dy_px);
        if (!blur.none()) {
          const double u = blur.major_px * sample_normal(blur_stream),
                       v = blur.minor_px * sample_normal(blur_stream);
          x += blur.cosine * u - blur.sine * v;
          y += blur.sine * u + blur.cosine * v;
        }
        if (light.halo_fraction > 0) {
          const double share = halo_stream.uniform(), angle = halo_stream.uniform();
          const double radius = light.halo_scale_px * sample_exponential(halo_stream);
          if (share < light.halo_fraction) {
            x += radius * math::cos_turns(angle);
            y += radius * math::sin_turns(angle);
          }
        }
        const double column_px = std::floor(x + 0.5) - region.offset_x,
                     row_px = std::floor(y + 0.5) - region.offset_y;
        const bool inside =
            column_px >= 0 && row_px >= 0 && column_px < region.width && row_px < region.height;
        if (!landing_.window.global()) {
          // A rolling shutter: the photon counts if its row is open when it arrives.
          const double time = landing_.window.light_begin_s + emitter.start_s +
                              time_stream.uniform() * (emitter.end_s - emitter.start_s);
          if (!inside) continue;
          const double opens = landing_.window.row_begin_s(static_cast<int>(row_px));
          if (time < opens || time >= opens + landing_.window.exposure_s) continue;
        }
        if (!inside) {
          if (light.response_ratio) response_stream.uniform();
          continue;
        }
        int row = static_cast<int>(row_px), column = static_cast<int>(column_px);
        if (binned) {
          row /= landing_.binning_y;
          column /= landing_.binning_x;
          if (row >= plane_rows || column >= plane_columns) continue;
        }
        if (light.response_ratio && response_stream.uniform() * static_cast<double>(largest_response_) >=
                                        static_cast<double>((*light.response_ratio)(row, column)))
          continue;
        landed.push_back(static_cast<std::uint32_t>(row) << 16 | static_cast<std::uint32_t>(column));
      }
    }
  }

 private:
  struct Keys {
    PhiloxKey electrons, landing, blur, halo, time, response;
  };
  const Landing& landing_;
  float largest_response_;
  Keys keys_;
};

/// Counting sort by row: what a readout takes.
PhotoElectrons by_row(std::span<const std::vector<std::uint32_t>> landed, int rows) {
  PhotoElectrons electrons;
  electrons.row_begin.assign(static_cast<std::size_t>(rows) + 1, 0);
  for (const auto& keys : landed)
    for (const std::uint32_t key : keys) ++electrons.row_begin[(key >> 16) + 1];
  for (std::size_t r = 1; r < electrons.row_begin.size(); ++r)
    electrons.row_begin[r] += electrons.row_begin[r - 1];
  electrons.columns.resize(electrons.row_begin.back());
  std::vector<std::uint32_t> next(electrons.row_begin.begin(), electrons.row_begin.end() - 1);
  for (const auto& keys : landed)
    for (const std::uint32_t key : keys)
      electrons.columns[next[key >> 16]++] = static_cast<std::uint16_t>(key);
  return electrons;
}

}  // namespace

const PointSpreadFunction& PointSpreadFunctions::at(double defocus_um) const {
  const int step = static_cast<int>(std::lround(defocus_um / defocus_step_um));
  const std::lock_guard lock(mutex_);
  auto& function = by_defocus_[step];
  if (!function) function = std::make_unique<PointSpreadFunction>(optics_, step * defocus_step_um, blur_um_);
  return *function;
}

double Landing::expected_electrons(const Emitter& emitter) const {
  if (window.global()) return emitter.emitted() * electrons_per_photon;
  // The shutter's time at the emitter's own row stands for the few rows of its image.
  const int row = static_cast<int>(std::floor(emitter.y_px + light->shift_y_px + 0.5)) - region.offset_y;
  return emitter.rate_hz * electrons_per_photon *
         window.overlap_s(std::clamp(row, 0, region.height - 1), window.light_begin_s + emitter.start_s,
                          window.light_begin_s + emitter.end_s);
}

PhotoElectrons Landing::draw(std::span<std::int64_t> detected, int threads) const {
  const EmitterLanding emitter_landing(*this, largest(light->response_ratio.get()));
  const int emitters = static_cast<int>(light->emitters->size());
  std::vector<std::vector<std::uint32_t>> landed(light->emitters->size());
  parallel_for(emitters, threads, 16, [&](int i) {
    emitter_landing.draw(i, landed[i]);
    detected[i] = static_cast<std::int64_t>(landed[i].size());
  });
  return by_row(landed, plane().rows);
}

void Landing::add_expected(PhotonImage& image) const {
  // Points and weights of Gauss-Hermite quadrature with five points, for a standard normal variable.
  constexpr double points[5] = {-2.8569700138728056, -1.3556261799742659, 0, 1.3556261799742659,
                                2.8569700138728056};
  constexpr double weights[5] = {0.011257411327720689, 0.22207592200561264, 0.53333333333333333,
                                 0.22207592200561264, 0.011257411327720689};
  PhotonImage atoms(image.shape());
  for (const Emitter& emitter : *light->emitters) {
    const double x = emitter.x_px + light->shift_x_px, y = emitter.y_px + light->shift_y_px;
    const double electrons = expected_electrons(emitter);
    const PointSpreadFunction& function = point_spread->at(emitter.defocus_um);
    const BlurAxes blur(emitter, pixels_per_um);
    const auto add = [&](double share, double dx, double dy) {
      function.add_expected(atoms, electrons * share, x + dx, y + dy, region.offset_x, region.offset_y,
                            binning_x, binning_y);
    };
    const double direct = 1 - light->halo_fraction;
    if (blur.none()) {
      add(direct, 0, 0);
    } else {
      for (int a = 0; a < 5; ++a)
        for (int b = 0; b < 5; ++b) {
          const double u = blur.major_px * points[a], v = blur.minor_px * points[b];
          add(direct * weights[a] * weights[b], blur.cosine * u - blur.sine * v,
              blur.sine * u + blur.cosine * v);
        }
    }
    if (light->halo_fraction > 0) {
      // The halo is smooth: 24 angles by 12 equally likely radii stand for it.
      constexpr int angles = 24, radii = 12;
      for (int a = 0; a < angles; ++a)
        for (int r = 0; r < radii; ++r) {
          const double radius = -light->halo_scale_px * math::log(1 - (r + 0.5) / radii);
          const double angle = (a + 0.5) / angles;
          add(light->halo_fraction / (angles * radii), radius * math::cos_turns(angle),
              radius * math::sin_turns(angle));
        }
    }
  }
  for (int row = 0; row < image.rows(); ++row)
    for (int column = 0; column < image.columns(); ++column)
      image(row, column) +=
          atoms(row, column) * (light->response_ratio ? (*light->response_ratio)(row, column) : 1.0f);
}

}  // namespace atomcam
