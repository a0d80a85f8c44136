#pragma once
#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include "anigen/core/random.h"
#include "anigen/io/arrays/npz.h"

namespace anigen::test {

/// Arrays of a small rig: a random tree of joints, a square tube around every bone, weights that pass linearly from
/// the bone's parent to its child.
inline io::NamedArrays synthetic_rig(std::uint64_t seed, int joint_count) {
  Rng rng(seed, "synthetic rig");
  std::vector<Eigen::Vector3f> joints{{0, 0, 0}};
  std::vector<std::int64_t> parents{-1};
  for (int j = 1; j < joint_count; ++j) {
    parents.push_back(static_cast<std::int64_t>(rng.index(static_cast<std::size_t>(j))));
    const Eigen::Vector3f way(static_cast<float>(rng.normal()), static_cast<float>(rng.normal()),
                              static_cast<float>(rng.normal()));
    joints.push_back(joints[static_cast<std::size_t>(parents.back())] + 0.15f * way.normalized());
  }
  constexpr int kRings = 5, kSides = 4;
  std::vector<float> flat_joints, vertices, skin;
  std::vector<std::int64_t> faces;
  for (const Eigen::Vector3f& joint : joints) flat_joints.insert(flat_joints.end(), joint.data(), joint.data() + 3);
  for (int j = 1; j < joint_count; ++j) {
    const auto parent = static_cast<std::size_t>(parents[static_cast<std::size_t>(j)]);
    const Eigen::Vector3f from = joints[parent], bone = joints[static_cast<std::size_t>(j)] - from;
    const Eigen::Vector3f side = bone.unitOrthogonal(), up = bone.normalized().cross(side);
    const auto first = static_cast<std::int64_t>(vertices.size() / 3);
    for (int ring = 0; ring < kRings; ++ring) {
      const float t = static_cast<float>(ring) / (kRings - 1);
      for (int s = 0; s < kSides; ++s) {
        const float angle = 1.5707963f * static_cast<float>(s);
        const Eigen::Vector3f vertex = from + t * bone + 0.02f * (std::cos(angle) * side + std::sin(angle) * up);
        vertices.insert(vertices.end(), vertex.data(), vertex.data() + 3);
        std::vector<float> row(static_cast<std::size_t>(joint_count), 0.0f);
        row[parent] = 1.0f - t;
        row[static_cast<std::size_t>(j)] += t;
        skin.insert(skin.end(), row.begin(), row.end());
      }
    }
    for (int ring = 0; ring + 1 < kRings; ++ring) {
      for (int s = 0; s < kSides; ++s) {
        const std::int64_t a = first + ring * kSides + s, b = first + ring * kSides + (s + 1) % kSides;
        for (const std::int64_t index : {a, b, a + kSides, b, b + kSides, a + kSides}) faces.push_back(index);
      }
    }
  }
  const auto v = static_cast<std::int64_t>(vertices.size() / 3), f = static_cast<std::int64_t>(faces.size() / 3);
  return {{"joints", io::NdArray::from(flat_joints, {joint_count, 3})},
          {"parents", io::NdArray::from(parents, {joint_count})},
          {"skin", io::NdArray::from(skin, {v, joint_count})},
          {"vertices", io::NdArray::from(vertices, {v, 3})},
          {"faces", io::NdArray::from(faces, {f, 3})}};
}

inline std::filesystem::path rig_file(const std::filesystem::path& root, const std::string& id) {
  return root / "skeleton" / id / "skeleton_voxelized.npz";
}

/// A dataset in the published layout: metadata.csv and rigs rig000, rig001, … with 4 to 8 joints.
inline void write_synthetic_dataset(const std::filesystem::path& root, int count) {
  std::filesystem::create_directories(root);
  std::ofstream csv(root / "metadata.csv");
  csv << "sha256,aesthetic_score,is_bad_skin,is_bad_skeleton,captions\n";
  for (int i = 0; i < count; ++i) {
    char id[16];
    std::snprintf(id, sizeof id, "rig%03d", i);
    io::write_npz(rig_file(root, id), synthetic_rig(static_cast<std::uint64_t>(i), 4 + i % 5));
    csv << id << ",6.5,False,False,\"[\"\"a creature, small\"\"]\"\n";
  }
}

}  // namespace anigen::test
