#include "optics/fourier.hpp"

#include <fftw3.h>

#include <mutex>

namespace atomcam {
namespace {

// Estimated plans depend on no measurement, scalar code on no processor: the same bits on every run.
constexpr unsigned plan_flags = FFTW_ESTIMATE | FFTW_NO_SIMD;

// FFTW's planner is not thread safe; executing a plan is.
std::mutex& planner() {
  static std::mutex mutex;
  return mutex;
}

class Plan {
 public:
  template <class Make>
  explicit Plan(Make make) {
    const std::scoped_lock lock(planner());
    plan_ = make();
  }
  ~Plan() {
    const std::scoped_lock lock(planner());
    fftw_destroy_plan(plan_);
  }
  Plan(const Plan&) = delete;
  Plan& operator=(const Plan&) = delete;
  void execute() const { fftw_execute(plan_); }

 private:
  fftw_plan plan_;
};

fftw_complex* raw(std::complex<double>* values) {
  return reinterpret_cast<fftw_complex*>(values);
}

std::size_t squared(int size) {
  return static_cast<std::size_t>(size) * static_cast<std::size_t>(size);
}

}  // namespace

FourierGrid::FourierGrid(int size) : size_(size), values_(squared(size)) {}

void FourierGrid::transform() {
  fftw_complex* data = raw(values_.data());
  Plan([&] { return fftw_plan_dft_2d(size_, size_, data, data, FFTW_FORWARD, plan_flags); }).execute();
}

std::vector<std::complex<double>> FourierGrid::spectrum_of_intensity(std::span<const double> factor,
                                                                     double total) const {
  std::vector<double> intensity(values_.size());
  const auto size = static_cast<std::size_t>(size_);
  for (std::size_t n = 0; n < size; ++n)
    for (std::size_t m = 0; m < size; ++m)
      intensity[n * size + m] = std::norm(values_[n * size + m]) * (factor[n] * factor[m]);
  std::vector<std::complex<double>> spectrum(static_cast<std::size_t>(size_) *
                                             static_cast<std::size_t>(size_ / 2 + 1));
  Plan([&] {
    return fftw_plan_dft_r2c_2d(size_, size_, intensity.data(), raw(spectrum.data()), plan_flags);
  }).execute();
  for (std::complex<double>& value : spectrum) value /= total;
  return spectrum;
}

std::vector<double> image_of_spectrum(std::vector<std::complex<double>> spectrum, int size) {
  std::vector<double> image(squared(size));
  Plan([&] {
    return fftw_plan_dft_c2r_2d(size, size, raw(spectrum.data()), image.data(), plan_flags);
  }).execute();
  return image;
}

}  // namespace atomcam
