#include "anigen/eval/merged_joints.h"

#include <utility>
#include <vector>

#include "anigen/asset/skeleton.h"
#include "anigen/core/numeric.h"

namespace anigen::eval {

std::size_t merge_joints(io::RiggedShape& shape, double distance) {
  const std::vector<Eigen::Vector3d>& positions = shape.joints.positions;
  std::vector<int> number(positions.size(), -1);  // of every joint among those that stay
  std::vector<int> kept;
  JointTree merged;
  std::vector<std::string> names;
  for (const int joint : parents_first(shape.joints)) {
    for (std::size_t k = 0; k < kept.size() && number[at(joint)] < 0; ++k) {
      if ((merged.positions[k] - positions[at(joint)]).norm() <= distance) number[at(joint)] = static_cast<int>(k);
    }
    if (number[at(joint)] >= 0) continue;
    number[at(joint)] = static_cast<int>(kept.size());
    kept.push_back(joint);
    const int parent = shape.joints.parents[at(joint)];
    merged.positions.push_back(positions[at(joint)]);
    merged.parents.push_back(parent < 0 ? -1 : number[at(parent)]);
    if (!shape.joint_names.empty()) names.push_back(shape.joint_names[at(joint)]);
  }
  const std::size_t gone = positions.size() - kept.size();
  if (gone == 0) return 0;

  SkinWeights skin;
  for (std::size_t v = 0; v < shape.skin.rows(); ++v) {
    std::vector<Influence> row(shape.skin.row(v), shape.skin.row(v) + shape.skin.row_size(v));
    for (Influence& influence : row) influence.joint = number[at(influence.joint)];
    skin.append_row(std::move(row));
  }
  shape.joints = std::move(merged);
  shape.joint_names = std::move(names);
  shape.skin = std::move(skin);
  shape.clips = nullptr;
  return gone;
}

}  // namespace anigen::eval
