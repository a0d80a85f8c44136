#include "anigen/train/flow_stage.h"

#include "anigen/flow/time_bins.h"

namespace anigen::train {

void add_time_bins(Losses& losses, const std::string& name, const torch::Tensor& errors, const torch::Tensor& t) {
  const torch::Tensor means = flow::mean_per_time_bin(errors.detach(), t);
  const torch::Tensor filled = torch::isfinite(means).to(torch::kCPU);
  for (std::int64_t bin = 0; bin < means.size(0); ++bin) {
    if (filled[bin].item<bool>()) losses.terms.emplace_back("bin_" + std::to_string(bin) + "." + name, means[bin]);
  }
}

}  // namespace anigen::train
