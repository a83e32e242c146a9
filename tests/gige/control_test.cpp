// Every command and every status of the control protocol, over sockets, as a client sees them.

#include <gtest/gtest.h>

#include <thread>

#include "base/error.hpp"
#include "gige/addresses.hpp"
#include "gige/bootstrap.hpp"
#include "gige/client.hpp"
#include "gige/device.hpp"
#include "gige/fake_camera.hpp"

namespace atomcam {
namespace {

using namespace std::chrono_literals;
using gige::Device;
using gige::DeviceOptions;
using test::Answer;
using test::Command;
using test::FakeCamera;
using test::Status;
using test::words;
namespace reg = gige::reg;

class Control : public ::testing::Test {
 protected:
  Control() : device_(camera_, options()), client_(endpoint()), other_(endpoint()) {}

  static DeviceOptions options() { return {.address = test::own_address(1), .port = 0, .discovery = false}; }
  gige::Endpoint endpoint() const { return {gige::parse_address("test", device_.address()), device_.port()}; }
  void take_control(test::TestClient& client, std::uint32_t value = 2) {
    ASSERT_EQ(client.write(reg::control, value), Status::success);
  }
  std::string text(std::uint32_t address, std::uint32_t bytes) {
    const auto answer = client_.ask(Command::read_memory, words({address, bytes}));
    if (!answer || answer->status != Status::success) return "?";
    const std::string raw(answer->payload.begin() + 4, answer->payload.end());
    EXPECT_EQ(raw.size(), bytes);
    return raw.substr(0, raw.find('\0'));
  }
  void wait_for_release() {
    for (int i = 0; i < 200 && device_.statistics().client; ++i) std::this_thread::sleep_for(10ms);
  }

  FakeCamera camera_;
  Device device_;
  test::TestClient client_, other_;
};

TEST_F(Control, DiscoveryTellsWhoTheDeviceIs) {
  const auto answer = client_.ask(Command::discovery, {});
  ASSERT_TRUE(answer);
  EXPECT_EQ(answer->status, Status::success);
  EXPECT_EQ(answer->command, 0x0003);
  ASSERT_EQ(answer->payload.size(), 248u);
  EXPECT_EQ(answer->word(0), 0x00020000u);
  EXPECT_EQ(answer->word(reg::current_ip / 4), gige::parse_address("test", device_.address()));
  EXPECT_EQ(answer->word(reg::subnet_mask / 4), 0xff000000u);
  EXPECT_STREQ(reinterpret_cast<const char*>(answer->payload.data() + reg::model), "Fake 1");
  EXPECT_STREQ(reinterpret_cast<const char*>(answer->payload.data() + reg::user_name), "fake");
  // A locally administered address.
  EXPECT_EQ(answer->word(reg::mac_high / 4) >> 8, 0x02u);
}

TEST_F(Control, RegistersAreReadManyAtATime) {
  std::vector<std::uint8_t> addresses;
  for (int i = 0; i < 135; ++i)
    gige::append32(addresses, i % 2 == 0 ? reg::heartbeat_timeout : FakeCamera::fixed);
  const auto answer = client_.ask(Command::read_register, addresses);
  ASSERT_TRUE(answer);
  EXPECT_EQ(answer->status, Status::success);
  ASSERT_EQ(answer->payload.size(), 540u);
  for (std::size_t i = 0; i < 135; ++i) EXPECT_EQ(answer->word(i), i % 2 == 0 ? 3000u : 42u);
  gige::append32(addresses, reg::version);
  EXPECT_EQ(client_.ask(Command::read_register, addresses)->status, Status::invalid_header);
}

TEST_F(Control, AFailedReadTellsWhatCameBefore) {
  const auto answer = client_.ask(Command::read_register, words({reg::version, 0x2000, reg::version}));
  ASSERT_TRUE(answer);
  EXPECT_EQ(answer->status, Status::invalid_address);
  ASSERT_EQ(answer->payload.size(), 4u);
  EXPECT_EQ(answer->word(), 0x00020000u);
}

TEST_F(Control, EveryStatusOfReading) {
  EXPECT_EQ(client_.read_status(reg::version + 1), Status::bad_alignment);
  EXPECT_EQ(client_.read_status(0x0018), Status::invalid_address);
  EXPECT_EQ(client_.read_status(0x20000), Status::invalid_address);
  EXPECT_EQ(client_.read_status(0xfffffffc), Status::invalid_address);
  EXPECT_EQ(client_.read_status(reg::switchover_key), Status::access_denied);
  const auto memory = [&](std::uint32_t address, std::uint32_t count) {
    return client_.ask(Command::read_memory, words({address, count}))->status;
  };
  EXPECT_EQ(memory(0, 248), Status::success);
  EXPECT_EQ(memory(2, 4), Status::bad_alignment);
  EXPECT_EQ(memory(0, 6), Status::bad_alignment);
  EXPECT_EQ(memory(0, 540), Status::invalid_parameter);
  EXPECT_EQ(memory(0, 0), Status::invalid_parameter);
  EXPECT_EQ(memory(0x3000, 16), Status::invalid_address);
  EXPECT_EQ(memory(0xfffc, 8), Status::invalid_address);
  EXPECT_EQ(memory(0x7fff0000, 512), Status::invalid_address);
  EXPECT_EQ(memory(0xfffffffc, 536), Status::invalid_address);
  EXPECT_EQ(client_.ask(Command::read_memory, words({0}))->status, Status::invalid_header);
}

TEST_F(Control, EveryStatusOfWriting) {
  EXPECT_EQ(client_.write(reg::heartbeat_timeout, 1000), Status::access_denied);
  EXPECT_EQ(client_.write(FakeCamera::plain, 1), Status::access_denied);
  take_control(client_);
  EXPECT_EQ(client_.write(reg::heartbeat_timeout, 1000), Status::success);
  EXPECT_EQ(client_.write(reg::heartbeat_timeout, 499), Status::invalid_parameter);
  EXPECT_EQ(client_.read(reg::heartbeat_timeout), 1000u);
  EXPECT_EQ(client_.write(reg::version, 1), Status::write_protect);
  EXPECT_EQ(client_.write(0x0018, 1), Status::invalid_address);
  EXPECT_EQ(client_.write(reg::heartbeat_timeout + 2, 1000), Status::bad_alignment);
  EXPECT_EQ(client_.write(FakeCamera::plain, 1000), Status::success);
  EXPECT_EQ(client_.read(FakeCamera::plain), 1000u);
  EXPECT_EQ(client_.write(FakeCamera::plain, 1001), Status::invalid_parameter);
  EXPECT_EQ(client_.write(FakeCamera::fixed, 1), Status::write_protect);
  EXPECT_EQ(client_.write(FakeCamera::locked, 1), Status::access_denied);
  EXPECT_EQ(client_.write(0x20000, 1), Status::invalid_address);
  EXPECT_EQ(client_.write(0x100000, 1), Status::write_protect);
  EXPECT_EQ(client_.write(0xfffffffc, 1), Status::invalid_address);
  // What is not served is refused: multi-part frames, big-endian pixels read back as not set.
  EXPECT_EQ(client_.write(reg::stream_configuration, 0x40), Status::invalid_parameter);
  EXPECT_EQ(client_.write(reg::stream_packet_size, 1u << 29 | 1500), Status::success);
  EXPECT_EQ(client_.read(reg::stream_packet_size), 1500u);
  EXPECT_EQ(client_.write(reg::stream_packet_size, 20), Status::invalid_parameter);
  EXPECT_EQ(client_.write(reg::stream_packet_size, 65532), Status::invalid_parameter);
  EXPECT_EQ(client_.write(reg::stream_packet_size, 1502), Status::success);
  EXPECT_EQ(client_.read(reg::stream_packet_size), 1500u);
  EXPECT_EQ(client_.write(reg::stream_address, 0xffffffff), Status::invalid_parameter);
  EXPECT_EQ(client_.write(reg::stream_address, 0x08080808), Status::invalid_parameter);
  EXPECT_EQ(client_.write(reg::stream_port, 1u << 16 | 5000), Status::invalid_parameter);
  EXPECT_EQ(client_.write(reg::fault_loss, 1'000'001), Status::invalid_parameter);
}

TEST_F(Control, SeveralRegistersAreWrittenUntilOneFails) {
  take_control(client_);
  auto answer = client_.ask(Command::write_register,
                            words({FakeCamera::plain, 5, reg::heartbeat_timeout, 900, FakeCamera::slow, 6}));
  ASSERT_TRUE(answer);
  EXPECT_EQ(answer->status, Status::success);
  EXPECT_EQ(answer->index(), 3);
  EXPECT_EQ(client_.read(FakeCamera::plain), 5u);
  EXPECT_EQ(client_.read(FakeCamera::slow), 6u);
  answer = client_.ask(Command::write_register,
                       words({FakeCamera::plain, 7, FakeCamera::fixed, 1, reg::heartbeat_timeout, 800}));
  ASSERT_TRUE(answer);
  EXPECT_EQ(answer->status, Status::write_protect);
  EXPECT_EQ(answer->index(), 1);
  EXPECT_EQ(client_.read(FakeCamera::plain), 7u);
  EXPECT_EQ(client_.read(reg::heartbeat_timeout), 900u);
}

TEST_F(Control, MemoryIsWritten) {
  take_control(client_);
  std::vector<std::uint8_t> name = words({reg::user_name});
  const std::string wanted = "lab 7";
  name.insert(name.end(), wanted.begin(), wanted.end());
  name.resize(20);
  auto answer = client_.ask(Command::write_memory, name);
  ASSERT_TRUE(answer);
  EXPECT_EQ(answer->status, Status::success);
  EXPECT_EQ(answer->index(), 16);
  EXPECT_EQ(text(reg::user_name, 16), "lab 7");
  EXPECT_EQ(camera_.identity().user_name, "lab 7");
  EXPECT_EQ(client_.ask(Command::write_memory, words({FakeCamera::plain, 9}))->status, Status::success);
  EXPECT_EQ(client_.read(FakeCamera::plain), 9u);
  answer = client_.ask(Command::write_memory, words({reg::persistent_gateway, 1, 2}));
  EXPECT_EQ(answer->status, Status::write_protect);  // the link's speed follows
  EXPECT_EQ(answer->index(), 4);
  EXPECT_EQ(client_.read(reg::persistent_gateway), 1u);
  EXPECT_EQ(client_.ask(Command::write_memory, words({reg::user_name}))->status, Status::invalid_parameter);
  std::vector<std::uint8_t> odd = words({reg::user_name, 0});
  odd.pop_back();
  EXPECT_EQ(client_.ask(Command::write_memory, odd)->status, Status::bad_alignment);
}

TEST_F(Control, HeadersAreChecked) {
  const gige::Endpoint to = endpoint();
  const auto none = [&](std::vector<std::uint8_t> bytes) {
    client_.socket.send(bytes, to);
    return !client_.answer(60);
  };
  EXPECT_TRUE(none({}));
  EXPECT_TRUE(none({0x42, 1, 0, 0x80}));
  EXPECT_TRUE(none(std::vector<std::uint8_t>(64, 0)));
  auto bytes = test::command_bytes(0x0080, words({0}), 9);
  EXPECT_TRUE(none([&] {
    auto b = bytes;
    b[0] = 0x43;
    return b;
  }()));
  EXPECT_TRUE(none(test::command_bytes(0x0080, words({0}), 9, 0)));  // no answer wanted
  EXPECT_TRUE(none(test::command_bytes(0x0081, words({0}), 9)));     // an answer to nothing
  const auto status = [&](const std::vector<std::uint8_t>& datagram) {
    client_.socket.send(datagram, to);
    const auto answer = client_.answer();
    return answer ? answer->status : static_cast<Status>(0xffff);
  };
  EXPECT_EQ(status(bytes), Status::success);
  EXPECT_EQ(status(test::command_bytes(0x0080, words({0}), 0)), Status::invalid_header);
  bytes[5] += 4;
  EXPECT_EQ(status(bytes), Status::invalid_header);
  EXPECT_EQ(status(test::command_bytes(0x0080, {}, 9)), Status::invalid_header);
  EXPECT_EQ(status(test::command_bytes(0x7ffe, {}, 9)), Status::not_implemented);
  EXPECT_EQ(status(test::command_bytes(0x00c0, {}, 9)), Status::not_implemented);
  // Longer than any command.
  EXPECT_EQ(status(test::command_bytes(0x0080, std::vector<std::uint8_t>(60'000), 9)),
            Status::invalid_header);
}

TEST_F(Control, TheDescriptionLiesInTheDevice) {
  const std::string url = text(reg::first_url, 512);
  EXPECT_EQ(url.substr(0, 21), "Local:atomcam-fake-1.");
  unsigned address = 0, size = 0;
  ASSERT_EQ(std::sscanf(url.c_str(), "Local:atomcam-fake-1.xml;%x;%x", &address, &size), 2) << url;
  EXPECT_EQ(address, 0x100000u);
  std::string xml;
  for (unsigned at = 0; at < size; at += 512) {
    const std::uint32_t count = std::min(512u, (size - at + 3) / 4 * 4);
    const auto answer = client_.ask(Command::read_memory, words({address + at, count}));
    ASSERT_EQ(answer->status, Status::success);
    xml.append(answer->payload.begin() + 4, answer->payload.end());
  }
  EXPECT_EQ(xml.substr(0, 6), "<fake>");
  EXPECT_EQ(xml.substr(0, size).substr(size - 7), "</fake>");
  EXPECT_EQ(client_.read_status(address + (size + 3) / 4 * 4), Status::invalid_address);
  EXPECT_EQ(text(reg::second_url, 512), "");
}

TEST_F(Control, OneClientControls) {
  take_control(client_);
  EXPECT_EQ(client_.read(reg::controller_port), client_.socket.local().port);
  EXPECT_EQ(client_.read(reg::controller_ip), 0x7f000001u);
  EXPECT_EQ(other_.write(reg::control, 2), Status::access_denied);
  EXPECT_EQ(other_.write(reg::control, 0), Status::access_denied);
  EXPECT_EQ(other_.write(FakeCamera::plain, 3), Status::access_denied);
  EXPECT_EQ(other_.read(FakeCamera::plain), 7u);
  EXPECT_EQ(client_.write(reg::control, 0), Status::success);
  EXPECT_EQ(other_.write(reg::control, 2), Status::success);
  EXPECT_EQ(client_.write(FakeCamera::plain, 3), Status::access_denied);
}

TEST_F(Control, ExclusiveControlHidesTheDevice) {
  take_control(client_, 1);
  EXPECT_EQ(other_.read_status(FakeCamera::plain), Status::access_denied);
  EXPECT_EQ(other_.ask(Command::read_memory, words({reg::control, 512}))->status, Status::access_denied);
  EXPECT_EQ(other_.read(reg::control), 1u);
  EXPECT_EQ(other_.ask(Command::discovery, {})->status, Status::success);
  EXPECT_EQ(client_.read(FakeCamera::plain), 7u);
  EXPECT_EQ(other_.write(reg::control, 1), Status::access_denied);
}

TEST_F(Control, SwitchoverNeedsTheKey) {
  take_control(client_, 2 | 4);
  EXPECT_EQ(client_.write(reg::switchover_key, 0xbeef), Status::success);
  EXPECT_EQ(other_.write(reg::control, 0xdeadu << 16 | 2), Status::access_denied);
  EXPECT_EQ(other_.write(reg::control, 0xbeefu << 16 | 2), Status::success);
  EXPECT_EQ(other_.read(reg::control), 2u);
  EXPECT_EQ(client_.write(FakeCamera::plain, 1), Status::access_denied);
  EXPECT_EQ(other_.write(FakeCamera::plain, 1), Status::success);
  EXPECT_EQ(client_.write(reg::control, 0xbeefu << 16 | 2), Status::access_denied);  // not offered again
}

TEST_F(Control, ASilentClientLosesControl) {
  take_control(client_);
  ASSERT_EQ(client_.write(reg::heartbeat_timeout, 500), Status::success);
  ASSERT_EQ(client_.write(reg::stream_address, 0x7f000001), Status::success);
  ASSERT_EQ(client_.write(reg::stream_port, 40000), Status::success);
  ASSERT_EQ(client_.write(FakeCamera::acquisition, 1), Status::success);
  // Any command keeps it alive.
  for (int i = 0; i < 8; ++i) {
    std::this_thread::sleep_for(100ms);
    client_.send(Command::discovery, {}, 0);
  }
  ASSERT_TRUE(device_.statistics().client);
  const auto start = std::chrono::steady_clock::now();
  wait_for_release();
  const auto silence = std::chrono::steady_clock::now() - start;
  EXPECT_FALSE(device_.statistics().client);
  EXPECT_GT(silence, 300ms);
  EXPECT_LT(silence, 800ms);
  for (int i = 0; i < 100 && camera_.acquiring; ++i) std::this_thread::sleep_for(5ms);
  EXPECT_FALSE(camera_.acquiring);
  EXPECT_FALSE(device_.statistics().destination);
  EXPECT_EQ(other_.read(reg::stream_port), 0u);
  take_control(other_);
}

TEST_F(Control, TheHeartbeatCanBeDisabled) {
  take_control(client_);
  ASSERT_EQ(client_.write(reg::heartbeat_timeout, 500), Status::success);
  ASSERT_EQ(client_.write(reg::gvcp_configuration, gige::bit::heartbeat_disable), Status::success);
  std::this_thread::sleep_for(800ms);
  EXPECT_TRUE(device_.statistics().client);
  EXPECT_EQ(client_.write(reg::gvcp_configuration, 1u << 7), Status::invalid_parameter);
}

TEST_F(Control, ASlowCommandIsAnnouncedAndHoldsNobodyUp) {
  take_control(client_);
  ASSERT_EQ(client_.write(reg::gvcp_configuration, gige::bit::pending_ack), Status::success);
  camera_.write_time = 300ms;
  client_.send(Command::write_register, words({FakeCamera::slow, 8}));
  const auto start = std::chrono::steady_clock::now();
  EXPECT_EQ(other_.ask(Command::discovery, {})->status, Status::success);
  EXPECT_EQ(other_.read(reg::control), 2u);
  EXPECT_LT(std::chrono::steady_clock::now() - start, 100ms);
  auto answer = client_.answer();
  ASSERT_TRUE(answer);
  EXPECT_EQ(answer->command, 0x0089);
  EXPECT_GE(gige::load16(answer->payload, 2), 300);
  const std::uint16_t id = answer->id;
  answer = client_.answer();
  ASSERT_TRUE(answer);
  EXPECT_EQ(answer->command, 0x0083);
  EXPECT_EQ(answer->id, id);
  EXPECT_EQ(answer->status, Status::success);
  EXPECT_EQ(client_.read(FakeCamera::slow), 8u);
}

TEST_F(Control, ARepeatedWriteIsDoneOnce) {
  take_control(client_);
  const auto bytes = test::command_bytes(0x0082, words({FakeCamera::slow, 8}), 77);
  const int before = camera_.writes;
  client_.socket.send(bytes, endpoint());
  client_.socket.send(bytes, endpoint());  // while it is under way
  const auto first = client_.answer();
  ASSERT_TRUE(first);
  EXPECT_FALSE(client_.answer(50));
  client_.socket.send(bytes, endpoint());  // its answer was lost
  const auto second = client_.answer();
  ASSERT_TRUE(second);
  EXPECT_EQ(second->id, 77);
  EXPECT_EQ(second->status, Status::success);
  EXPECT_EQ(camera_.writes, before + 1);
}

TEST_F(Control, TooManyCommandsAtOnceAreTurnedAway) {
  take_control(client_);
  client_.send(Command::write_register, words({FakeCamera::slow, 1}));
  for (int i = 0; i < 20; ++i) client_.send(Command::read_register, words({FakeCamera::plain}));
  int busy = 0, answered = 0;
  while (const auto answer = client_.answer(300)) {
    ++answered;
    if (answer->status == Status::busy) ++busy;
  }
  EXPECT_EQ(answered, 21);
  EXPECT_EQ(busy, 4);  // sixteen wait
}

TEST_F(Control, ForceIp) {
  const auto mac_high = client_.read(reg::mac_high), mac_low = client_.read(reg::mac_low);
  const auto ask = [&](std::uint32_t low, std::uint32_t address) {
    std::vector<std::uint8_t> payload(56);
    gige::store16(payload.data() + 2, *mac_high);
    gige::store32(payload.data() + 4, low);
    gige::store32(payload.data() + 20, address);
    client_.send(Command::force_ip, payload);
    return client_.answer(100);
  };
  EXPECT_FALSE(ask(*mac_low + 1, 0));  // another device's
  EXPECT_EQ(ask(*mac_low, 0)->status, Status::success);
  EXPECT_EQ(ask(*mac_low, gige::parse_address("test", device_.address()))->status, Status::success);
  EXPECT_EQ(ask(*mac_low, 0x7f010203)->status, Status::invalid_parameter);
  EXPECT_EQ(client_.ask(Command::force_ip, words({1, 2}))->status, Status::invalid_header);
  take_control(other_);
  EXPECT_EQ(ask(*mac_low, 0)->status, Status::access_denied);
}

TEST_F(Control, Timestamp) {
  take_control(client_);
  EXPECT_EQ(client_.read(reg::tick_frequency_low), 1'000'000'000u);
  const auto latched = [&] {
    EXPECT_EQ(client_.write(reg::timestamp_control, 2), Status::success);
    const auto answer = client_.ask(Command::read_register, words({reg::timestamp_high, reg::timestamp_low}));
    return std::uint64_t{answer->word(0)} << 32 | answer->word(1);
  };
  const std::uint64_t first = latched();
  std::this_thread::sleep_for(20ms);
  const std::uint64_t second = latched();
  EXPECT_GE(second - first, 20'000'000u);
  EXPECT_EQ(client_.write(reg::timestamp_control, 1), Status::success);
  EXPECT_LT(latched(), second);
}

TEST_F(Control, Actions) {
  const auto act = [&](std::uint32_t device, std::uint32_t group, std::uint32_t mask) {
    other_.send(Command::action, words({device, group, mask}));
    return other_.answer(60);
  };
  take_control(client_);
  ASSERT_EQ(client_.write(reg::action_device_key, 0x1234), Status::success);
  ASSERT_EQ(client_.write(reg::action_group_key, 5), Status::success);
  ASSERT_EQ(client_.write(reg::action_group_mask, 0b0011), Status::success);
  ASSERT_EQ(client_.write(reg::action_group_key + 16, 6), Status::success);
  ASSERT_EQ(client_.write(reg::action_group_mask + 16, 0b0100), Status::success);
  EXPECT_FALSE(act(0x1235, 5, 1));
  EXPECT_FALSE(act(0x1234, 4, 1));
  EXPECT_FALSE(act(0x1234, 5, 0b1100));
  EXPECT_TRUE(camera_.actions().empty());
  EXPECT_EQ(act(0x1234, 5, 0b0010)->status, Status::success);
  EXPECT_EQ(act(0x1234, 6, 0b0100)->status, Status::success);
  EXPECT_EQ(camera_.actions(), (std::vector<int>{0, 1}));
  // Without a client in control only where that is allowed.
  ASSERT_EQ(client_.write(reg::control, 0), Status::success);
  EXPECT_FALSE(act(0x1234, 5, 1));
  take_control(client_);
  ASSERT_EQ(client_.write(reg::gvcp_configuration, gige::bit::unconditional_action), Status::success);
  ASSERT_EQ(client_.write(reg::control, 0), Status::success);
  EXPECT_EQ(act(0x1234, 5, 1)->status, Status::success);
  EXPECT_EQ(camera_.actions().size(), 3u);
  // There is no common clock to schedule on.
  other_.send(Command::action, words({0x1234, 5, 1, 0, 0}), 0x81);
  EXPECT_EQ(other_.answer()->status, Status::not_implemented);
  EXPECT_EQ(camera_.actions().size(), 3u);
}

TEST_F(Control, EventsGoOutUntilAcknowledged) {
  take_control(client_);
  test::TestSocket messages;
  ASSERT_EQ(client_.write(reg::message_address, 0x7f000001), Status::success);
  ASSERT_EQ(client_.write(reg::message_timeout, 100), Status::success);
  ASSERT_EQ(client_.write(reg::message_retries, 2), Status::success);
  ASSERT_EQ(client_.write(reg::message_port, messages.local().port), Status::success);
  camera_.notify({CameraEvent::Kind::exposure_end, 5, 123456789012});
  camera_.notify({CameraEvent::Kind::frame_lost, 6, 99});
  std::optional<std::uint16_t> first_id;
  for (int i = 0; i < 3; ++i) {  // sent once, and twice again
    const auto event = messages.receive(1000);
    ASSERT_TRUE(event);
    ASSERT_EQ(event->size(), 24u);
    EXPECT_EQ((*event)[1], 1);
    EXPECT_EQ(gige::load16(*event, 2), 0x00c0);
    EXPECT_EQ(gige::load16(*event, 10), 0x9001);
    EXPECT_EQ(gige::load64(*event, 16), 123456789012u);
    if (!first_id) first_id = gige::load16(*event, 6);
    EXPECT_EQ(gige::load16(*event, 6), *first_id);
    EXPECT_EQ(messages.from.port, client_.read(reg::message_source_port));
  }
  const auto next = messages.receive(1000);
  ASSERT_TRUE(next);
  EXPECT_EQ(gige::load16(*next, 10), 0x9002);
  std::vector<std::uint8_t> acknowledge = words({0x00000000u | 0x00c1u, gige::load16(*next, 6)});
  messages.send(acknowledge, messages.from);
  EXPECT_FALSE(messages.receive(300));
  // Wide ids, no acknowledge wanted.
  ASSERT_EQ(client_.write(reg::message_timeout, 0), Status::success);
  ASSERT_EQ(client_.write(reg::gvsp_configuration, gige::bit::extended_ids), Status::success);
  camera_.notify({CameraEvent::Kind::frame_lost, 7, 100});
  const auto wide = messages.receive(1000);
  ASSERT_TRUE(wide);
  ASSERT_EQ(wide->size(), 32u);
  EXPECT_EQ((*wide)[1], 0x10);
  EXPECT_EQ(gige::load64(*wide, 24), 100u);
  EXPECT_FALSE(messages.receive(200));
}

TEST_F(Control, ASwitchoverIsToldToTheClientBefore) {
  take_control(client_, 2 | 4);
  test::TestSocket messages;
  ASSERT_EQ(client_.write(reg::switchover_key, 7), Status::success);
  ASSERT_EQ(client_.write(reg::message_address, 0x7f000001), Status::success);
  ASSERT_EQ(client_.write(reg::message_port, messages.local().port), Status::success);
  ASSERT_EQ(other_.write(reg::control, 7u << 16 | 2), Status::success);
  const auto event = messages.receive(1000);
  ASSERT_TRUE(event);
  EXPECT_EQ(gige::load16(*event, 10), 0x0007);
}

TEST_F(Control, CapabilitiesAreWhatIsThere) {
  const std::uint32_t capability = client_.read(reg::gvcp_capability).value_or(0);
  for (const int there : {0, 1, 2, 3, 5, 6, 20, 21, 22, 27, 28, 29, 30, 31})
    EXPECT_TRUE(capability >> there & 1) << there;
  for (const int missing : {4, 16, 17, 19, 23, 24, 25, 26})
    EXPECT_FALSE(capability >> missing & 1) << missing;
  EXPECT_EQ(client_.read(reg::stream_channels), 1u);
  EXPECT_EQ(client_.read(reg::message_channels), 1u);
  EXPECT_EQ(client_.read(reg::link_speed), 10000u);
}

TEST(Device, ATakenPortIsOneClearError) {
  FakeCamera camera, other;
  const DeviceOptions options{.address = test::own_address(2), .port = 0, .discovery = false};
  const Device device(camera, options);
  DeviceOptions same = options;
  same.port = device.port();
  try {
    const Device second(other, same);
    FAIL() << "listens on a taken port";
  } catch (const Error& error) {
    EXPECT_EQ(error.place(), device.address() + ":" + std::to_string(device.port()));
    EXPECT_EQ(std::string(error.what()).find('\n'), std::string::npos);
  }
}

TEST(Device, BadOptionsAreNamed) {
  FakeCamera camera;
  const auto place = [&](const DeviceOptions& options) {
    try {
      const Device device(camera, options);
    } catch (const Error& error) {
      return error.place();
    }
    return std::string();
  };
  EXPECT_EQ(place({.address = "localhost", .port = 0}), "address");
  EXPECT_EQ(place({.address = "192.0.2.77", .port = 0}), "192.0.2.77");
  EXPECT_EQ(place({.address = "0.0.0.0", .port = 0}), "0.0.0.0");
  EXPECT_EQ(place({.address = test::own_address(3), .port = 0, .packet_bytes = 100}), "packet_bytes");
  EXPECT_EQ(place({.address = test::own_address(3), .port = 0, .xml_file = "/nowhere/x.xml"}),
            "/nowhere/x.xml");
}

TEST(Device, BroadcastsFindAllDevicesOfTheSubnet) {
  FakeCamera one, other;
  const Device first(one, {.address = test::own_address(4), .port = 0});
  const Device second(other, {.address = test::own_address(5), .port = first.port()});
  for (const std::uint32_t everybody : {0xffffffffu, 0x7fffffffu}) {
    test::TestClient client({everybody, first.port()});
    client.send(Command::discovery, {}, 0x11);
    std::set<std::uint32_t> found;
    while (const auto answer = client.answer(200)) {
      EXPECT_EQ(answer->status, Status::success);
      found.insert(answer->word(reg::current_ip / 4));
      EXPECT_EQ(client.socket.from.port, first.port());
    }
    EXPECT_EQ(found, (std::set<std::uint32_t>{gige::parse_address("", first.address()),
                                              gige::parse_address("", second.address())}));
    // Commands that change or tell more are for one device.
    client.send(Command::read_register, words({0}));
    EXPECT_FALSE(client.answer(60));
  }
}

TEST(Device, AnotherDescriptionCanBeServed) {
  const std::string path =
      ::testing::TempDir() + "atomcam_description_" + std::to_string(::getpid()) + ".xml";
  {
    std::FILE* file = std::fopen(path.c_str(), "w");
    std::fputs("<other/>", file);
    std::fclose(file);
  }
  FakeCamera camera;
  const Device device(camera,
                      {.address = test::own_address(6), .port = 0, .discovery = false, .xml_file = path});
  std::remove(path.c_str());
  test::TestClient client({gige::parse_address("", device.address()), device.port()});
  const auto answer = client.ask(Command::read_memory, words({0x100000, 8}));
  ASSERT_TRUE(answer);
  EXPECT_EQ(std::string(answer->payload.begin() + 4, answer->payload.end()), "<other/>");
}

}  // namespace
}  // namespace atomcam
