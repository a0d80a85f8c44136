#include "anigen/data/augment.h"

#include <Eigen/Geometry>
#include <cmath>

#include "anigen/core/numeric.h"

namespace anigen::data {

namespace {

Eigen::Quaterniond random_rotation(Rng& rng) {
  const double u = rng.uniform(), a = 2.0 * kPi * rng.uniform(), b = 2.0 * kPi * rng.uniform();
  const double s = std::sqrt(1.0 - u), t = std::sqrt(u);
  return {t * std::cos(b), s * std::sin(a), s * std::cos(a), t * std::sin(b)};
}

Eigen::Vector3d random_direction(Rng& rng) {
  const double z = rng.uniform(-1.0, 1.0), angle = 2.0 * kPi * rng.uniform();
  const double r = std::sqrt(1.0 - z * z);
  return {r * std::cos(angle), r * std::sin(angle), z};
}

// Removes the joints that are marked, each into the nearest ancestor that stays. Roots are never marked.
void fold_into_parents(RigDraw& rig, const std::vector<bool>& gone) {
  const std::size_t count = rig.joints.size();
  const auto staying = [&](int joint) {
    while (joint >= 0 && gone[at(joint)]) joint = rig.parents[at(joint)];
    return joint;
  };
  std::vector<int> renumbered(count, -1);
  RigDraw folded;
  for (std::size_t j = 0; j < count; ++j) {
    if (gone[j]) continue;
    renumbered[j] = static_cast<int>(folded.joints.size());
    folded.joints.push_back(rig.joints[j]);
  }
  for (std::size_t j = 0; j < count; ++j) {
    if (gone[j]) continue;
    const int parent = staying(rig.parents[j]);
    folded.parents.push_back(parent < 0 ? -1 : renumbered[at(parent)]);
  }
  for (const int joint : rig.joint_of) folded.joint_of.push_back(renumbered[at(staying(joint))]);
  rig = std::move(folded);
}

}  // namespace

void Augmentations::fields(ConfigFields& f) {
  f("rotation", rotation, {{"none", Rotation::kNone}, {"z", Rotation::kAboutZ}, {"so3", Rotation::kAny}});
  f("anisotropic_scale", anisotropic_scale, {0.0, 3.0});
  f("random_pose", random_pose, {0.0, 180.0});
  f("joint_jitter", joint_jitter, {0.0, 10.0});
  f("merge_joints", merge_joints, {0.0, 1.0});
  f("drop_leaves", drop_leaves, {0.0, 1.0});
  f("blend_sampling", blend_sampling, {0.0, 1.0});
  f("sharpen", sharpen, {0.0, 3.0});
}

RigDraw unchanged(const std::vector<Eigen::Vector3f>& joints, const std::vector<int>& parents) {
  RigDraw rig{joints, parents, std::vector<int>(joints.size())};
  for (std::size_t j = 0; j < joints.size(); ++j) rig.joint_of[j] = static_cast<int>(j);
  return rig;
}

void rotate(RigDraw& rig, Augmentations::Rotation rotation, Rng& rng) {
  if (rotation == Augmentations::Rotation::kNone) return;
  Eigen::Matrix3f turn;
  if (rotation == Augmentations::Rotation::kAboutZ) {
    turn =
        Eigen::AngleAxisf(static_cast<float>(2.0 * kPi * rng.uniform()), Eigen::Vector3f::UnitZ()).toRotationMatrix();
  } else {
    turn = random_rotation(rng).toRotationMatrix().cast<float>();
  }
  for (Eigen::Vector3f& joint : rig.joints) joint = turn * joint;
}

void scale_axes(RigDraw& rig, double range, Rng& rng) {
  Eigen::Vector3f factors;
  for (int axis = 0; axis < 3; ++axis) factors[axis] = static_cast<float>(std::exp(rng.uniform(-range, range)));
  for (Eigen::Vector3f& joint : rig.joints) joint = joint.cwiseProduct(factors);
}

void pose(RigDraw& rig, const std::vector<int>& order, double degrees, Rng& rng) {
  const std::vector<Eigen::Vector3f> rest = rig.joints;
  std::vector<Eigen::Quaterniond> turn(rest.size());
  for (const int joint : order) {
    const int parent = rig.parents[at(joint)];
    const double angle = rng.normal() * degrees * kPi / 180.0;
    const Eigen::Quaterniond own(Eigen::AngleAxisd(angle, random_direction(rng)));
    if (parent < 0) {
      turn[at(joint)] = own;
      continue;
    }
    const Eigen::Vector3d bone = (rest[at(joint)] - rest[at(parent)]).cast<double>();
    rig.joints[at(joint)] = rig.joints[at(parent)] + (turn[at(parent)] * bone).cast<float>();
    turn[at(joint)] = turn[at(parent)] * own;
  }
}

void jitter_joints(RigDraw& rig, double bone_lengths, Rng& rng) {
  const std::size_t count = rig.joints.size();
  std::vector<double> length(count, 0.0), below(count, 0.0);
  std::vector<int> children(count, 0);
  for (std::size_t j = 0; j < count; ++j) {
    if (rig.parents[j] < 0) continue;
    length[j] = (rig.joints[j] - rig.joints[at(rig.parents[j])]).norm();
    below[at(rig.parents[j])] += length[j];
    ++children[at(rig.parents[j])];
  }
  for (std::size_t j = 0; j < count; ++j) {
    if (rig.parents[j] < 0 && children[j] > 0) length[j] = below[j] / children[j];
    for (int axis = 0; axis < 3; ++axis)
      rig.joints[j][axis] += static_cast<float>(rng.normal() * bone_lengths * length[j]);
  }
}

void merge_joints(RigDraw& rig, double share, Rng& rng) {
  std::vector<std::size_t> candidates;
  for (std::size_t j = 0; j < rig.joints.size(); ++j) {
    if (rig.parents[j] >= 0) candidates.push_back(j);
  }
  const auto most = static_cast<std::size_t>(share * static_cast<double>(candidates.size()));
  const std::size_t merges = rng.index(most + 1);
  if (merges == 0) return;
  std::vector<bool> gone(rig.joints.size(), false);
  const std::vector<std::size_t> order = rng.permutation(candidates.size());
  for (std::size_t i = 0; i < merges; ++i) gone[candidates[order[i]]] = true;
  fold_into_parents(rig, gone);
}

void drop_unweighted(RigDraw& rig, const std::vector<bool>& used) {
  const std::size_t count = rig.joints.size();
  std::vector<bool> needed(count, false);
  for (std::size_t source = 0; source < used.size(); ++source) {
    if (!used[source]) continue;
    for (int j = rig.joint_of[source]; j >= 0 && !needed[at(j)]; j = rig.parents[at(j)]) needed[at(j)] = true;
  }
  std::vector<bool> gone(count);
  bool any = false;
  for (std::size_t j = 0; j < count; ++j) {
    gone[j] = !needed[j] && rig.parents[j] >= 0;
    any = any || gone[j];
  }
  if (any) fold_into_parents(rig, gone);
}

RigDraw augment(const std::vector<Eigen::Vector3f>& joints, const std::vector<int>& parents,
                const std::vector<int>& order, const std::vector<bool>& used, const Augmentations& options, Rng& rng) {
  RigDraw rig = unchanged(joints, parents);
  if (options.random_pose > 0.0) pose(rig, order, options.random_pose, rng);
  rotate(rig, options.rotation, rng);
  if (options.anisotropic_scale > 0.0) scale_axes(rig, options.anisotropic_scale, rng);
  if (options.joint_jitter > 0.0) jitter_joints(rig, options.joint_jitter, rng);
  if (options.merge_joints > 0.0) merge_joints(rig, options.merge_joints, rng);
  if (options.drop_leaves > 0.0 && rng.chance(options.drop_leaves)) drop_unweighted(rig, used);
  return rig;
}

void sharpen(float* row, std::size_t count, float power) {
  float sum = 0.0f;
  for (std::size_t j = 0; j < count; ++j) {
    if (row[j] > 0.0f) sum += row[j] = std::pow(row[j], power);
  }
  for (std::size_t j = 0; j < count; ++j) row[j] /= sum;
}

}  // namespace anigen::data
