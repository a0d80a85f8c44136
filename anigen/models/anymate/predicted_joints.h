#pragma once
#include "anigen/models/anymate/model.h"

namespace anigen::models::anymate {

/// What predicted_joints needs beside a model; each kind of decoder looks at its own part.
struct JointPrediction {
  double eps = 0.0;                    ///< joints this near become one; 0: as released, 0.03 regressed, 0.05 denoised
  std::int64_t denoised_joints = 128;  ///< how many a denoiser starts from
  std::int64_t train_steps = 100;      ///< levels of noise that it was trained with
  Tensor noise;                        ///< [1, denoised_joints, 3] standard normal draws; only a denoiser needs them
  Tensor cells;                        ///< [V, 3] integers in [0, 64): where a field is asked about; only it needs them
};

/// The joints of one shape by whichever decoder for joints the model has, merged as at inference (reference
/// anymate-baselines.md, 3). No gradient is recorded.
/// @param latents [1, ...], of AnymateModelImpl::encode @return [J, 3] fp32 on the CPU; a field may have none
/// @throws InputError for a decoder of another task, shapes, and noise or cells that are missing
Tensor predicted_joints(AnymateModelImpl& model, const Tensor& latents, const JointPrediction& options = {});

}  // namespace anigen::models::anymate
