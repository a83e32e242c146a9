#include "optics/pupil_row.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "base/math.hpp"
#include "optics/sinc.hpp"
#include "support/instruction_sets.hpp"

namespace atomcam {
namespace {

constexpr double rounding = 2e-14;  // of a hundred operations on numbers of order 1, and of sinc's polynomial

std::complex<double> plain(const PupilRow& row, double x) {
  const auto at = [x](const auto& coefficients) {
    double sum = 0;
    for (std::size_t i = coefficients.size(); i-- > 0;) sum = sum * x + coefficients[i];
    return sum;
  };
  const double amplitude = (1 - row.edge_loss_y - row.edge_loss * x * x) /
                           std::sqrt(std::sqrt(1 - row.sine_square_y - row.sine_square * x * x));
  const double turns = at(row.turns);
  return amplitude * sinc(at(row.slope_x)) * sinc(at(row.slope_y)) *
         std::complex(math::cos_turns(turns), math::sin_turns(turns));
}

TEST(PupilRow, IsThePlainPupilOnEveryInstructionSet) {
  PupilRow row{{0.1, -3.0, 2.5, 0.7, -1.9},
               {0.01, -0.2, 0.05, 0.3},
               {0.4, 0.02, 0, -0.1},
               1.0 / 41,
               0.42,
               0.1,
               0.5,
               0.2};
  for (const bool apodised : {true, false}) {
    if (!apodised) row.sine_square = row.sine_square_y = row.edge_loss = row.edge_loss_y = 0;
    std::vector<std::complex<double>> first_set;
    on_every_instruction_set([&](const char* name) {
      SCOPED_TRACE(name);
      std::vector<std::complex<double>> made(80);
      pupil_row(row, -40, 80, made.data());
      for (int n = 0; n < 80; ++n) {
        const auto value = plain(row, (n - 40) * row.spacing);
        EXPECT_NEAR(made[n].real(), value.real(), rounding) << n;
        EXPECT_NEAR(made[n].imag(), value.imag(), rounding) << n;
      }
      if (first_set.empty()) first_set = made;
      EXPECT_EQ(made, first_set);
    });
  }
}

}  // namespace
}  // namespace atomcam
