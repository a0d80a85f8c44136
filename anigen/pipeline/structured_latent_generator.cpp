#include "anigen/pipeline/structured_latent_generator.h"

#include "anigen/core/config_reader.h"
#include "anigen/core/error.h"
#include "anigen/features/trained_condition_encoder.h"
#include "anigen/loaders/latent_normalization.h"
#include "anigen/models/structured_latent_flow_runs.h"
#include "anigen/pipeline/conditioned_reading.h"
#include "anigen/pipeline/device.h"

namespace anigen::pipeline {
namespace {

using torch::Tensor;

models::StructuredLatentFlowStageOptions training_options(const models::RunModel& flow) {
  ConfigReader top(flow.run, flow.config.string());
  ConfigReader args = top.object("trainer").object("args");
  return models::StructuredLatentFlowStageOptions::read(args);
}

}  // namespace

StructuredLatentGenerator::StructuredLatentGenerator(const Request& request)
    : device_(parse_device(request.device)),
      run_(request.run),
      flow_(models::find_flow_model(request.run,
                                    {models::kStructuredLatentFlowClass, models::kPlainStructuredLatentFlowClass},
                                    request.ckpt, request.averages)),
      reading_(conditioned_reading<loaders::StructuredLatentOptions>(flow_, "AniGenImageConditionedSLat")),
      training_(training_options(flow_)) {
  model_ = models::load_structured_latent_flow(flow_, device_);
  if (request.precision != torch::kFloat32) model_->set_compute_dtype(request.precision);
}

Tensor StructuredLatentGenerator::condition(const Tensor& pictures) {
  const torch::NoGradGuard no_grad;
  if (!encoder_) {
    encoder_ =
        features::trained_condition_encoder(run_, flow_, reading_.image_size, model_->options().cond_channels, device_);
  }
  return encoder_->tokens(pictures);
}

flow::Streams StructuredLatentGenerator::noise(const sparse::Support& shape, const sparse::Support& skeleton,
                                               const at::Generator& generator) const {
  flow::Streams streams =
      models::structured_latent_noise(model_->options(), shape, skeleton, training_.smoothing, generator);
  for (Tensor& stream : streams) stream = stream.to(device_);
  return streams;
}

models::PerStream<sparse::SparseTensor> StructuredLatentGenerator::sample(const flow::Streams& noise,
                                                                          const models::StructuredLatentTarget& target,
                                                                          const flow::SamplerOptions& sampler,
                                                                          bool guided,
                                                                          const flow::SamplingExtras& extras) {
  const torch::NoGradGuard no_grad;
  const flow::Velocities velocities = models::structured_latent_velocities(model_, target, guided);
  const flow::Streams latents = flow::sample_flow(noise, velocities, sampler, extras).samples;
  const Tensor shape = loaders::denormalised(latents[0], reading_.normalization);
  const Tensor skeleton = loaders::denormalised(latents[1], reading_.normalization_skl);
  const std::int64_t geometry = model_->options().geometry.out_channels;
  return {{target.shape, shape.slice(1, 0, geometry).contiguous()},
          {target.shape, shape.slice(1, geometry).contiguous()},
          {target.skeleton, skeleton}};
}

}  // namespace anigen::pipeline
