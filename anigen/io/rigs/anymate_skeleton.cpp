#include "anigen/io/rigs/anymate_skeleton.h"

#include <algorithm>
#include <limits>
#include <string>

namespace anigen::io {
namespace {

constexpr double kSamePlace = 1e-4;  // bones are stored in single precision, predictions have joints averaged

struct Bone {
  Eigen::Vector3d head, tail;
};

/// An array's length, cut to the count that padded samples tell beside it.
std::size_t told_count(const ArrayFields& fields, const std::string& name, const std::string& count_name) {
  const auto rows = static_cast<std::size_t>(fields.rows(name));
  if (!fields.has(count_name)) return rows;
  const std::int32_t told = fields.integer(count_name);
  if (told < 0 || static_cast<std::size_t>(told) > rows)
    fields.fail(count_name, std::to_string(told) + " of " + std::to_string(rows) + " rows in " + name);
  return static_cast<std::size_t>(told);
}

std::vector<Bone> read_bones(const ArrayFields& fields) {
  if (!fields.has("bones") || fields.rows("bones") == 0) return {};
  fields.array("bones", {-1, 6});
  const std::vector<Eigen::Vector3d> heads = fields.precise_points("bones");
  const std::vector<Eigen::Vector3d> tails = fields.second_points("bones");
  std::vector<Bone> bones(told_count(fields, "bones", "bones_num"));
  for (std::size_t b = 0; b < bones.size(); ++b) bones[b] = {heads[b], tails[b]};
  return bones;
}

/// The nearest joint within kSamePlace, else -1.
int joint_at(const std::vector<Eigen::Vector3d>& joints, const Eigen::Vector3d& place) {
  int best = -1;
  double smallest = kSamePlace;
  for (std::size_t j = 0; j < joints.size(); ++j) {
    const double distance = (joints[j] - place).norm();
    if (distance < smallest) {
      smallest = distance;
      best = static_cast<int>(j);
    }
  }
  return best;
}

std::vector<Eigen::Vector3d> unique_ends(const std::vector<Bone>& bones) {
  std::vector<Eigen::Vector3d> joints;
  const auto add = [&joints](const Eigen::Vector3d& place) {
    if (std::find(joints.begin(), joints.end(), place) == joints.end()) joints.push_back(place);
  };
  for (const Bone& bone : bones) add(bone.head);
  for (const Bone& bone : bones) add(bone.tail);
  return joints;
}

/// conns as parents, -1 for a root. @param rows of the dense form beyond the joints are padding
std::vector<int> read_parents(const ArrayFields& fields, std::size_t joints) {
  std::vector<int> parents(joints);
  const auto rows = static_cast<std::size_t>(fields.rows("conns"));
  if (rows < joints) fields.fail("conns", std::to_string(rows) + " parents for " + std::to_string(joints) + " joints");
  std::vector<std::int32_t> told;
  if (fields.dimensions("conns") == 1) {
    told = fields.integers("conns", {-1});
  } else {
    const auto columns = static_cast<std::size_t>(fields.array("conns", {-1, -1}).shape[1]);
    if (columns < joints)
      fields.fail("conns", std::to_string(columns) + " columns for " + std::to_string(joints) + " joints");
    const std::vector<float> scores = fields.reals("conns", {-1, -1});
    for (std::size_t j = 0; j < joints; ++j) {
      const auto row = scores.begin() + static_cast<std::ptrdiff_t>(j * columns);
      told.push_back(static_cast<std::int32_t>(std::max_element(row, row + static_cast<std::ptrdiff_t>(joints)) - row));
    }
  }
  for (std::size_t j = 0; j < joints; ++j) {
    const std::string place = "conns[" + std::to_string(j) + "]";
    if (told[j] < -1 || (told[j] >= 0 && static_cast<std::size_t>(told[j]) >= joints))
      fields.fail(place, "names joint " + std::to_string(told[j]) + " of " + std::to_string(joints));
    parents[j] = told[j] == static_cast<std::int32_t>(j) ? -1 : told[j];
  }
  return parents;
}

std::vector<int> parents_of_tails(const ArrayFields& fields, const std::vector<Eigen::Vector3d>& joints,
                                  const std::vector<Bone>& bones, const std::vector<int>& heads) {
  std::vector<int> parents(joints.size(), -1);
  for (std::size_t b = 0; b < bones.size(); ++b) {
    const std::string place = "bones[" + std::to_string(b) + "]";
    const int tail = joint_at(joints, bones[b].tail);
    if (tail < 0) fields.fail(place, "its tail is no joint");
    if (tail == heads[b]) continue;
    int& known = parents[static_cast<std::size_t>(tail)];
    if (known >= 0 && known != heads[b]) fields.fail(place, "two bones with different heads end at its tail");
    known = heads[b];
  }
  return parents;
}

}  // namespace

AnymateSkeleton read_anymate_skeleton(const ArrayFields& fields) {
  AnymateSkeleton skeleton;
  if (!fields.has("joints") && !fields.has("bones")) return skeleton;
  std::vector<Eigen::Vector3d>& joints = skeleton.joints.positions;
  if (fields.has("joints")) {
    const std::size_t count = told_count(fields, "joints", "joints_num");
    joints = fields.precise_points("joints");
    joints.resize(std::min(count, joints.size()));
  }
  const std::vector<Bone> bones = read_bones(fields);
  if (!fields.has("joints")) joints = unique_ends(bones);
  for (std::size_t b = 0; b < bones.size(); ++b) {
    const int head = joint_at(joints, bones[b].head);
    if (head < 0) fields.fail("bones[" + std::to_string(b) + "]", "its head is no joint");
    skeleton.bone_head.push_back(head);
  }
  skeleton.joints.parents = fields.has("conns") ? read_parents(fields, joints.size())
                                                : parents_of_tails(fields, joints, bones, skeleton.bone_head);
  if (!fields.has("bones")) {
    for (const int parent : skeleton.joints.parents) {
      if (parent >= 0) skeleton.bone_head.push_back(parent);
    }
  }
  return skeleton;
}

}  // namespace anigen::io
