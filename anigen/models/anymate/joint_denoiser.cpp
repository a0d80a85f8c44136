#include "anigen/models/anymate/joint_denoiser.h"

#include <string>
#include <vector>

#include "anigen/models/anymate/checks.h"
#include "anigen/nn/kept_contexts.h"
#include "anigen/nn/timestep_embedder.h"

namespace anigen::models::anymate {

DenoisingTerm denoising_term(JointDenoiserImpl& model, const DdimSchedule& schedule, const Tensor& joints,
                             const Tensor& latents, const Tensor& noise, const Tensor& t) {
  require_shape(joints, {-1, -1, 3}, "joints");
  DenoisingTerm term;
  term.noisy = schedule.noisy(joints, noise, t).transpose(1, 2);
  term.predicted = model.forward(term.noisy, t, latents);
  term.loss = torch::mse_loss(term.predicted, noise.transpose(1, 2));
  return term;
}

DenoisingTerm denoising_term(JointDenoiserImpl& model, const DdimSchedule& schedule, const Tensor& joints,
                             const Tensor& latents) {
  require_shape(joints, {-1, -1, 3}, "joints");
  const Tensor t = torch::randint(schedule.train_steps(), {joints.size(0)}, torch::kInt64).to(joints.device());
  return denoising_term(model, schedule, joints, latents, torch::randn_like(joints), t);
}

Tensor sample_joints(JointDenoiserImpl& model, const DdimSchedule& schedule, const Tensor& latents, const Tensor& noise,
                     const DdimSampling& sampling) {
  require_shape(noise, {-1, -1, 3}, "noise");
  const torch::NoGradGuard no_grad;
  const nn::KeptContexts contexts;  // what a network makes of the latents is the same at every step
  const std::int64_t steps = sampling.steps > 0 ? sampling.steps : schedule.train_steps();
  const std::vector<std::int64_t> times = schedule.timesteps(steps);
  Tensor x = noise.transpose(1, 2);
  for (std::size_t i = 0; i < times.size(); ++i) {
    const Tensor t = torch::full({1}, times[i], torch::TensorOptions().dtype(torch::kInt64).device(x.device()));
    x = schedule.step(x, model.forward(x, t, latents), times[i], schedule.train_steps() / steps).previous;
    if (sampling.progress) sampling.progress(static_cast<std::int64_t>(i) + 1, steps);
  }
  return x.transpose(1, 2).contiguous();
}

Tensor level_features(const Tensor& t, std::int64_t items, std::int64_t width) {
  require(t.defined() && (t.numel() == 1 || t.numel() == items), "t",
          "must be one number, or one for each of " + std::to_string(items) + " items");
  return nn::timestep_features(t.flatten(), width).expand({items, width});
}

}  // namespace anigen::models::anymate
