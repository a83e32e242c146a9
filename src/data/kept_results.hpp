#pragma once
// What took long to work out, kept on disk: simulated stacks or a fit need not be gone through again.

#include <Eigen/Dense>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "data/sha256.hpp"

namespace atomcam {

/// What a result depends on.
class ResultKey {
 public:
  ResultKey& add(std::string_view text);
  ResultKey& add(std::uint64_t number);
  ResultKey& add(const Eigen::MatrixXd& values);
  std::string digits() { return hash_.digits(); }

 private:
  Sha256 hash_;
};

using Matrices = std::vector<Eigen::MatrixXd>;

/// A folder with a file per result. Files that are damaged are as good as none; a folder that cannot be
/// written keeps nothing.
class KeptResults {
 public:
  /// `common`: what all results depend on besides their own keys. The program itself always counts.
  KeptResults(std::filesystem::path folder, std::string common);

  std::optional<Matrices> find(ResultKey key) const;
  void keep(ResultKey key, const Matrices& matrices) const;
  static constexpr std::uintmax_t largest = std::uintmax_t{4} << 30;
  /// Removes what was not used for longest until at most `bytes` are left.
  void trim(std::uintmax_t bytes = largest) const;

 private:
  std::filesystem::path file_of(ResultKey key) const;

  std::filesystem::path folder_;
  std::string common_;
};

}  // namespace atomcam
