// Exposures, triggers and frames in time. The machine may be busy: what is checked is what the camera says of
// itself (timestamps, counters), never how soon a thread ran.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <future>

#include "camera/big_endian.hpp"
#include "camera/pixel_format.hpp"
#include "fixtures.hpp"

namespace atomcam::test {
namespace {

using namespace std::chrono_literals;

/// A 64 x 64 image exposed for `exposure_us`, as fast as that goes.
void small_image(Bench& bench, double exposure_us) {
  bench.set("Width", 64);
  bench.set("Height", 64);
  bench.set("AcquisitionFrameRateEnable", false);
  bench.set("ExposureTime", exposure_us);
}

void stop(Bench& bench) {
  bench.camera->execute("AcquisitionStop");
}

TEST(Acquisition, FreeRunningFramesComeInOrderAndFromTheSource) {
  Bench bench(ixon_model());
  small_image(bench, 5000);
  bench.camera->execute("AcquisitionStart");
  ASSERT_TRUE(bench.sink.wait_frames(10));
  stop(bench);
  const auto frames = bench.sink.frames();
  for (std::size_t i = 0; i < frames.size(); ++i) {
    EXPECT_EQ(frames[i]->id, i);
    EXPECT_EQ(frames[i]->width, 64u);
    EXPECT_EQ(frames[i]->payload.size(), static_cast<std::size_t>(bench.integer("PayloadSize")));
    const auto counts = unpack(PixelFormat::mono16, frames[i]->payload, 64 * 64);
    EXPECT_EQ(counts[65], 16 * (2 + i));
  }
}

TEST(Acquisition, KeepsAnAbsoluteSchedule) {
  Bench bench(ixon_model());
  small_image(bench, 20000);
  bench.set("AcquisitionFrameRateEnable", true);
  bench.set("AcquisitionFrameRate", 20.0);
  bench.set("AcquisitionMode", "MultiFrame");
  bench.set("AcquisitionFrameCount", 12);
  bench.camera->execute("AcquisitionStart");
  ASSERT_TRUE(bench.sink.wait_stopped(1));
  const auto frames = bench.sink.frames();
  ASSERT_EQ(frames.size(), 12u);
  // A stalled machine makes the schedule slip, never run ahead.
  int exact = 0;
  for (std::size_t i = 1; i < frames.size(); ++i) {
    const auto interval = frames[i]->timestamp_ns - frames[i - 1]->timestamp_ns;
    EXPECT_GE(interval, 50'000'000u);
    exact += interval == 50'000'000u;
  }
  EXPECT_GE(exact, 6);
  EXPECT_EQ(bench.camera->settings().frame_interval_s, 0.05);
}

TEST(Acquisition, FramesComeAfterExposureAndReadout) {
  Bench bench(ixon_model());
  small_image(bench, 30000);
  const double readout_us = bench.floating("SensorReadoutTime");
  bench.set("AcquisitionMode", "SingleFrame");
  const auto before = std::chrono::steady_clock::now();
  bench.camera->execute("AcquisitionStart");
  ASSERT_TRUE(bench.sink.wait_frames(1));
  const auto took = std::chrono::duration<double, std::micro>(bench.sink.arrivals()[0] - before).count();
  EXPECT_GE(took, 30000 + readout_us);
}

TEST(Acquisition, SingleAndMultiFrameEndByThemselvesAndNumbersGoOn) {
  Bench bench(ixon_model());
  small_image(bench, 5000);
  bench.set("AcquisitionMode", "SingleFrame");
  for (int snap = 0; snap < 2; ++snap) {
    bench.camera->execute("AcquisitionStart");
    ASSERT_TRUE(bench.sink.wait_stopped(snap + 1));
  }
  bench.set("AcquisitionMode", "MultiFrame");
  bench.set("AcquisitionFrameCount", 7);
  bench.camera->execute("AcquisitionStart");
  ASSERT_TRUE(bench.sink.wait_stopped(3));
  std::this_thread::sleep_for(30ms);
  const auto frames = bench.sink.frames();
  ASSERT_EQ(frames.size(), 9u);
  for (std::size_t i = 0; i < frames.size(); ++i) EXPECT_EQ(frames[i]->id, i);
  EXPECT_EQ(bench.sink.started(), 3);
  EXPECT_EQ(bench.integer("ParametersLocked"), 0);
  EXPECT_EQ(bench.camera->statistics().frames, 9u);
}

TEST(Acquisition, StopEndsAtOnceAndUndeliveredNumbersComeAgain) {
  Bench bench(ixon_model());
  small_image(bench, 5000);
  for (int round = 0; round < 3; ++round) {
    bench.camera->execute("AcquisitionStart");
    ASSERT_TRUE(bench.sink.wait_frames(bench.sink.frames().size() + 3));
    stop(bench);
    ASSERT_TRUE(bench.sink.wait_stopped(round + 1));
    bench.set("Width", 32 + 16 * round);  // not refused
  }
  const auto frames = bench.sink.frames();
  for (std::size_t i = 0; i < frames.size(); ++i) EXPECT_EQ(frames[i]->id, i);
}

TEST(Acquisition, SettingsActFromTheNextExposure) {
  Bench bench(ixon_model());
  small_image(bench, 40000);
  bench.set("ChunkModeActive", true);
  bench.camera->execute("AcquisitionStart");
  ASSERT_TRUE(bench.sink.wait_frames(3));
  const std::uint64_t before = bench.camera->timestamp_ns();
  bench.set("ExposureTime", 25000.0);
  bench.set("Gain", 77.0);
  const std::uint64_t after = bench.camera->timestamp_ns();
  ASSERT_TRUE(bench.sink.wait_frames(bench.sink.frames().size() + 6));
  stop(bench);
  int old_frames = 0, new_frames = 0;
  std::uint64_t last = 0;
  for (const auto& frame : bench.sink.frames()) {
    const CameraSettings settings = bench.source->of(frame->id);
    if (frame->timestamp_ns < before) {
      EXPECT_EQ(settings.exposure_s, 0.04) << frame->id;
      EXPECT_EQ(settings.em_gain, 300) << frame->id;
      ++old_frames;
    } else if (frame->timestamp_ns > after) {
      EXPECT_EQ(settings.exposure_s, 0.025) << frame->id;
      EXPECT_EQ(settings.em_gain, 77) << frame->id;
      ++new_frames;
    }
    EXPECT_TRUE(frame->id == last || frame->id == last + 1);
    last = frame->id;
  }
  EXPECT_GE(old_frames, 3);
  EXPECT_GE(new_frames, 4);
}

TEST(Acquisition, SlowRenderingMakesFramesLateButSkipsNone) {
  Bench bench(ixon_model());
  small_image(bench, 5000);
  bench.source->delay = 20ms;
  bench.set("AcquisitionMode", "MultiFrame");
  bench.set("AcquisitionFrameCount", 12);
  bench.camera->execute("AcquisitionStart");
  ASSERT_TRUE(bench.sink.wait_stopped(1));
  const auto frames = bench.sink.frames();
  ASSERT_EQ(frames.size(), 12u);
  for (std::size_t i = 0; i < frames.size(); ++i) EXPECT_EQ(frames[i]->id, i);
  const auto statistics = bench.camera->statistics();
  EXPECT_EQ(statistics.late_frames, 12u);
  EXPECT_EQ(statistics.lost_frames, 0u);
  EXPECT_EQ(static_cast<std::uint64_t>(bench.integer("LateFrameCount")), 12u);
  // The schedule slipped: rendering sets the pace, no faster than one frame in 20 ms once the queue is full.
  EXPECT_GE(frames[11]->timestamp_ns - frames[5]->timestamp_ns, 6 * 19'000'000u);
}

TEST(Acquisition, SeveralThreadsRenderAheadInOrder) {
  CameraModel model = ixon_model();
  model.render_threads = 4;
  std::atomic<int> at_once = 0, most = 0;
  Bench bench(model);
  small_image(bench, 5000);
  bench.source->before = [&](std::uint64_t number) {
    const int now = ++at_once;
    int seen = most;
    while (seen < now && !most.compare_exchange_weak(seen, now)) {
    }
    std::this_thread::sleep_for(number % 3 == 0 ? 20ms : 5ms);
    --at_once;
  };
  bench.camera->execute("AcquisitionStart");
  ASSERT_TRUE(bench.sink.wait_frames(20));
  stop(bench);
  const auto frames = bench.sink.frames();
  for (std::size_t i = 0; i < frames.size(); ++i) EXPECT_EQ(frames[i]->id, i);
  EXPECT_GT(most, 1);
  EXPECT_LE(most, 4);
}

TEST(Acquisition, ControlNeverWaitsForRendering) {
  std::promise<void> release;
  const std::shared_future<void> released = release.get_future().share();
  std::promise<void> rendering;
  Bench bench(orca_model());
  bench.source->before = [&, first = true](std::uint64_t) mutable {
    if (first) rendering.set_value();
    first = false;
    released.wait();
  };
  bench.camera->execute("AcquisitionStart");
  rendering.get_future().wait();
  // Would hang here if any of these waited for the frame.
  for (const FeatureDeclaration& d : bench.camera->features()) {
    if (d.chunk_id != 0) continue;
    std::vector<std::uint8_t> bytes(static_cast<std::size_t>((d.length + 3) / 4 * 4));
    EXPECT_EQ(bench.camera->read(static_cast<std::uint32_t>(d.address), bytes), RegisterStatus::ok);
  }
  bench.set("ExposureTime", 20000.0);
  stop(bench);
  bench.set("Height", 4);
  release.set_value();
}

TEST(Trigger, SoftwareTriggersOneFrameEach) {
  Bench bench(ixon_model());
  small_image(bench, 5000);
  bench.set("TriggerMode", "On");
  bench.set("TriggerSource", "Software");
  bench.camera->execute("AcquisitionStart");
  for (std::size_t i = 0; i < 5; ++i) {
    ASSERT_EQ(bench.sink.frames().size(), i);
    const std::uint64_t before = bench.camera->timestamp_ns();
    bench.camera->execute("TriggerSoftware");
    const std::uint64_t after = bench.camera->timestamp_ns();
    ASSERT_TRUE(bench.sink.wait_frames(i + 1));
    const auto frame = bench.sink.frames()[i];
    EXPECT_EQ(frame->id, i);
    EXPECT_GE(frame->timestamp_ns, before);
    EXPECT_LE(frame->timestamp_ns, after);
  }
  EXPECT_EQ(bench.camera->statistics().missed_triggers, 0u);
  EXPECT_EQ(bench.sink.frames().size(), 5u);
}

TEST(Trigger, ThoseWhileTheCameraIsBusyAreMissedAndCounted) {
  Bench bench(ixon_model());
  small_image(bench, 300000);
  bench.set("TriggerMode", "On");
  bench.camera->execute("TriggerSoftware");  // not acquiring: nothing
  bench.camera->execute("AcquisitionStart");
  for (int i = 0; i < 5; ++i) bench.camera->execute("TriggerSoftware");
  ASSERT_TRUE(bench.sink.wait_frames(1));
  EXPECT_EQ(bench.integer("MissedTriggerCount"), 4);
  bench.camera->execute("TriggerSoftware");
  ASSERT_TRUE(bench.sink.wait_frames(2));
  EXPECT_EQ(bench.integer("MissedTriggerCount"), 4);
}

TEST(Trigger, OverlapAcceptsDuringReadout) {
  for (const bool overlap : {false, true}) {
    Bench bench(orca_model());
    bench.set("ScanMode", "UltraQuiet");  // readout of 199 ms
    bench.set("Width", 64);
    bench.set("ExposureTime", 150000.0);
    bench.set("TriggerMode", "On");
    bench.set("TriggerSource", "Line0");
    bench.set("TriggerOverlap", overlap ? "ReadOut" : "Off");
    bench.set("LineTriggerRate", 4.0);  // 250 ms: after the exposure, before the end of the readout
    bench.camera->execute("AcquisitionStart");
    ASSERT_TRUE(bench.sink.wait_frames(3));
    stop(bench);
    const auto frames = bench.sink.frames();
    const std::uint64_t interval = overlap ? 250'000'000 : 500'000'000;
    EXPECT_EQ(frames[1]->timestamp_ns - frames[0]->timestamp_ns, interval);
    EXPECT_EQ(frames[2]->timestamp_ns - frames[1]->timestamp_ns, interval);
    EXPECT_EQ(bench.camera->statistics().missed_triggers > 0, !overlap);
  }
}

TEST(Trigger, TheLineKeepsItsRateAndEdge) {
  Bench bench(ixon_model());
  small_image(bench, 10000);
  bench.set("TriggerMode", "On");
  bench.set("TriggerSource", "Line0");
  bench.set("LineTriggerRate", 25.0);
  EXPECT_EQ(bench.camera->settings().frame_interval_s, 1 / 25.0);
  std::uint64_t phase[2];
  for (const int falling : {0, 1}) {
    bench.set("TriggerActivation", falling ? "FallingEdge" : "RisingEdge");
    const std::size_t had = bench.sink.frames().size();
    bench.camera->execute("AcquisitionStart");
    ASSERT_TRUE(bench.sink.wait_frames(had + 6));
    stop(bench);
    ASSERT_TRUE(bench.sink.wait_stopped(falling + 1));
    const auto frames = bench.sink.frames();
    phase[falling] = frames[had]->timestamp_ns % 40'000'000;
    for (std::size_t i = had; i < frames.size(); ++i)
      EXPECT_EQ(frames[i]->timestamp_ns % 40'000'000, phase[falling]) << i;
  }
  EXPECT_EQ(phase[1] > phase[0] ? phase[1] - phase[0] : phase[0] - phase[1], 20'000'000u);
}

TEST(Trigger, TheDelayComesBetween) {
  Bench bench(ixon_model());
  small_image(bench, 5000);
  bench.set("TriggerMode", "On");
  bench.set("TriggerDelay", 50000.0);
  bench.camera->execute("AcquisitionStart");
  const std::uint64_t before = bench.camera->timestamp_ns();
  bench.camera->execute("TriggerSoftware");
  const std::uint64_t after = bench.camera->timestamp_ns();
  bench.set("Gain", 5.0);  // until the exposure begins, settings act on it
  ASSERT_TRUE(bench.sink.wait_frames(1));
  const std::uint64_t start = bench.sink.frames()[0]->timestamp_ns;
  EXPECT_GE(start, before + 50'000'000);
  EXPECT_LE(start, after + 50'000'000);
  EXPECT_EQ(bench.source->of(0).em_gain, 5);
}

TEST(Trigger, ActionsFireOnlyTheirOwnSource) {
  Bench bench(ixon_model());
  small_image(bench, 5000);
  bench.set("TriggerMode", "On");
  bench.set("TriggerSource", "Action1");
  bench.camera->execute("AcquisitionStart");
  bench.camera->fire_action(0);
  bench.camera->execute("TriggerSoftware");
  bench.camera->fire_action(1);
  ASSERT_TRUE(bench.sink.wait_frames(1));
  std::this_thread::sleep_for(50ms);
  EXPECT_EQ(bench.sink.frames().size(), 1u);
}

TEST(Status, TellsWhatTheCameraDoes) {
  Bench bench(ixon_model());
  small_image(bench, 400000);
  bench.set("TriggerMode", "On");
  const auto status = [&](const char* signal) {
    bench.set("AcquisitionStatusSelector", signal);
    return bench.on("AcquisitionStatus");
  };
  EXPECT_FALSE(status("AcquisitionActive"));
  EXPECT_FALSE(status("FrameTriggerWait"));
  bench.camera->execute("AcquisitionStart");
  EXPECT_TRUE(status("AcquisitionActive"));
  EXPECT_TRUE(status("FrameTriggerWait"));
  EXPECT_FALSE(status("ExposureActive"));
  bench.set("LineSelector", "Line1");
  EXPECT_FALSE(bench.on("LineStatus"));
  bench.camera->execute("TriggerSoftware");
  EXPECT_TRUE(status("ExposureActive"));
  EXPECT_TRUE(status("FrameActive"));
  EXPECT_FALSE(status("FrameTriggerWait"));
  EXPECT_TRUE(bench.on("LineStatus"));
  bench.set("LineInverter", true);
  EXPECT_FALSE(bench.on("LineStatus"));
  ASSERT_TRUE(bench.sink.wait_frames(1));
  EXPECT_FALSE(status("ExposureActive"));
  EXPECT_TRUE(status("FrameTriggerWait"));
}

TEST(Events, ExposureEndIsToldWhenAskedFor) {
  Bench bench(ixon_model());
  small_image(bench, 20000);
  bench.set("AcquisitionMode", "MultiFrame");
  bench.set("AcquisitionFrameCount", 3);
  bench.camera->execute("AcquisitionStart");
  ASSERT_TRUE(bench.sink.wait_stopped(1));
  EXPECT_TRUE(bench.sink.events().empty());
  EXPECT_EQ(bench.integer("EventExposureEndFrameID"), 2);
  bench.set("EventNotification", "On");
  bench.camera->execute("AcquisitionStart");
  ASSERT_TRUE(bench.sink.wait_stopped(2));
  const auto events = bench.sink.events();
  const auto frames = bench.sink.frames();
  ASSERT_EQ(events.size(), 3u);
  for (std::size_t i = 0; i < 3; ++i) {
    EXPECT_EQ(events[i].kind, CameraEvent::Kind::exposure_end);
    EXPECT_EQ(events[i].frame_id, 3 + i);
    EXPECT_EQ(events[i].timestamp_ns, frames[3 + i]->timestamp_ns + 20'000'000);
  }
}

TEST(Events, LostFramesAreToldAndCounted) {
  Bench bench(ixon_model());
  small_image(bench, 5000);
  bench.source->fail = [](std::uint64_t number) { return number == 2; };
  bench.set("EventSelector", "FrameLost");
  bench.set("EventNotification", "On");
  bench.set("AcquisitionMode", "MultiFrame");
  bench.set("AcquisitionFrameCount", 5);
  bench.camera->execute("AcquisitionStart");
  ASSERT_TRUE(bench.sink.wait_stopped(1));
  EXPECT_EQ(bench.sink.frames().size(), 4u);
  bench.camera->report_lost(3);
  ASSERT_TRUE(bench.sink.wait_events(2));
  EXPECT_EQ(bench.sink.events()[0].frame_id, 2u);
  EXPECT_EQ(bench.sink.events()[1].frame_id, 3u);
  EXPECT_EQ(bench.integer("LostFrameCount"), 2);
  EXPECT_EQ(bench.integer("EventFrameLostFrameID"), 3);
}

TEST(Clock, LatchAndReset) {
  Bench bench(ixon_model());
  const auto before = static_cast<std::int64_t>(bench.camera->timestamp_ns());
  bench.camera->execute("TimestampLatch");
  const std::int64_t latched = bench.integer("TimestampLatchValue");
  EXPECT_GE(latched, before);
  EXPECT_EQ(bench.integer("TimestampLatchValue"), latched);
  std::this_thread::sleep_for(20ms);
  const std::uint64_t late = bench.camera->timestamp_ns();
  bench.camera->execute("TimestampReset");
  EXPECT_LT(bench.camera->timestamp_ns(), late);
}

TEST(Chunks, TellTheFrame) {
  Bench bench(ixon_model());
  small_image(bench, 5000);
  bench.set("Gain", 42.0);
  bench.set("ChunkModeActive", true);
  bench.camera->execute("AcquisitionStart");
  ASSERT_TRUE(bench.sink.wait_frames(3));
  stop(bench);
  const auto frame = bench.sink.frames()[2];
  EXPECT_TRUE(frame->chunks);
  // Behind the image and its tail: number, timestamp, exposure, gain, seed, truth, each with id and length.
  const std::uint8_t* data = frame->payload.data() + frame->image_bytes + 8;
  EXPECT_EQ(load_big_endian<std::int64_t>(data), 2);
  EXPECT_EQ(load_big_endian<std::uint64_t>(data + 16), frame->timestamp_ns);
  EXPECT_EQ(load_big_endian<double>(data + 32), 5000);
  EXPECT_EQ(load_big_endian<double>(data + 48), 42);
  EXPECT_EQ(load_big_endian<std::uint64_t>(data + 64), bench.source->seed());
  EXPECT_STREQ(reinterpret_cast<const char*>(data + 80), "{\"frame\":2}");
}

TEST(Sink, NothingIsDeliveredAfterDetaching) {
  Bench bench(ixon_model());
  small_image(bench, 5000);
  bench.camera->execute("AcquisitionStart");
  ASSERT_TRUE(bench.sink.wait_frames(2));
  bench.camera->attach(nullptr);
  const std::size_t had = bench.sink.frames().size();
  std::this_thread::sleep_for(50ms);
  EXPECT_EQ(bench.sink.frames().size(), had);
  RecordingSink other;
  bench.camera->attach(&other);
  EXPECT_TRUE(other.wait_frames(2));
  bench.camera->attach(nullptr);
}

// Control from one thread, triggers from another, frames in between; for the thread sanitizer.
TEST(Threads, EverythingAtOnce) {
  CameraModel model = ixon_model();
  model.render_threads = 2;
  Bench bench(model);
  small_image(bench, 5000);
  std::atomic<bool> done = false;
  std::thread control([&] {
    for (int i = 0; i < 60; ++i) {
      bench.set("Gain", 1.0 + i);
      bench.set("ExposureTime", 5000.0 + i);
      bench.camera->settings();
      bench.camera->statistics();
      std::this_thread::sleep_for(2ms);
    }
    done = true;
  });
  std::thread transport([&] {
    while (!done) {
      bench.camera->report_lost(0);
      bench.camera->fire_action(0);
      bench.camera->identity();
      std::this_thread::sleep_for(1ms);
    }
  });
  while (!done) {
    bench.camera->execute("AcquisitionStart");
    std::this_thread::sleep_for(15ms);
    bench.camera->stop_acquisition();
    std::this_thread::sleep_for(1ms);
  }
  control.join();
  transport.join();
  std::uint64_t last = 0;
  for (const auto& frame : bench.sink.frames()) {
    EXPECT_GE(frame->id, last);
    last = frame->id;
  }
}

}  // namespace
}  // namespace atomcam::test
