#include "anigen/rig/embedding/bone_refinement.h"

#include <algorithm>
#include <cmath>

#include "anigen/core/numeric.h"

namespace anigen::rig {
namespace {

constexpr int kBoneSamples = 10;
constexpr double kDifference = 1e-4;  // for gradients
constexpr double kFirstStep = 0.0005;
constexpr int kMostDoublings = 30;

}  // namespace

BoneRefinement::BoneRefinement(const SolidField& field, const std::vector<float>& medial_distance,
                               const TemplateSkeleton& skeleton, const EmbeddingOptions& options)
    : field_(field), medial_distance_(medial_distance), skeleton_(skeleton), options_(options) {
  const auto& joints = skeleton.joints;
  bones_of_.resize(joints.size());
  for (std::size_t j = 1; j < joints.size(); ++j) {
    const auto parent = at(joints[j].parent);
    if (joints[j].carried || joints[parent].carried) continue;
    bones_.push_back(j);
    bones_of_[j].push_back(j);
    bones_of_[parent].push_back(j);
    if (joints[j].mirror < 1) continue;
    // A bone is compared with that of the other side, so its energy depends on those joints too.
    const auto other = at(joints[j].mirror);
    bones_of_[other].push_back(j);
    bones_of_[at(joints[other].parent)].push_back(j);
  }
  for (auto& list : bones_of_) {
    std::sort(list.begin(), list.end());
    list.erase(std::unique(list.begin(), list.end()), list.end());
  }
}

double BoneRefinement::depth_energy(const Eigen::Vector3d& from, const Eigen::Vector3d& to) const {
  double sum = 0.0;
  for (int i = 0; i < kBoneSamples; ++i) {
    const double t = (i + 0.5) / kBoneSamples;
    const Eigen::Vector3d p = (1.0 - t) * from + t * to;
    const double medial = interpolate(field_.grid, medial_distance_, p);
    const double shallow = 0.001 + std::max(0.0, 0.05 + field_.value(p));
    const double squared = std::min(medial, shallow) * std::min(medial, shallow);
    if (squared > options_.tolerance * options_.tolerance) sum += squared;
  }
  return sum / kBoneSamples;
}

double BoneRefinement::bone_energy(std::size_t bone, const std::vector<Eigen::Vector3d>& joints) const {
  const TemplateJoint& joint = skeleton_.joints[bone];
  const auto parent = at(joint.parent);
  const Eigen::Vector3d way = joints[bone] - joints[parent];
  const Eigen::Vector3d wanted = joint.position - skeleton_.joints[parent].position;
  double sum = options_.surface_weight * depth_energy(joints[parent], joints[bone]);
  const double wanted_length = wanted.norm(), length = way.norm();
  if (wanted_length > 0.0) {
    const double along = way.dot(wanted) / wanted_length;
    sum += options_.bone_length_weight * std::max(0.5, (1e-4 + wanted_length * wanted_length) / (1e-4 + along * along));
    const double dot = length > 1e-12 ? std::clamp(along / length, -1.0, 1.0) : 1.0;
    const double angle = 0.3 + 0.5 * std::acos(dot);
    sum += options_.bone_angle_weight * (dot < 0.0 ? 10.0 : 1.0) * angle * angle * angle;
  }
  const int mirror = joint.mirror;
  if (mirror >= 1 && !skeleton_.joints[at(mirror)].carried) {
    const double other = (joints[at(mirror)] - joints[at(skeleton_.joints[at(mirror)].parent)]).squaredNorm();
    const double a = 1e-3 + length * length, b = 1e-3 + other;
    sum += options_.bone_symmetry_weight * std::max(1.05, std::max(a / b, b / a));
  }
  return sum;
}

double BoneRefinement::energy_around(const std::vector<Eigen::Vector3d>& joints,
                                     const std::vector<std::size_t>& bones) const {
  double sum = 0.0;
  for (const std::size_t bone : bones) sum += bone_energy(bone, joints);
  return sum;
}

double BoneRefinement::energy(const std::vector<Eigen::Vector3d>& joints) const {
  return energy_around(joints, bones_);
}

std::vector<std::size_t> BoneRefinement::bones_at(const std::vector<std::size_t>& moving) const {
  std::vector<std::size_t> bones;
  for (const std::size_t j : moving) bones.insert(bones.end(), bones_of_[j].begin(), bones_of_[j].end());
  std::sort(bones.begin(), bones.end());
  bones.erase(std::unique(bones.begin(), bones.end()), bones.end());
  return bones;
}

std::vector<Eigen::Vector3d> BoneRefinement::gradient(const std::vector<Eigen::Vector3d>& joints,
                                                      const std::vector<std::size_t>& moving) const {
  std::vector<Eigen::Vector3d> result(joints.size(), Eigen::Vector3d::Zero());
  std::vector<Eigen::Vector3d> moved = joints;
  for (const std::size_t j : moving) {
    for (int axis = 0; axis < 3; ++axis) {
      moved[j][axis] = joints[j][axis] + kDifference;
      const double above = energy_around(moved, bones_of_[j]);
      moved[j][axis] = joints[j][axis] - kDifference;
      const double below = energy_around(moved, bones_of_[j]);
      moved[j][axis] = joints[j][axis];
      result[j][axis] = (above - below) / (2.0 * kDifference);
    }
  }
  return result;
}

void BoneRefinement::search_along_gradient(std::vector<Eigen::Vector3d>& joints,
                                           const std::vector<std::size_t>& moving) const {
  const std::vector<Eigen::Vector3d> slope = gradient(joints, moving);
  double squared = 0.0;
  for (const std::size_t j : moving) squared += slope[j].squaredNorm();
  const std::vector<std::size_t> bones = bones_at(moving);
  double step = kFirstStep / std::sqrt(0.001 + squared), best = energy_around(joints, bones), best_step = 0.0;
  std::vector<Eigen::Vector3d> tried = joints;
  for (int i = 0; i < kMostDoublings; ++i, step *= 2.0) {
    for (const std::size_t j : moving) tried[j] = joints[j] - step * slope[j];
    const double here = energy_around(tried, bones);
    if (!(here < best)) break;
    best = here;
    best_step = step;
  }
  for (const std::size_t j : moving) joints[j] -= best_step * slope[j];
}

void BoneRefinement::refine(std::vector<Eigen::Vector3d>& joints) const {
  std::vector<std::size_t> all;
  for (std::size_t j = 0; j < joints.size(); ++j) {
    if (!bones_of_[j].empty()) all.push_back(j);
  }
  for (int round = 0; round < options_.refinement_rounds; ++round) {
    for (int i = 0; i < 2; ++i) search_along_gradient(joints, all);
    for (const std::size_t bone : bones_) search_along_gradient(joints, {at(skeleton_.joints[bone].parent), bone});
  }
}

}  // namespace anigen::rig
