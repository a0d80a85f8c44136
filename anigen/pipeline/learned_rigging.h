#pragma once
#include <Eigen/Core>
#include <functional>
#include <memory>
#include <vector>

#include "anigen/rig/rig_meshes.h"

namespace anigen::pipeline {

/// What a learned rigger does about joints; unset where it has no model for it. Positions are in the shape's frame.
struct JointModels {
  std::function<std::vector<Eigen::Vector3d>()> predict;
  std::function<std::vector<int>(const std::vector<Eigen::Vector3d>&)> connect;  ///< [J], -1 for the root
};

/// Joints of one shape and their tree. Joints are predicted, or, without a model for them, those that `given` proposes.
/// Parents are those of the model for connectivity; without one those given with the joints, and of predicted joints
/// the shortest tree through them. Given joints keep their names. @throws InputError as `given` and the models
rig::ProposedJoints propose_by_models(const io::RiggedShape& shape, const rig::JointProposer& given,
                                      const JointModels& models);

/// Positions of the shape's frame in that of a model, [J].
template <typename Frame>
std::vector<Eigen::Vector3f> placed_in(const Frame& frame, const std::vector<Eigen::Vector3d>& points) {
  std::vector<Eigen::Vector3f> moved;
  for (const Eigen::Vector3d& point : points) moved.emplace_back(frame.into(point).template cast<float>());
  return moved;
}

/// A rigger with propose() and bind() as steps of rig_meshes(); what is not wanted stays with the request's method.
template <typename Rigger>
rig::LearnedSteps learned_steps(const std::shared_ptr<Rigger>& rigger, bool proposes, bool binds) {
  rig::LearnedSteps steps;
  if (proposes) {
    steps.propose = [rigger](const io::RiggedShape& shape, const rig::JointProposer& given) {
      return rigger->propose(shape, given);
    };
  }
  if (binds) {
    steps.bind = [rigger](const io::RiggedShape& shape, const Skeleton& skeleton) {
      return rigger->bind(shape, skeleton);
    };
  }
  return steps;
}

}  // namespace anigen::pipeline
