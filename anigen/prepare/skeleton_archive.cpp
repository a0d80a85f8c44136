#include "anigen/prepare/skeleton_archive.h"

#include <cstdint>
#include <string>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/io/npz.h"

namespace anigen::prepare {

void write_skeleton_archive(const std::filesystem::path& path, const Asset& asset) {
  const std::size_t joints = asset.skeleton.size(), vertices = asset.mesh.vertices.size();
  if (joints > 0 && vertices > kMaxDenseSkinBytes / sizeof(float) / joints) {
    throw InputError(asset.name, "",
                     "dense weights of " + std::to_string(vertices) + " vertices by " + std::to_string(joints) +
                         " joints exceed " + std::to_string(kMaxDenseSkinBytes >> 20) + " MiB");
  }
  std::vector<float> positions, points;
  for (const Eigen::Vector3d& p : asset.skeleton.positions()) {
    for (int k = 0; k < 3; ++k) positions.push_back(static_cast<float>(p[k]));
  }
  for (const Eigen::Vector3f& p : asset.mesh.vertices) points.insert(points.end(), p.data(), p.data() + 3);
  std::vector<std::int32_t> faces;
  for (const Triangle& face : asset.mesh.faces) faces.insert(faces.end(), face.begin(), face.end());
  const std::vector<std::int32_t> parents(asset.skeleton.parents.begin(), asset.skeleton.parents.end());
  const auto n = [](std::size_t size) { return static_cast<std::int64_t>(size); };
  io::write_npz(path, {{"joints", io::NdArray::from(positions, {n(joints), 3})},
                       {"parents", io::NdArray::from(parents, {n(joints)})},
                       {"skin", io::NdArray::from(to_dense(asset.skin, joints), {n(vertices), n(joints)})},
                       {"vertices", io::NdArray::from(points, {n(vertices), 3})},
                       {"faces", io::NdArray::from(faces, {n(asset.mesh.faces.size()), 3})}});
}

}  // namespace anigen::prepare
