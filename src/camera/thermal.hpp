#pragma once
// A sensor that cools and warms with one time constant.

#include <cmath>

namespace atomcam {

class ThermalModel {
 public:
  ThermalModel() = default;
  explicit ThermalModel(double temperature_c) : start_c_(temperature_c), target_c_(temperature_c) {}

  void set_target(double time_s, double target_c) {
    start_c_ = at(time_s);
    start_s_ = time_s;
    target_c_ = target_c;
  }
  void set_time_constant(double time_s, double time_constant_s) {
    set_target(time_s, target_c_);
    time_constant_s_ = time_constant_s;
  }
  double target_c() const { return target_c_; }

  /// Within 0.05 degrees of the target it is at the target.
  double at(double time_s) const {
    const double away = (start_c_ - target_c_) * std::exp(-(time_s - start_s_) / time_constant_s_);
    return std::fabs(away) < 0.05 ? target_c_ : target_c_ + away;
  }
  bool stable(double time_s) const { return at(time_s) == target_c_; }
  /// What a frame is rendered with: steps of half a degree on the way, so that a frame's settings are a plain
  /// number.
  double stepped(double time_s) const {
    const double now = at(time_s);
    return now == target_c_ ? now : std::round(2 * now) / 2;
  }
  bool operator==(const ThermalModel&) const = default;

 private:
  double start_c_ = 20, target_c_ = 20;
  double start_s_ = 0;
  double time_constant_s_ = 20;
};

}  // namespace atomcam
