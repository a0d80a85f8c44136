#include "anigen/rigging/bone_axes.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/io/gltf/export.h"

namespace anigen::rigging {

namespace {

using Directions = std::vector<Eigen::Vector3d>;

/// Cosine to their mean down to which children lead the same way: 60°.
constexpr double kSameWay = 0.5;
/// Cosine beyond which a bone lies along the reference of its roll.
constexpr double kAlongReference = 0.8;

/// Directions of the bones of a skeleton.
class BoneDirections {
 public:
  explicit BoneDirections(const Skeleton& skeleton)
      : positions_(skeleton.positions()),
        parents_(skeleton.parents),
        mirrored_(mirrored_joints(positions_, parents_)),
        children_(parents_.size()),
        reach_(parents_.size(), 0.0) {
    for (std::size_t j = parents_.size(); j-- > 1;) {
      const std::size_t parent = at(parents_[j]);
      children_[parent].push_back(j);
      reach_[parent] = std::max(reach_[parent], reach_[j] + length(j));
    }
  }

  const std::vector<int>& mirrored() const { return mirrored_; }

  Directions all() const {
    Directions directions;
    for (std::size_t j = 0; j < parents_.size(); ++j) {
      const Eigen::Vector3d way = direction(j);
      const bool none = way.isZero();
      directions.push_back(!none ? way : j == 0 ? Eigen::Vector3d::UnitZ() : directions[at(parents_[j])]);
    }
    return directions;
  }

 private:
  double length(std::size_t joint) const { return (positions_[joint] - positions_[at(parents_[joint])]).norm(); }

  /// Zero where no child tells.
  Eigen::Vector3d direction(std::size_t joint) const {
    Directions ways;
    std::vector<std::size_t> leading;
    Eigen::Vector3d sum = Eigen::Vector3d::Zero();
    for (const std::size_t child : children_[joint]) {
      const Eigen::Vector3d way = positions_[child] - positions_[joint];
      if (!(way.norm() > 1e-9 * (1.0 + positions_[joint].norm()))) continue;
      ways.push_back(way.normalized());
      leading.push_back(child);
      sum += ways.back();
    }
    if (ways.empty()) return Eigen::Vector3d::Zero();
    const Eigen::Vector3d mean = sum.norm() > 1e-9 ? Eigen::Vector3d(sum.normalized()) : Eigen::Vector3d::Zero();
    const bool agree =
        std::all_of(ways.begin(), ways.end(), [&mean](const Eigen::Vector3d& w) { return w.dot(mean) > kSameWay; });
    if (agree) return mean;
    std::size_t best = ways.size();
    for (std::size_t k = 0; k < ways.size(); ++k) {
      const int twin = mirrored_[leading[k]];
      if (twin >= 0 && parents_[at(twin)] == parents_[leading[k]]) continue;
      if (best == ways.size() ||
          reach_[leading[k]] + length(leading[k]) > reach_[leading[best]] + length(leading[best]))
        best = k;
    }
    return best < ways.size() ? ways[best] : Eigen::Vector3d(Eigen::Vector3d::Zero());
  }

  const std::vector<Eigen::Vector3d> positions_;
  const std::vector<int>& parents_;
  const std::vector<int> mirrored_;
  std::vector<std::vector<std::size_t>> children_;
  std::vector<double> reach_;  // from a joint to the farthest tip below it
};

Eigen::Matrix3d axes_along(const Eigen::Vector3d& y, const Eigen::Vector3d& reference) {
  const Eigen::Vector3d z = (reference - y * y.dot(reference)).normalized();
  Eigen::Matrix3d axes;
  axes << y.cross(z), y, z;
  return axes;
}

}  // namespace

BoneAxes parse_bone_axes(const std::string& word) {
  if (word == "world") return BoneAxes::kWorld;
  if (word == "along") return BoneAxes::kAlong;
  throw InputError("", "--bone-axes", "\"" + word + "\" is none of world, along");
}

Skeleton with_bone_axes(const Skeleton& skeleton, BoneAxes axes, const Eigen::Vector3d& forward) {
  if (axes == BoneAxes::kWorld) return io::unrotated_in_file(skeleton, io::ExportAxes::kGltf);
  const BoneDirections bones(skeleton);
  const Directions directions = bones.all();
  const Eigen::Vector3d left = Eigen::Vector3d::UnitZ().cross(forward);
  Skeleton result = skeleton;
  for (std::size_t j = 0; j < skeleton.size(); ++j) {
    const int twin = bones.mirrored()[j];
    const Eigen::Vector3d place = skeleton.bind[j].topRightCorner<3, 1>();
    std::size_t asked = j;
    if (twin >= 0 && place.dot(left) < skeleton.bind[at(twin)].topRightCorner<3, 1>().dot(left)) asked = at(twin);
    const bool lies_along = std::abs(directions[asked].dot(forward)) > kAlongReference;
    Eigen::Vector3d reference = lies_along ? Eigen::Vector3d(Eigen::Vector3d::UnitZ()) : forward;
    // The left one's choice may lie along a right one that stands otherwise.
    if (std::abs(directions[j].dot(reference)) > 0.999) reference = lies_along ? forward : Eigen::Vector3d::UnitZ();
    result.bind[j].setIdentity();
    result.bind[j].topLeftCorner<3, 3>() = axes_along(directions[j], reference);
    result.bind[j].topRightCorner<3, 1>() = place;
  }
  result.rest = bind_pose(result);
  return result;
}

}  // namespace anigen::rigging
