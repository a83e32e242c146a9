#include "analysis/fourier.hpp"

#include <fftw3.h>

#include <map>
#include <mutex>

namespace atomcam::analysis {
namespace {

// FFTW's planner is not thread safe; executing a plan is. The planner of single precision is one of its own.
std::mutex& planner() {
  static std::mutex mutex;
  return mutex;
}

struct Plans {
  std::map<std::pair<int, int>, fftwf_plan> of;
  ~Plans() {
    for (const auto& [shape, plan] : of) fftwf_destroy_plan(plan);
  }
};

}  // namespace

ImageSpectrum::ImageSpectrum(int rows, int columns)
    : rows_(rows),
      columns_(columns),
      image_(static_cast<std::size_t>(rows) * static_cast<std::size_t>(columns)),
      spectrum_(static_cast<std::size_t>(rows) * static_cast<std::size_t>(columns / 2 + 1)) {
  const std::scoped_lock lock(planner());
  // Plans are kept: a process measures thousands of stacks of the same shape.
  static Plans plans;
  fftwf_plan& plan = plans.of[{rows, columns}];
  // Estimated: depends on no measurement, so the bits are the same on every run.
  if (!plan)
    plan = fftwf_plan_dft_r2c_2d(rows, columns, image_.data(),
                                 reinterpret_cast<fftwf_complex*>(spectrum_.data()),
                                 FFTW_ESTIMATE | FFTW_PRESERVE_INPUT);
  plan_ = plan;
}

void ImageSpectrum::transform() {
  fftwf_execute_dft_r2c(static_cast<fftwf_plan>(plan_), image_.data(),
                        reinterpret_cast<fftwf_complex*>(spectrum_.data()));
}

void ImageSpectrum::add_power(std::span<float> sums) const {
  for (std::size_t i = 0; i < spectrum_.size(); ++i) {
    const float re = spectrum_[i].real(), im = spectrum_[i].imag();
    sums[i] += re * re + im * im;
  }
}

}  // namespace atomcam::analysis
