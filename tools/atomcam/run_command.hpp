#pragma once
// How a subcommand fails.

#include <CLI/CLI.hpp>
#include <functional>
#include <stdexcept>
#include <string>

namespace atomcam {

/// Something that went wrong while a command ran, though what it was told was right.
class Failure : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// Runs `body` and ends the command with one line on stderr and exit code `bad_input` for an Error, `failed`
/// for anything else.
void run_command(const std::string& name, const std::function<void()>& body, int bad_input = 2,
                 int failed = 1);

/// `body`, with an Error turned into a Failure: from here on it is not the input's fault.
void at_run_time(const std::function<void()>& body);

}  // namespace atomcam
