#include <algorithm>
#include <cmath>

#include "base/random.hpp"
#include "base/samplers.hpp"
#include "sensor/qcmos.hpp"
#include "sensor/row_loops.hpp"
#include "sensor/word_laws.hpp"

namespace atomcam {
namespace {

/// Words of one map: keyed by the serial number and the map's name, addressed by row.
class MapWords {
 public:
  MapWords(const std::string& serial, std::string_view name, int columns)
      : key_(stream_key(stream_id(serial), stream_id(name))), words_(static_cast<std::size_t>(columns)) {}
  const std::vector<std::uint32_t>& row(int r) {
    fill_random(key_, 0, static_cast<std::uint32_t>(r), words_);
    return words_;
  }
  RandomStream stream(int r) const { return RandomStream(key_, 0, static_cast<std::uint32_t>(r)); }

 private:
  PhiloxKey key_;
  std::vector<std::uint32_t> words_;
};

/// A map whose rows are `fill(words, pixels)`.
template <class MapImage, class Fill>
std::shared_ptr<MapImage> draw_map(Shape shape, const std::string& serial, std::string_view name, Fill fill) {
  auto map = std::make_shared<MapImage>(shape);
  MapWords words(serial, name, shape.columns);
  for (int r = 0; r < shape.rows; ++r) fill(words.row(r), map->row(r));
  return map;
}

}  // namespace

QcmosMaps draw_qcmos_maps(const QcmosDescription& description, const std::string& serial) {
  const Shape shape = description.shape;
  using OffsetMap = Image<float, unit::counts>;
  QcmosMaps maps;

  const auto pixel_sigma = static_cast<float>(description.offset_sigma_counts);
  const auto offset =
      draw_map<OffsetMap>(shape, serial, "sensor/offset", [&](const auto& words, auto pixels) {
        if (pixel_sigma == 0) return;
        row_loops::normal_row(words, pixels);
        for (float& pixel : pixels) pixel *= pixel_sigma;
      });
  if (description.column_gumbel_counts != 0 || description.row_offset_sigma_counts != 0) {
    const std::vector<std::uint32_t> column_words =
        MapWords(serial, "sensor/column_offset", shape.columns).row(0);
    const std::vector<std::uint32_t> row_words = MapWords(serial, "sensor/row_offset", shape.rows).row(0);
    std::vector<float> column_offset;
    for (const std::uint32_t word : column_words)
      column_offset.push_back(static_cast<float>(description.column_gumbel_counts) * word_laws::gumbel(word));
    for (int r = 0; r < shape.rows; ++r) {
      const float row_offset = static_cast<float>(description.row_offset_sigma_counts) *
                               word_laws::normal(row_words[static_cast<std::size_t>(r)]);
      const std::span<float> pixels = offset->row(r);
      for (std::size_t c = 0; c < pixels.size(); ++c) pixels[c] += column_offset[c] + row_offset;
    }
  }
  maps.offset_counts = offset;

  const auto gain_sigma = static_cast<float>(description.gain_sigma);
  maps.gain_ratio = draw_map<RatioMap>(shape, serial, "sensor/gain", [&](const auto& words, auto pixels) {
    row_loops::normal_row(words, pixels);
    for (float& pixel : pixels) pixel = std::max(1.0f + gain_sigma * pixel, 0.01f);
  });

  const auto s = static_cast<float>(description.read_noise_log_sigma);
  maps.read_noise_ratio = draw_map<RatioMap>(
      shape, serial, "sensor/read_noise_map",
      [&](const auto& words, auto pixels) { row_loops::log_normal_row(words, s, -s * s, pixels); });

  const double dark_shape = description.dark_gamma_shape;
  if (dark_shape == 1) {  // an exponential law, one word each
    maps.dark_ratio = draw_map<RatioMap>(shape, serial, "sensor/dark", [](const auto& words, auto pixels) {
      row_loops::exponential_row(words, pixels);
    });
  } else {
    const auto dark = std::make_shared<RatioMap>(shape);
    const MapWords words(serial, "sensor/dark", 0);
    for (int r = 0; r < shape.rows; ++r) {
      RandomStream random = words.stream(r);
      for (float& ratio : dark->row(r))
        ratio = static_cast<float>(sample_gamma(random, dark_shape) / dark_shape);
    }
    maps.dark_ratio = dark;
  }
  return maps;
}

}  // namespace atomcam
