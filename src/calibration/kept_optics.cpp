#include "calibration/kept_optics.hpp"

#include <span>

namespace atomcam {
namespace {

Eigen::MatrixXd column_of(std::span<const double> values) {
  return Eigen::Map<const Eigen::VectorXd>(values.data(), std::ssize(values));
}

Eigen::MatrixXd figures_of(const Lattice& lattice) {
  Eigen::VectorXd figures(8);
  figures << lattice.columns, lattice.rows, lattice.origin_x, lattice.origin_y, lattice.a_x, lattice.a_y,
      lattice.b_x, lattice.b_y;
  return figures;
}

Lattice lattice_of(const Eigen::MatrixXd& figures) {
  return {static_cast<int>(figures(0)),
          static_cast<int>(figures(1)),
          figures(2),
          figures(3),
          figures(4),
          figures(5),
          figures(6),
          figures(7)};
}

ResultKey key_of(const MeanImage& mean, const OpticsDescription& optics, const Lattice& start) {
  ResultKey key;
  key.add("optics fit").add(static_cast<std::uint64_t>(mean.electrons.rows()));
  for (const auto* image : {&mean.electrons, &mean.variance, &mean.dark_variance})
    key.add(column_of(image->pixels()));
  const double figures[] = {mean.variance_per_e,   optics.wavelength_um, optics.numerical_aperture,
                            optics.magnification,  optics.pixel_um,      optics.transmission,
                            optics.pupil_edge_loss};
  return key.add(column_of(figures))
      .add(static_cast<std::uint64_t>(optics.apodisation))
      .add(column_of(optics.zernike_um))
      .add(figures_of(start));
}

Matrices parts_of(const OpticsFit& fit) {
  const double figures[] = {fit.background_e,
                            fit.background_error,
                            fit.chi_square,
                            static_cast<double>(fit.degrees_of_freedom),
                            static_cast<double>(fit.converged),
                            fit.position_error_px};
  return {figures_of(fit.lattice), column_of(fit.zernike_um), column_of(fit.site_e), fit.covariance,
          column_of(figures)};
}

OpticsFit fit_of(const Matrices& parts) {
  OpticsFit fit;
  fit.lattice = lattice_of(parts[0]);
  std::copy_n(parts[1].data(), zernike_terms, fit.zernike_um.begin());
  fit.site_e.assign(parts[2].data(), parts[2].data() + parts[2].size());
  fit.covariance = parts[3];
  fit.background_e = parts[4](0);
  fit.background_error = parts[4](1);
  fit.chi_square = parts[4](2);
  fit.degrees_of_freedom = static_cast<int>(parts[4](3));
  fit.converged = parts[4](4) != 0;
  fit.position_error_px = parts[4](5);
  return fit;
}

}  // namespace

OpticsFit kept_optics(const KeptResults* kept, const MeanImage& mean, const OpticsDescription& optics,
                      const Lattice& start, int threads) {
  if (!kept) return fit_optics(mean, optics, start, nullptr, nullptr, threads);
  const ResultKey key = key_of(mean, optics, start);
  if (const auto found = kept->find(key); found && found->size() == 5 && (*found)[0].size() == 8 &&
                                          (*found)[1].size() == zernike_terms &&
                                          (*found)[2].size() == start.sites() && (*found)[4].size() == 6)
    return fit_of(*found);
  OpticsFit fit = fit_optics(mean, optics, start, nullptr, nullptr, threads);
  kept->keep(key, parts_of(fit));
  return fit;
}

}  // namespace atomcam
