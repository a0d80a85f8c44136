#pragma once
#include "anigen/core/config.h"

namespace anigen::train {

/// Fills in the arguments that `"compatibility": "paper"` in `trainer.args` stands for and that the config does not
/// give itself (docs/divergences.md), so that the config in a run folder says them to whoever uses the run's models:
///  - AniGenSparseStructureVaeTrainer: deterministic latents of ℓ1 norm 1 in both streams, noise on both
///  - AniGenSLatVaeSkeletonTrainer: `geometry_latent` "dae", noise on all three latents
///  - AnymateTrainer, of a model of connectivity: `children` "columns", `connectivity_loss` "bce"
///
/// The largest share of noise rises to 0.75 over the whole training. A shape branch that is frozen keeps its latents:
/// its pretrained weights know no others. Any other config stays as it is, and so does what is no object where one
/// belongs, which those who read the config then refuse.
void fill_in_paper_variants(Json& config);

}  // namespace anigen::train
