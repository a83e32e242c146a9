#include "optics/fourier.hpp"

#include <fftw3.h>

#include <map>

#include "base/fftw_planner.hpp"

namespace atomcam {
namespace {

// Estimated plans depend on no measurement, scalar code on no processor: the same bits on every run.
constexpr unsigned plan_flags = FFTW_ESTIMATE | FFTW_NO_SIMD;

class Plan {
 public:
  template <class Make>
  explicit Plan(Make make) {
    const std::scoped_lock lock(fftw_planner());
    plan_ = make();
  }
  ~Plan() {
    const std::scoped_lock lock(fftw_planner());
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

FourierLine::FourierLine(int size) {
  // Tables come in a handful of sizes, so the plans that are kept are as few. They are there until the end.
  static auto& plans = *new std::map<int, fftw_plan>;
  const std::scoped_lock lock(fftw_planner());
  fftw_plan& plan = plans[size];
  if (plan == nullptr) {
    std::vector<std::complex<double>> from(static_cast<std::size_t>(size)), to(from.size());
    plan = fftw_plan_dft_1d(size, raw(from.data()), raw(to.data()), FFTW_FORWARD,
                            plan_flags | FFTW_UNALIGNED | FFTW_PRESERVE_INPUT);
  }
  plan_ = plan;
}

void FourierLine::transform(const std::complex<double>* from, std::complex<double>* to) const {
  fftw_execute_dft(static_cast<fftw_plan>(plan_), raw(const_cast<std::complex<double>*>(from)), raw(to));
}

std::vector<std::complex<double>> spectrum_of_image(std::vector<double> image, int size) {
  std::vector<std::complex<double>> spectrum(static_cast<std::size_t>(size) *
                                             static_cast<std::size_t>(size / 2 + 1));
  Plan([&] {
    return fftw_plan_dft_r2c_2d(size, size, image.data(), raw(spectrum.data()), plan_flags);
  }).execute();
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
