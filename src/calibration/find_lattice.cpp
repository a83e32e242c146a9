#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <vector>

#include "calibration/lattice.hpp"

namespace atomcam {

Lattice find_lattice(const MeanImage& mean, const Lattice& noted, double spot_px) {
  const int rows = mean.electrons.rows(), columns = mean.electrons.columns();
  // The mean image smoothed by the spot, its value at a position is the correlation with a spot there; by
  // less where images overlap, of which too little would be left to tell one from the next.
  const double spacing = std::max(4.0, std::hypot(noted.a_x, noted.a_y));
  if (noted.sites() > 1) spot_px = std::min(spot_px, 0.2 * spacing);
  const int reach = std::max(1, static_cast<int>(std::ceil(2.5 * spot_px)));
  std::vector<double> kernel(2 * static_cast<std::size_t>(reach) + 1);
  double total = 0;
  for (int k = -reach; k <= reach; ++k)
    total += kernel[k + reach] = std::exp(-0.5 * k * k / (spot_px * spot_px));
  for (double& k : kernel) k /= total;
  Eigen::ArrayXXd smooth(rows, columns), across(rows, columns);
  for (int y = 0; y < rows; ++y)
    for (int x = 0; x < columns; ++x) {
      double sum = 0;
      for (int k = -reach; k <= reach; ++k)
        sum += kernel[k + reach] * mean.electrons(y, std::clamp(x + k, 0, columns - 1));
      across(y, x) = sum;
    }
  for (int y = 0; y < rows; ++y)
    for (int x = 0; x < columns; ++x) {
      double sum = 0;
      for (int k = -reach; k <= reach; ++k)
        sum += kernel[k + reach] * across(std::clamp(y + k, 0, rows - 1), x);
      smooth(y, x) = sum;
    }
  // One bright outlier must not draw the lattice: light counts by its square root.
  const double floor = [&] {
    std::vector<double> values(smooth.data(), smooth.data() + smooth.size());
    std::nth_element(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(values.size() / 4),
                     values.end());
    return values[values.size() / 4];
  }();
  smooth = (smooth - floor).max(0).sqrt();
  const auto at = [&](double x, double y) {
    const int i = static_cast<int>(std::floor(x)), j = static_cast<int>(std::floor(y));
    if (i < 0 || j < 0 || i + 1 >= columns || j + 1 >= rows) return 0.0;
    const double u = x - i, v = y - j;
    return (1 - v) * ((1 - u) * smooth(j, i) + u * smooth(j, i + 1)) +
           v * ((1 - u) * smooth(j + 1, i) + u * smooth(j + 1, i + 1));
  };
  // Light of the sites over that half-way between them: where images overlap, more of it lies about the
  // middle of the array, which a lattice that is too narrow must not gather.
  const double half_i = noted.columns > 1 ? 0.5 : 0, half_j = noted.rows > 1 ? 0.5 : 0;
  const auto score = [&](const Lattice& lattice) {
    const auto light = [&](double i, double j) {
      return at(lattice.origin_x + i * lattice.a_x + j * lattice.b_x,
                lattice.origin_y + i * lattice.a_y + j * lattice.b_y);
    };
    double sum = 0;
    for (int j = 0; j < lattice.rows; ++j)
      for (int i = 0; i < lattice.columns; ++i) {
        sum += light(i, j);
        if (lattice.sites() == 1) continue;
        for (const double u : {-half_i, half_i})
          for (const double v : {-half_j, half_j}) sum -= 0.25 * light(i + u, j + v);
      }
    return sum;
  };
  const auto about_middle = [&](const Lattice& from, double dx, double dy, double scale, double turn) {
    Lattice to = from;
    const double c = std::cos(turn) * scale, s = std::sin(turn) * scale;
    to.a_x = c * from.a_x - s * from.a_y, to.a_y = s * from.a_x + c * from.a_y;
    to.b_x = c * from.b_x - s * from.b_y, to.b_y = s * from.b_x + c * from.b_y;
    const double i = (from.columns - 1) / 2.0, j = (from.rows - 1) / 2.0;
    to.origin_x = from.x(0, 0) + i * (from.a_x - to.a_x) + j * (from.b_x - to.b_x) + dx;
    to.origin_y = from.y(0, 0) + i * (from.a_y - to.a_y) + j * (from.b_y - to.b_y) + dy;
    return to;
  };
  // Displacements of up to half a spacing, spacings some percent off, angles some degrees off.
  Lattice best = noted;
  double best_score = score(noted);
  const double span = std::max({noted.columns, noted.rows, 2}) * spacing / 2;
  const double turn_step = spot_px / span, scale_step = spot_px / span;
  const int turns = noted.sites() > 1 ? static_cast<int>(std::ceil(0.06 / turn_step)) : 0;
  const int scales = noted.sites() > 1 ? static_cast<int>(std::ceil(0.06 / scale_step)) : 0;
  const double shift_step = std::max(0.5, spot_px * 0.7);
  const int shifts = static_cast<int>(std::ceil(std::max(2.5, 0.45 * spacing) / shift_step));
  for (int t = -turns; t <= turns; ++t)
    for (int k = -scales; k <= scales; ++k)
      for (int dy = -shifts; dy <= shifts; ++dy)
        for (int dx = -shifts; dx <= shifts; ++dx) {
          const Lattice moved =
              about_middle(noted, dx * shift_step, dy * shift_step, 1 + k * scale_step, t * turn_step);
          const double value = score(moved);
          if (value > best_score * (1 + 1e-9)) best_score = value, best = moved;
        }
  // Then each of the six numbers in ever smaller steps.
  for (double step = spot_px; step > 0.02; step *= 0.6)
    for (int pass = 0; pass < 3; ++pass)
      for (int k = 0; k < 6; ++k)
        for (const double sign : {-1.0, 1.0}) {
          Lattice moved = best;
          const double change = sign * step, per_site = 2 * change / std::max({noted.columns, noted.rows, 2});
          if (k == 0) moved.origin_x += change;
          if (k == 1) moved.origin_y += change;
          const double i = (best.columns - 1) / 2.0, j = (best.rows - 1) / 2.0;
          if (k == 2) moved.a_x += per_site, moved.origin_x -= i * per_site;
          if (k == 3) moved.a_y += per_site, moved.origin_y -= i * per_site;
          if (k == 4) moved.b_x += per_site, moved.origin_x -= j * per_site;
          if (k == 5) moved.b_y += per_site, moved.origin_y -= j * per_site;
          const double value = score(moved);
          if (value > best_score) best_score = value, best = moved;
        }
  return best;
}

}  // namespace atomcam
