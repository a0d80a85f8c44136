#include "anigen/loaders/rignet/solid_shape.h"

#include <algorithm>
#include <cmath>

#include "anigen/core/error.h"
#include "anigen/fields/tensor_points.h"

namespace anigen::loaders {
namespace {

constexpr int kSolidResolution = 88;
constexpr double kWayStep = 0.01;

}  // namespace

SolidShape::SolidShape(const std::vector<Eigen::Vector3f>& vertices, const std::vector<Triangle>& faces)
    : frame_(RignetFrame::of(vertices)) {
  Mesh mesh;
  mesh.vertices = vertices;
  mesh.faces = faces;
  const rig::WeldedSurface surface = rig::weld_surface(mesh);
  if (!surface.has_extent) throw InputError("", "faces", "the mesh has no extent");
  const rig::SolidVoxels solid = rig::solid_voxels(surface, {}, kSolidResolution, /*validate=*/false);
  center_ = surface.center;
  size_ = surface.size;
  block_ = solid.block;
  for (std::size_t cell = 0; cell < block_.cells(); ++cell) is_solid_.push_back(solid.is_solid(cell));
}

bool SolidShape::holds(const Eigen::Vector3d& point) const {
  const Eigen::Vector3d place = block_.measured((frame_.out_of(point) - center_) / size_).array().floor();
  for (int axis = 0; axis < 3; ++axis) {
    if (!(place[axis] >= 0.0 && place[axis] < block_.size[static_cast<std::size_t>(axis)])) return false;
  }
  return is_solid_[block_.index(static_cast<int>(place.x()), static_cast<int>(place.y()), static_cast<int>(place.z()))];
}

torch::Tensor SolidShape::holds(const torch::Tensor& points) const {
  torch::Tensor inside = torch::empty({points.size(0)}, torch::kBool);
  bool* out = inside.data_ptr<bool>();
  for (const Eigen::Vector3d& point : fields::points_of<double>(points, "points")) *out++ = holds(point);
  return inside;
}

SolidShape::Way SolidShape::way(const Eigen::Vector3d& from, const Eigen::Vector3d& to) const {
  const int steps = std::max(1, static_cast<int>(std::ceil((to - from).norm() / kWayStep)));
  Way found;
  for (int i = 0; i <= steps; ++i) {
    found.outside += holds(Eigen::Vector3d(from + (to - from) * (static_cast<double>(i) / steps))) ? 0 : 1;
  }
  found.inside = 1.0 - static_cast<double>(found.outside) / (steps + 1);
  return found;
}

SolidShape::Ways SolidShape::ways(const std::vector<Eigen::Vector3d>& joints) const {
  const auto count = static_cast<std::int64_t>(joints.size());
  Ways all{torch::empty({count, count}), torch::empty({count, count})};
  auto inside = all.inside.accessor<float, 2>(), outside = all.outside.accessor<float, 2>();
  for (std::int64_t i = 0; i < count; ++i) {
    for (std::int64_t j = i; j < count; ++j) {
      const Way one = way(joints[static_cast<std::size_t>(i)], joints[static_cast<std::size_t>(j)]);
      inside[i][j] = inside[j][i] = static_cast<float>(one.inside);
      outside[i][j] = outside[j][i] = static_cast<float>(one.outside);
    }
  }
  return all;
}

}  // namespace anigen::loaders
