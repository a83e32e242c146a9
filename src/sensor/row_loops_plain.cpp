#include <algorithm>
#include <cmath>

#include "sensor/row_loops.hpp"
#include "sensor/word_laws.hpp"

namespace atomcam::row_loops::plain {

void emccd_amplify(const EmccdConversion& conversion, std::span<const float> output_e,
                   const std::uint32_t* noise, std::span<float> analog_counts) {
  for (std::size_t c = 0; c < output_e.size(); ++c)
    analog_counts[c] = (conversion.bias_counts + output_e[c] * conversion.counts_per_e) +
                       word_laws::normal(noise[c]) * conversion.read_noise_counts;
}

void qcmos_amplify(const QcmosConversion& conversion, std::span<const float> output_e,
                   const std::uint32_t* noise, const std::uint32_t* flicker, std::span<float> analog_counts) {
  for (std::size_t c = 0; c < output_e.size(); ++c) {
    float electrons = output_e[c] + conversion.row_noise_e;
    if (flicker != nullptr) electrons += word_laws::gumbel(flicker[c]) * conversion.flicker_noise_e;
    electrons += word_laws::normal(noise[c]) * (conversion.read_noise_ratio[c] * conversion.read_noise_e);
    analog_counts[c] = (conversion.bias_counts + conversion.offset_counts[c]) +
                       electrons * (conversion.gain_ratio[c] * conversion.counts_per_e);
  }
}

void digitise(std::span<const float> analog_counts, float largest, std::span<std::uint16_t> counts) {
  for (std::size_t c = 0; c < counts.size(); ++c)
    counts[c] =
        static_cast<std::uint16_t>(std::nearbyint(std::min(std::max(analog_counts[c], 0.0f), largest)));
}

}  // namespace atomcam::row_loops::plain
