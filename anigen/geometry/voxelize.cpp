#include "anigen/geometry/voxelize.h"

#include <algorithm>
#include <string>

#include "anigen/core/error.h"
#include "anigen/core/parallel.h"
#include "anigen/geometry/bone_distance.h"
#include "anigen/geometry/voxel_bits.h"
#include "anigen/geometry/voxel_segment.h"
#include "anigen/geometry/voxel_triangle.h"

namespace anigen::geometry {
namespace {

void require_faces(const std::vector<Triangle>& faces, std::size_t vertices) {
  if (faces.empty()) throw InputError("", "mesh.faces", "a mesh without faces has no surface to voxelise");
  for (std::size_t f = 0; f < faces.size(); ++f) {
    for (const std::int32_t v : faces[f]) {
      if (v >= 0 && static_cast<std::size_t>(v) < vertices) continue;
      throw InputError("", "mesh.faces[" + std::to_string(f) + "]", "there is no vertex " + std::to_string(v));
    }
  }
}

FixedPoint placed(const Eigen::Vector3d& vertex, std::size_t index, int resolution, OutsideCube outside) {
  const auto place = [&] { return "mesh.vertices[" + std::to_string(index) + "]"; };
  if (!vertex.allFinite()) throw InputError("", place(), "the vertex is not finite");
  if (outside == OutsideCube::kClip) return to_fixed(clip_to_cube(vertex), resolution);
  if (vertex.cwiseAbs().maxCoeff() > 0.5) throw InputError("", place(), "the vertex lies outside [-0.5, 0.5]");
  return to_fixed(vertex, resolution);
}

template <typename Vertex>
std::vector<Voxel> surface(const std::vector<Vertex>& vertices, const std::vector<Triangle>& faces, int resolution,
                           OutsideCube outside) {
  require_resolution(resolution);
  require_faces(faces, vertices.size());
  std::vector<FixedPoint> points(vertices.size());
  for (std::size_t v = 0; v < vertices.size(); ++v) {
    points[v] = placed(vertices[v].template cast<double>(), v, resolution, outside);
  }
  VoxelBits voxels(resolution);
  constexpr std::size_t kBlock = 128;  // faces at a time, so that handing out work costs nothing
  parallel_for((faces.size() + kBlock - 1) / kBlock, [&](std::size_t block) {
    const std::size_t end = std::min(faces.size(), (block + 1) * kBlock);
    for (std::size_t f = block * kBlock; f < end; ++f) {
      const auto corner = [&](std::size_t k) { return points[static_cast<std::size_t>(faces[f][k])]; };
      insert_triangle({corner(0), corner(1), corner(2)}, voxels);
    }
  });
  return voxels.voxels();
}

}  // namespace

std::vector<Voxel> voxelize_surface(const std::vector<Eigen::Vector3f>& vertices, const std::vector<Triangle>& faces,
                                    int resolution, OutsideCube outside) {
  return surface(vertices, faces, resolution, outside);
}

std::vector<Voxel> voxelize_surface(const std::vector<Eigen::Vector3d>& vertices, const std::vector<Triangle>& faces,
                                    int resolution, OutsideCube outside) {
  return surface(vertices, faces, resolution, outside);
}

std::vector<Voxel> voxelize_bones(const std::vector<Eigen::Vector3d>& joints, const std::vector<int>& parents,
                                  int resolution) {
  require_resolution(resolution);
  if (joints.empty()) throw InputError("", "skeleton", "a skeleton without joints has no voxels");
  const std::vector<Bone> bones = bones_of(joints, parents);
  std::vector<Voxel> voxels;
  const auto fixed = [&](const Eigen::Vector3d& point) { return to_fixed(clip_to_cube(point), resolution); };
  for (const Bone& bone : bones) append_segment(fixed(bone.head), fixed(bone.tail), voxels);
  for (const Eigen::Vector3d& joint : joints) {  // a root without children has no bone
    const FixedPoint point = fixed(joint);
    append_segment(point, point, voxels);
  }
  sort_unique(voxels);
  return voxels;
}

}  // namespace anigen::geometry
