#include "analysis/shape_templates.hpp"

#include "analysis/stamp_templates.hpp"

namespace atomcam::analysis {

ShapeTemplates::ShapeTemplates(const Layout& layout, const PackedSite& packed) {
  // The Laplacian reaches a pixel beyond the stamp, and is differentiated itself.
  const std::size_t wide = static_cast<std::size_t>(packed.columns) + 2;
  const auto around = [&](int r, int c) {
    return wide * static_cast<std::size_t>(r + 1) + static_cast<std::size_t>(c + 1);
  };
  std::vector<double> laplacians(wide * (static_cast<std::size_t>(packed.rows) + 2));
  for (int r = -1; r <= packed.rows; ++r)
    for (int c = -1; c <= packed.columns; ++c) laplacians[around(r, c)] = laplacian_at(packed, r, c);

  for (Floats& change : weighed) change.assign(packed.share.size(), 0.0f);
  for (int r = 0; r < packed.rows; ++r)
    for (int c = 0; c < packed.columns; ++c) {
      const auto share = [&](int down, int right) { return share_at(packed, r + down, c + right); };
      const auto laplacian = [&](int down, int right) { return laplacians[around(r + down, c + right)]; };
      const OfImageChange<double> change = {
          (share(0, 1) - share(0, -1)) / 2,
          (share(1, 0) - share(-1, 0)) / 2,
          share(0, 1) - 2 * share(0, 0) + share(0, -1),
          share(1, 0) - 2 * share(0, 0) + share(-1, 0),
          (share(1, 1) + share(-1, -1) - share(1, -1) - share(-1, 1)) / 4,
          (laplacian(0, 1) - laplacian(0, -1)) / 2,
          (laplacian(1, 0) - laplacian(-1, 0)) / 2,
          laplacian(0, 1) + laplacian(0, -1) + laplacian(1, 0) + laplacian(-1, 0) - 4 * laplacian(0, 0)};
      const double scale = static_cast<double>(layout.inverse_scale_at(packed, r, c)), weight = scale * scale;
      const std::size_t i = packed.width * static_cast<std::size_t>(r) + static_cast<std::size_t>(c);
      for (std::size_t k = 0; k < change.size(); ++k) {
        weighed[k][i] = static_cast<float>(change[k] * weight);
        norm[k] += change[k] * change[k] * weight;
      }
    }
}

}  // namespace atomcam::analysis
