#include "calibration/site_images.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "calibration/cubic_spline.hpp"
#include "calibration/focus_steps.hpp"

namespace atomcam {
namespace {

/// Waves, rms. Beyond it no spot is left (a Strehl ratio below 3 %): what asks for more is no wavefront.
constexpr double widest_wavefront = 0.3;

struct Stamp {
  int left = 0, top = 0, width = 0, height = 0;
  double x = 0, y = 0;
};

/// No step leads there.
Likelihood impossible() {
  Likelihood out;
  out.minus_log = std::numeric_limits<double>::infinity();
  return out;
}

/// Its rms in um: of terms of unit rms.
double wavefront(const Eigen::VectorXd& p) {
  return p.segment(SiteImages::lattice_parameters, fitted_zernikes).norm();
}

}  // namespace

Lattice SiteImages::lattice(const Eigen::VectorXd& p) const {
  Lattice moved = lattice_;
  moved.a_x = p(2), moved.a_y = p(3), moved.b_x = p(4), moved.b_y = p(5);
  const double i = (lattice_.columns - 1) / 2.0, j = (lattice_.rows - 1) / 2.0;
  moved.origin_x = p(0) - i * p(2) - j * p(4);
  moved.origin_y = p(1) - i * p(3) - j * p(5);
  return moved;
}

std::array<double, zernike_terms> SiteImages::zernike(const Eigen::VectorXd& p) {
  std::array<double, zernike_terms> values{};
  for (int k = 0; k < fitted_zernikes; ++k) values[k + first_fitted_zernike] = p(lattice_parameters + k);
  return values;
}

Eigen::VectorXd SiteImages::start(double defocus_um, double spherical_um) const {
  Eigen::VectorXd p = Eigen::VectorXd::Zero(size());
  const double i = (lattice_.columns - 1) / 2.0, j = (lattice_.rows - 1) / 2.0;
  p(0) = lattice_.origin_x + i * lattice_.a_x + j * lattice_.b_x;
  p(1) = lattice_.origin_y + i * lattice_.a_y + j * lattice_.b_y;
  p(2) = lattice_.a_x, p(3) = lattice_.a_y, p(4) = lattice_.b_x, p(5) = lattice_.b_y;
  p(lattice_parameters) = defocus_um;
  p(lattice_parameters + 1) = p(lattice_parameters + 2) = 0.003;
  p(lattice_parameters + 10 - first_fitted_zernike) = spherical_um;
  return p;
}

Eigen::VectorXd SiteImages::with(Eigen::VectorXd p,
                                 const std::array<double, zernike_terms>& zernike_um) const {
  for (int k = 0; k < fitted_zernikes; ++k)
    p(lattice_parameters + k) = zernike_um[static_cast<std::size_t>(k + first_fitted_zernike)];
  solve_linear(p);
  return p;
}

void SiteImages::solve_linear(Eigen::VectorXd& p) const {
  Eigen::VectorXd at = p;
  at.tail(sites() + 1).setZero();
  const Likelihood linear = evaluate(at, true, true);
  if (linear.gradient.size() == 0) return;
  const Eigen::Index n = sites() + 1;
  Eigen::MatrixXd information = linear.information.bottomRightCorner(n, n);
  information.diagonal().array() += 1e-9 * information.diagonal().maxCoeff();
  p.tail(n) = -information.ldlt().solve(linear.gradient.tail(n));
}

Eigen::ArrayXd SiteImages::image(const Eigen::VectorXd& p) const {
  Eigen::ArrayXd image;
  evaluate(p, false, false, &image);
  return image;
}

Likelihood SiteImages::evaluate(const Eigen::VectorXd& p, bool derivatives, bool linear_only,
                                Eigen::ArrayXd* image) const {
  const Lattice where = lattice(p);
  const bool step = !derivatives && !image;
  if (step && wavefront(p) > widest_wavefront * wavelength_um_) return impossible();
  const bool shapes = derivatives && !linear_only, field = shapes_ > shape_parameters;
  const auto [nearest, farthest] = defocus_range(p, where);
  if (!(farthest - nearest < 2 * widest_wavefront * wavelength_um_)) return impossible();
  const FocusSteps focus(pupil_image_, pupil_changes_, zernike(p), nearest, farthest, shapes);
  FineImage between;
  const int rows = mean_.electrons.rows(), columns = mean_.electrons.columns();
  const Eigen::Index pixels = static_cast<Eigen::Index>(rows) * columns;
  Eigen::ArrayXd model = Eigen::ArrayXd::Constant(pixels, p(size() - 1));
  Eigen::ArrayXXd by_shape;
  if (shapes) by_shape.setZero(pixels, shapes_);

  const int radius = pupil_image_.radius_px();
  std::vector<Stamp> stamps(static_cast<std::size_t>(sites()));
  std::vector<Eigen::ArrayXd> shares(stamps.size());
  for (int j = 0, s = 0; j < where.rows; ++j)
    for (int i = 0; i < where.columns; ++i, ++s) {
      Stamp& stamp = stamps[s];
      stamp.x = where.x(i, j);
      stamp.y = where.y(i, j);
      if (!(std::fabs(stamp.x) < 1e6 && std::fabs(stamp.y) < 1e6)) return impossible();
      stamp.left = std::clamp(static_cast<int>(std::ceil(stamp.x)) - radius, 0, columns);
      stamp.top = std::clamp(static_cast<int>(std::ceil(stamp.y)) - radius, 0, rows);
      stamp.width =
          std::clamp(static_cast<int>(std::floor(stamp.x)) + radius + 1, stamp.left, columns) - stamp.left;
      stamp.height =
          std::clamp(static_cast<int>(std::floor(stamp.y)) + radius + 1, stamp.top, rows) - stamp.top;
      Eigen::ArrayXd& share = shares[s];
      share.setZero(static_cast<Eigen::Index>(stamp.width) * stamp.height);
      if (share.size() == 0) continue;
      const double amplitude = p(shapes_ + s);
      const Eigen::Vector3d place = field ? in_field(stamp.x, stamp.y) : Eigen::Vector3d::Zero();
      const FineImage& fine = focus.at(field ? place.dot(p.segment<3>(shape_parameters)) : 0, between);
      constexpr int m = FineImage::oversampling;
      // A pixel at c is the sample m (c - x) from the centre: the fraction is the same for all pixels.
      const double first_x = m * (stamp.left - stamp.x) + fine.centre,
                   first_y = m * (stamp.top - stamp.y) + fine.centre;
      const int base_x = static_cast<int>(std::floor(first_x)),
                base_y = static_cast<int>(std::floor(first_y));
      const CubicWeights wx(first_x - base_x), wy(first_y - base_y);
      for (int r = 0, n = 0; r < stamp.height; ++r)
        for (int c = 0; c < stamp.width; ++c, ++n) {
          const int x = base_x + m * c - 1, y = base_y + m * r - 1;
          const auto block = fine.share.matrix().block<4, 4>(y, x);
          const Eigen::Vector4d across = block * wx.value;
          const double value = wy.value.dot(across);
          share(n) = value;
          const Eigen::Index pixel = static_cast<Eigen::Index>(stamp.top + r) * columns + stamp.left + c;
          model(pixel) += amplitude * value;
          if (!shapes) continue;
          const double dx = -m * amplitude * wy.value.dot(block * wx.slope),
                       dy = -m * amplitude * wy.slope.dot(across);
          const double ci = i - (where.columns - 1) / 2.0, cj = j - (where.rows - 1) / 2.0;
          by_shape(pixel, 0) += dx;
          by_shape(pixel, 1) += dy;
          by_shape(pixel, 2) += ci * dx;
          by_shape(pixel, 3) += ci * dy;
          by_shape(pixel, 4) += cj * dx;
          by_shape(pixel, 5) += cj * dy;
          for (int k = 0; k < fitted_zernikes; ++k)
            by_shape(pixel, lattice_parameters + k) +=
                amplitude * wy.value.dot(fine.by_zernike[k].matrix().block<4, 4>(y, x) * wx.value);
          if (!field) continue;
          const double by_defocus =
              amplitude * wy.value.dot(fine.by_zernike[0].matrix().block<4, 4>(y, x) * wx.value);
          for (int k = 0; k < field_parameters; ++k)
            by_shape(pixel, shape_parameters + k) += place(k) * by_defocus;
        }
    }

  if (image) *image = model;
  const Eigen::Map<const Eigen::ArrayXd> data(mean_.electrons.pixels().data(), pixels);
  const Eigen::Map<const Eigen::ArrayXd> variance(mean_.variance.pixels().data(), pixels);
  const Eigen::ArrayXd weight = variance.inverse(), residual = model - data;
  Likelihood out;
  out.minus_log = 0.5 * (residual.square() * weight).sum();
  if (!derivatives) return out;
  out.gradient.setZero(size());
  out.information.setZero(size(), size());
  const Eigen::ArrayXd weighted = residual * weight;
  const Eigen::Index background = size() - 1;
  Eigen::ArrayXXd weighted_shape;
  if (shapes) {
    weighted_shape = by_shape.colwise() * weight;
    out.gradient.head(shapes_) = by_shape.matrix().transpose() * weighted.matrix();
    out.information.topLeftCorner(shapes_, shapes_) = by_shape.matrix().transpose() * weighted_shape.matrix();
    out.information.col(background).head(shapes_) = weighted_shape.colwise().sum().matrix();
  }
  out.gradient(background) = weighted.sum();
  out.information(background, background) = weight.sum();
  for (int s = 0; s < sites(); ++s) {
    const Stamp& stamp = stamps[s];
    const Eigen::Index at = shapes_ + s;
    for (int r = 0; r < stamp.height; ++r) {
      const Eigen::Index pixel = static_cast<Eigen::Index>(stamp.top + r) * columns + stamp.left;
      const auto share = shares[s].segment(static_cast<Eigen::Index>(r) * stamp.width, stamp.width);
      out.gradient(at) += (share * weighted.segment(pixel, stamp.width)).sum();
      out.information(at, background) += (share * weight.segment(pixel, stamp.width)).sum();
      if (shapes)
        out.information.row(at).head(shapes_) +=
            share.matrix().transpose() * weighted_shape.middleRows(pixel, stamp.width).matrix();
    }
    for (int other = s; other < sites(); ++other) {
      const Stamp& second = stamps[other];
      const int left = std::max(stamp.left, second.left), top = std::max(stamp.top, second.top);
      const int right = std::min(stamp.left + stamp.width, second.left + second.width);
      const int bottom = std::min(stamp.top + stamp.height, second.top + second.height);
      if (left >= right || top >= bottom) continue;
      double sum = 0;
      for (int r = top; r < bottom; ++r) {
        const auto one = shares[s].segment(
            static_cast<Eigen::Index>(r - stamp.top) * stamp.width + left - stamp.left, right - left);
        const auto two = shares[other].segment(
            static_cast<Eigen::Index>(r - second.top) * second.width + left - second.left, right - left);
        sum +=
            (one * two * weight.segment(static_cast<Eigen::Index>(r) * columns + left, right - left)).sum();
      }
      out.information(at, shapes_ + other) = sum;
      out.information(shapes_ + other, at) = sum;
    }
    if (stamp.width == 0 || stamp.height == 0) out.information(at, at) = 1;
    if (shapes) out.information.col(at).head(shapes_) = out.information.row(at).head(shapes_).transpose();
  }
  out.information.row(background) = out.information.col(background).transpose();
  return out;
}

/// What the field's parameters are multiplied with at this pixel: u, v and their squares, from -1 to 1
/// across the image's width.
Eigen::Vector3d SiteImages::in_field(double x, double y) const {
  const double half = mean_.electrons.columns() / 2.0;
  const double u = (x - (mean_.electrons.columns() - 1) / 2.0) / half,
               v = (y - (mean_.electrons.rows() - 1) / 2.0) / half;
  return {u, v, u * u + v * v};
}

/// Least and most that the field adds to the sites' defocus, um.
std::pair<double, double> SiteImages::defocus_range(const Eigen::VectorXd& p, const Lattice& where) const {
  if (shapes_ == shape_parameters) return {0, 0};
  double least = std::numeric_limits<double>::infinity(), most = -least;
  for (int j = 0; j < where.rows; ++j)
    for (int i = 0; i < where.columns; ++i) {
      const double one = in_field(where.x(i, j), where.y(i, j)).dot(p.segment<3>(shape_parameters));
      least = std::min(least, one);
      most = std::max(most, one);
    }
  return {least, most};
}

}  // namespace atomcam
