#pragma once
// Where photons land: one slot of a table for each, from 64 random bits.

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "optics/optics.hpp"

namespace atomcam {

/// Cells of the point-spread function's pyramid, to be drawn by the alias method. A slot in 64 bits:
/// threshold (26), own cell (19), alias cell (19); a cell: level, row, column.
struct PhotonTable {
  static constexpr int cell_bits = 19, threshold_shift = 2 * cell_bits;
  static constexpr std::uint64_t cell_mask = (std::uint64_t{1} << cell_bits) - 1;

  int side = 0;
  std::array<float, 8> level_px{};       // width of a level's cells
  float shift_x_px = 0, shift_y_px = 0;  // by the tilts
  int low_bits = 0;
  std::vector<std::uint64_t> slots;

  PointSpreadFunction::Displacement draw(std::uint32_t cell_word, std::uint32_t jitter_word) const {
    return place(slots[cell_word >> low_bits], cell_word, jitter_word);
  }
  PointSpreadFunction::Displacement place(std::uint64_t slot, std::uint32_t cell_word,
                                          std::uint32_t jitter_word) const {
    const std::uint32_t low = cell_word & ((std::uint32_t{1} << low_bits) - 1);
    const bool own = low < slot >> threshold_shift;
    const auto cell = static_cast<std::uint32_t>((own ? slot >> cell_bits : slot) & cell_mask);
    const float width = level_px[cell >> 16];
    const auto row = static_cast<int>(cell >> 8 & 0xff) - side / 2;
    const auto column = static_cast<int>(cell & 0xff) - side / 2;
    // 2^-16 of a cell apart, centred.
    const float jitter_x = (static_cast<float>(static_cast<int>(jitter_word & 0xffff)) + 0.5f) * 0x1p-16f;
    const float jitter_y = (static_cast<float>(static_cast<int>(jitter_word >> 16)) + 0.5f) * 0x1p-16f;
    return {shift_x_px + (static_cast<float>(column) + jitter_x) * width,
            shift_y_px + (static_cast<float>(row) + jitter_y) * width};
  }
};

/// out[n] = table.draw(words[2 n], words[2 n + 1]), the same bits on every instruction set.
void draw_photons(const PhotonTable& table, const std::uint32_t* words, std::size_t count,
                  PointSpreadFunction::Displacement* out);

}  // namespace atomcam
