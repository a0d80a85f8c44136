#include "anigen/train/stages/flow_stage.h"

namespace anigen::train {

std::optional<nn::RunModel> samples_decoder(const std::string& path, const std::string& ckpt,
                                            const std::string& class_name, const std::string& key,
                                            const TrainerOptions& trainer) {
  if (trainer.i_sample <= 0) return std::nullopt;
  if (path.empty()) {
    log::info("dataset.args.{} names no run: no samples will be drawn", key);
    return std::nullopt;
  }
  nn::RunModel found = nn::find_run_model(path, class_name, ckpt);
  log::info("samples are decoded by {}", found.checkpoint.string());
  return found;
}

void add_time_bins(Losses& losses, const std::string& name, const torch::Tensor& errors, const torch::Tensor& t) {
  const torch::Tensor means = flow::mean_per_time_bin(errors.detach(), t), bins = flow::time_bin(t);
  for (std::int64_t bin = 0; bin < means.size(0); ++bin) {
    if ((bins == bin).any().item<bool>())
      losses.terms.emplace_back("bin_" + std::to_string(bin) + "." + name, means[bin]);
  }
}

}  // namespace anigen::train
