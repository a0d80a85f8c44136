#include <vector>

#include "anigen/fields/skeleton_field.h"
#include "anigen/fields/tensor_points.h"
#include "anigen/geometry/joint_field.h"

namespace anigen::fields {
namespace {

// Below it a joint counts as having no voxels.
constexpr double kLeastWeight = 1e-6;

/// The nearest joint of each centre. @return [M] int64 on the device of the centres
Tensor owners_of(const Tensor& centers, const Tensor& joints) {
  const std::vector<geometry::NearestJoints> nearest =
      geometry::nearest_joints(points_of<double>(centers, "positions"), points_of<double>(joints, "joints"));
  const Tensor owners = torch::empty({static_cast<std::int64_t>(nearest.size())}, torch::kInt64);
  auto* next = owners.data_ptr<std::int64_t>();
  for (const geometry::NearestJoints& joint : nearest) *next++ = joint.joint;
  return owners.to(centers.device());
}

}  // namespace

JointSkinFeatures joint_skin_features(const SkeletonField& field, const Tensor& joints) {
  require_matrix(field.positions, -1, 3, "positions");
  require_matrix(joints, -1, 3, "joints");
  const std::int64_t voxels = field.positions.size(0), count = joints.size(0);
  if (!field.skin_features.defined() || field.skin_features.dim() != 2 || field.skin_features.size(0) != voxels) {
    throw InputError("", "skin_features", "expected one row per centre, got " + nn::shape_text(field.skin_features));
  }
  if (field.conf_skin.defined()) require_matrix(field.conf_skin, voxels, 1, "conf_skin");
  const torch::Dtype dtype = nn::accumulation_dtype(field.skin_features.scalar_type());
  const Tensor features = field.skin_features.to(dtype);
  if (count == 0) return {features.new_zeros({0, features.size(1)}), features.new_zeros({})};

  const Tensor owners = owners_of(field.positions, joints);
  const Tensor weights =
      field.conf_skin.defined() ? torch::sigmoid(field.conf_skin.to(dtype)) : features.new_ones({voxels, 1});
  const auto sum_by_joint = [&](const Tensor& rows) {
    return rows.new_zeros({count, rows.size(1)}).index_add(0, owners, rows);
  };
  const Tensor weighted = weights * features;
  const Tensor totals = sum_by_joint(weights).clamp_min(kLeastWeight);
  const Tensor mean = sum_by_joint(weighted) / totals;
  const Tensor mean_square = sum_by_joint(weighted * features) / totals;
  return {mean, (mean_square - mean.square()).mean()};
}

}  // namespace anigen::fields
