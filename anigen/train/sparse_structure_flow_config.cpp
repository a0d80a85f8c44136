#include "anigen/models/sparse_structure_runs.h"
#include "anigen/train/flow_stage_config.h"
#include "anigen/train/sparse_structure_flow_stage.h"

// From a config to the stage; what the stage does is in sparse_structure_flow_stage.cpp.
namespace anigen::train {
namespace {

const FlowConfigNames& structure_names() {
  static const FlowConfigNames names{{models::kSparseStructureFlowClass},
                                     "AniGenImageConditionedFlowMatchingCFGTrainer",
                                     "ImageConditionedAniGenSparseStructureLatent",
                                     "AniGenSparseStructureLatent"};
  return names;
}

}  // namespace

std::unique_ptr<Stage> make_sparse_structure_flow_stage(const Json& config, const std::string& file,
                                                        ConfigReader& trainer_args, const TrainerOptions& trainer,
                                                        torch::Device device) {
  models::SparseStructureFlowStageOptions options = models::SparseStructureFlowStageOptions::read(trainer_args);
  options.seed = trainer.seed;
  auto parts = flow_parts<SparseStructureFlowStage>(config, file, trainer_args, trainer, device, structure_names());
  const loaders::StructureLatentOptions& reading = parts.data->options();
  if (const auto decoder = samples_decoder(reading.ss_dec_path, reading.ss_dec_ckpt,
                                           models::kSparseStructureDecoderClass, "ss_dec_path", trainer)) {
    parts.decoder = models::load_sparse_structure_decoder(*decoder, device);
  }
  return std::make_unique<SparseStructureFlowStage>(options, std::move(parts));
}

}  // namespace anigen::train
