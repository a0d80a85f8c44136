#pragma once
#include <memory>
#include <string>

#include "anigen/data/datasets.h"
#include "anigen/structured_latent/decoder.h"
#include "anigen/structured_latent/flow.h"
#include "anigen/structured_latent/sampling.h"
#include "anigen/train/options.h"
#include "anigen/train/stages/flow_stage.h"

namespace anigen::train {

/// Stage 5: the structured-latent flow learns the velocity from noise to the latents of stage 3 on their voxels (paper
/// 3.4). One time per item, shared by all streams, independent noise; L = mse + mse_skl, where `mse` is the mean over
/// geometry and skin channels together, and means are over the voxels of the micro-batch: large assets weigh more, as
/// published. Terms: "mse", "mse_skl"; the parts "mse_geo" and "mse_skin" of the first; the first two per item for
/// every tenth of the time axis that a micro-batch has items in, "bin_0.mse" … "bin_9.mse_skl".
///
/// Evaluation on held-out assets: "mse", "mse_geo", "mse_skin" and "mse_skl" at the times (k + ½) / eval_times with
/// fixed noise and condition views and the asset's number of joints, the mean over assets and times. The same draws at
/// every evaluation, so that its numbers can be compared.
class StructuredLatentFlowStage
    : public FlowStage<structured_latent::StructuredLatentFlow, data::StructuredLatentDataset,
                       structured_latent::StructuredLatentDecoder> {
 public:
  StructuredLatentFlowStage(const structured_latent::StructuredLatentFlowStageOptions& options, Parts parts);

  Losses losses(const data::Batch& batch, const LossContext& context) override;
  Values evaluate() override;
  /// Writes samples.png: for some held-out assets (or training assets, where none is held out) the condition picture, a
  /// guided sample on the asset's own voxels, decoded, with its grouped skeleton and with its weights, the asset's own
  /// latents decoded likewise, and the asset. From fixed noise.
  void sample(const std::filesystem::path& folder) override;
  std::unique_ptr<Stage> replica() const override;

 private:
  // The latents of a batch, on the device.
  struct Latents {
    sparse::SparseTensor shape, skeleton;
    torch::Tensor joints_num;  // [B]; undefined where the model is told nothing
  };
  // Squared errors of a batch, [N, C] and [M, C'].
  struct Errors {
    torch::Tensor shape, skeleton;
  };
  Latents latents_of(const data::StructuredLatentBatch& batch) const;
  Errors errors(const Latents& latents, const torch::Tensor& t, const flow::Streams& noise,
                const torch::Tensor& condition);
  // Geometry and skin channels of errors.
  torch::Tensor geometry_channels(const torch::Tensor& shape) const;
  torch::Tensor skin_channels(const torch::Tensor& shape) const;
  flow::Streams drawn_sample(const Latents& latents, const torch::Tensor& condition, std::uint64_t number);

  structured_latent::StructuredLatentFlowStageOptions options_;
};

/// The stage of a config whose trainer is AniGenImageConditionedSparseFlowMatchingCFGTrainer, or
/// AniGenSparseFlowMatchingTrainer or AniGenSparseFlowMatchingCFGTrainer, which learn the same without pictures.
/// @param trainer the options already read from the same config @throws InputError naming file and JSON pointer: also
/// for models, dataset and decoder whose channels do not fit each other
std::unique_ptr<Stage> make_structured_latent_flow_stage(const Json& config, const std::string& file,
                                                         ConfigReader& trainer_args, const TrainerOptions& trainer,
                                                         torch::Device device);

}  // namespace anigen::train
