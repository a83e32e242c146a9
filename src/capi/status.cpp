#include "capi/status.hpp"

#include <new>

#include <fmt/format.h>

#include "base/error.hpp"

namespace atomcam {
namespace {

thread_local std::string last_error;

int fail(int status, const char* text) noexcept {
  try {
    last_error = text;
  } catch (...) {
    last_error.clear();
  }
  return status;
}

}  // namespace

int status_of_exception() noexcept {
  try {
    throw;
  } catch (const Error& error) {
    return fail(ATOMCAM_BAD_INPUT, error.what());
  } catch (const TooSmall& error) {
    return fail(ATOMCAM_TOO_SMALL, error.what());
  } catch (const std::bad_alloc&) {
    return fail(ATOMCAM_NO_MEMORY, "out of memory");
  } catch (const std::exception& error) {
    return fail(ATOMCAM_FAILED, error.what());
  } catch (...) {
    return fail(ATOMCAM_FAILED, "an exception of unknown type");
  }
}

void require(const void* argument, std::string_view name) {
  if (!argument) throw Error(name, "NULL; a pointer is needed");
}

void require_room(std::size_t length, std::size_t needed, std::string_view name) {
  if (length < needed) throw TooSmall(fmt::format("{}: room for {}; {} needed", name, length, needed));
}

void copy_text(const std::string& value, char* text, std::size_t size, std::size_t* needed) {
  if (needed) *needed = value.size() + 1;
  if (size == 0 && !text) {
    require(needed, "needed");
    return;
  }
  require(text, "text");
  require_room(size, value.size() + 1, "text");
  std::char_traits<char>::copy(text, value.c_str(), value.size() + 1);
}

}  // namespace atomcam

using namespace atomcam;

const char* atomcam_last_error(void) {
  return last_error.c_str();
}

const char* atomcam_status_name(int status) {
  switch (status) {
    case ATOMCAM_OK:
      return "ok";
    case ATOMCAM_BAD_INPUT:
      return "bad input";
    case ATOMCAM_TOO_SMALL:
      return "memory too small";
    case ATOMCAM_NO_MEMORY:
      return "out of memory";
    case ATOMCAM_FAILED:
      return "failed";
  }
  return "unknown status";
}

// The header's numbers are what a compiler sees, the project's what a package is called by.
static_assert(ATOMCAM_VERSION_MAJOR == ATOMCAM_PROJECT_MAJOR &&
              ATOMCAM_VERSION_MINOR == ATOMCAM_PROJECT_MINOR &&
              ATOMCAM_VERSION_PATCH == ATOMCAM_PROJECT_PATCH);

#define ATOMCAM_TEXT_OF(number) #number
#define ATOMCAM_TEXT(number) ATOMCAM_TEXT_OF(number)

const char* atomcam_version(void) {
  return ATOMCAM_TEXT(ATOMCAM_VERSION_MAJOR) "." ATOMCAM_TEXT(ATOMCAM_VERSION_MINOR) "." ATOMCAM_TEXT(
      ATOMCAM_VERSION_PATCH);
}
