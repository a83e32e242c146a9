#pragma once
// Where families write their statistics: one call says what a statistic is and what its value is, so that the
// list of declarations and the values cannot get out of step.

#include <cmath>
#include <limits>
#include <string>
#include <string_view>
#include <vector>

#include "analysis/battery.hpp"

namespace atomcam::analysis {

constexpr double not_a_number = std::numeric_limits<double>::quiet_NaN();

class Sheet {
 public:
  /// What all statistics that follow have in common.
  struct Kind {
    std::string_view observable, axis, place;
  };

  explicit Sheet(bool declaring) : declaring_(declaring) {}
  /// Without any frame no statistic has a value.
  void frames(bool darks, bool any) {
    darks_ = darks;
    any_ = any;
  }
  void family(std::string_view name) { family_ = name; }
  void kind(Kind kind) { kind_ = kind; }

  /// `name` after "light.<family>." or "dark.<family>.".
  void put(std::string_view name, double value) { put(name, {}, value); }
  void put(std::string_view name, std::string_view suffix, double value) {
    add(name, suffix, value, false, false);
  }
  /// One that is unsteady, see StatisticDeclaration.
  void put_unsteady(std::string_view name, double value) { put_unsteady(name, {}, value); }
  void put_unsteady(std::string_view name, std::string_view suffix, double value) {
    add(name, suffix, value, false, true);
  }
  /// A sum over outliers.
  void put_outliers(std::string_view name, std::string_view suffix, double sum) {
    add(name, suffix, std::log1p(sum), true, true);
  }
  /// How far some few things differ: the logarithm of a chi-square per degree of freedom. Below one its cube
  /// root (with the same slope there), which is nearly normal for a few degrees of freedom (Wilson and
  /// Hilferty 1931), where the logarithm is ten deviations off now and then because six sites agree.
  void put_chi_square(std::string_view name, std::string_view suffix, double square, double freedom) {
    const double each = freedom > 0 ? square / freedom : not_a_number;
    put(name, suffix, each < 1 ? 3 * (std::cbrt(each) - 1) : std::log(each));
  }
  std::vector<StatisticDeclaration> take_declarations() { return std::move(declarations_); }
  std::vector<double> take_values() { return std::move(values_); }

 private:
  void add(std::string_view name, std::string_view suffix, double value, bool outliers, bool unsteady) {
    if (!declaring_) return values_.push_back(any_ && std::isfinite(value) ? value : not_a_number);
    std::string full = darks_ ? "dark." : "light.";
    full.append(family_).append(".").append(name);
    if (!suffix.empty()) full.append(".").append(suffix);
    declarations_.push_back({.name = std::move(full),
                             .observable = std::string(kind_.observable),
                             .axis = std::string(kind_.axis),
                             .place = std::string(kind_.place),
                             .darks = darks_,
                             .outliers = outliers,
                             .unsteady = unsteady});
  }

  bool declaring_;
  bool darks_ = false, any_ = false;
  std::string_view family_;
  Kind kind_;
  std::vector<StatisticDeclaration> declarations_;
  std::vector<double> values_;
};

}  // namespace atomcam::analysis
