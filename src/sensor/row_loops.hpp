#pragma once
// The loops over the pixels of a row. `plain` is the definition, one pixel at a time; the dispatched versions
// give the same bits with the widest vectors of the machine.

#include <cstdint>
#include <span>

namespace atomcam::row_loops {

/// Conversion of an EMCCD: counts = bias + output / (e-/count) + read noise.
struct EmccdConversion {
  float bias_counts = 0;
  float counts_per_e = 1;
  float read_noise_counts = 0;
};

/// Conversion of a qCMOS row; the maps are those of the row's pixels.
struct QcmosConversion {
  float bias_counts = 0;
  float counts_per_e = 1;
  float read_noise_e = 0;  // of the mode; the map multiplies it
  float row_noise_e = 0;   // this row's, this frame's
  float flicker_noise_e = 0;
  const float* offset_counts = nullptr;
  const float* gain_ratio = nullptr;
  const float* read_noise_ratio = nullptr;
};

namespace plain {

void emccd_amplify(const EmccdConversion& conversion, std::span<const float> output_e,
                   const std::uint32_t* noise, std::span<float> analog_counts);
/// `flicker`: words of the flicker noise, null where there is none.
void qcmos_amplify(const QcmosConversion& conversion, std::span<const float> output_e,
                   const std::uint32_t* noise, const std::uint32_t* flicker, std::span<float> analog_counts);
/// Rounds to the nearest count (ties to even) and clips to 0..largest.
void digitise(std::span<const float> analog_counts, float largest, std::span<std::uint16_t> counts);

}  // namespace plain

}  // namespace atomcam::row_loops
