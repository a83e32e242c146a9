// The loop, compiled once per instruction set by the include below.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "optics/photon_draws.cpp"  // NOLINT
#include "base/instruction_sets.hpp"
// Highway's own include order: foreach_target before highway.
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include <algorithm>

#include "optics/photon_draws.hpp"

HWY_BEFORE_NAMESPACE();
namespace atomcam::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

/// `slots`: each photon's.
void place_photons(const PhotonTable& table, const std::uint64_t* slots, const std::uint32_t* words,
                   std::size_t count, PointSpreadFunction::Displacement* out) {
  std::size_t n = 0;
#if HWY_TARGET != HWY_SCALAR
  const hn::ScalableTag<float> f;
  const hn::RebindToUnsigned<decltype(f)> u;
  const hn::RebindToSigned<decltype(f)> i;
  const hn::RepartitionToWide<decltype(u)> wide;
  const hn::RebindToSigned<decltype(wide)> signed_wide;
  const hn::Half<decltype(u)> half;
  const std::size_t lanes = hn::Lanes(f);
  const auto low_mask = hn::Set(u, (std::uint32_t{1} << table.low_bits) - 1), byte = hn::Set(u, 0xff);
  const auto cell_mask = hn::Set(wide, PhotonTable::cell_mask);
  const auto centre = hn::Set(i, table.side / 2);
  const auto centred = hn::Set(f, 0.5f), unit = hn::Set(f, 0x1p-16f);
  const auto cells = [&](auto slot, auto low) HWY_ATTR {
    const auto threshold = hn::ShiftRight<PhotonTable::threshold_shift>(slot);
    const auto own = hn::Lt(hn::BitCast(signed_wide, low), hn::BitCast(signed_wide, threshold));
    const auto chosen =
        hn::IfThenElse(hn::RebindMask(wide, own), hn::ShiftRight<PhotonTable::cell_bits>(slot), slot);
    return hn::BitCast(u, hn::And(chosen, cell_mask));
  };
  for (; n + lanes <= count; n += lanes) {
    hn::Vec<decltype(u)> cell_word, jitter;
    hn::LoadInterleaved2(u, words + 2 * n, cell_word, jitter);
    const auto low = hn::And(cell_word, low_mask);
    const auto first = cells(hn::LoadU(wide, slots + n), hn::PromoteTo(wide, hn::LowerHalf(half, low)));
    const auto second =
        cells(hn::LoadU(wide, slots + n + lanes / 2), hn::PromoteTo(wide, hn::UpperHalf(half, low)));
    const auto cell = hn::ConcatEven(u, second, first);
    const auto width = hn::GatherIndex(f, table.level_px.data(), hn::BitCast(i, hn::ShiftRight<16>(cell)));
    const auto place = [&](auto index, auto within, float shift) HWY_ATTR {
      const auto whole = hn::ConvertTo(f, hn::Sub(hn::BitCast(i, index), centre));
      const auto part = hn::Mul(hn::Add(hn::ConvertTo(f, hn::BitCast(i, within)), centred), unit);
      return hn::Add(hn::Set(f, shift), hn::Mul(hn::Add(whole, part), width));
    };
    const auto dx = place(hn::And(cell, byte), hn::And(jitter, hn::Set(u, 0xffff)), table.shift_x_px);
    const auto dy =
        place(hn::And(hn::ShiftRight<8>(cell), byte), hn::ShiftRight<16>(jitter), table.shift_y_px);
    hn::StoreInterleaved2(dx, dy, f, &out[n].dx_px);
  }
#endif
  for (; n < count; ++n) out[n] = table.place(slots[n], words[2 * n], words[2 * n + 1]);
}

}  // namespace atomcam::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace atomcam {

HWY_EXPORT(place_photons);

void draw_photons(const PhotonTable& table, const std::uint32_t* words, std::size_t count,
                  PointSpreadFunction::Displacement* out) {
  static_assert(sizeof(PointSpreadFunction::Displacement) == 2 * sizeof(float));
  // The table does not fit the nearest cache: first all slots, so that many are on their way at once.
  constexpr std::size_t block = 128;
  std::array<std::uint64_t, block> slots;
  for (std::size_t begin = 0; begin < count; begin += block) {
    const std::size_t size = std::min(block, count - begin);
    for (std::size_t n = 0; n < size; ++n) slots[n] = table.slots[words[2 * (begin + n)] >> table.low_bits];
    HWY_DYNAMIC_DISPATCH(place_photons)(table, slots.data(), words + 2 * begin, size, out + begin);
  }
}

}  // namespace atomcam
#endif  // HWY_ONCE
