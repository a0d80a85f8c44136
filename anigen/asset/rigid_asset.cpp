#include "anigen/asset/rigid_asset.h"

#include <vector>

namespace anigen {

void bind_rigidly(Asset& asset, const std::string& joint) {
  const std::vector<Eigen::Vector3d> origin(1, Eigen::Vector3d::Zero());
  asset.skeleton = skeleton_from_joints(origin, {-1}, std::vector<std::string>(1, joint));
  asset.skin = SkinWeights();
  for (std::size_t v = 0; v < asset.mesh.vertices.size(); ++v) asset.skin.append_row({Influence{0, 1.0F}});
}

}  // namespace anigen
