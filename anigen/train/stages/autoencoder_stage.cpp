#include "anigen/train/stages/autoencoder_stage.h"

#include "anigen/core/error.h"
#include "anigen/core/log.h"

namespace anigen::train {

using torch::Tensor;

void LatentDenoising::fields(ConfigFields& f, const std::string& suffix) {
  f("latent_denoising" + suffix, enabled);
  f("latent_denoising_gamma" + suffix, gamma, {0.0});
  f("latent_time_max" + suffix, time_max, {0.0, 1.0});
  f("latent_achive_max_step" + suffix, ramp_steps, {0});
}

double LatentDenoising::time_max_at(std::int64_t step) const {
  if (ramp_steps == 0) return time_max;
  return std::min(1.0, static_cast<double>(step) / static_cast<double>(ramp_steps)) * time_max;
}

Tensor latent_times(const Tensor& u, double time_max, double cut) {
  return (1.0 - torch::sqrt((1.0 - u).clamp_min(cut))) * time_max;
}

Tensor mix_latent_noise(const Tensor& z, const Tensor& noise, const Tensor& times, double gamma) {
  if (z.dim() < 1 || times.dim() != 1 || times.size(0) != z.size(0) || noise.sizes() != z.sizes())
    throw InputError("", "", "latent noise needs one draw per entry and one time per row");
  std::vector<std::int64_t> column(static_cast<std::size_t>(z.dim()), 1);
  column.front() = z.size(0);
  const Tensor t = times.to(z.options()).view(column);
  return (1.0 - t) * z + t * gamma * noise.to(z.options());
}

Tensor normal_draws(torch::IntArrayRef shape, const at::Generator& generator, torch::Device device) {
  return nn::to_device(torch::randn(shape, generator, torch::TensorOptions(torch::kFloat32)), device);
}

data::Datasets autoencoder_datasets(ConfigReader& top, const char* class_name, std::uint64_t seed) {
  ConfigReader dataset = top.object("dataset");
  dataset.require("name");
  dataset.choice("name", "", {class_name});
  data::Datasets data = data::make_datasets(top.object("dataset"), seed);
  log::info("{} samples an epoch to train on, {} assets held out", data.train->size(),
            data.eval ? data.eval->size() : 0);
  return data;
}

}  // namespace anigen::train
