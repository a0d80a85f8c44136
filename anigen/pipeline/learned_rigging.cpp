#include "anigen/pipeline/learned_rigging.h"

#include <utility>

#include "anigen/geometry/joint_names.h"
#include "anigen/geometry/spanning_trees.h"

namespace anigen::pipeline {

rig::ProposedJoints propose_by_models(const io::RiggedShape& shape, const rig::JointProposer& given,
                                      const JointModels& models) {
  io::RiggedShape found;
  if (models.predict) {
    found.joints.positions = models.predict();
    found.joints.parents =
        models.connect ? models.connect(found.joints.positions) : geometry::shortest_tree(found.joints.positions);
  } else {
    rig::ProposedJoints proposed = given.propose(shape);
    if (!models.connect) return proposed;
    found.joints.positions = proposed.skeleton.positions();
    found.joint_names = std::move(proposed.skeleton.names);
    found.joints.parents = models.connect(found.joints.positions);
  }
  Skeleton skeleton = io::to_asset(found).skeleton;
  if (models.predict) skeleton.names = geometry::joint_names(skeleton.positions(), skeleton.parents);
  return {std::move(skeleton), ""};
}

}  // namespace anigen::pipeline
