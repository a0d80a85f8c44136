#include "anigen/train/stages/flow_stage.h"

#include <algorithm>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/flow/matching.h"

namespace anigen::train {

using torch::Tensor;

LatentDenoising LatentDenoising::read(ConfigReader& args, const std::string& suffix) {
  LatentDenoising noise;
  noise.enabled = args.boolean("latent_denoising" + suffix, noise.enabled);
  noise.gamma = args.number("latent_denoising_gamma" + suffix, noise.gamma, 0.0);
  noise.time_max = args.number("latent_time_max" + suffix, noise.time_max, 0.0, 1.0);
  noise.ramp_steps = args.integer("latent_achive_max_step" + suffix, noise.ramp_steps, 0);
  return noise;
}

double LatentDenoising::time_max_at(std::int64_t step) const {
  if (ramp_steps == 0) return time_max;
  return std::min(1.0, static_cast<double>(step) / static_cast<double>(ramp_steps)) * time_max;
}

Tensor latent_times(const Tensor& u, double time_max, double cut) {
  return (1.0 - torch::sqrt((1.0 - u).clamp_min(cut))) * time_max;
}

Tensor mix_latent_noise(const Tensor& z, const Tensor& noise, const Tensor& times, double gamma) {
  if (z.dim() < 1 || times.dim() != 1 || times.size(0) != z.size(0) || noise.sizes() != z.sizes()) {
    throw InputError("", "", "latent noise needs one draw per entry and one time per row");
  }
  std::vector<std::int64_t> column(static_cast<std::size_t>(z.dim()), 1);
  column.front() = z.size(0);
  const Tensor t = times.to(z.options()).view(column);
  return (1.0 - t) * z + t * gamma * noise.to(z.options());
}

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
  const torch::Tensor means = flow::mean_per_time_bin(errors.detach(), t);
  const torch::Tensor filled = torch::isfinite(means).to(torch::kCPU);
  for (std::int64_t bin = 0; bin < means.size(0); ++bin) {
    if (filled[bin].item<bool>()) losses.terms.emplace_back("bin_" + std::to_string(bin) + "." + name, means[bin]);
  }
}

}  // namespace anigen::train
