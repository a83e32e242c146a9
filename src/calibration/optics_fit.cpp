#include "calibration/optics_fit.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <numeric>
#include <optional>

#include "calibration/pupil_image.hpp"
#include "simulation/parallel.hpp"

namespace atomcam {
namespace {

constexpr int lattice_parameters = 6;
constexpr int shape_parameters = lattice_parameters + fitted_zernikes;
constexpr int field_parameters = 3;  // of the defocus across the field: along x, along y, curvature

/// Cubic B-spline at one sub-pixel position: four weights and their slopes. Through the spline's coefficients
/// the interpolation errs a hundred times less than through four samples, which blurs a narrow image.
struct CubicWeights {
  Eigen::Vector4d value, slope;
  explicit CubicWeights(double t) {  // between coefficients 0 and 1 of -1, 0, 1, 2
    const double s = 1 - t;
    value << s * s * s / 6, 2.0 / 3 - t * t * (2 - t) / 2, 2.0 / 3 - s * s * (2 - s) / 2, t * t * t / 6;
    slope << -s * s / 2, t * (1.5 * t - 2), -s * (1.5 * s - 2), t * t / 2;
  }
};

/// Samples into the coefficients of the cubic B-spline through them: a recursive filter there and back along
/// each axis, the samples mirrored at the ends.
void to_spline(Eigen::ArrayXXd& samples) {
  const double pole = std::sqrt(3.0) - 2;
  const auto along = [&](Eigen::ArrayXXd& of) {  // across columns
    const Eigen::Index n = of.cols();
    of *= 6;
    Eigen::ArrayXd first = of.col(0);
    double power = pole;
    for (Eigen::Index k = 1; k < std::min<Eigen::Index>(n, 24); ++k, power *= pole)
      first += power * of.col(k);
    of.col(0) = first;
    for (Eigen::Index k = 1; k < n; ++k) of.col(k) += pole * of.col(k - 1);
    of.col(n - 1) = pole / (pole * pole - 1) * (of.col(n - 1) + pole * of.col(n - 2)).eval();
    for (Eigen::Index k = n - 1; k-- > 0;) of.col(k) = pole * (of.col(k + 1) - of.col(k)).eval();
  };
  along(samples);
  Eigen::ArrayXXd turned = samples.transpose();
  along(turned);
  samples = turned.transpose();
}

/// Waves, rms. Beyond it no spot is left (a Strehl ratio below 3 %): what asks for more is no wavefront.
constexpr double widest_wavefront = 0.3;

struct Stamp {
  int left = 0, top = 0, width = 0, height = 0;
  double x = 0, y = 0;
};

/// Images of a point at steps of defocus, between which it changes evenly enough; or one for the whole field.
class FocusSteps {
 public:
  FocusSteps(const PupilImage& image, const PupilImage& changes, std::array<double, zernike_terms> zernike_um,
             double lowest_um, double highest_um, bool derivatives)
      : lowest_(lowest_um) {
    constexpr double widest_step = 0.008;  // um: the peak is right to 0.3 %
    constexpr int most_steps = 24;
    const int steps =
        std::clamp(static_cast<int>(std::ceil((highest_um - lowest_um) / widest_step)), 0, most_steps);
    step_ = steps > 0 ? (highest_um - lowest_um) / steps : 0;
    const double middle = zernike_um[3];
    for (int k = 0; k <= steps; ++k) {
      zernike_um[3] = middle + lowest_ + k * step_;
      FineImage fine = image(zernike_um, false);
      if (derivatives) fine.by_zernike = changes(zernike_um, true).by_zernike;
      to_spline(fine.share);
      for (Eigen::ArrayXXd& change : fine.by_zernike) to_spline(change);
      images_.push_back(std::move(fine));
    }
  }
  /// At a defocus between the lowest and the highest; `between` holds it if it has to be made.
  const FineImage& at(double defocus_um, FineImage& between) const {
    if (images_.size() == 1) return images_.front();
    const double where = std::clamp((defocus_um - lowest_) / step_, 0.0, images_.size() - 1.0);
    const std::size_t k = std::min(static_cast<std::size_t>(where), images_.size() - 2);
    const double part = where - static_cast<double>(k);
    const auto mixed = [part](const Eigen::ArrayXXd& a, const Eigen::ArrayXXd& b) -> Eigen::ArrayXXd {
      return (1 - part) * a + part * b;
    };
    between.centre = images_[k].centre;
    between.share = mixed(images_[k].share, images_[k + 1].share);
    between.by_zernike.resize(images_[k].by_zernike.size());
    for (std::size_t term = 0; term < between.by_zernike.size(); ++term)
      between.by_zernike[term] = mixed(images_[k].by_zernike[term], images_[k + 1].by_zernike[term]);
    return between;
  }

 private:
  double lowest_, step_ = 0;
  std::vector<FineImage> images_;
};

class Model {
 public:
  /// `changes`: gives the derivatives, which only say where to go and how sure that is: a rough one will do.
  /// `field`: the defocus changes across the field.
  Model(const MeanImage& mean, const Lattice& start, double wavelength_um, const PupilImage& image,
        const PupilImage& changes, bool field = false)
      : mean_(mean),
        wavelength_um_(wavelength_um),
        pupil_image_(image),
        pupil_changes_(changes),
        lattice_(start),
        shapes_(shape_parameters + (field ? field_parameters : 0)) {}

  int sites() const { return lattice_.sites(); }
  /// Lattice, Zernike terms, field; then the sites' light and the background.
  Eigen::Index shapes() const { return shapes_; }
  Eigen::Index size() const { return shapes_ + sites() + 1; }

  Lattice lattice(const Eigen::VectorXd& p) const {
    Lattice moved = lattice_;
    moved.a_x = p(2), moved.a_y = p(3), moved.b_x = p(4), moved.b_y = p(5);
    const double i = (lattice_.columns - 1) / 2.0, j = (lattice_.rows - 1) / 2.0;
    moved.origin_x = p(0) - i * p(2) - j * p(4);
    moved.origin_y = p(1) - i * p(3) - j * p(5);
    return moved;
  }
  static std::array<double, zernike_terms> zernike(const Eigen::VectorXd& p) {
    std::array<double, zernike_terms> values{};
    for (int k = 0; k < fitted_zernikes; ++k) values[k + first_fitted_zernike] = p(lattice_parameters + k);
    return values;
  }
  Eigen::VectorXd start(double defocus_um, double spherical_um) const {
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
  Eigen::VectorXd start(const std::array<double, zernike_terms>& zernike_um) const {
    return with(start(0, 0), zernike_um);
  }
  /// The same lattice with these terms, and the light that fits best.
  Eigen::VectorXd with(Eigen::VectorXd p, const std::array<double, zernike_terms>& zernike_um) const {
    for (int k = 0; k < fitted_zernikes; ++k)
      p(lattice_parameters + k) = zernike_um[static_cast<std::size_t>(k + first_fitted_zernike)];
    solve_linear(p);
    return p;
  }
  /// The sites' brightness and the background that fit best at these shapes.
  void solve_linear(Eigen::VectorXd& p) const {
    Eigen::VectorXd at = p;
    at.tail(sites() + 1).setZero();
    const Likelihood linear = evaluate(at, true, true);
    const Eigen::Index n = sites() + 1;
    Eigen::MatrixXd information = linear.information.bottomRightCorner(n, n);
    information.diagonal().array() += 1e-9 * information.diagonal().maxCoeff();
    p.tail(n) = -information.ldlt().solve(linear.gradient.tail(n));
  }

  /// Expected electrons per pixel, row by row.
  Eigen::ArrayXd image(const Eigen::VectorXd& p) const {
    Eigen::ArrayXd image;
    evaluate(p, false, false, &image);
    return image;
  }

  Likelihood evaluate(const Eigen::VectorXd& p, bool derivatives, bool linear_only = false,
                      Eigen::ArrayXd* image = nullptr) const {
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
      out.information.topLeftCorner(shapes_, shapes_) =
          by_shape.matrix().transpose() * weighted_shape.matrix();
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

 private:
  /// No step leads there.
  static Likelihood impossible() {
    Likelihood out;
    out.minus_log = std::numeric_limits<double>::infinity();
    return out;
  }
  /// Its rms in um: of terms of unit rms.
  static double wavefront(const Eigen::VectorXd& p) {
    return p.segment(lattice_parameters, fitted_zernikes).norm();
  }

  /// What the field's parameters are multiplied with at this pixel: u, v and their squares, from -1 to 1
  /// across the image's width.
  Eigen::Vector3d in_field(double x, double y) const {
    const double half = mean_.electrons.columns() / 2.0;
    const double u = (x - (mean_.electrons.columns() - 1) / 2.0) / half,
                 v = (y - (mean_.electrons.rows() - 1) / 2.0) / half;
    return {u, v, u * u + v * v};
  }
  /// Least and most that the field adds to the sites' defocus, um.
  std::pair<double, double> defocus_range(const Eigen::VectorXd& p, const Lattice& where) const {
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

  const MeanImage& mean_;
  double wavelength_um_;
  const PupilImage &pupil_image_, &pupil_changes_;
  Lattice lattice_;
  Eigen::Index shapes_;
};

}  // namespace

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

int stamp_radius_px(const Lattice& lattice) {
  const double spacing = lattice.sites() > 1 ? std::max(std::hypot(lattice.a_x, lattice.a_y), 4.0) : 12;
  return std::clamp(static_cast<int>(std::lround(1.5 * spacing)), 8, 16);
}

double OpticsFit::mean_site_e() const {
  const double total = std::accumulate(site_e.begin(), site_e.end(), 0.0);
  return std::max(0.0, total) / static_cast<double>(std::max<std::size_t>(1, site_e.size()));
}

namespace {

/// The middle of a large array, up to some sites each way, and the image around it.
struct Middle {
  MeanImage mean;
  Lattice lattice;

  Middle(const MeanImage& all, const Lattice& whole, int most) : lattice(whole) {
    lattice.columns = std::min(whole.columns, most);
    lattice.rows = std::min(whole.rows, most);
    const int i = (whole.columns - lattice.columns) / 2, j = (whole.rows - lattice.rows) / 2;
    lattice.origin_x = whole.x(i, j);
    lattice.origin_y = whole.y(i, j);
    double low_x = 1e300, low_y = 1e300, high_x = -1e300, high_y = -1e300;
    for (const double u : {-0.5, lattice.columns - 0.5})
      for (const double v : {-0.5, lattice.rows - 0.5}) {
        const double x = lattice.origin_x + u * whole.a_x + v * whole.b_x,
                     y = lattice.origin_y + u * whole.a_y + v * whole.b_y;
        low_x = std::min(low_x, x), high_x = std::max(high_x, x);
        low_y = std::min(low_y, y), high_y = std::max(high_y, y);
      }
    const auto pixel = [](double at, int pixels) {
      return static_cast<int>(std::clamp(at, 0.0, pixels - 1.0));
    };
    const int left = pixel(low_x, all.electrons.columns()), right = pixel(high_x, all.electrons.columns());
    const int top = pixel(low_y, all.electrons.rows()), bottom = pixel(high_y, all.electrons.rows());
    lattice.origin_x -= left;
    lattice.origin_y -= top;
    mean.variance_per_e = all.variance_per_e;
    for (const auto part : {&MeanImage::electrons, &MeanImage::variance, &MeanImage::dark_variance}) {
      mean.*part = Image<double, unit::electrons>(Shape{bottom - top + 1, right - left + 1});
      for (int row = top; row <= bottom; ++row)
        for (int column = left; column <= right; ++column)
          (mean.*part)(row - top, column - left) = (all.*part)(row, column);
    }
  }
};

constexpr double rough_tolerance = 0.05;

/// A few steps from each start.
template <class Evaluate>
std::vector<MaximumLikelihood> maximised_from(const std::vector<Eigen::VectorXd>& starts,
                                              const Evaluate& evaluate, int steps, int threads) {
  std::vector<MaximumLikelihood> ends(starts.size());
  parallel_for(static_cast<int>(starts.size()), thread_count(threads), 1, [&](int k) {
    const auto at = static_cast<std::size_t>(k);
    ends[at] = maximise(starts[at], evaluate, rough_tolerance, steps);
  });
  return ends;
}

/// Where the likeliest of them ended.
std::vector<Eigen::VectorXd> best_ends(std::vector<MaximumLikelihood> ends, std::size_t count) {
  std::stable_sort(ends.begin(), ends.end(),
                   [](const auto& a, const auto& b) { return a.minus_log < b.minus_log; });
  std::vector<Eigen::VectorXd> places;
  for (std::size_t k = 0; k < count; ++k) places.push_back(ends[k].values);
  return places;
}

/// The even terms enter by their squares and products: a focus with astigmatism may have been taken for a
/// defocus, from where no step leads back. So the directions that the same rms allows are tried as well, and
/// the likeliest followed. `terms`: in um, where a fit has led; those that fit clearly better, or the same.
std::array<double, zernike_terms> best_focus(const Model& model, std::array<double, zernike_terms> terms,
                                             double wavelength_um, int threads) {
  constexpr int first_steps = 5, more_steps = 30, angles = 8;
  constexpr std::size_t followed = 3;
  constexpr double clearly = 1;  // better, by the logarithm of the likelihood: another minimum
  const auto evaluate = [&](const Eigen::VectorXd& p, bool derivatives) {
    return model.evaluate(p, derivatives);
  };
  double rms = 0;
  for (const std::size_t term : {3, 4, 5, 10}) rms += terms[term] * terms[term];
  rms = std::max(std::sqrt(rms), 0.02 * wavelength_um);
  std::vector<Eigen::VectorXd> starts;
  for (int k = 0; k < angles; ++k)
    for (const double spherical : {-0.4, 0.4}) {
      const double angle = 2 * std::numbers::pi * k / angles;
      std::array<double, zernike_terms> from = terms;
      from[3] = 0.3 * rms;
      from[4] = 0.85 * rms * std::cos(angle);
      from[5] = 0.85 * rms * std::sin(angle);
      from[10] = spherical * rms;
      starts.push_back(model.start(from));
    }
  starts = best_ends(maximised_from(starts, evaluate, first_steps, threads), followed);
  starts.insert(starts.begin(), model.start(terms));
  const std::vector<MaximumLikelihood> ends = maximised_from(starts, evaluate, more_steps, threads);
  double least = ends.front().minus_log - clearly;
  for (std::size_t k = 1; k < ends.size(); ++k) {
    if (ends[k].minus_log > least) continue;
    least = ends[k].minus_log;
    terms = Model::zernike(ends[k].values);
  }
  return terms;
}

}  // namespace

OpticsFit fit_optics(const MeanImage& mean, const OpticsDescription& optics, const Lattice& start,
                     const std::array<double, zernike_terms>* known, const ImageMotion* motion, int threads) {
  const int radius = stamp_radius_px(start);
  // The image does not tell the common sign of the even terms, and about zero it does not change with them:
  // several starts.
  MaximumLikelihood best;
  const double wave = optics.wavelength_um;
  MeanImage near = mean;
  PupilImage rough_pupil(optics, radius, PupilImage::rough), pupil(optics, radius);
  if (motion)
    for (PupilImage* one : {&rough_pupil, &pupil}) one->spread_over(motion->x_px, motion->y_px);
  const Model rough(near, start, wave, rough_pupil, rough_pupil);
  const Model model(near, start, wave, pupil, rough_pupil);
  const auto roughly = [&](const Eigen::VectorXd& p, bool derivatives) {
    return rough.evaluate(p, derivatives);
  };
  const auto evaluate = [&](const Eigen::VectorXd& p, bool derivatives) {
    return model.evaluate(p, derivatives);
  };
  if (known) {
    best = maximise(rough.start(*known), roughly, rough_tolerance, 12);
  } else {
    std::vector<Eigen::VectorXd> starts;
    for (const auto& [defocus, spherical] :
         {std::pair{0.07, 0.02}, std::pair{0.07, -0.06}, std::pair{0.15, 0.04}, std::pair{0.02, 0.07}}) {
      starts.push_back(rough.start(defocus * wave, spherical * wave));
      rough.solve_linear(starts.back());
    }
    best.values = best_ends(maximised_from(starts, roughly, 12, threads), 1).front();
  }
  best = maximise(best.values, roughly, rough_tolerance, 30);
  if (!known) {
    constexpr int most_sites = 10;  // each way: enough to tell directions apart
    const Middle middle(near, rough.lattice(best.values), most_sites);
    const auto terms = Model::zernike(best.values);
    const auto others =
        best_focus(Model(middle.mean, middle.lattice, wave, rough_pupil, rough_pupil), terms, wave, threads);
    if (others != terms) {
      MaximumLikelihood found = maximise(rough.with(best.values, others), roughly, rough_tolerance, 30);
      if (found.minus_log < best.minus_log) best = std::move(found);
    }
  }
  // Light beyond the stamps, by the whole table: taken off the image, then once more.
  OpticsDescription fitted = optics;
  std::optional<PointSpreadFunction> table;
  constexpr double same_table = 0.002;  // um of every term: the light that far off does not notice
  for (int round = 0; round < 2; ++round) {
    const Lattice where = model.lattice(best.values);
    const auto zernike_um = Model::zernike(best.values);
    const auto same = [](double a, double b) { return std::fabs(a - b) < same_table; };
    if (!table || !std::equal(zernike_um.begin(), zernike_um.end(), fitted.zernike_um.begin(), same)) {
      fitted.zernike_um = zernike_um;
      table.emplace(fitted);
    }
    PhotonImage far(Shape{mean.electrons.rows(), mean.electrons.columns()});
    for (int j = 0, s = 0; j < where.rows; ++j)
      for (int i = 0; i < where.columns; ++i, ++s) {
        const double e = best.values(shape_parameters + s), x = where.x(i, j), y = where.y(i, j);
        if (!(e > 0)) continue;
        table->add_expected(far, e, x, y);
        const int left = std::max(0, static_cast<int>(std::ceil(x)) - radius),
                  top = std::max(0, static_cast<int>(std::ceil(y)) - radius);
        const int right = std::min(far.columns(), static_cast<int>(std::floor(x)) + radius + 1),
                  bottom = std::min(far.rows(), static_cast<int>(std::floor(y)) + radius + 1);
        if (left >= right || top >= bottom) continue;
        PhotonImage stamp({bottom - top, right - left});
        table->add_expected(stamp, e, x, y, left, top);
        for (int r = top; r < bottom; ++r)
          for (int c = left; c < right; ++c) far(r, c) -= stamp(r - top, c - left);
      }
    // Weights from the model, not from the data: a pixel that fluctuated up must not weigh less for it.
    const Eigen::ArrayXd image = model.image(best.values);
    for (std::size_t n = 0; n < far.pixels().size(); ++n) {
      near.electrons.pixels()[n] = mean.electrons.pixels()[n] - static_cast<double>(far.pixels()[n]);
      const double light = image(static_cast<Eigen::Index>(n)) + static_cast<double>(far.pixels()[n]);
      if (mean.variance.pixels()[n] < 1e6)
        near.variance.pixels()[n] =
            mean.dark_variance.pixels()[n] + mean.variance_per_e * std::max(0.0, light);
    }
    best = maximise(best.values, evaluate, 1e-3, 20);
  }

  OpticsFit fit;
  fit.lattice = model.lattice(best.values);
  fit.zernike_um = Model::zernike(best.values);
  if (fit.zernike_um[3] < 0)
    for (const int even : {3, 4, 5, 10, 11, 12, 13, 14}) fit.zernike_um[even] = -fit.zernike_um[even];
  for (int s = 0; s < model.sites(); ++s) fit.site_e.push_back(best.values(shape_parameters + s));
  fit.background_e = best.values(model.size() - 1);
  std::vector<Eigen::Index> common(shape_parameters);
  std::iota(common.begin(), common.end(), 0);
  common.push_back(model.size() - 1);
  const Eigen::MatrixXd covariance = best.covariance(common);
  fit.background_error = std::sqrt(covariance(shape_parameters, shape_parameters));
  fit.covariance = covariance.topLeftCorner(shape_parameters, shape_parameters);
  fit.chi_square = 2 * best.minus_log;
  fit.degrees_of_freedom = static_cast<int>(mean.electrons.pixels().size()) - static_cast<int>(model.size());
  fit.converged = best.converged;
  fit.position_error_px = std::sqrt(std::max(fit.covariance(0, 0), fit.covariance(1, 1)));
  return fit;
}

FieldFocus fit_field_focus(const MeanImage& mean, const OpticsDescription& optics, const OpticsFit& common,
                           int threads) {
  constexpr int directions = 8, first_steps = 4, more_steps = 30;
  constexpr std::size_t followed = 2;
  const PupilImage pupil(optics, stamp_radius_px(common.lattice), PupilImage::rough);
  const Model model(mean, common.lattice, optics.wavelength_um, pupil, pupil, true);
  const auto evaluate = [&](const Eigen::VectorXd& p, bool derivatives) {
    return model.evaluate(p, derivatives);
  };
  const Eigen::VectorXd start = model.start(common.zernike_um);
  const MaximumLikelihood without = maximise(
      start,
      [&](const Eigen::VectorXd& p, bool derivatives) {
        Likelihood one = evaluate(p, derivatives);
        if (derivatives) {  // the field stays as it is
          one.gradient.segment<field_parameters>(shape_parameters).setZero();
          one.information.middleRows<field_parameters>(shape_parameters).setZero();
          one.information.middleCols<field_parameters>(shape_parameters).setZero();
          one.information.diagonal().segment<field_parameters>(shape_parameters).setOnes();
        }
        return one;
      },
      rough_tolerance, more_steps);
  // Common optics see the mean square of the field's defocus: a tilt to the edge is root three times that.
  const double defocus = std::max(std::fabs(common.zernike_um[3]), 0.02 * optics.wavelength_um);
  std::vector<Eigen::VectorXd> starts;
  for (int k = 0; k < directions; ++k) {
    const double angle = 2 * std::numbers::pi * k / directions;
    Eigen::VectorXd from = without.values;
    from(lattice_parameters) = 0.3 * defocus;
    from(shape_parameters) = std::numbers::sqrt3 * defocus * std::cos(angle);
    from(shape_parameters + 1) = std::numbers::sqrt3 * defocus * std::sin(angle);
    starts.push_back(std::move(from));
  }
  starts = best_ends(maximised_from(starts, evaluate, first_steps, threads), followed);
  const std::vector<MaximumLikelihood> ends = maximised_from(starts, evaluate, more_steps, threads);
  const MaximumLikelihood& best = ends[0].minus_log < ends[1].minus_log ? ends[0] : ends[1];
  return {.x_um = best.values(shape_parameters),
          .y_um = best.values(shape_parameters + 1),
          .curvature_um = best.values(shape_parameters + 2),
          .zernike_um = Model::zernike(best.values),
          .gain = without.minus_log - best.minus_log};
}

}  // namespace atomcam
