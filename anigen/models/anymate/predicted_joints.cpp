#include "anigen/models/anymate/predicted_joints.h"

#include "anigen/models/anymate/checks.h"
#include "anigen/models/anymate/dbscan.h"
#include "anigen/models/anymate/joint_denoiser.h"
#include "anigen/models/anymate/joint_regression.h"
#include "anigen/models/anymate/joint_volume.h"

namespace anigen::models::anymate {
namespace {

constexpr double kRegressedEps = 0.03, kDenoisedEps = 0.05;

DbscanOptions merging(double wanted, double released) { return {wanted > 0.0 ? wanted : released, 1}; }

}  // namespace

Tensor predicted_joints(AnymateModelImpl& model, const Tensor& latents, const JointPrediction& options) {
  require(latents.defined() && latents.dim() >= 2 && latents.size(0) == 1, "latents", "must be of one shape");
  const torch::NoGradGuard no_grad;
  switch (task_of(model.options().decoder)) {
    case Task::kJointRegression: {
      const Tensor joints = model.decoder<JointRegressionImpl>().forward(latents)[0];
      return merged_joints(joints, merging(options.eps, kRegressedEps)).to(torch::kFloat32);
    }
    case Task::kDenoisedJoints: {
      require_shape(options.noise, {1, -1, 3}, "noise");
      const DdimSchedule schedule(options.train_steps);
      const Tensor joints = sample_joints(model.decoder<JointDenoiserImpl>(), schedule, latents, options.noise)[0];
      return merged_joints(joints, merging(options.eps, kDenoisedEps)).to(torch::kFloat32);
    }
    case Task::kJointVolume: {
      require_shape(options.cells, {-1, 3}, "cells");
      const Tensor field = joint_volume(model.decoder<JointVolumeImpl>(), latents, options.cells);
      return joint_key_points(field, options.cells).to(torch::kFloat32);
    }
    default:
      throw InputError("", "decoder", "'" + name_of(model.options().decoder) + "' does not predict joints");
  }
}

}  // namespace anigen::models::anymate
