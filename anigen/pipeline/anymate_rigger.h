#pragma once
#include <cstddef>
#include <cstdint>

#include "anigen/loaders/anymate/anymate_mesh.h"
#include "anigen/pipeline/anymate_models.h"
#include "anigen/rig/rig_meshes.h"

namespace anigen::pipeline {

struct AnymateRiggerOptions {
  std::int64_t points = 0;             ///< of the surface that encoders look at; 0: as many as each was trained with
  double eps = 0.0;                    ///< joints this near become one, in a box of side 2; 0: as released
  std::uint64_t seed = 0;              ///< of the points, and of what a denoiser starts from
  std::size_t most_influences = 4;     ///< joints per vertex; 0: any number
  torch::Device device = torch::kCPU;  ///< where the models are
};

/// Anymate as a rigger of meshes (Deng et al. 2025; reference anymate-baselines.md, 5.3), any of its models missing.
/// Each mesh is looked at by itself: what it is given depends on the seed, not on the meshes before it.
class AnymateRigger {
 public:
  /// @throws InputError naming its file for a model that is for another task than its place, or needs more points
  AnymateRigger(AnymateModels models, const AnymateRiggerOptions& options);

  /// Joints and their tree. Joints are predicted and merged, or, without a model for them, those that `given` proposes.
  /// Parents are the likeliest tree (geometry/spanning_trees.h) under the model for connectivity; without one those
  /// given with the joints, and of predicted joints the shortest tree through them.
  /// @return the shape's frame @throws InputError without a surface, without joints, as `given`
  rig::ProposedJoints propose(const io::RiggedShape& shape, const rig::JointProposer& given);

  /// Weights by the model for skinning, which must be there: of each bone the share that the softmax gives it, for the
  /// joint at its head. Predicted joints have the bones between them (bones_between()), any others bones of their own
  /// (bones_of_rig()). Shares below 1e-4 are dropped. A skeleton of one joint gets all weights.
  /// @return one row per vertex of the shape @throws InputError without a surface, or for weights that are not finite
  SkinWeights bind(const io::RiggedShape& shape, const Skeleton& skeleton);

 private:
  torch::Tensor surface(const loaders::AnymateMesh& mesh, const TrainedAnymateModel& seen_by) const;
  std::vector<Eigen::Vector3d> predicted(const loaders::AnymateMesh& mesh);
  std::vector<int> parents_of(const loaders::AnymateMesh& mesh, const std::vector<Eigen::Vector3d>& joints);

  AnymateModels models_;
  AnymateRiggerOptions options_;
};

/// The steps of rig_meshes() that these models take over; what they lack stays with the request's method.
/// @throws InputError as AnymateRigger
rig::LearnedSteps anymate_steps(AnymateModels models, const AnymateRiggerOptions& options);

}  // namespace anigen::pipeline
