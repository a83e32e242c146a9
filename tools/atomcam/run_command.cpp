#include "atomcam/run_command.hpp"

#include <fmt/format.h>

#include "base/error.hpp"

namespace atomcam {

void run_command(const std::string& name, const std::function<void()>& body, int bad_input, int failed) {
  try {
    body();
  } catch (const CLI::Error&) {
    throw;
  } catch (const Error& error) {
    fmt::print(stderr, "atomcam {}: {}\n", name, error.what());
    throw CLI::RuntimeError(bad_input);
  } catch (const std::exception& error) {
    fmt::print(stderr, "atomcam {}: {}\n", name, error.what());
    throw CLI::RuntimeError(failed);
  }
}

void at_run_time(const std::function<void()>& body) {
  try {
    body();
  } catch (const Error& error) {
    throw Failure(error.what());
  }
}

}  // namespace atomcam
