#include "anigen/train/latent_scale.h"

#include <vector>

namespace anigen::train {

using torch::Tensor;

Tensor denormalised(const Tensor& x, const loaders::ChannelStatistics& statistics) {
  if (statistics.empty()) return x;
  std::vector<std::int64_t> per_channel(static_cast<std::size_t>(x.dim()), 1);
  per_channel[1] = -1;
  const Tensor mean = torch::tensor(statistics.mean).to(x.device()).view(per_channel);
  const Tensor deviation = torch::tensor(statistics.deviation).to(x.device()).view(per_channel);
  return x * deviation + mean;
}

}  // namespace anigen::train
