#include "anigen/asset/normalize.h"

#include <cmath>

#include "anigen/core/error.h"

namespace anigen {

void apply(const Similarity& similarity, Asset& asset) {
  const double scale = similarity.scale;
  for (Eigen::Vector3f& vertex : asset.mesh.vertices) {
    vertex = (scale * vertex.cast<double>() + similarity.offset).cast<float>();
  }
  Skeleton& skeleton = asset.skeleton;
  // S · W · diag(1/s): positions move with the object, orientation and scale of each joint stay. Relative to the
  // parent that is a pure scaling of translations; only the root also takes the offset.
  for (Eigen::Matrix4d& bind : skeleton.bind) {
    bind.topRightCorner<3, 1>() = scale * bind.topRightCorner<3, 1>() + similarity.offset;
  }
  const auto offset_of = [&](std::size_t joint) {
    return skeleton.parents[joint] < 0 ? similarity.offset : Eigen::Vector3d(Eigen::Vector3d::Zero());
  };
  for (std::size_t j = 0; j < skeleton.rest.size(); ++j) {
    skeleton.rest[j].translation = scale * skeleton.rest[j].translation + offset_of(j);
  }
  for (Animation& animation : asset.animations) {
    for (Channel& channel : animation.channels) {
      if (channel.path != ChannelPath::kTranslation) continue;
      const Eigen::Vector3d offset = offset_of(static_cast<std::size_t>(channel.joint));
      const bool cubic = channel.interpolation == Interpolation::kCubicSpline;
      for (std::size_t i = 0; i < channel.values.size(); ++i) {
        // Of a cubic key's three vectors only the middle one is a position; tangents do not take the offset.
        const bool tangent = cubic && (i / 3) % 3 != 1;
        channel.values[i] = scale * channel.values[i] + (tangent ? 0.0 : offset[static_cast<Eigen::Index>(i % 3)]);
      }
    }
  }
}

Similarity normalize(Asset& asset) {
  const Box box = bounding_box(asset.mesh.vertices);
  if (box.empty()) throw InputError(asset.name, "mesh", "cannot normalise a mesh without vertices");
  const double side = box.longest_side();
  if (!std::isfinite(side) || !box.center().allFinite()) throw InputError(asset.name, "mesh", "a vertex is not finite");
  if (!(side > 0.0)) throw InputError(asset.name, "mesh", "cannot normalise a mesh without extent");
  Similarity similarity;
  similarity.scale = 1.0 / side;
  similarity.offset = -box.center() / side;
  apply(similarity, asset);
  return similarity;
}

}  // namespace anigen
