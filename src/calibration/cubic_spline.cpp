#include "calibration/cubic_spline.hpp"

#include <algorithm>
#include <cmath>

namespace atomcam {

// A recursive filter there and back along each axis.
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

}  // namespace atomcam
