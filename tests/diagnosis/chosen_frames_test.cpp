#include "diagnosis/chosen_frames.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <vector>

#include "diagnosis/simulated_frames.hpp"

namespace atomcam {
namespace {

std::vector<std::size_t> numbers(const FrameChoice& choice) {
  std::vector<std::size_t> list;
  for (std::size_t k = 0; k < choice.count(); ++k) list.push_back(choice.number(k));
  return list;
}

TEST(ChosenFrames, StretchesReachFromTheFirstFrameToTheLast) {
  EXPECT_EQ(numbers({10, 6, 2}), (std::vector<std::size_t>{0, 1, 4, 5, 8, 9}));
  EXPECT_EQ(numbers({10, 7, 3}), (std::vector<std::size_t>{0, 1, 2, 7, 8, 9}));  // no part of a stretch
  EXPECT_EQ(numbers({9, 8, 2}), (std::vector<std::size_t>{0, 1, 2, 3, 4, 5, 7, 8}));
  for (const FrameChoice& all : {FrameChoice(4), FrameChoice(4, 4, 2), FrameChoice(4, 9, 3)}) {
    EXPECT_TRUE(all.is_all());
    EXPECT_EQ(numbers(all), (std::vector<std::size_t>{0, 1, 2, 3}));
  }
  EXPECT_EQ(FrameChoice(0).count(), 0u);
}

TEST(ChosenFrames, NoFrameIsLookedAtTwice) {
  for (std::size_t all = 65; all < 400; all += 7)
    for (const std::size_t stretch : {2, 16, 20, 64}) {
      const FrameChoice choice(all, 64, stretch);
      const std::vector<std::size_t> list = numbers(choice);
      ASSERT_EQ(list.size(), 64 - 64 % stretch);
      for (std::size_t k = 1; k < list.size(); ++k) ASSERT_LT(list[k - 1], list[k]) << all << " " << stretch;
      ASSERT_EQ(list.back(), stretch < 64 ? all - 1 : 63);
    }
}

TEST(ChosenFrames, OnlyOfALongStackOfLargeFramesAPartIsWorthLookingAt) {
  EXPECT_TRUE(frames_worth_looking_at(300, {96, 96}).is_all());
  EXPECT_TRUE(frames_worth_looking_at(46, {512, 512}).is_all());
  EXPECT_TRUE(frames_worth_looking_at(60, {2304, 4096}).is_all());  // fewer tell too little
  for (const Shape& shape : {Shape{512, 512}, Shape{2304, 4096}}) {
    const FrameChoice part = frames_worth_looking_at(1000, shape);
    EXPECT_EQ(part.count(), 64u);
    EXPECT_EQ(part.stretch(), 16u);  // a block of eight frames of either part
  }
  const FrameChoice smaller = frames_worth_looking_at(100000, {128, 128});
  EXPECT_LE(smaller.count() * 128 * 128, std::size_t{1} << 24);
  EXPECT_GT(smaller.count(), 1000u);
  EXPECT_EQ(smaller.stretch(), 20u);
}

TEST(ChosenFrames, SimulatedOnesAreThoseOfTheWholeStack) {
  Lab lab = preset("ixon-ultra-897");
  lab.settings.region = {0, 0, 32, 32};
  lab.effects["bias_drift"] = {20, 5, 0};  // what came before a frame counts, looked at or not
  const FrameChoice choice(40, 12, 4);
  for (const bool shutter_open : {true, false}) {
    const SimulatedFrames part(lab, choice, shutter_open), all(lab, 40, shutter_open);
    const ChosenFrames of_all(all, choice);
    ASSERT_EQ(part.frames(), 12u);
    ASSERT_EQ(of_all.frames(), 12u);
    std::vector<CountImage> expected;
    of_all.visit([&](std::size_t n, const CountImage& frame) {
      EXPECT_EQ(n, expected.size());
      expected.push_back(frame);
    });
    ASSERT_EQ(expected.size(), 12u);
    part.visit([&](std::size_t n, const CountImage& frame) {
      EXPECT_TRUE(std::ranges::equal(frame.pixels(), expected[n].pixels())) << n;
    });
    all.visit([&](std::size_t n, const CountImage& frame) {
      if (n != choice.number(7)) return;
      EXPECT_TRUE(std::ranges::equal(frame.pixels(), expected[7].pixels()));
    });
  }
}

}  // namespace
}  // namespace atomcam
