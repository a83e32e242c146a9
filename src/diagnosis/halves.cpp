#include "diagnosis/halves.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "base/random.hpp"
#include "simulation/parallel.hpp"

namespace atomcam {
namespace {

constexpr std::size_t blocks_of_stack = 16;

/// The frames of some blocks, then those of the others, each in their order.
class InHalves : public FrameSequence {
 public:
  InHalves(const FrameSequence& all, std::size_t block, std::uint64_t seed, int choice)
      : all_(all), block_(block) {
    std::vector<std::size_t> order(all.frames() / block);
    std::iota(order.begin(), order.end(), std::size_t{0});
    RandomStream random(stream_key(seed, stream_id("diagnosis/halves")), static_cast<std::uint64_t>(choice),
                        0);
    for (std::size_t k = order.size(); k > 1; --k) std::swap(order[k - 1], order[random() % k]);
    half_of_.assign(order.size(), 2);  // the odd one out belongs to neither
    const std::size_t half = order.size() / 2;
    for (std::size_t k = 0; k < 2 * half; ++k) half_of_[order[k]] = k < half ? 0 : 1;
    in_half_ = half * block;
  }
  std::size_t frames() const override { return 2 * in_half_; }
  std::size_t in_half() const { return in_half_; }
  Shape shape() const override { return all_.shape(); }
  void visit(const std::function<void(std::size_t, const CountImage&)>& take) const override {
    std::size_t k = 0;
    for (const int half : {0, 1})
      all_.visit([&](std::size_t n, const CountImage& frame) {
        if (n / block_ < half_of_.size() && half_of_[n / block_] == half) take(k++, frame);
      });
  }

 private:
  const FrameSequence& all_;
  std::size_t block_, in_half_ = 0;
  std::vector<int> half_of_;
};

}  // namespace

std::size_t block_of_halves(std::size_t frames) {
  return std::max<std::size_t>(1, frames / blocks_of_stack);
}

Eigen::MatrixXd differences_of_halves(const FrameSequence& frames, const StackPlan& plan, int count) {
  std::vector<Eigen::VectorXd> rows(static_cast<std::size_t>(count));
  parallel_for(count, plan.threads, 1, [&](int n) {
    const InHalves halves(frames, block_of_halves(frames.frames()), plan.seed, n);
    const BatteryValues values = measure(plan.model, halves, nullptr, {halves.in_half()});
    if (plan.check_in) plan.check_in();
    rows[static_cast<std::size_t>(n)] = as_vector(values.part[0]) - as_vector(values.part[1]);
  });
  Eigen::MatrixXd differences(count, rows.front().size());
  for (int n = 0; n < count; ++n) differences.row(n) = rows[static_cast<std::size_t>(n)].transpose();
  return differences;
}

Eigen::VectorXd scatter_of(const Eigen::MatrixXd& differences) {
  Eigen::VectorXd scatter = Eigen::VectorXd::Zero(differences.cols());
  for (Eigen::Index i = 0; i < differences.cols(); ++i) {
    std::vector<double> sizes;
    for (Eigen::Index n = 0; n < differences.rows(); ++n)
      if (std::isfinite(differences(n, i))) sizes.push_back(differences(n, i));
    if (sizes.size() < 8) continue;
    const auto at = [&](double q) {
      const auto k = static_cast<std::ptrdiff_t>(q * static_cast<double>(sizes.size() - 1) + 0.5);
      std::nth_element(sizes.begin(), sizes.begin() + k, sizes.end());
      return sizes[static_cast<std::size_t>(k)];
    };
    const double middle = at(0.5);
    for (double& value : sizes) value = std::fabs(value - middle);
    // Rare large values: the largest counts as 4, as in a Standard.
    scatter(i) = std::max({1.4826 * at(0.5), at(0.9) / 1.645, at(0.985) / 2.43, at(1) / 4});
  }
  return scatter;
}

}  // namespace atomcam
