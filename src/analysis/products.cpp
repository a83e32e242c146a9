#include "analysis/products.hpp"

#include "analysis/lanes.hpp"

namespace atomcam::analysis {

ATOMCAM_VECTOR_CLONES
double sum_of_products(std::size_t n, const float* a, const float* b) {
  Lanes sum = lanes(0);
  for (std::size_t i = 0; i < n; i += lane_count) sum += load(a + i) * load(b + i);
  return total(sum);
}

}  // namespace atomcam::analysis
