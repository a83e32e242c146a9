#include "scene/scene.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "base/error.hpp"

namespace atomcam {
namespace {

SceneDescription array_of(int sites) {
  SceneDescription scene;
  for (int i = 0; i < sites; ++i) scene.sites.push_back({10.25 + i, 20.5, 1});
  return scene;
}

/// Kolmogorov's asymptotic tail: P(sqrt(n) D > t).
double kolmogorov_tail(double t) {
  double tail = 0;
  for (int k = 1; k < 100; ++k) tail += (k % 2 ? 2 : -2) * std::exp(-2.0 * k * k * t * t);
  return tail;
}

template <class Law>
double ks_probability(std::vector<double> sample, Law law) {
  std::sort(sample.begin(), sample.end());
  const double n = static_cast<double>(sample.size());
  double distance = 0;
  for (std::size_t i = 0; i < sample.size(); ++i) {
    const double p = law(sample[i]);
    distance = std::max({distance, p - static_cast<double>(i) / n, static_cast<double>(i + 1) / n - p});
  }
  return kolmogorov_tail(std::sqrt(n) * distance);
}

/// A count of a binomial law within 5 standard errors.
void expect_binomial(double count, double n, double p) {
  EXPECT_LE(std::fabs(count - n * p), 5 * std::sqrt(n * p * (1 - p)))
      << count << " of " << n << ", p = " << p;
}

bool same(const SceneFrame& a, const SceneFrame& b) {
  if (a.atoms.size() != b.atoms.size() || a.emitters.size() != b.emitters.size()) return false;
  for (std::size_t i = 0; i < a.atoms.size(); ++i)
    if (a.atoms[i].present_at_start != b.atoms[i].present_at_start ||
        a.atoms[i].present_at_end != b.atoms[i].present_at_end ||
        a.atoms[i].loss_time_s != b.atoms[i].loss_time_s ||
        a.atoms[i].photons_emitted != b.atoms[i].photons_emitted)
      return false;
  for (std::size_t i = 0; i < a.emitters.size(); ++i)
    if (a.emitters[i].site != b.emitters[i].site || a.emitters[i].end_s != b.emitters[i].end_s) return false;
  return true;
}

std::vector<double> loss_times(double survival, double exposure_s) {
  SceneDescription scene = array_of(200000);
  scene.filling = 1;
  scene.survival = survival;
  scene.reference_exposure_s = exposure_s;
  std::vector<double> times;
  for (const Atom& atom : draw_scene(scene, exposure_s, 5, 0).atoms)
    if (!atom.present_at_end) times.push_back(atom.loss_time_s / exposure_s);
  return times;
}

TEST(LossTime, FollowsThePapersLaw) {
  for (const double p : {0.05, 0.4, 0.9, 0.99}) {
    const auto times = loss_times(p, 0.08);
    expect_binomial(static_cast<double>(times.size()), 200000, 1 - p);
    EXPECT_GT(ks_probability(times, [p](double t) { return (std::pow(p, t) - 1) / (p - 1); }), 1e-6) << p;
  }
}

TEST(LossTime, TheRigRefusesAnEvenLaw) {
  const auto times = loss_times(0.4, 0.08);
  EXPECT_LT(ks_probability(times, [](double t) { return t; }), 1e-6);
}

TEST(Survival, IsARateOverAnyExposure) {
  SceneDescription scene = array_of(100000);
  scene.filling = 1;
  scene.survival = 0.8;
  scene.reference_exposure_s = 0.1;
  for (const double exposure_s : {0.01, 0.1, 0.35, 1.0}) {
    double survivors = 0;
    for (const Atom& atom : draw_scene(scene, exposure_s, 6, 3).atoms) survivors += atom.present_at_end;
    expect_binomial(survivors, 100000, std::pow(0.8, exposure_s / 0.1));
  }
}

TEST(Survival, OneLosesNoneAndZeroLosesAllAtOnce) {
  SceneDescription scene = array_of(1000);
  scene.filling = 1;
  scene.survival = 1;
  for (const Atom& atom : draw_scene(scene, 1e6, 1, 0).atoms) {
    EXPECT_TRUE(atom.present_at_end);
    EXPECT_EQ(atom.loss_time_s, never);
  }
  scene.survival = 0;
  const SceneFrame frame = draw_scene(scene, 0.08, 1, 0);
  for (const Atom& atom : frame.atoms) {
    EXPECT_TRUE(atom.present_at_start);
    EXPECT_FALSE(atom.present_at_end);
    EXPECT_EQ(atom.loss_time_s, 0);
    EXPECT_EQ(atom.photons_emitted, 0);
  }
  EXPECT_TRUE(frame.emitters.empty());
}

TEST(Shot, SurvivorsCarryOverAndOthersDoNot) {
  SceneDescription scene = array_of(20000);
  scene.survival = 0.7;
  scene.images_per_shot = 4;
  for (std::uint64_t shot = 0; shot < 2; ++shot) {
    SceneFrame before = draw_scene(scene, 0.08, 9, 4 * shot);
    for (std::uint64_t image = 1; image < 4; ++image) {
      SceneFrame after = draw_scene(scene, 0.08, 9, 4 * shot + image);
      double carried = 0, kept = 0;
      for (std::size_t i = 0; i < before.atoms.size(); ++i) {
        EXPECT_EQ(after.atoms[i].present_at_start, before.atoms[i].present_at_end);
        carried += after.atoms[i].present_at_start;
        kept += after.atoms[i].present_at_end;
      }
      expect_binomial(kept, carried, 0.7);
      before = std::move(after);
    }
  }
}

TEST(Shot, LoadsAfresh) {
  SceneDescription scene = array_of(20000);
  scene.images_per_shot = 3;
  const SceneFrame a = draw_scene(scene, 0.08, 2, 0), b = draw_scene(scene, 0.08, 2, 3);
  double both = 0;
  for (std::size_t i = 0; i < a.atoms.size(); ++i)
    both += a.atoms[i].present_at_start && b.atoms[i].present_at_start;
  expect_binomial(both, 20000, 0.25);
}

TEST(Filling, HasTheBinomialMoments) {
  SceneDescription scene = array_of(306);
  for (const double filling : {0.01, 0.5, 0.93}) {
    scene.filling = filling;
    const int frames = 2000;
    double sum = 0, squares = 0;
    for (int frame = 0; frame < frames; ++frame) {
      double filled = 0;
      for (const Atom& atom : draw_scene(scene, 0.08, 3, static_cast<std::uint64_t>(frame)).atoms)
        filled += atom.present_at_start;
      sum += filled;
      squares += (filled - 306 * filling) * (filled - 306 * filling);
    }
    expect_binomial(sum, 306.0 * frames, filling);
    // The squared deviation has mean v = n p q and variance 2 v^2 + v (1 - 6 p q).
    const double v = 306 * filling * (1 - filling);
    const double spread = std::sqrt((2 * v * v + v * (1 - 6 * filling * (1 - filling))) / frames);
    EXPECT_LE(std::fabs(squares / frames - v), 5 * spread);
  }
}

TEST(Filling, ZeroGivesNoneAndOneGivesAll) {
  SceneDescription scene = array_of(100000);
  for (const double filling : {0.0, 1.0}) {
    scene.filling = filling;
    for (const Atom& atom : draw_scene(scene, 0.08, 4, 0).atoms)
      EXPECT_EQ(atom.present_at_start, filling == 1);
  }
}

TEST(DrawScene, IsPureInAnyOrder) {
  SceneDescription scene = array_of(50);
  scene.images_per_shot = 3;
  scene.survival = 0.5;
  std::vector<SceneFrame> forward;
  for (std::uint64_t frame = 0; frame < 12; ++frame) forward.push_back(draw_scene(scene, 0.08, 77, frame));
  for (std::uint64_t frame = 12; frame-- > 0;)
    EXPECT_TRUE(same(forward[frame], draw_scene(scene, 0.08, 77, frame))) << frame;
  EXPECT_FALSE(same(forward[0], draw_scene(scene, 0.08, 78, 0)));
  EXPECT_FALSE(same(forward[0], forward[3]));
}

TEST(DrawScene, ASitesFateDoesNotDependOnOtherSites) {
  const SceneFrame few = draw_scene(array_of(10), 0.08, 1, 0), many = draw_scene(array_of(100), 0.08, 1, 0);
  for (std::size_t i = 0; i < few.atoms.size(); ++i) {
    EXPECT_EQ(few.atoms[i].present_at_start, many.atoms[i].present_at_start);
    EXPECT_EQ(few.atoms[i].loss_time_s, many.atoms[i].loss_time_s);
  }
}

TEST(DrawScene, GivenOccupancyIsObeyed) {
  SceneDescription scene = array_of(64);
  scene.images_per_shot = 2;
  scene.survival = 0.6;
  scene.filling = 0;
  std::vector<Occupancy> sequence(5, Occupancy(64));
  for (std::size_t shot = 0; shot < sequence.size(); ++shot)
    for (std::size_t i = 0; i < 64; ++i) sequence[shot][i] = (i * 7 + shot) % 3 == 0;
  for (std::uint64_t frame = 0; frame < 10; ++frame) {
    const Occupancy& given = sequence[frame / 2];
    const SceneFrame drawn = draw_scene(scene, 0.08, 8, frame, &given);
    const SceneFrame first = draw_scene(scene, 0.08, 8, frame / 2 * 2, &given);
    for (std::size_t i = 0; i < 64; ++i) {
      if (frame % 2 == 0)
        EXPECT_EQ(drawn.atoms[i].present_at_start, given[i] != 0);
      else
        EXPECT_EQ(drawn.atoms[i].present_at_start, first.atoms[i].present_at_end);
    }
  }
  const Occupancy wrong(63);
  EXPECT_THROW(draw_scene(scene, 0.08, 8, 0, &wrong), Error);
}

TEST(DrawScene, EmittersCarryTheLightOfTheirAtoms) {
  SceneDescription scene = array_of(500);
  scene.survival = 0.5;
  for (std::size_t i = 0; i < scene.sites.size(); ++i)
    scene.sites[i].brightness = 0.5 + 0.001 * static_cast<double>(i);
  const SceneFrame frame = draw_scene(scene, 0.05, 1, 0);
  std::size_t lit = 0;
  for (const Atom& atom : frame.atoms) lit += atom.photons_emitted > 0;
  ASSERT_EQ(frame.emitters.size(), lit);
  for (const Emitter& emitter : frame.emitters) {
    const Atom& atom = frame.atoms[static_cast<std::size_t>(emitter.site)];
    const Site& site = scene.sites[static_cast<std::size_t>(emitter.site)];
    EXPECT_TRUE(atom.present_at_start);
    EXPECT_EQ(emitter.x_px, site.x_px);
    EXPECT_EQ(emitter.y_px, site.y_px);
    EXPECT_EQ(emitter.start_s, 0);
    EXPECT_EQ(emitter.end_s, std::min(atom.loss_time_s, 0.05));
    EXPECT_EQ(emitter.rate_hz, 30000 * site.brightness);
    EXPECT_EQ(emitter.emitted(), atom.photons_emitted);
  }
}

TEST(DrawScene, RefusesBadInputByName) {
  const auto place = [](auto change) {
    SceneDescription scene = array_of(1);
    change(scene);
    try {
      draw_scene(scene, 0.08, 1, 0);
    } catch (const Error& error) {
      return error.place();
    }
    return std::string("no error");
  };
  EXPECT_EQ(place([](SceneDescription& s) { s.filling = 1.5; }), "filling");
  EXPECT_EQ(place([](SceneDescription& s) { s.filling = std::nan(""); }), "filling");
  EXPECT_EQ(place([](SceneDescription& s) { s.survival = -0.1; }), "survival");
  EXPECT_EQ(place([](SceneDescription& s) { s.reference_exposure_s = 0; }), "reference_exposure_s");
  EXPECT_EQ(place([](SceneDescription& s) { s.images_per_shot = 0; }), "images_per_shot");
}

TEST(GridSites, StandWhereTheFormulaSays) {
  SiteGrid grid;
  grid.columns = 3;
  grid.rows = 4;
  grid.spacing_x = 10;
  grid.spacing_y = 20;
  grid.offset_x = 5.5;
  grid.offset_y = 7.25;
  grid.angle_x_deg = 30;
  grid.angle_y_deg = 90;
  const auto sites = grid_sites(grid, 9.765625, 255.5, 255.5);
  ASSERT_EQ(sites.size(), 12u);
  for (int j = 0; j < 4; ++j)
    for (int i = 0; i < 3; ++i) {
      const Site& site = sites[static_cast<std::size_t>(j * 3 + i)];
      EXPECT_NEAR(site.x_px, 5.5 + i * 10 * std::sqrt(0.75) - j * 20, 1e-13);
      EXPECT_NEAR(site.y_px, 7.25 + i * 5, 1e-13);
    }
}

TEST(GridSites, ObjectPlaneScalesAboutTheCentre) {
  SiteGrid grid;
  grid.columns = 2;
  grid.rows = 1;
  grid.spacing_x = 4;
  grid.offset_x = -2;
  grid.offset_y = 1;
  grid.object_plane = true;
  const auto sites = grid_sites(grid, 10, 255.5, 127.5);
  EXPECT_DOUBLE_EQ(sites[0].x_px, 235.5);
  EXPECT_DOUBLE_EQ(sites[1].x_px, 275.5);
  EXPECT_DOUBLE_EQ(sites[1].y_px, 137.5);
}

}  // namespace
}  // namespace atomcam
