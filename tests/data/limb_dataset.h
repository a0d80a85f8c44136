#pragma once
#include <Eigen/Core>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include "anigen/io/arrays/npz.h"
#include "tests/rigging/binding_shapes.h"

namespace anigen::test {

/// Joints of the limb `i` of a limb dataset: 3, 4, 5, 3, …, so that there are three joint trees.
inline int limb_joints(int i) { return 3 + i / 2 % 3; }

/// A tube along x with joints evenly along it, whose vertices each follow the bone beside them and no other: what heat
/// blends, and a network has to learn to sharpen.
inline void write_limb(const std::filesystem::path& file, int joints, double radius) {
  const Mesh tube = capsule(0.5, radius, 20, 8);
  const auto place = [joints](int j) { return -0.4 + 0.8 * j / (joints - 1); };
  std::vector<float> positions, vertices, skin;
  std::vector<std::int64_t> parents, faces;
  for (int j = 0; j < joints; ++j) {
    positions.insert(positions.end(), {static_cast<float>(place(j)), 0.0F, 0.0F});
    parents.push_back(j - 1);
  }
  for (const Eigen::Vector3f& vertex : tube.vertices) {
    vertices.insert(vertices.end(), vertex.data(), vertex.data() + 3);
    int own = 0;
    while (own + 1 < joints && static_cast<double>(vertex.x()) > place(own + 1)) ++own;
    for (int j = 0; j < joints; ++j) skin.push_back(j == own ? 1.0F : 0.0F);
  }
  for (const Triangle& face : tube.faces) faces.insert(faces.end(), face.begin(), face.end());
  const auto v = static_cast<std::int64_t>(tube.vertices.size()), f = static_cast<std::int64_t>(tube.faces.size());
  io::write_npz(file, {{"joints", io::NdArray::from(positions, {joints, 3})},
                       {"parents", io::NdArray::from(parents, {joints})},
                       {"skin", io::NdArray::from(skin, {v, joints})},
                       {"vertices", io::NdArray::from(vertices, {v, 3})},
                       {"faces", io::NdArray::from(faces, {f, 3})}});
}

/// A dataset of limbs: limb0, limb1, …; those of even numbers are real rigs, the others creatures. The last two are in
/// splits/test.txt, the others in splits/train.txt.
inline void write_limb_dataset(const std::filesystem::path& root, int count) {
  std::filesystem::create_directories(root / "splits");
  std::ofstream csv(root / "metadata.csv"), train(root / "splits/train.txt"), test(root / "splits/test.txt");
  csv << "sha256,file_identifier,source,is_bad_skin,is_bad_skeleton\n";
  for (int i = 0; i < count; ++i) {
    const std::string id = "limb" + std::to_string(i);
    csv << id << ','
        << (i % 2 == 0 ? "limbs/" + id + ".glb,real" : "procedural/5/" + std::to_string(i) + ",procedural:limb")
        << ",False,False\n";
    (i + 2 < count ? train : test) << id << "\n";
    write_limb(root / "skeleton" / id / "skeleton_voxelized.npz", limb_joints(i), 0.05 + 0.01 * (i % 4));
  }
}

}  // namespace anigen::test
