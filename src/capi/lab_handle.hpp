#pragma once
// What is behind the C interface's opaque lab.

#include "capi/atomcam.h"
#include "simulation/workbench.hpp"

struct atomcam_lab {
  atomcam::Workbench bench;
};
