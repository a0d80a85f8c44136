#pragma once
#include <memory>
#include <string>

#include "anigen/data/datasets.h"
#include "anigen/sparse_structure/autoencoder.h"
#include "anigen/sparse_structure/flow.h"
#include "anigen/train/options.h"
#include "anigen/train/stages/flow_stage.h"

namespace anigen::train {

/// Stage 4: the sparse-structure flow learns the velocity from noise to the latents of stage 2 (paper 3.3.3). One time
/// per item, shared by both streams, independent noise; L = mse + mse_skl. Terms: "mse", "mse_skl", and both for every
/// tenth of the time axis that a micro-batch has items in, "bin_0.mse" … "bin_9.mse_skl".
///
/// Evaluation on held-out assets: "mse" and "mse_skl" at the times (k + ½) / eval_times with fixed noise and condition
/// views, the mean over assets and times. The same draws at every evaluation, so that its numbers can be compared.
class SparseStructureFlowStage : public FlowStage<sparse_structure::SparseStructureFlow, data::StructureLatentDataset,
                                                  sparse_structure::SparseStructureDecoder> {
 public:
  SparseStructureFlowStage(const sparse_structure::SparseStructureFlowStageOptions& options, Parts parts);

  Losses losses(const data::Batch& batch, const LossContext& context) override;
  Values evaluate() override;
  /// Writes samples.png: for some held-out assets (or training assets, where none is held out) the condition picture, a
  /// sample with and one without guidance, and the asset's own latents decoded. From fixed noise.
  void sample(const std::filesystem::path& folder) override;
  std::unique_ptr<Stage> replica() const override;

 private:
  // Squared error of each item of a batch, [B] per stream.
  struct ItemErrors {
    torch::Tensor shape, skeleton;
  };
  ItemErrors errors(const data::StructureLatentBatch& latents, const torch::Tensor& t, const torch::Tensor& noise,
                    const torch::Tensor& noise_skl, const torch::Tensor& condition);
  flow::Streams drawn_sample(const flow::Streams& noise, const torch::Tensor& condition, bool guided);

  sparse_structure::SparseStructureFlowStageOptions options_;
};

/// The stage of a config whose trainer is AniGenImageConditionedFlowMatchingCFGTrainer, or AniGenFlowMatchingTrainer or
/// AniGenFlowMatchingCFGTrainer, which learn the same without pictures.
/// @param trainer the options already read from the same config @throws InputError naming file and JSON pointer
std::unique_ptr<Stage> make_sparse_structure_flow_stage(const Json& config, const std::string& file,
                                                        ConfigReader& trainer_args, const TrainerOptions& trainer,
                                                        torch::Device device);

}  // namespace anigen::train
