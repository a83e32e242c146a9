#include "analysis/layout.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "base/error.hpp"

namespace atomcam::analysis {
namespace {

PackedSite pack(const PlaneShape& shape, const SiteImage& site, float share_scale, float weight_scale) {
  PackedSite packed;
  packed.rows = site.share.rows();
  packed.columns = site.share.columns();
  if (site.weight.shape() != site.share.shape() || site.left < 0 || site.top < 0 ||
      site.left + packed.columns > shape.columns || site.top + packed.rows > shape.rows)
    throw Error("stack model", "a site's stamp does not lie within the frame");
  packed.offset = shape.index(site.top, site.left);
  packed.width = (static_cast<std::size_t>(packed.columns) + PlaneShape::lanes - 1) / PlaneShape::lanes *
                 PlaneShape::lanes;
  const std::size_t size = packed.width * static_cast<std::size_t>(packed.rows);
  for (Floats* values :
       {&packed.share, &packed.weight, &packed.slope_x, &packed.slope_y, &packed.core, &packed.wing})
    values->assign(size, 0.0f);
  const auto share = [&](int r, int c) {
    return r < 0 || c < 0 || r >= packed.rows || c >= packed.columns ? 0.0f : site.share(r, c);
  };
  float peak = 0;
  for (const float value : site.share.pixels()) peak = std::max(peak, value);
  for (int r = 0; r < packed.rows; ++r)
    for (int c = 0; c < packed.columns; ++c) {
      const std::size_t i = packed.width * static_cast<std::size_t>(r) + static_cast<std::size_t>(c);
      packed.share[i] = share(r, c) * share_scale;
      packed.weight[i] = site.weight(r, c) * weight_scale;
      packed.weight_sum += static_cast<double>(packed.weight[i]);
      packed.slope_x[i] = (share(r, c + 1) - share(r, c - 1)) / 2 * share_scale;
      packed.slope_y[i] = (share(r + 1, c) - share(r - 1, c)) / 2 * share_scale;
      (share(r, c) > 0.3f * peak ? packed.core : packed.wing)[i] = 1;
    }
  return packed;
}

}  // namespace

Layout::Layout(const StackModel& model, bool for_darks)
    : shape(model.shape),
      darks(for_darks),
      bias(static_cast<float>(model.bias_counts)),
      // Below this, rounding to whole counts is the noise.
      read_noise(static_cast<float>(std::max(model.read_noise_counts, 0.3))),
      counts_per_e(static_cast<float>(std::max(model.counts_per_electron, 1e-6))),
      multiplied(model.excess_noise > 1.2),
      filling(model.filling),
      expected(for_darks ? model.expected_dark : model.expected_light),
      inverse_scale(shape),
      quiet(shape),
      event_threshold(shape),
      site_light(shape) {
  if (model.shape.rows < 8 || model.shape.columns < 8)
    throw Error("stack model", "frames of fewer than 8 x 8 pixels cannot be measured");
  if (!model.site_light.empty() && model.site_light.shape() != model.shape)
    throw Error("stack model", "site light of another shape than the frames");
  const double gain = static_cast<double>(counts_per_e), read = static_cast<double>(read_noise);
  const double events = model.dark_e + (darks ? 0 : model.background_e);
  const double atom = std::max(model.atom_e, 1.0);
  atom_counts = static_cast<float>(atom * gain);
  const double pixel_variance = model.excess_noise * gain * gain;
  white = std::sqrt(read * read + pixel_variance * events);
  background = multiplied ? static_cast<float>(events * gain) : 0.0f;
  pedestal = multiplied ? bias : bias + static_cast<float>(events * gain);
  dark_scale = multiplied ? read_noise : static_cast<float>(white);
  const double base = static_cast<double>(dark_scale);
  // One electron's exponential tail reaches this often less than once in a million pixels.
  const double tail = multiplied ? 14 * gain : 0;
  const auto event_from = [&](double noise) { return 7 * noise + tail + static_cast<double>(background); };
  least_event = event_from(white);
  drive_cap = static_cast<float>(std::max(12.0, 3 * gain / base));
  const bool lit = !darks && !model.site_light.empty() && !model.sites.empty();
  for (int r = 0; r < shape.rows; ++r)
    for (int c = 0; c < shape.columns; ++c) {
      const double light = lit ? std::max(0.0, static_cast<double>(model.site_light(r, c))) : 0.0;
      const double scale = std::sqrt(base * base + pixel_variance * atom * model.filling * light);
      const double full = std::sqrt(white * white + pixel_variance * atom * light);
      inverse_scale.at(r, c) = static_cast<float>(1 / scale);
      const double q = base / scale;
      quiet.at(r, c) = static_cast<float>(q);
      quiet_sum += q;
      quiet_square_sum += q * q;
      site_light.at(r, c) = static_cast<float>(light);
      event_threshold.at(r, c) = static_cast<float>(event_from(full) / scale);
    }
  for (int r = -PlaneShape::margin_rows; r < shape.rows + PlaneShape::margin_rows; ++r)
    for (std::ptrdiff_t c = 0; c < shape.stride; ++c)
      if (r < 0 || r >= shape.rows || c >= shape.columns)
        event_threshold.all()[shape.index(r, static_cast<int>(c))] = 1e30f;
  std::vector<std::uint32_t> order(shape.pixels());
  std::iota(order.begin(), order.end(), 0u);
  if (lit) {
    const auto light = model.site_light.pixels();
    const auto dark = static_cast<std::ptrdiff_t>(order.size() * 3 / 10);
    std::nth_element(order.begin(), order.begin() + dark, order.end(), [&](std::uint32_t a, std::uint32_t b) {
      return light[a] != light[b] ? light[a] < light[b] : a < b;
    });
    order.resize(static_cast<std::size_t>(dark));
    std::sort(order.begin(), order.end());
  }
  dark_pixels = std::move(order);
  if (darks) return;
  sites = model.sites;
  for (const SiteImage& site : sites)
    packed.push_back(
        pack(shape, site, static_cast<float>(atom * gain), static_cast<float>(1 / (atom * gain))));
}

}  // namespace atomcam::analysis
