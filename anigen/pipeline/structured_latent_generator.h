#pragma once
#include <filesystem>
#include <memory>
#include <string>

#include "anigen/features/condition_encoder.h"
#include "anigen/loaders/datasets/structured_latent_dataset.h"
#include "anigen/models/run_model.h"
#include "anigen/models/stream_coder.h"
#include "anigen/models/structured_latent_sampling.h"

namespace anigen::pipeline {

/// A trained structured-latent flow with its image encoder: pictures and the voxels of a shape and its skeleton become
/// structured latents (paper 3.4; reference flows-and-pipeline.md, 5.6).
class StructuredLatentGenerator {
 public:
  struct Request {
    std::filesystem::path run;  ///< run folder of stage 5, or a published one
    std::string ckpt;           ///< as models::find_flow_model
    models::Averages averages = models::Averages::kUsual;
    std::string device = "cpu";
    torch::Dtype precision = torch::kFloat32;  ///< of the torso
  };
  /// @throws InputError when the run is unusable, or the flow was trained without pictures
  explicit StructuredLatentGenerator(const Request& request);

  const models::RunModel& flow() const { return flow_; }
  const models::StructuredLatentFlowOptions& options() const { return model_->options(); }
  /// Of its dataset: the size and kind of its pictures, what normalises its latents, and the decoder's run.
  const loaders::StructuredLatentOptions& reading() const { return reading_; }
  const flow::SamplerOptions& sampler() const { return training_.sampler; }  ///< as its config samples

  /// @param pictures [B, 3, S, S] in [0, 1], S = reading().image_size @return [B, K, C]
  /// @throws InputError at the first call, when the image encoder or its weights are missing or do not fit
  torch::Tensor condition(const torch::Tensor& pictures);
  /// Standard normal noise of both streams as the generator gives it, shape first, smoothed where the config says so.
  flow::Streams noise(const sparse::Support& shape, const sparse::Support& skeleton,
                      const at::Generator& generator) const;
  /// Latents as the decoder takes them: what normalised them in training is undone.
  /// @param target voxels, tokens and joint counts @param progress see flow::SamplingExtras
  models::PerStream<sparse::SparseTensor> sample(const flow::Streams& noise,
                                                 const models::StructuredLatentTarget& target,
                                                 const flow::SamplerOptions& sampler, bool guided,
                                                 const flow::SamplingExtras& extras = {});

 private:
  torch::Device device_;
  std::filesystem::path run_;
  models::RunModel flow_;
  loaders::StructuredLatentOptions reading_;
  models::StructuredLatentFlowStageOptions training_;
  models::StructuredLatentFlow model_ = nullptr;
  std::unique_ptr<features::ConditionEncoder> encoder_;  // from the first condition() on
};

}  // namespace anigen::pipeline
