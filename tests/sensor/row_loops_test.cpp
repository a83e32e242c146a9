#include "sensor/row_loops.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "base/random.hpp"
#include "sensor/word_laws.hpp"
#include "support/instruction_sets.hpp"

namespace atomcam {
namespace {

/// Random words, with those where the laws change their formula or end.
std::vector<std::uint32_t> words_of(std::string_view name, std::size_t count) {
  std::vector<std::uint32_t> words(count);
  fill_random(stream_key(1, stream_id(name)), 0, 0, words);
  constexpr auto edge = static_cast<std::uint32_t>(word_laws::first_tail_word);
  const std::uint32_t special[] = {0,           1,    2,        0xffffffffu, 0xfffffffeu, 0x7fffffffu,
                                   0x80000000u, edge, edge + 1, ~edge,       ~(edge + 1), 0x12345u};
  for (std::size_t i = 0; i < std::size(special) && 3 * i < count; ++i) words[3 * i] = special[i];
  return words;
}

// Every function against its plain definition, over rows of every length a vector can leave a rest of.
class RowLoops : public testing::Test {
 protected:
  static constexpr std::size_t longest = 83;

  RowLoops() : noise(words_of("noise", longest)), flicker(words_of("flicker", longest)) {
    RandomStream random(1, stream_id("test/rows"), 0, 0);
    for (std::size_t c = 0; c < longest; ++c) {
      electrons.push_back(c % 7 == 0 ? static_cast<std::int32_t>(random() % 2000)
                                     : static_cast<std::int32_t>(c % 3));
      output.push_back(static_cast<float>(random() % 900000));
      offset.push_back(static_cast<std::int16_t>(random()));
      gain.push_back(static_cast<std::uint16_t>(random()));
      sigma.push_back(static_cast<std::uint16_t>(random()));
    }
    qcmos.bias_counts = 200;
    qcmos.counts_per_e = 9.3f;
    qcmos.read_noise_e = 0.43f;
    qcmos.row_noise_e = -0.07f;
    qcmos.flicker_noise_e = 0.3f;
    qcmos.offset_counts = {offset.data(), 0x1p-7f};
    qcmos.gain_ratio = {gain.data(), 0x1p-15f};
    qcmos.read_noise_ratio = {sigma.data(), 0x1p-13f};
    emccd.bias_counts = 200;
    emccd.counts_per_e = 0.24f;
    emccd.read_noise_counts = 7.3f;
  }

  template <class Check>
  void for_every_length(Check check) {
    on_every_instruction_set([&](const char* name) {
      SCOPED_TRACE(name);
      for (std::size_t length = 0; length <= longest; ++length) check(length);
    });
  }

  std::vector<std::uint32_t> noise, flicker;
  std::vector<std::int32_t> electrons;
  std::vector<float> output;
  std::vector<std::int16_t> offset;
  std::vector<std::uint16_t> gain, sigma;
  row_loops::QcmosConversion qcmos;
  row_loops::EmccdConversion emccd;
};

TEST_F(RowLoops, EmccdConversion) {
  for_every_length([&](std::size_t length) {
    const std::span<const float> in(output.data(), length);
    std::vector<float> expected(length), got(length);
    row_loops::plain::emccd_amplify(emccd, in, noise.data(), expected);
    row_loops::emccd_amplify(emccd, in, noise.data(), got);
    ASSERT_EQ(got, expected);
    std::vector<std::uint16_t> expected_counts(length), counts(length), fused(length);
    row_loops::plain::digitise(expected, emccd.largest_count, expected_counts);
    row_loops::digitise(expected, emccd.largest_count, counts);
    row_loops::emccd_convert(emccd, in, noise.data(), fused);
    ASSERT_EQ(counts, expected_counts);
    ASSERT_EQ(fused, expected_counts);
  });
}

TEST_F(RowLoops, QcmosConversion) {
  for_every_length([&](std::size_t length) {
    for (const bool flickers : {true, false}) {
      const std::uint32_t* words = flickers ? flicker.data() : nullptr;
      const std::vector<float> in(electrons.begin(), electrons.begin() + static_cast<std::ptrdiff_t>(length));
      std::vector<float> expected(length), got(length);
      row_loops::plain::qcmos_amplify(qcmos, in, noise.data(), words, expected);
      row_loops::qcmos_amplify(qcmos, in, noise.data(), words, got);
      ASSERT_EQ(got, expected);
      std::vector<std::uint16_t> counts(length), fused(length);
      row_loops::plain::digitise(expected, qcmos.largest_count, counts);
      row_loops::qcmos_convert(qcmos, std::span(electrons).first(length), noise.data(), words, fused);
      ASSERT_EQ(fused, counts);
    }
  });
}

TEST_F(RowLoops, DigitiseRoundsTiesToEvenAndClips) {
  const std::vector<float> analog{-1e30f, -1,    -0.6f, -0.5f,    -0.0f,      0.4999999f,
                                  0.5f,   1.5f,  2.5f,  65534.5f, 65534.498f, 65535,
                                  65536,  1e30f, 7.25f, 1023.5f,  32767.5f,   32768.5f};
  const std::vector<std::uint16_t> expected{0,     0,     0,     0,     0,     0, 0,    2,     2,
                                            65534, 65534, 65535, 65535, 65535, 7, 1024, 32768, 32768};
  std::vector<std::uint16_t> counts(analog.size());
  on_every_instruction_set([&](const char* name) {
    row_loops::digitise(analog, 65535, counts);
    EXPECT_EQ(counts, expected) << name;
  });
  row_loops::digitise(analog, 16383, counts);
  EXPECT_EQ(counts[13], 16383);
}

TEST_F(RowLoops, ListsThePixelsThatHoldElectrons) {
  for_every_length([&](std::size_t length) {
    row_loops::Packets packets;
    std::vector<float> out(length);
    row_loops::spread_electrons(std::span(electrons).first(length), 100, out, packets);
    std::size_t i = 0;
    for (std::size_t c = 0; c < length; ++c) {
      ASSERT_EQ(out[c], std::min(static_cast<float>(electrons[c]), 100.0f));
      if (electrons[c] == 0) continue;
      ASSERT_LT(i, packets.count);
      ASSERT_EQ(packets.columns[i], static_cast<std::int32_t>(c));
      ASSERT_EQ(packets.electrons[i++], electrons[c]);
    }
    ASSERT_EQ(i, packets.count);
  });
}

TEST_F(RowLoops, RowsOfWordLaws) {
  for_every_length([&](std::size_t length) {
    const std::span<const std::uint32_t> words(noise.data(), length);
    std::vector<float> normal(length), log_normal(length), exponential(length);
    row_loops::normal_row(words, normal);
    row_loops::log_normal_row(words, 0.3f, -0.09f, log_normal);
    row_loops::exponential_row(words, exponential);
    for (std::size_t c = 0; c < length; ++c) {
      ASSERT_EQ(normal[c], word_laws::normal(words[c]));
      ASSERT_EQ(log_normal[c], word_laws::exp(0.3f * word_laws::normal(words[c]) + -0.09f));
      ASSERT_EQ(exponential[c], word_laws::minus_log(word_laws::fraction(words[c])));
    }
  });
}

TEST_F(RowLoops, ExponentialFunctionKeepsItsAccuracy) {
  for (float x = -20; x < 20; x += 0.0137f)
    ASSERT_LE(std::fabs(word_laws::exp(x) - std::exp(static_cast<double>(x))),
              1e-6 * std::exp(static_cast<double>(x)));
}

TEST_F(RowLoops, Clip) {
  for_every_length([&](std::size_t length) {
    std::vector<std::int32_t> clipped(electrons.begin(),
                                      electrons.begin() + static_cast<std::ptrdiff_t>(length));
    row_loops::clip(1, clipped);
    for (std::size_t c = 0; c < length; ++c) ASSERT_EQ(clipped[c], std::min(electrons[c], 1));
  });
}

}  // namespace
}  // namespace atomcam
