// Charge that the model cannot have put there: cosmic rays, tracks, pixels that fire again and again.

#include <algorithm>
#include <cmath>

#include "analysis/family.hpp"
#include "analysis/lanes.hpp"

namespace atomcam::analysis {
namespace {

struct Events {
  enum { pixels, single, two_to_three, four_and_more, elongated, charge, frames_with, count };
  std::array<double, count> sums{};
  double largest = 0;  // charge of a cluster, in least ones
  std::vector<std::uint16_t> fired;
  Events& operator+=(const Events& other) {
    for (std::size_t k = 0; k < sums.size(); ++k) sums[k] += other.sums[k];
    largest = std::max(largest, other.largest);
    for (std::size_t i = 0; i < fired.size(); ++i)
      fired[i] = static_cast<std::uint16_t>(fired[i] + other.fired[i]);
    return *this;
  }
};

/// Indices where scaled exceeds the threshold, at most `most`.
ATOMCAM_VECTOR_CLONES
void find_events(std::size_t n, const float* scaled, const float* threshold, std::size_t most,
                 std::vector<std::uint32_t>& events) {
  // Events are rare: one look at a block's lanes together.
  constexpr std::size_t block = 4 * lane_count;
  for (std::size_t begin = 0; begin < n; begin += block) {
    const std::size_t end = std::min(begin + block, n);
    Lanes above = lanes(0);
    for (std::size_t i = begin; i < end; i += lane_count)
      above += where_above(load(scaled + i), load(threshold + i), lanes(1));
    if (total(above) == 0) continue;
    for (std::size_t k = begin; k < end; ++k)
      if (scaled[k] > threshold[k] && events.size() < most) events.push_back(static_cast<std::uint32_t>(k));
  }
}

class Clusters : public Family {
 public:
  explicit Clusters(const Layout& layout)
      : layout_(layout),
        label_(layout.shape.inner()),
        events_(Events{.fired = std::vector<std::uint16_t>(layout.shape.inner())}) {}

  void second_look(const SecondLook& look) override {
    Events& events = events_[look.part];
    found_.clear();
    find_events(look.scaled.size(), look.scaled.inner(), layout_.event_threshold.inner(), 2000, found_);
    if (found_.empty()) return;
    events.sums[Events::pixels] += static_cast<double>(found_.size());
    ++events.sums[Events::frames_with];
    for (const std::uint32_t p : found_) {
      ++events.fired[p];
      label_[p] = 1;
    }
    const float* z = look.scaled.inner();
    for (const std::uint32_t start : found_) {
      if (!label_[start]) continue;
      label_[start] = 0;
      stack_.assign(1, start);
      double charge = 0;
      int size = 0;
      const auto stride = static_cast<std::int64_t>(layout_.shape.stride);
      std::int64_t left = stride, right = 0, top = 1 << 30, bottom = 0;
      while (!stack_.empty()) {
        const std::int64_t p = stack_.back();
        stack_.pop_back();
        ++size;
        charge += static_cast<double>(z[p]) * static_cast<double>(layout_.dark_scale) /
                  static_cast<double>(layout_.quiet.inner()[p]);
        left = std::min(left, p % stride), right = std::max(right, p % stride);
        top = std::min(top, p / stride), bottom = std::max(bottom, p / stride);
        for (std::int64_t dy = -1; dy <= 1; ++dy)
          for (std::int64_t dx = -1; dx <= 1; ++dx)
            if (const std::int64_t next = p + dy * stride + dx;
                next >= 0 && next < static_cast<std::int64_t>(label_.size()) &&
                label_[static_cast<std::size_t>(next)]) {
              label_[static_cast<std::size_t>(next)] = 0;
              stack_.push_back(static_cast<std::uint32_t>(next));
            }
      }
      const std::int64_t longer = std::max(right - left, bottom - top) + 1,
                         shorter = std::min(right - left, bottom - top) + 1;
      ++events.sums[size == 1 ? Events::single : size < 4 ? Events::two_to_three : Events::four_and_more];
      events.sums[Events::elongated] += longer >= 3 && longer >= 2 * shorter;
      events.sums[Events::charge] += charge / layout_.least_event;
      events.largest = std::max(events.largest, charge / layout_.least_event);
    }
  }

  void summarise(Part which, const Record& record, Sheet& sheet) const override {
    sheet.family("clusters");
    sheet.kind({"bright_clusters", "space", "whole frame"});
    const Events events = events_.of(which);
    const bool enough = record.count(which) > 0;
    const auto put = [&](std::string_view name, double number) {
      sheet.put_unsteady(name, enough ? std::asinh(number) : not_a_number);
    };
    put("single", events.sums[Events::single]);
    put("two_to_three", events.sums[Events::two_to_three]);
    put("four_and_more", events.sums[Events::four_and_more]);
    put("elongated", events.sums[Events::elongated]);
    put("largest", events.largest);
    put("charge", events.sums[Events::charge]);
    put("frames", events.sums[Events::frames_with]);
    double repeated = 0, often = 0;
    for (const std::uint16_t times : events.fired) repeated += times >= 2, often += times >= 5;
    sheet.kind({"bright_clusters", "time", "whole frame"});
    put("repeated", repeated);
    put("often", often);
  }

 private:
  const Layout& layout_;
  std::vector<std::uint32_t> found_, stack_;
  std::vector<char> label_;
  Halves<Events> events_;
};

}  // namespace

std::unique_ptr<Family> make_clusters(const Layout& layout) {
  return std::make_unique<Clusters>(layout);
}

}  // namespace atomcam::analysis
