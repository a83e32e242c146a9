#pragma once
// The loops over the pixels of a row. `plain` is the definition, one pixel at a time; the functions outside
// it give the same bits with the widest vectors of the machine.

#include <cstdint>
#include <span>
#include <vector>

namespace atomcam::row_loops {

/// Conversion of an EMCCD: counts = bias + output / (e-/count) + read noise.
struct EmccdConversion {
  float bias_counts = 0;
  float counts_per_e = 1;
  float read_noise_counts = 0;
  float largest_count = 65535;
};

/// A row of a map in fixed point: value = number * scale. Half the memory traffic of single precision.
template <class Number>
struct FixedRow {
  const Number* numbers = nullptr;
  float scale = 1;
  float operator[](std::size_t c) const { return static_cast<float>(numbers[c]) * scale; }
};

/// Conversion of a qCMOS row; the maps are those of the row's pixels.
struct QcmosConversion {
  float bias_counts = 0;
  float counts_per_e = 1;
  float read_noise_e = 0;  // of the mode; the map multiplies it
  float row_noise_e = 0;   // this row's, this frame's
  float flicker_noise_e = 0;
  float largest_count = 65535;
  FixedRow<std::int16_t> offset_counts;
  FixedRow<std::uint16_t> gain_ratio;
  FixedRow<std::uint16_t> read_noise_ratio;
};

// Pointers `noise` and `flicker` are to the row's random words, one per pixel; `flicker` is null without that
// noise.

void emccd_amplify(const EmccdConversion& conversion, std::span<const float> output_e,
                   const std::uint32_t* noise, std::span<float> analog_counts);
void qcmos_amplify(const QcmosConversion& conversion, std::span<const float> output_e,
                   const std::uint32_t* noise, const std::uint32_t* flicker, std::span<float> analog_counts);
/// Rounds to the nearest count (ties to even) and clips to 0..largest.
void digitise(std::span<const float> analog_counts, float largest_count, std::span<std::uint16_t> counts);

/// amplify and digitise in one pass.
void emccd_convert(const EmccdConversion& conversion, std::span<const float> output_e,
                   const std::uint32_t* noise, std::span<std::uint16_t> counts);
/// The same from the pixels' electrons.
void qcmos_convert(const QcmosConversion& conversion, std::span<const std::int32_t> electrons,
                   const std::uint32_t* noise, const std::uint32_t* flicker, std::span<std::uint16_t> counts);

/// For every 16-bit half of `words` (low half first) the number of thresholds below it. Pixels whose half
/// equals a threshold are undecided: returns whether there are any.
bool count_thresholds(const std::uint32_t* words, std::span<const std::uint16_t> thresholds,
                      std::span<std::int32_t> numbers);

/// Pixels that hold electrons.
struct Packets {
  std::vector<std::int32_t> columns, electrons;
  std::size_t count = 0;
};
/// output_e = min(electrons, well) as numbers; lists the pixels that hold electrons.
void spread_electrons(std::span<const std::int32_t> electrons, float well_e, std::span<float> output_e,
                      Packets& packets);

/// Word laws of every word, for maps: normal numbers; exp(scale * normal + shift); -ln of a uniform number.
void normal_row(std::span<const std::uint32_t> words, std::span<float> values);
void log_normal_row(std::span<const std::uint32_t> words, float scale, float shift, std::span<float> values);
void exponential_row(std::span<const std::uint32_t> words, std::span<float> values);

void clip(std::int32_t largest, std::span<std::int32_t> electrons);

namespace plain {

void emccd_amplify(const EmccdConversion& conversion, std::span<const float> output_e,
                   const std::uint32_t* noise, std::span<float> analog_counts);
void qcmos_amplify(const QcmosConversion& conversion, std::span<const float> output_e,
                   const std::uint32_t* noise, const std::uint32_t* flicker, std::span<float> analog_counts);
void digitise(std::span<const float> analog_counts, float largest_count, std::span<std::uint16_t> counts);

}  // namespace plain

}  // namespace atomcam::row_loops
