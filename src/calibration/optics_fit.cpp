#include "calibration/optics_fit.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>
#include <optional>

#include "calibration/pupil_image.hpp"
#include "calibration/site_images.hpp"
#include "optics/zernike.hpp"
#include "simulation/parallel.hpp"

namespace atomcam {

int stamp_radius_px(const Lattice& lattice) {
  const double spacing = lattice.sites() > 1 ? std::max(std::hypot(lattice.a_x, lattice.a_y), 4.0) : 12;
  return std::clamp(static_cast<int>(std::lround(1.5 * spacing)), 8, 16);
}

double OpticsFit::mean_site_e() const {
  const double total = std::accumulate(site_e.begin(), site_e.end(), 0.0);
  return std::max(0.0, total) / static_cast<double>(std::max<std::size_t>(1, site_e.size()));
}

namespace {

constexpr int lattice_parameters = SiteImages::lattice_parameters,
              shape_parameters = SiteImages::shape_parameters,
              field_parameters = SiteImages::field_parameters;

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
std::array<double, zernike_terms> best_focus(const SiteImages& model, std::array<double, zernike_terms> terms,
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
    terms = SiteImages::zernike(ends[k].values);
  }
  return terms;
}

/// Whether the term has the same value at opposite points of the pupil.
bool is_even(std::size_t term) {
  return zernike_catalogue()[term].degree % 2 == 0;
}

void turn_sign(OpticsFit& fit) {
  for (std::size_t term = first_fitted_zernike; term < zernike_terms; ++term)
    if (is_even(term)) fit.zernike_um[term] = -fit.zernike_um[term];
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
  const SiteImages rough(near, start, wave, rough_pupil, rough_pupil);
  const SiteImages model(near, start, wave, pupil, rough_pupil);
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
    const auto terms = SiteImages::zernike(best.values);
    const auto others = best_focus(SiteImages(middle.mean, middle.lattice, wave, rough_pupil, rough_pupil),
                                   terms, wave, threads);
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
    const auto zernike_um = SiteImages::zernike(best.values);
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
  fit.zernike_um = SiteImages::zernike(best.values);
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
  if (known)
    take_sign_of(fit, *known);
  else if (fit.zernike_um[3] < 0)
    turn_sign(fit);
  return fit;
}

void take_sign_of(OpticsFit& fit, const std::array<double, zernike_terms>& zernike_um) {
  double alike = 0;
  for (std::size_t term = first_fitted_zernike; term < zernike_terms; ++term) {
    if (!is_even(term)) continue;
    const auto row = static_cast<Eigen::Index>(lattice_parameters - first_fitted_zernike + term);
    const double variance = fit.covariance(row, row);
    if (variance > 0) alike += fit.zernike_um[term] * zernike_um[term] / variance;
  }
  if (alike < 0) turn_sign(fit);
}

FieldFocus fit_field_focus(const MeanImage& mean, const OpticsDescription& optics, const OpticsFit& common,
                           int threads) {
  constexpr int directions = 8, first_steps = 4, more_steps = 30;
  constexpr std::size_t followed = 2;
  constexpr double strongest = 0.2;  // waves, at the edge: hardly a spot is left there
  const PupilImage pupil(optics, stamp_radius_px(common.lattice), PupilImage::rough);
  const SiteImages model(mean, common.lattice, optics.wavelength_um, pupil, pupil, true);
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
  // Common optics see the mean square of the field's defocus: a tilt to the edge is root three times that. Of
  // a strong one they make aberrations of all kinds, so that there are starts without any, too.
  const auto& known = common.zernike_um;
  const double defocus = std::max(std::fabs(known[3]), 0.02 * optics.wavelength_um),
               rms = std::sqrt(std::inner_product(known.begin(), known.end(), known.begin(), 0.0));
  std::vector<Eigen::VectorXd> starts;
  const auto start_from = [&](Eigen::VectorXd from, double defocus_um, double angle) {
    const double tilt_um = std::min(std::numbers::sqrt3 * defocus_um, strongest * optics.wavelength_um);
    from(lattice_parameters) = 0.3 * defocus_um;
    from(shape_parameters) = tilt_um * std::cos(angle);
    from(shape_parameters + 1) = tilt_um * std::sin(angle);
    model.solve_linear(from);
    starts.push_back(std::move(from));
  };
  for (int k = 0; k < directions; ++k) {
    const double angle = 2 * std::numbers::pi * k / directions;
    start_from(without.values, defocus, angle);
    if (rms > defocus) start_from(model.with(without.values, {}), rms, angle);
  }
  starts = best_ends(maximised_from(starts, evaluate, first_steps, threads), followed);
  const std::vector<MaximumLikelihood> ends = maximised_from(starts, evaluate, more_steps, threads);
  const MaximumLikelihood& best = ends[0].minus_log < ends[1].minus_log ? ends[0] : ends[1];
  return {.x_um = best.values(shape_parameters),
          .y_um = best.values(shape_parameters + 1),
          .curvature_um = best.values(shape_parameters + 2),
          .zernike_um = SiteImages::zernike(best.values),
          .gain = without.minus_log - best.minus_log};
}

}  // namespace atomcam
