#include "anigen/apps/common/torch_half.h"

#include "anigen/apps/with_torch/programs.h"
#include "anigen/eval/comparison/evaluate_command.h"
#include "anigen/eval/skin_command.h"
#include "anigen/features/feature_models.h"
#include "anigen/nn/blas.h"
#include "anigen/pipeline/run_weights.h"
#include "anigen/rig/rig_meshes.h"

namespace anigen {
namespace {

std::string describe_weights(const std::string& run, Json& description) {
  description["weights"] = pipeline::describe_weights(run);
  return pipeline::first_incomplete(description["weights"]);
}

}  // namespace

/// The entry that torch_half() looks for.
extern "C" __attribute__((visibility("default"))) const TorchHalf* anigen_torch_half() {
  static const TorchHalf half{
      nn::version_details,
      run_encode,
      run_generate,
      run_train,
      retrieve,
      learned_steps,
      add_perceptual_metric,
      skin_reconstruction,
      evaluate_structures,
      describe_weights,
      features::make_feature_extractor,
  };
  return &half;
}

}  // namespace anigen
