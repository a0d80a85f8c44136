#include "anigen/flow/time_bins.h"

#include <limits>

namespace anigen::flow {

Tensor time_bin(const Tensor& t, std::int64_t bins) {
  const Tensor edges = torch::linspace(0.0, 1.0, bins + 1, torch::kFloat64);
  const Tensor times = t.detach().to(torch::kCPU, torch::kFloat64).contiguous();
  return torch::bucketize(times, edges, /*out_int32=*/false, /*right=*/true) - 1;
}

Tensor mean_per_time_bin(const Tensor& values, const Tensor& t, std::int64_t bins) {
  const Tensor bin = time_bin(t, bins), list = values.detach().to(torch::kCPU, torch::kFloat64);
  Tensor means = torch::full({bins}, std::numeric_limits<double>::quiet_NaN(), torch::kFloat64);
  for (std::int64_t b = 0; b < bins; ++b) {
    const Tensor inside = list.masked_select(bin == b);
    if (inside.numel() > 0) means[b] = inside.mean();
  }
  return means;
}

Tensor mse_per_item(const Tensor& prediction, const Tensor& target) {
  const torch::Dtype wide = nn::accumulation_dtype(nn::dtype_of(prediction));
  return (prediction.to(wide) - target.to(wide)).square().flatten(1).mean(1);
}

Tensor mean_per_item(const Tensor& rows, const Tensor& item, std::int64_t items) {
  const Tensor sums = torch::zeros({items}, rows.options()).index_add(0, item, rows.mean(1));
  return sums / torch::bincount(item, {}, items).clamp_min(1).to(rows.options());
}

}  // namespace anigen::flow
