#pragma once
// Bad input throws an Error that names the place, the value and what is allowed. What is expected at run time
// (a timeout, a lost packet, no frame yet) is a return value, never an Error.

#include <span>
#include <stdexcept>
#include <string>
#include <string_view>

namespace atomcam {

class Error : public std::runtime_error {
 public:
  /// `place`: file, key or argument; `problem`: the value and what is allowed instead.
  Error(std::string_view place, std::string_view problem)
      : std::runtime_error(std::string(place) + ": " + std::string(problem)), place_(place) {}
  const std::string& place() const { return place_; }

 private:
  std::string place_;
};

/// The element of `known` nearest to `word` in edit distance (ties: the first); empty if `known` is empty.
std::string nearest_word(std::string_view word, std::span<const std::string> known);

/// Throws an Error: "<place>: unknown <what> 'word'; the nearest is 'near'" (or the list of all where it is
/// short).
[[noreturn]] void throw_unknown(std::string_view place, std::string_view what, std::string_view word,
                                std::span<const std::string> known);

}  // namespace atomcam
