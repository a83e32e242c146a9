#pragma once
// A client of any GenICam camera, on Aravis.

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "atomcam/stack_settings.hpp"
#include "base/image.hpp"

namespace atomcam {

struct FoundCamera {
  std::string id, address, protocol;
};
/// Cameras that answer discovery.
std::vector<FoundCamera> find_cameras();

struct GrabbedFrame {
  std::uint64_t id = 0;
  CountImage counts;  // as sent: Mono12 gives 0 to 4095
  std::string truth;  // JSON; empty if the camera tells none
};

/// What became of the frames since the stream began, as the receiver counts them.
struct StreamReport {
  std::uint64_t completed = 0, failed = 0, underrun = 0;
  std::uint64_t skipped = 0;  // frame numbers that never came
  std::uint64_t missing_packets = 0, resend_requests = 0, resent_packets = 0;
};

class AravisClient {
 public:
  /// `name`: an address or an id. Throws Error if nobody answers there.
  explicit AravisClient(const std::string& name);
  ~AravisClient();
  AravisClient(const AravisClient&) = delete;
  AravisClient& operator=(const AravisClient&) = delete;

  /// Sets any feature from text; a command is executed. Throws Error.
  void set(const std::string& feature, const std::string& value);
  StackSettings settings();
  std::string model();

  /// Streams until `take` returns false or `stop` returns true. Throws Failure if no frame comes for
  /// `timeout_s`.
  StreamReport grab(double timeout_s, const std::function<bool(const GrabbedFrame&)>& take,
                    const std::function<bool()>& stop);

 private:
  struct Body;
  std::unique_ptr<Body> body_;
};

}  // namespace atomcam
