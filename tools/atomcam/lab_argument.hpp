#pragma once
// LAB on the command line: a preset's name or a file.

#include <string>
#include <vector>

#include "simulation/lab.hpp"

namespace atomcam {

/// With the --set changes applied.
Lab lab_of_argument(const std::string& argument, const std::vector<std::string>& settings = {});

}  // namespace atomcam
