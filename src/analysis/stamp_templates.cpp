#include "analysis/stamp_templates.hpp"

#include <utility>
#include <vector>

#include "analysis/lanes.hpp"
#include "analysis/products.hpp"

namespace atomcam::analysis {
namespace {

Floats times(Floats a, const Floats& b) {
  for (std::size_t i = 0; i < a.size(); ++i) a[i] *= b[i];
  return a;
}

/// What a site's pixels gain when its image gets wider by itself, in deviations of their noise: the Laplacian
/// of the share, less what of it looks like any of `others` (counts).
Floats widening_of(const PackedSite& packed, const Floats& inverse_scale, std::vector<Floats> others) {
  const auto product = [](const Floats& a, const Floats& b) {
    return sum_of_products(a.size(), a.data(), b.data());
  };
  const auto take_away = [&](const Floats& of, Floats& from) {
    const auto part = static_cast<float>(product(of, from) / product(of, of));
    for (std::size_t i = 0; i < of.size(); ++i) from[i] -= part * of[i];
  };
  constexpr double rounding = 1e-6;
  std::vector<Floats> apart;
  for (Floats& counts : others) {
    Floats other = times(std::move(counts), inverse_scale);
    const double whole = product(other, other);
    for (const Floats& before : apart) take_away(before, other);
    if (product(other, other) > rounding * whole) apart.push_back(std::move(other));
  }
  Floats widening(packed.share.size(), 0.0f);
  for (int r = 0; r < packed.rows; ++r)
    for (int c = 0; c < packed.columns; ++c)
      widening[packed.width * static_cast<std::size_t>(r) + static_cast<std::size_t>(c)] =
          static_cast<float>(laplacian_at(packed, r, c));
  widening = times(std::move(widening), inverse_scale);
  for (const Floats& other : apart) take_away(other, widening);
  return widening;
}

}  // namespace

double share_at(const PackedSite& packed, int r, int c) {
  return r < 0 || c < 0 || r >= packed.rows || c >= packed.columns
             ? 0.0
             : static_cast<double>(
                   packed.share[packed.width * static_cast<std::size_t>(r) + static_cast<std::size_t>(c)]);
}

double laplacian_at(const PackedSite& packed, int r, int c) {
  return share_at(packed, r, c + 1) + share_at(packed, r, c - 1) + share_at(packed, r + 1, c) +
         share_at(packed, r - 1, c) - 4 * share_at(packed, r, c);
}

StampTemplates::StampTemplates(const Layout& layout, const PackedSite& packed) {
  const Floats none(packed.share.size(), 0.0f);
  Floats inverse_scale = none;
  x = y = core = wing = none;
  for (int r = 0; r < packed.rows; ++r)
    for (int c = 0; c < packed.columns; ++c) {
      const std::size_t i = packed.width * static_cast<std::size_t>(r) + static_cast<std::size_t>(c);
      const float scale = layout.inverse_scale_at(packed, r, c), scale2 = scale * scale;
      x[i] = packed.slope_x[i] * scale2;
      y[i] = packed.slope_y[i] * scale2;
      core[i] = packed.core[i] * scale2;
      wing[i] = packed.wing[i] * scale2;
      norm_x += static_cast<double>(x[i]) * static_cast<double>(packed.slope_x[i]);
      norm_y += static_cast<double>(y[i]) * static_cast<double>(packed.slope_y[i]);
      inverse_scale[i] = scale;
    }
  const Floats level(packed.share.size(), 1.0f), light_in_error = times(packed.share, packed.weight);
  width = widening_of(packed, inverse_scale, {level, packed.share});
  // Atoms that seem fainter by chance are no wider: nor does it go with the error that read noise or photon
  // noise make in the brightness.
  atom_width = widening_of(packed, inverse_scale, {level, packed.share, packed.weight, light_in_error});
  norm_width = sum_of_products(width.size(), width.data(), width.data());
  norm_atom_width = sum_of_products(atom_width.size(), atom_width.data(), atom_width.data());
  width = times(std::move(width), inverse_scale);
  atom_width = times(std::move(atom_width), inverse_scale);
}

ATOMCAM_VECTOR_CLONES
StampSums add_stamp(const PackedSite& packed, const StampTemplates& templates, const float* light,
                    const float* mean, std::ptrdiff_t stride, float change, float* response) {
  const float *slope_x = templates.x.data(), *slope_y = templates.y.data(),
              *widening = templates.width.data(), *atom_widening = templates.atom_width.data(),
              *core = templates.core.data(), *wing = templates.wing.data();
  const std::size_t rows = static_cast<std::size_t>(packed.rows), width = packed.width;
  Lanes x = lanes(0), y = x, wider = x, atom_wider = x, c2 = x, w2 = x, c3 = x;
  const Lanes change_lanes = lanes(change);
  std::size_t i = 0;
  for (std::size_t r = 0; r < rows; ++r, light += stride, mean += stride)
    for (std::size_t c = 0; c < width; c += lane_count, i += lane_count) {
      const Lanes d = load(light + c) - load(mean + c), d2 = d * d, in_core = load(core + i);
      store(response + i, load(response + i) + change_lanes * d);
      x += d * load(slope_x + i);
      y += d * load(slope_y + i);
      wider += d * load(widening + i);
      atom_wider += d * load(atom_widening + i);
      c2 += d2 * in_core;
      c3 += d2 * d * in_core;
      w2 += d2 * load(wing + i);
    }
  return {static_cast<float>(total(x)),     static_cast<float>(total(y)),
          static_cast<float>(total(wider)), static_cast<float>(total(atom_wider)),
          static_cast<float>(total(c2)),    static_cast<float>(total(w2)),
          static_cast<float>(total(c3))};
}

}  // namespace atomcam::analysis
