#include <gtest/gtest.h>

#include <algorithm>
#include <boost/math/special_functions/gamma.hpp>
#include <cmath>
#include <numbers>
#include <numeric>
#include <string>
#include <thread>
#include <vector>

#include "base/error.hpp"
#include "base/math.hpp"
#include "base/random.hpp"
#include "optics/cells.hpp"
#include "optics/direct.hpp"
#include "optics/optics.hpp"

namespace atomcam {
namespace {

using testing::DirectPointSpread;

constexpr std::array<double, zernike_terms> papers_fit{
    0,          0,          0,          0.07232454,  0.00087644,  -0.01069755, 0.00280808, 0.00723265,
    0.00436401, 0.00117688, 0.02449155, -0.00427388, -0.00250116, -0.00477205, -0.00054310};

OpticsDescription with(int term, double um) {
  OpticsDescription optics;
  optics.zernike_um[static_cast<std::size_t>(term)] = um;
  return optics;
}

double unit_px(const OpticsDescription& optics) {
  return optics.wavelength_um / optics.numerical_aperture * optics.magnification / optics.pixel_um;
}

/// Light is even within a cell of width h: about half a mesh h away from its own place it is as good as a
/// linear interpolation between cell edges, which blurs by h^2 / 12 d^2/dx^2 per axis; of an Airy peak's
/// height that is at most (2 pi h)^2 / 12.
const double cell_error = std::pow(2 * std::numbers::pi * finest_cell, 2) / 12;
/// Light of an ideal lens beyond the table, by which the outermost cells are off.
constexpr double beyond_table = 1e-3;

double sum(const PhotonImage& image) {
  return std::accumulate(image.pixels().begin(), image.pixels().end(), 0.0);
}

PhotonImage expected(const PointSpreadFunction& psf, Shape shape, double x_px, double y_px,
                     double photons = 1) {
  PhotonImage image(shape);
  psf.add_expected(image, photons, x_px, y_px);
  return image;
}

/// Centre of the light in a window of 2 half + 1 pixels about the geometric image.
struct Centre {
  double x, y;
};
Centre centroid(const PointSpreadFunction& psf, int half) {
  const PhotonImage image = expected(psf, {2 * half + 1, 2 * half + 1}, half, half);
  double x = 0, y = 0;
  for (int r = 0; r < image.rows(); ++r)
    for (int c = 0; c < image.columns(); ++c) {
      x += image(r, c) * (c - half);
      y += image(r, c) * (r - half);
    }
  return {x / sum(image), y / sum(image)};
}

/// An edge's light falls off as 1 / r^3, so a window's centroid misses a part that goes as 1 / window.
Centre extrapolated_centroid(const PointSpreadFunction& psf) {
  const Centre near = centroid(psf, 128), far = centroid(psf, 256);
  return {2 * far.x - near.x, 2 * far.y - near.y};
}

TEST(PointSpreadFunction, KeepsAllLight) {
  for (const OpticsDescription& optics : {OpticsDescription{}, with(3, 0.3), with(7, 0.1)}) {
    const PointSpreadFunction psf(optics);
    const int reach = static_cast<int>(psf.reach_px()) + 2;
    // Each of some 10^6 pixels is rounded to single precision, a few times over.
    EXPECT_NEAR(sum(expected(psf, {2 * reach + 1, 2 * reach + 1}, reach + 0.3, reach - 0.4)), 1, 4 * 0x1p-24);
    EXPECT_NEAR(psf.fraction_within(2 * psf.reach_px()), 1, 1e-12);
  }
}

TEST(PointSpreadFunction, EncircledEnergyIsAirys) {
  const OpticsDescription optics;
  const PointSpreadFunction psf(optics);
  for (const double u : {0.2, 0.5, 0.609835, 1.0, 1.116, 2.0, 5.0, 10.0, 30.0}) {
    const double v = 2 * std::numbers::pi * u;
    const double airy = 1 - std::pow(std::cyl_bessel_j(0, v), 2) - std::pow(std::cyl_bessel_j(1, v), 2);
    EXPECT_NEAR(psf.fraction_within(u * unit_px(optics)), airy, beyond_table) << u;
  }
  EXPECT_NEAR(psf.fraction_within(0.609835 * unit_px(optics)), 0.8378, 0.0001);  // the first dark ring
}

struct Case {
  std::string name;
  OpticsDescription optics;
};

std::vector<Case> cases() {
  std::vector<Case> all{{"ideal", {}}};
  const char* names[zernike_terms] = {"piston",
                                      "tilt x",
                                      "tilt y",
                                      "defocus",
                                      "oblique astigmatism",
                                      "vertical astigmatism",
                                      "vertical coma",
                                      "horizontal coma",
                                      "vertical trefoil",
                                      "oblique trefoil",
                                      "spherical",
                                      "secondary astigmatism v",
                                      "secondary astigmatism o",
                                      "quadrafoil v",
                                      "quadrafoil o"};
  for (int term = 1; term < zernike_terms; ++term) all.push_back({names[term], with(term, 0.06)});
  OpticsDescription optics;
  optics.zernike_um = papers_fit;
  all.push_back({"the paper's fit", optics});
  optics.apodisation = true;
  optics.numerical_aperture = 0.9;
  all.push_back({"apodised", optics});
  optics = with(7, 0.06);
  optics.pupil_edge_loss = 0.6;
  all.push_back({"dimmed edge", optics});
  optics = with(3, 0.15);  // contrast is reversed at some frequencies
  all.push_back({"strong defocus", optics});
  optics.magnification = 8;  // pixels wider than the image of a point
  all.push_back({"wide pixels", optics});
  return all;
}

TEST(PointSpreadFunction, AgreesWithDirectIntegrationOverThePupil) {
  for (const Case& c : cases()) {
    const PointSpreadFunction psf(c.optics);
    const DirectPointSpread direct(c.optics);
    const bool wide = unit_px(c.optics) < 1;
    const double x = 10.3, y = 9.85;
    const PhotonImage image = expected(psf, {21, 21}, x, y);
    const int first = wide ? 9 : 1, last = wide ? 11 : 20, step = wide ? 1 : 3, nodes = wide ? 24 : 4;
    const double peak = std::numbers::pi / std::pow(unit_px(c.optics), 2);  // of an ideal lens, per pixel
    for (int row = first; row <= last; row += step)
      for (int column = first; column <= last; column += step) {
        const double truth =
            direct.within(column - 0.5 - x, row - 0.5 - y, column + 0.5 - x, row + 0.5 - y, nodes);
        EXPECT_NEAR(image(row, column), truth, cell_error * std::min(1.0, peak))
            << c.name << " at row " << row << ", column " << column;
      }
  }
}

TEST(PointSpreadFunction, TheDirectRigSeesALostPhase) {
  // The magnitude of the transfer function keeps no odd term: an image without coma must fail the comparison.
  const OpticsDescription coma = with(7, 0.06);
  const PointSpreadFunction without{OpticsDescription{}};
  const DirectPointSpread direct(coma);
  const PhotonImage image = expected(without, {21, 21}, 10, 10);
  double worst = 0;
  for (int column = 4; column < 17; ++column)
    worst = std::max(worst,
                     std::fabs(image(10, column) - direct.within(column - 10.5, -0.5, column - 9.5, 0.5, 4)));
  EXPECT_GT(worst, 20 * cell_error * direct(0, 0));
}

TEST(Tilt, MovesTheImageByTwiceItsRmsOverTheAperture) {
  for (const int axis : {1, 2}) {
    const OpticsDescription optics = with(axis, 0.2);
    const PointSpreadFunction tilted(optics), plain{OpticsDescription{}};
    const double shift = 2 * 0.2 / 0.65 * 156.25 / 16;  // 6.01 px towards +x (columns) or +y (rows)
    const double x = 30.3, y = 29.6;
    const PhotonImage a = expected(tilted, {64, 64}, x, y);
    const PhotonImage b = expected(plain, {64, 64}, x + (axis == 1 ? shift : 0), y + (axis == 2 ? shift : 0));
    for (std::size_t i = 0; i < a.pixels().size(); ++i) EXPECT_FLOAT_EQ(a.pixels()[i], b.pixels()[i]);
    const Centre centre = extrapolated_centroid(tilted);
    EXPECT_NEAR(axis == 1 ? centre.x : centre.y, shift, beyond_table * shift);
    EXPECT_NEAR(axis == 1 ? centre.y : centre.x, 0, beyond_table);
  }
}

TEST(Coma, MovesTheCentroidByTheMeanSlopeOfTheWavefront) {
  for (const int term : {6, 7})
    for (const double um : {0.00723265, 0.05}) {
      const PointSpreadFunction psf(with(term, um));
      const double shift = std::sqrt(8.0) * um / 0.65 * 156.25 / 16;
      const Centre centre = extrapolated_centroid(psf);
      EXPECT_NEAR(term == 7 ? centre.x : centre.y, shift, beyond_table * shift);
      EXPECT_NEAR(term == 7 ? centre.y : centre.x, 0, beyond_table * shift);
    }
}

/// Half the summed difference between an image and itself turned by half a turn.
double asymmetry(const PhotonImage& image) {
  double difference = 0;
  for (int r = 0; r < image.rows(); ++r)
    for (int c = 0; c < image.columns(); ++c)
      difference += std::fabs(image(r, c) - image(image.rows() - 1 - r, image.columns() - 1 - c));
  return difference / 2;
}

TEST(OddTerms, SkewTheImageAsThePupilSays) {
  for (const int term : {6, 7, 8, 9}) {
    const OpticsDescription optics = with(term, 0.05);
    const DirectPointSpread direct(optics);
    const PhotonImage image = expected(PointSpreadFunction(optics), {25, 25}, 12, 12);
    PhotonImage truth(image.shape());
    for (int r = 0; r < 25; ++r)
      for (int c = 0; c < 25; ++c)
        truth(r, c) = static_cast<float>(direct.within(c - 12.5, r - 12.5, c - 11.5, r - 11.5, 2));
    EXPECT_NEAR(asymmetry(image), asymmetry(truth), cell_error * sum(truth)) << term;
    EXPECT_GT(asymmetry(image), 0.2) << term;
  }
}

TEST(EvenTerms, TheirSignDoesNotMatterAndTheImageIsSymmetric) {
  for (const int term : {3, 10}) {
    const PointSpreadFunction plus(with(term, 0.1)), minus(with(term, -0.1));
    const PhotonImage a = expected(plus, {41, 41}, 20, 20), b = expected(minus, {41, 41}, 20, 20);
    // Shares are rounded to 2^-32 per cell, and a pixel holds fewer than 64 finest cells.
    for (std::size_t i = 0; i < a.pixels().size(); ++i)
      EXPECT_NEAR(a.pixels()[i], b.pixels()[i], 64 * 0x1p-32 + 0x1p-22 * a.pixels()[i]);
    EXPECT_LE(asymmetry(a), 41 * 41 * 64 * 0x1p-32 + 0x1p-22);
  }
  const PointSpreadFunction both([] {
    OpticsDescription optics = with(3, 0.07);
    optics.zernike_um[5] = 0.05;
    return optics;
  }());
  const PointSpreadFunction opposite([] {
    OpticsDescription optics = with(3, 0.07);
    optics.zernike_um[5] = -0.05;
    return optics;
  }());
  // The other sign of vertical astigmatism swaps the axes.
  const PhotonImage a = expected(both, {41, 41}, 20.25, 20), b = expected(opposite, {41, 41}, 20, 20.25);
  for (int r = 0; r < 41; ++r)
    for (int c = 0; c < 41; ++c) EXPECT_NEAR(a(r, c), b(c, r), 64 * 0x1p-32 + 0x1p-22 * a(r, c));
}

TEST(Defocus, AddsToTheGlobalOne) {
  const PhotonImage a = expected(PointSpreadFunction(with(3, 0.07), 0.05), {41, 41}, 20, 20);
  const PhotonImage b = expected(PointSpreadFunction(with(3, 0.12)), {41, 41}, 20, 20);
  for (std::size_t i = 0; i < a.pixels().size(); ++i)
    EXPECT_NEAR(a.pixels()[i], b.pixels()[i], 64 * 0x1p-32 + 0x1p-22 * a.pixels()[i]);
}

TEST(Blur, IsTheAverageOverShiftedImages) {
  const OpticsDescription optics = with(7, 0.03);
  const double px_per_um = optics.magnification / optics.pixel_um;
  const Blur blur{0.2, 0.05, 30};
  const PhotonImage blurred = expected(PointSpreadFunction(optics, 0, blur), {41, 41}, 20.2, 19.7);
  const PointSpreadFunction sharp(optics);
  PhotonImage average(Shape{41, 41});
  const int steps = 60;
  const double c = std::cos(std::numbers::pi / 6), s = std::sin(std::numbers::pi / 6);
  for (int i = 0; i < steps; ++i)
    for (int j = 0; j < steps; ++j) {
      const double a = blur.major_um * px_per_um * math::normal_quantile((i + 0.5) / steps);
      const double b = blur.minor_um * px_per_um * math::normal_quantile((j + 0.5) / steps);
      sharp.add_expected(average, 1.0 / (steps * steps), 20.2 + c * a - s * b, 19.7 + s * a + c * b);
    }
  const double peak = *std::max_element(average.pixels().begin(), average.pixels().end());
  // The mid-points of `steps` even parts miss about 1 / (2 steps) of the normal law's variance.
  for (std::size_t i = 0; i < average.pixels().size(); ++i)
    EXPECT_NEAR(blurred.pixels()[i], average.pixels()[i], (cell_error + 0.5 / steps) * peak);
}

TEST(AddExpected, BinnedPixelsAreSumsOfPixels) {
  const PointSpreadFunction psf(with(7, 0.05));
  PhotonImage fine(Shape{60, 90}), binned(Shape{20, 45});
  psf.add_expected(fine, 1000, 131.2, 57.9, 100, 40);
  psf.add_expected(binned, 1000, 131.2, 57.9, 100, 40, 2, 3);
  for (int r = 0; r < 20; ++r)
    for (int c = 0; c < 45; ++c) {
      double total = 0;
      for (int j = 0; j < 3; ++j)
        for (int i = 0; i < 2; ++i) total += fine(3 * r + j, 2 * c + i);
      EXPECT_NEAR(binned(r, c), total, 0x1p-20 * total);
    }
}

TEST(AddExpected, AnyRegionIsACutOfTheWholeSensor) {
  OpticsDescription optics;
  optics.zernike_um = papers_fit;
  const PointSpreadFunction psf(optics);
  const double x = 130.4, y = 141.3;
  const PhotonImage whole = expected(psf, {300, 300}, x, y);
  struct Part {
    int row, column;
    Shape shape;
  };
  for (const Part& part : {Part{0, 0, {64, 256}}, Part{10, 20, {256, 64}}, Part{130, 120, {20, 20}},
                           Part{100, 128, {128, 3}}, Part{141, 0, {1, 300}}, Part{200, 160, {64, 32}}}) {
    PhotonImage image(part.shape);
    psf.add_expected(image, 1, x, y, part.column, part.row);
    for (int r = 0; r < image.rows(); ++r)
      for (int c = 0; c < image.columns(); ++c)
        EXPECT_NEAR(image(r, c), whole(part.row + r, part.column + c), 0x1p-20 * image(r, c));
  }
}

TEST(AddExpected, PortraitIsLandscapeTransposed) {
  const PointSpreadFunction wide(with(7, 0.05)), tall(with(6, 0.05));
  const PhotonImage landscape = expected(wide, {128, 512}, 250.25, 60.5);
  const PhotonImage portrait = expected(tall, {512, 128}, 60.5, 250.25);
  for (int r = 0; r < 128; ++r)
    for (int c = 0; c < 512; ++c)
      EXPECT_NEAR(landscape(r, c), portrait(c, r), 64 * 0x1p-32 + 0x1p-20 * landscape(r, c));
}

TEST(AddExpected, AnAtomOutsideTheImageSendsItsTail) {
  const PointSpreadFunction psf{OpticsDescription{}};
  const PhotonImage image = expected(psf, {40, 40}, -4.5, 20, 1);
  const PhotonImage whole = expected(psf, {40, 60}, 15.5, 20, 1);
  EXPECT_GT(sum(image), 0.02);
  for (int r = 0; r < 40; ++r)
    for (int c = 0; c < 40; ++c) EXPECT_NEAR(image(r, c), whole(r, c + 20), 0x1p-20 * image(r, c));
  EXPECT_EQ(sum(expected(psf, {40, 40}, -2 * psf.reach_px(), 20)), 0);
}

TEST(AddExpected, IsContinuousInThePosition) {
  const PointSpreadFunction psf(with(6, 0.04));
  const PhotonImage start = expected(psf, {33, 33}, 16, 16);
  // A step moves at most (edge length) x (step) x (largest density) of light in or out of a pixel.
  const double density =
      2.0 / (unit_px(OpticsDescription{}) * unit_px(OpticsDescription{})) * std::numbers::pi;
  const double step = 1.0 / 64;
  PhotonImage before = start;
  for (int i = 1; i <= 64; ++i) {
    const PhotonImage now = expected(psf, {33, 33}, 16 + i * step, 16);
    for (std::size_t k = 0; k < now.pixels().size(); ++k)
      EXPECT_LE(std::fabs(now.pixels()[k] - before.pixels()[k]), density * step);
    before = now;
  }
  for (int r = 0; r < 33; ++r)
    for (int c = 1; c < 33; ++c) EXPECT_NEAR(before(r, c), start(r, c - 1), 0x1p-20 * before(r, c));
}

/// Probability of a chi-square as large, drawn photons against expected ones, cells below 10 pooled.
double drawn_against_expected(const PointSpreadFunction& drawn, const PointSpreadFunction& law,
                              bool jitter = true) {
  const int size = 48, photons = 2000000;
  const double x = 23.37, y = 24.81;
  const PhotonImage mean = expected(law, {size, size}, x, y, photons);
  std::vector<std::uint32_t> words(2 * static_cast<std::size_t>(photons));
  fill_random(stream_key(11, stream_id("test/photons")), 0, 0, words);
  if (!jitter)
    for (std::size_t i = 1; i < words.size(); i += 2) words[i] = 0;
  std::vector<PointSpreadFunction::Displacement> landed(static_cast<std::size_t>(photons));
  drawn.draw(words, landed);
  std::vector<double> count(static_cast<std::size_t>(size) * size);
  for (const auto& d : landed) {
    const int column = static_cast<int>(std::floor(x + d.dx_px + 0.5)),
              row = static_cast<int>(std::floor(y + d.dy_px + 0.5));
    if (row >= 0 && row < size && column >= 0 && column < size)
      ++count[static_cast<std::size_t>(row * size + column)];
  }
  double statistic = 0, rest = photons, rest_mean = photons;
  int freedom = 0;
  for (std::size_t i = 0; i < count.size(); ++i) {
    const double m = mean.pixels()[i];
    if (m < 10) continue;
    statistic += (count[i] - m) * (count[i] - m) / m;
    rest -= count[i];
    rest_mean -= m;
    ++freedom;
  }
  statistic += (rest - rest_mean) * (rest - rest_mean) / rest_mean;
  return boost::math::gamma_q(freedom / 2.0, statistic / 2);
}

TEST(Draw, FollowsTheExpectedImage) {
  OpticsDescription optics;
  optics.zernike_um = papers_fit;
  for (const OpticsDescription& each : {OpticsDescription{}, optics, with(1, 0.3), with(3, 0.4)}) {
    const PointSpreadFunction psf(each);
    EXPECT_GT(drawn_against_expected(psf, psf), 1e-6);
  }
}

TEST(Draw, TheRigRefusesWrongDraws) {
  const PointSpreadFunction ideal{OpticsDescription{}};
  EXPECT_LT(drawn_against_expected(PointSpreadFunction(with(7, 0.002)), ideal), 1e-6);  // 0.085 px of skew
  EXPECT_LT(drawn_against_expected(ideal, ideal, false), 1e-6);                         // no jitter: 0.09 px
}

TEST(Draw, OneByOneGivesTheSamePhotons) {
  const PointSpreadFunction psf{OpticsDescription{}}, copy = psf;
  std::vector<std::uint32_t> words(2000);
  fill_random(stream_key(1, 2), 0, 0, words);
  std::vector<PointSpreadFunction::Displacement> many(1000);
  psf.draw(words, many);
  for (std::size_t n = 0; n < many.size(); ++n) {
    const auto one = copy.draw(words[2 * n], words[2 * n + 1]);
    EXPECT_EQ(one.dx_px, many[n].dx_px);
    EXPECT_EQ(one.dy_px, many[n].dy_px);
    EXPECT_LE(std::max(std::fabs(one.dx_px), std::fabs(one.dy_px)), psf.reach_px());
  }
  EXPECT_THROW(psf.draw(std::span(words).first(10), many), Error);
}

TEST(PointSpreadFunction, TheTransformsLastBitsDoNotMatter) {
  OpticsDescription optics;
  optics.zernike_um = papers_fit;
  const Cells cells = point_spread_cells(optics, {});
  const double largest = *std::max_element(cells.share.begin(), cells.share.end());
  RandomStream random(3, stream_id("test/last bits"), 0, 0);
  std::vector<double> perturbed = cells.share;
  for (double& share : perturbed) share += (random.uniform() - 0.5) * 0x1p-53 * largest;
  EXPECT_EQ(integer_weights(cells.share, std::uint64_t{1} << 32),
            integer_weights(perturbed, std::uint64_t{1} << 32));
  for (double& share : perturbed) share *= 1 + (random.uniform() - 0.5) * 1e-6;
  EXPECT_NE(integer_weights(cells.share, std::uint64_t{1} << 32),
            integer_weights(perturbed, std::uint64_t{1} << 32));
}

TEST(PointSpreadFunction, ThreadsMayBuildAtOnce) {
  std::vector<PhotonImage> images(4);
  std::vector<std::thread> threads;
  for (PhotonImage& image : images)
    threads.emplace_back([&image] {
      image = expected(PointSpreadFunction(with(7, 0.03)), {31, 31}, 15, 15);
    });
  for (std::thread& thread : threads) thread.join();
  for (const PhotonImage& image : images) EXPECT_EQ(image, images[0]);
}

TEST(PointSpreadFunction, RefusesBadOptics) {
  const auto place = [](auto change) {
    OpticsDescription optics;
    change(optics);
    try {
      const PointSpreadFunction psf(optics);
    } catch (const Error& error) {
      return error.place();
    }
    return std::string("no error");
  };
  EXPECT_EQ(place([](OpticsDescription& o) { o.numerical_aperture = 1; }), "numerical_aperture");
  EXPECT_EQ(place([](OpticsDescription& o) { o.wavelength_um = 0; }), "wavelength_um");
  EXPECT_EQ(place([](OpticsDescription& o) { o.zernike_um[4] = std::nan(""); }), "zernike_um");
  EXPECT_EQ(place([](OpticsDescription& o) { o.zernike_um[3] = 1000; }), "optics");
}

TEST(CollectedFraction, IsThePapers) {
  EXPECT_NEAR(collected_fraction(0.65), 0.120, 0.0005);
  EXPECT_EQ(collected_fraction(0), 0);
  EXPECT_EQ(collected_fraction(1), 0.5);
}

}  // namespace
}  // namespace atomcam
