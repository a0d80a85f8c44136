#include "anigen/models/normal_estimator/convex_upsampling.h"

#include "anigen/models/normal_estimator/normal_propagation.h"

namespace anigen::models {

Tensor convex_upsampling(const Tensor& x, const Tensor& mask) {
  constexpr std::int64_t kFactor = 8, kNeighbors = 9;
  const std::int64_t batch = x.size(0), channels = x.size(1), height = x.size(2), width = x.size(3);
  const Tensor shares = mask.view({batch, kNeighbors, kFactor, kFactor, height, width}).softmax(1);
  const Tensor around = neighborhood(x, 1);
  Tensor fine = torch::zeros({batch, channels, kFactor, kFactor, height, width}, x.options());
  for (std::int64_t q = 0; q < kNeighbors; ++q) {
    const Tensor value = around.select(2, q).view({batch, channels, 1, 1, height, width});
    fine.addcmul_(shares.select(1, q).unsqueeze(1), value);
  }
  return fine.permute({0, 1, 4, 2, 5, 3}).reshape({batch, channels, height * kFactor, width * kFactor});
}

}  // namespace anigen::models
