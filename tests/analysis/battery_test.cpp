// What the battery says of plain stacks, and of stacks of unusual kinds.

#include "analysis/battery.hpp"

#include <gtest/gtest.h>

#include <set>

#include "analysis/synthetic.hpp"
#include "base/observable.hpp"

namespace atomcam {
namespace {

using synthetic::Camera;
using synthetic::frames_of;
using synthetic::model_of;

/// The same frames, made anew at every visit.
class Rebuilt : public FrameSequence {
 public:
  Rebuilt(Camera camera, std::size_t frames, std::uint64_t seed)
      : camera_(camera), frames_(frames), seed_(seed) {}
  std::size_t frames() const override { return frames_; }
  Shape shape() const override { return {camera_.size, camera_.size}; }
  void visit(const std::function<void(std::size_t, const CountImage&)>& take) const override {
    frames_of(camera_, frames_, seed_, false).visit(take);
    ++visits;
  }
  mutable int visits = 0;

 private:
  Camera camera_;
  std::size_t frames_;
  std::uint64_t seed_;
};

TEST(Battery, DeclaresEveryStatisticOnceWithAKnownObservable) {
  const auto declarations = battery(model_of({}), true);
  std::set<std::string> names;
  const std::set<std::string> axes = {"space", "time", "intensity", "frequency", "site", "shape"};
  for (const StatisticDeclaration& d : declarations) {
    EXPECT_TRUE(names.insert(d.name).second) << d.name;
    EXPECT_TRUE(std::find(observables.begin(), observables.end(), d.observable) != observables.end())
        << d.name << " " << d.observable;
    EXPECT_TRUE(axes.contains(d.axis)) << d.name;
    EXPECT_FALSE(d.place.empty()) << d.name;
    EXPECT_EQ(d.name.starts_with(d.darks ? "dark." : "light."), true) << d.name;
  }
  RecordProperty("statistics", static_cast<int>(declarations.size()));
}

TEST(Battery, HasANumberForEverythingInAUsualStack) {
  for (const bool multiplied : {true, false}) {
    const Camera camera{.multiplied = multiplied};
    const StackModel model = model_of(camera);
    const auto declarations = battery(model, true);
    const auto light = frames_of(camera, 60, 1, false), darks = frames_of(camera, 40, 1, true);
    const BatteryValues values = measure(model, light, &darks);
    ASSERT_EQ(values.whole.size(), declarations.size());
    for (const auto* list : {&values.whole, &values.part[0], &values.part[1]}) {
      ASSERT_EQ(list->size(), declarations.size());
      for (std::size_t i = 0; i < list->size(); ++i) {
        // The stack's first frames are all in the first part.
        if (list == &values.part[1] && declarations[i].name.ends_with("first_frames")) continue;
        EXPECT_TRUE(std::isfinite((*list)[i])) << declarations[i].name;
      }
    }
  }
}

TEST(Battery, IsPureAndNeedsTwoVisits) {
  const Camera camera;
  const StackModel model = model_of(camera);
  const Rebuilt rebuilt(camera, 40, 3);
  const auto in_memory = frames_of(camera, 40, 3, false);
  const BatteryValues a = measure(model, rebuilt, nullptr), b = measure(model, in_memory, nullptr);
  EXPECT_EQ(rebuilt.visits, 2);
  const auto same = [](const std::vector<double>& x, const std::vector<double>& y) {
    return std::equal(x.begin(), x.end(), y.begin(), y.end(),
                      [](double u, double v) { return u == v || (std::isnan(u) && std::isnan(v)); });
  };
  EXPECT_TRUE(same(a.whole, b.whole));
  EXPECT_TRUE(same(a.part[0], b.part[0]));
  EXPECT_TRUE(same(a.part[1], b.part[1]));
}

TEST(Battery, PartsAreThoseOfTheSplit) {
  // Frames of the second part are brighter: only its mean moves.
  const Camera camera{.sites = 0};
  const StackModel model = model_of(camera);
  const BatterySplit split{.block = 4};
  synthetic::Hooks brighter;
  brighter.counts = [&](std::size_t n, std::vector<double>& counts) {
    if (n / split.block % 2)
      for (double& c : counts) c += 5;
  };
  const auto plain = frames_of(camera, 40, 5, false), moved = frames_of(camera, 40, 5, false, brighter);
  const BatteryValues a = measure(model, plain, nullptr, split), b = measure(model, moved, nullptr, split);
  const auto declarations = battery(model, false);
  for (std::size_t i = 0; i < declarations.size(); ++i)
    if (declarations[i].name.starts_with("light.pixel_histogram.quantile")) {
      EXPECT_EQ(a.part[0][i], b.part[0][i]);
      EXPECT_LT(a.part[1][i], b.part[1][i]);
    }
}

TEST(Battery, WorksWithoutSitesAndWithFewFrames) {
  for (const int sites : {0, 1, 5})
    for (const std::size_t frames : {0u, 1u, 3u}) {
      const Camera camera{.sites = sites};
      const StackModel model = model_of(camera);
      const auto light = frames_of(camera, frames, 1, false), darks = frames_of(camera, frames, 1, true);
      const FramesInMemory none{{}};
      const BatteryValues values = measure(model, light, &darks);
      const auto declarations = battery(model, true);
      ASSERT_EQ(values.whole.size(), declarations.size());
      std::size_t numbers = 0;
      for (const double value : values.whole) numbers += std::isfinite(value);
      if (frames == 0) {
        EXPECT_EQ(numbers, 0u) << sites;
      }
      if (frames == 3) {
        EXPECT_GT(numbers, declarations.size() / 4) << sites;
      }
      EXPECT_EQ(battery(model, false).size(), measure(model, light, nullptr).whole.size());
    }
}

TEST(Battery, FramesThatDoNotVaryGiveNoInfinity) {
  const Camera camera{.size = 32, .sites = 0};
  const StackModel model = model_of(camera);
  for (const std::uint16_t code : {std::uint16_t{0}, std::uint16_t{200}, std::uint16_t{65535}}) {
    const FramesInMemory light(std::vector<CountImage>(30, CountImage(model.shape, code)));
    for (const double value : measure(model, light, nullptr).whole) EXPECT_FALSE(std::isinf(value));
  }
}

}  // namespace
}  // namespace atomcam
