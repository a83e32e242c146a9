// Two visits of a sequence: the first gives the sites' brightness and the means, the second what is left over
// them.

#include <algorithm>
#include <cmath>

#include "analysis/battery.hpp"
#include "analysis/family.hpp"
#include "analysis/lanes.hpp"
#include "base/error.hpp"

namespace atomcam {
namespace analysis {
namespace {

using MakeFamily = std::unique_ptr<Family> (*)(const Layout&);

struct ListedFamily {
  MakeFamily make;
  bool darks;  // also of frames with the shutter closed
  bool sites;  // only of frames with sites
};

constexpr ListedFamily families[] = {
    {make_pixel_histogram, true, false},  {make_static_maps, true, false},
    {make_temporal_maps, true, false},    {make_lines, true, false},
    {make_readout_spectrum, true, false}, {make_neighbours, true, false},
    {make_trailing, true, false},         {make_frame_series, true, false},
    {make_clusters, true, false},         {make_site_brightness, false, true},
    {make_point_spread, false, true},     {make_far_light, false, true},
};

ATOMCAM_VECTOR_CLONES
void counts_to_plane(const CountImage& counts, float bias, Plane& plane) {
  const int columns = counts.columns();
  for (int r = 0; r < counts.rows(); ++r) {
    const std::uint16_t* from = counts.row(r).data();
    float* to = plane.row(r);
    for (int c = 0; c < columns; ++c) to[c] = static_cast<float>(from[c]) - bias;
  }
}

ATOMCAM_VECTOR_CLONES
double weighted(const PackedSite& site, const Floats& weight, const float* plane, std::ptrdiff_t stride) {
  Lanes sum = lanes(0);
  const float* w = weight.data();
  for (int r = 0; r < site.rows; ++r, plane += stride)
    for (std::size_t c = 0; c < site.width; c += lane_count, w += lane_count)
      sum += load(plane + c) * load(w);
  return total(sum);
}

ATOMCAM_VECTOR_CLONES
void take_away(const PackedSite& site, float brightness, float* plane, std::ptrdiff_t stride) {
  const float* s = site.share.data();
  const Lanes b = lanes(brightness);
  for (int r = 0; r < site.rows; ++r, plane += stride)
    for (std::size_t c = 0; c < site.width; c += lane_count, s += lane_count)
      store(plane + c, load(plane + c) - b * load(s));
}

constexpr float clip = 3;

ATOMCAM_VECTOR_CLONES
void add_means(std::size_t n, const float* light, const float* inverse_scale, float* sum,
               float* clipped_sum) {
  const Lanes top = lanes(clip), bottom = lanes(-clip);
  for (std::size_t i = 0; i < n; i += lane_count) {
    const Lanes x = load(light + i), z = x * load(inverse_scale + i);
    const Lanes clipped = larger(smaller(z, top), bottom);
    store(sum + i, load(sum + i) + x);
    store(clipped_sum + i, load(clipped_sum + i) + clipped);
  }
}

struct FrameSums {
  double quiet = 0, square = 0, repeat = 0;
};

/// Fills scaled, residual and quiet; sums over the frame.
ATOMCAM_VECTOR_CLONES
FrameSums residuals(std::size_t n, const float* light, const float* inverse_scale, const float* weight,
                    const float* clipped_mean, const float* before, float* scaled, float* residual,
                    float* quiet) {
  const Lanes top = lanes(clip), bottom = lanes(-clip);
  Lanes sum = lanes(0), square = lanes(0), repeat = lanes(0);
  for (std::size_t i = 0; i < n; i += lane_count) {
    const Lanes z = load(light + i) * load(inverse_scale + i);
    const Lanes clipped = larger(smaller(z, top), bottom);
    const Lanes q = clipped - load(clipped_mean + i);
    const Lanes a = q * load(weight + i);
    store(scaled + i, z);
    store(residual + i, q);
    store(quiet + i, a);
    sum += a;
    square += q * q;
    repeat += q * load(before + i);
  }
  return {total(sum), total(square), total(repeat)};
}

void clear_margin(Plane& plane) {
  const PlaneShape& shape = plane.shape();
  for (int r = 0; r < shape.rows; ++r)
    std::fill(plane.row(r) + shape.columns, plane.row(r) + shape.stride, 0.0f);
}

class Measurement {
 public:
  Measurement(const StackModel& model, bool darks) : layout_(model, darks), record_(layout_) {
    for (const ListedFamily& family : families)
      if ((!darks || family.darks) && (!family.sites || !layout_.packed.empty()))
        families_.push_back(family.make(layout_));
    for (int p : {0, 1}) {
      record_.sum[static_cast<std::size_t>(p)] = Plane(layout_.shape);
      record_.clipped_sum[static_cast<std::size_t>(p)] = Plane(layout_.shape);
    }
  }

  void look(const FrameSequence& sequence, BatterySplit split) {
    if (sequence.shape() != Shape{layout_.shape.rows, layout_.shape.columns} && sequence.frames() > 0)
      throw Error("frames", "their shape differs from the stack model's");
    const std::size_t block = std::max<std::size_t>(split.block, 1);
    record_.frames = sequence.frames();
    for (std::size_t n = 0; n < record_.frames; ++n)
      record_.part.push_back(static_cast<std::uint8_t>(n / block % 2));
    first_visit(sequence);
    second_visit(sequence);
  }

  void summarise(Part which, Sheet& sheet) const {
    sheet.frames(layout_.darks, record_.count(which) > 0);
    for (const auto& family : families_) family->summarise(which, record_, sheet);
  }

 private:
  void first_visit(const FrameSequence& sequence) {
    const std::size_t sites = record_.sites(), n_inner = layout_.shape.inner();
    record_.brightness.resize(record_.frames * sites);
    mean_brightness_.assign(sites, 0.0f);
    record_.linear_level.assign(record_.frames, 0.0);
    Plane light(layout_.shape);
    std::vector<double> brightness_sum(sites);
    sequence.visit([&](std::size_t n, const CountImage& counts) {
      const int part = record_.part[n];
      ++record_.in_part[static_cast<std::size_t>(part)];
      counts_to_plane(counts, layout_.pedestal, light);
      double level = 0;
      for (std::size_t s = 0; s < sites; ++s) {
        const PackedSite& site = layout_.packed[s];
        const double b = weighted(site, site.weight, light.all() + site.offset, layout_.shape.stride) -
                         static_cast<double>(layout_.background) * site.weight_sum;
        record_.brightness[n * sites + s] = static_cast<float>(b);
        brightness_sum[s] += b;
      }
      for (std::size_t s = 0; s < sites; ++s)
        take_away(layout_.packed[s], record_.brightness[n * sites + s],
                  light.all() + layout_.packed[s].offset, layout_.shape.stride);
      const auto pixels = counts.pixels();
      std::uint64_t dark_sum = 0;
      for (const std::uint32_t p : layout_.dark_pixels) dark_sum += pixels[p];
      level = static_cast<double>(dark_sum) / static_cast<double>(layout_.dark_pixels.size()) -
              static_cast<double>(layout_.bias);
      record_.linear_level[n] = level;
      add_means(n_inner, light.inner(), layout_.inverse_scale.inner(),
                record_.sum[static_cast<std::size_t>(part)].inner(),
                record_.clipped_sum[static_cast<std::size_t>(part)].inner());
      for (const auto& family : families_) family->first_look({n, part, counts});
    });
    for (std::size_t s = 0; s < sites; ++s)
      mean_brightness_[s] = static_cast<float>(brightness_sum[s] /
                                               static_cast<double>(std::max<std::size_t>(record_.frames, 1)));
    mean_ = Plane(layout_.shape);
    clipped_mean_ = Plane(layout_.shape);
    const float inverse = record_.frames ? 1 / static_cast<float>(record_.frames) : 0.0f;
    for (std::size_t i = 0; i < n_inner; ++i) {
      mean_.inner()[i] = (record_.sum[0].inner()[i] + record_.sum[1].inner()[i]) * inverse;
      clipped_mean_.inner()[i] =
          (record_.clipped_sum[0].inner()[i] + record_.clipped_sum[1].inner()[i]) * inverse;
    }
    clear_margin(mean_);
    clear_margin(clipped_mean_);
  }

  void second_visit(const FrameSequence& sequence) {
    const std::size_t sites = record_.sites();
    record_.level.assign(record_.frames, 0.0);
    record_.noise.assign(record_.frames, 0.0);
    record_.repeat.assign(record_.frames, not_a_number);
    Plane light(layout_.shape), quiet(layout_.shape);
    const Plane zero(layout_.shape);
    std::array<Plane, 3> scaled{zero, zero, zero}, residual{zero, zero, zero};
    const double pixels = static_cast<double>(layout_.shape.pixels());
    std::vector<double> norms(record_.frames);
    sequence.visit([&](std::size_t n, const CountImage& counts) {
      const int part = record_.part[n];
      counts_to_plane(counts, layout_.pedestal, light);
      const std::span brightness = std::span(record_.brightness).subspan(n * sites, sites);
      for (std::size_t s = 0; s < sites; ++s)
        take_away(layout_.packed[s], brightness[s], light.all() + layout_.packed[s].offset,
                  layout_.shape.stride);
      const auto same = [&](std::size_t back) { return n >= back && record_.part[n - back] == part; };
      Plane& z = scaled[n % 3];
      Plane& q = residual[n % 3];
      const Plane& q1 = residual[(n + 2) % 3];
      const Plane& q2 = residual[(n + 1) % 3];
      const FrameSums sums = residuals(
          layout_.shape.inner(), light.inner(), layout_.inverse_scale.inner(), layout_.quiet.inner(),
          clipped_mean_.inner(), n > 0 ? q1.inner() : zero.inner(), z.inner(), q.inner(), quiet.inner());
      // Stamps reach into the margin with weight zero; nothing else writes there.
      record_.level[n] = sums.quiet / layout_.quiet_sum;
      record_.noise[n] = sums.square / pixels;
      norms[n] = sums.square;
      if (n > 0 && norms[n] > 0 && norms[n - 1] > 0)
        record_.repeat[n] = sums.repeat / std::sqrt(norms[n] * norms[n - 1]);
      const bool one = same(1), two = one && same(2);
      const SecondLook look{.frame = n,
                            .part = part,
                            .counts = counts,
                            .light = light,
                            .mean = mean_,
                            .scaled = z,
                            .residual = q,
                            .quiet = quiet,
                            .before = one ? &q1 : nullptr,
                            .before_that = two ? &q2 : nullptr,
                            .scaled_before = one ? &scaled[(n + 2) % 3] : nullptr,
                            .scaled_before_that = two ? &scaled[(n + 1) % 3] : nullptr,
                            .brightness = brightness,
                            .mean_brightness = mean_brightness_};
      for (const auto& family : families_) family->second_look(look);
    });
  }

  Layout layout_;
  Record record_;
  std::vector<std::unique_ptr<Family>> families_;
  std::vector<float> mean_brightness_;
  Plane mean_, clipped_mean_;
};

}  // namespace
}  // namespace analysis

std::vector<StatisticDeclaration> battery(const StackModel& model, bool darks) {
  analysis::Sheet sheet(true);
  analysis::Measurement(model, false).summarise(analysis::Part::whole, sheet);
  if (darks) analysis::Measurement(model, true).summarise(analysis::Part::whole, sheet);
  return sheet.take_declarations();
}

BatteryValues measure(const StackModel& model, const FrameSequence& light, const FrameSequence* darks,
                      BatterySplit split) {
  using analysis::Part;
  std::vector<std::unique_ptr<analysis::Measurement>> measurements;
  measurements.push_back(std::make_unique<analysis::Measurement>(model, false));
  measurements.back()->look(light, split);
  if (darks) {
    measurements.push_back(std::make_unique<analysis::Measurement>(model, true));
    measurements.back()->look(*darks, split);
  }
  const auto values = [&](Part which) {
    analysis::Sheet sheet(false);
    for (const auto& measurement : measurements) measurement->summarise(which, sheet);
    return sheet.take_values();
  };
  return {values(Part::whole), {values(Part::first), values(Part::second)}};
}

}  // namespace atomcam
