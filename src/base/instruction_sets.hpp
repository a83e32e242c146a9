#pragma once
// The instruction sets that vector loops are compiled for: the compiler's baseline (one pixel at a time),
// SSE4, AVX2 and AVX-512. The first include of a file with such loops.

#include <hwy/detect_targets.h>

#undef HWY_DISABLED_TARGETS
#define HWY_DISABLED_TARGETS (HWY_SSSE3 | HWY_AVX3_DL)
