#include "anigen/train/stages.h"

#include "anigen/core/error.h"
#include "anigen/train/anymate_stage.h"
#include "anigen/train/rignet_stage.h"
#include "anigen/train/skin_autoencoder_stage.h"
#include "anigen/train/sparse_structure_autoencoder_stage.h"
#include "anigen/train/sparse_structure_flow_stage.h"
#include "anigen/train/structured_latent_autoencoder_stage.h"
#include "anigen/train/structured_latent_flow_stage.h"

namespace anigen::train {
namespace {

using StageFactory = std::unique_ptr<Stage> (*)(const Json& config, const std::string& file, ConfigReader& trainer_args,
                                                const TrainerOptions& trainer, torch::Device device);

struct TrainerEntry {
  const char* name;
  StageFactory make;
};

constexpr TrainerEntry kTrainers[] = {
    {"AniGenSkinAETrainer", make_skin_autoencoder_stage},
    {"AniGenSparseStructureVaeTrainer", make_sparse_structure_autoencoder_stage},
    {"AniGenSLatVaeSkeletonTrainer", make_structured_latent_autoencoder_stage},
    {"AniGenImageConditionedFlowMatchingCFGTrainer", make_sparse_structure_flow_stage},
    {"AniGenFlowMatchingTrainer", make_sparse_structure_flow_stage},
    {"AniGenFlowMatchingCFGTrainer", make_sparse_structure_flow_stage},
    {"AniGenImageConditionedSparseFlowMatchingCFGTrainer", make_structured_latent_flow_stage},
    {"AniGenSparseFlowMatchingTrainer", make_structured_latent_flow_stage},
    {"AniGenSparseFlowMatchingCFGTrainer", make_structured_latent_flow_stage},
    {"AnymateTrainer", make_anymate_stage},
    {"RignetTrainer", make_rignet_stage},
};

}  // namespace

std::vector<std::string> trainer_names() {
  std::vector<std::string> names;
  for (const TrainerEntry& entry : kTrainers) names.emplace_back(entry.name);
  return names;
}

std::unique_ptr<Stage> make_stage(const std::string& trainer_name, const Json& config, const std::string& file,
                                  ConfigReader& trainer_args, const TrainerOptions& trainer, torch::Device device) {
  for (const TrainerEntry& entry : kTrainers) {
    if (trainer_name == entry.name) return entry.make(config, file, trainer_args, trainer, device);
  }
  std::string known;
  for (const std::string& name : trainer_names()) known += (known.empty() ? "" : ", ") + name;
  throw NotSupportedError(file, "/trainer/name",
                          "trainer '" + trainer_name.substr(0, 80) + "'; this build trains " + known);
}

}  // namespace anigen::train
