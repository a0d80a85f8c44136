#pragma once
#include <cstdint>

#include "anigen/core/config_fields.h"

namespace anigen::train {

/// Arguments of RignetTrainer beside those all trainers share (docs/reference/rignet.md).
struct RignetStageOptions : JsonOptions<RignetStageOptions> {
  /// Of joints: the step from which mean shift is part of the loss. Before it JointNet and MaskNet learn apart, as in
  /// the published pre-training, each its own term; from it on the loss is chamfer + 2 clusters + 0.1 attention.
  std::int64_t clustering_from = 0;
  std::int64_t mean_shifts = 15;
  double clustering_weight = 2.0, attention_weight = 0.1;  ///< then
  std::int64_t eval_max_assets = 0;                        ///< held-out assets to look at; 0: all

  void fields(ConfigFields& f);
};

}  // namespace anigen::train
