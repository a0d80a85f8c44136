#include "anigen/train/stages/stages.h"

#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/text.h"

namespace anigen::train {

std::unique_ptr<Stage> make_stage(const std::string& trainer_name, const StageRequest& request) {
  using Make = std::unique_ptr<Stage> (*)(const StageRequest&);
  constexpr std::pair<const char*, Make> kTrainers[] = {
      {"AniGenSkinAETrainer", make_skin_autoencoder_stage},
      {"AniGenSparseStructureVaeTrainer", make_sparse_structure_autoencoder_stage},
      {"AniGenSLatVaeSkeletonTrainer", make_structured_latent_autoencoder_stage},
      {"AniGenImageConditionedFlowMatchingCFGTrainer", make_sparse_structure_flow_stage},
      {"AniGenFlowMatchingTrainer", make_sparse_structure_flow_stage},
      {"AniGenFlowMatchingCFGTrainer", make_sparse_structure_flow_stage},
      {"AniGenImageConditionedSparseFlowMatchingCFGTrainer", make_structured_latent_flow_stage},
      {"AniGenSparseFlowMatchingTrainer", make_structured_latent_flow_stage},
      {"AniGenSparseFlowMatchingCFGTrainer", make_structured_latent_flow_stage},
      {"AniGenPictureEstimatorTrainer", make_picture_estimator_stage},
      {"AniGenMattingTrainer", make_matting_stage},
      {"AniGenSkinCorrectionTrainer", make_skin_correction_stage},
      {"AnymateTrainer", make_anymate_stage},
      {"RignetTrainer", make_rignet_stage},
  };
  for (const auto& [name, make] : kTrainers) {
    if (trainer_name == name) return make(request);
  }
  throw NotSupportedError(request.file, "/trainer/name",
                          "trainer '" + trainer_name.substr(0, 80) + "'; this build trains " +
                              joined(kTrainers, ", ", &std::pair<const char*, Make>::first));
}

std::vector<torch::Tensor> on_device(const std::vector<torch::Tensor>& tensors, torch::Device device,
                                     std::optional<torch::Dtype> dtype) {
  std::vector<torch::Tensor> there;
  for (const torch::Tensor& tensor : tensors)
    there.push_back(nn::to_device(tensor, device).to(dtype.value_or(tensor.scalar_type())));
  return there;
}

}  // namespace anigen::train
