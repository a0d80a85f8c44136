#include "anigen/structured_latent/sampling.h"

#include <utility>

namespace anigen::structured_latent {

using torch::Tensor;

void StructuredLatentFlowStageOptions::fields(ConfigFields& f) {
  flow_fields(f, /*cfg_strength=*/3.0);
  f("use_joint_num_cond", use_joint_num_cond);
  f("p_uncond_joint_num", p_uncond_joint_num, {0.0, 1.0});
  f("lambda_votes", lambda_votes, {0.0});
  f("lambda_rig_features", lambda_rig_features, {0.0});
  f("rig_time", rig_time, {0.0, 1.0});
  smoothing.fields(f);
}

flow::Velocities structured_latent_velocities(StructuredLatentFlow model, const StructuredLatentTarget& target,
                                              bool guided) {
  const auto velocity_under = [model = std::move(model), target](const Tensor& tokens, const Tensor& joints_num) {
    return [model, target, tokens, joints_num](const flow::Streams& x, float time) mutable {
      const Tensor t = torch::full({target.shape->items().items()}, time, x[0].options());
      const StructuredVelocity velocity =
          model->forward({target.shape, x[0]}, {target.skeleton, x[1]}, t, tokens, joints_num);
      return flow::Streams{velocity.x.feats, velocity.x_skl.feats};
    };
  };
  flow::Velocities velocities;
  velocities.conditional = velocity_under(target.tokens, target.joints_num);
  if (guided) {
    const Tensor none = target.joints_num.defined() ? torch::zeros_like(target.joints_num) : Tensor();
    velocities.unconditional = velocity_under(torch::zeros_like(target.tokens), none);
  }
  return velocities;
}

Tensor shape_latent_noise(const StructuredLatentFlowOptions& model, const sparse::Support& shape,
                          const flow::GeodesicNoiseOptions& smoothing, const at::Generator& generator) {
  const std::int64_t geometry = model.geometry.in_channels, channels = geometry + model.skin.in_channels;
  const Tensor noise = torch::randn({shape.size(), channels}, generator);
  return flow::smooth_geodesic_noise(noise, shape.coords(), geometry, channels, smoothing);
}

flow::Streams structured_latent_noise(const StructuredLatentFlowOptions& model, const sparse::Support& shape,
                                      const sparse::Support& skeleton, const flow::GeodesicNoiseOptions& smoothing,
                                      const at::Generator& generator) {
  Tensor noise = shape_latent_noise(model, shape, smoothing, generator);
  return {std::move(noise), torch::randn({skeleton.size(), model.skeleton.in_channels}, generator)};
}

}  // namespace anigen::structured_latent
