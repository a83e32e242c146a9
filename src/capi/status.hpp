#pragma once
// No exception leaves the library: each becomes a status, and a text for atomcam_last_error().

#include <stdexcept>
#include <string>
#include <string_view>

#include "capi/atomcam.h"

namespace atomcam {

/// Memory of the caller that is too small.
class TooSmall : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// The one table from the exception in flight to a status; keeps its text for this thread.
int status_of_exception() noexcept;

/// `body` behind the boundary.
template <class Body>
int guarded(const Body& body) noexcept {
  try {
    body();
    return ATOMCAM_OK;
  } catch (...) {
    return status_of_exception();
  }
}

/// Throws an Error if the argument is null.
void require(const void* argument, std::string_view name);
/// Throws TooSmall if `length` is less than `needed` elements.
void require_room(std::size_t length, std::size_t needed, std::string_view name);
/// `value` with its final zero into the caller's memory; `needed` may be null.
void copy_text(const std::string& value, char* text, std::size_t size, std::size_t* needed);

/// Fills the members of `to` that its caller knows of.
template <class Structure>
void copy_known(Structure* to, Structure from) {
  const std::size_t known = to->size < sizeof(Structure) ? to->size : sizeof(Structure);
  from.size = to->size;
  std::char_traits<char>::copy(reinterpret_cast<char*>(to), reinterpret_cast<const char*>(&from), known);
}

}  // namespace atomcam
