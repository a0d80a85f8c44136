#include "anigen/loaders/anymate/anymate_mesh.h"

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "anigen/core/error.h"
#include "anigen/rig/binding/solid_voxels.h"

namespace anigen::loaders {
namespace {

constexpr int kGridSide = 64;

Eigen::Vector3d y_up(const Eigen::Vector3d& p) { return {p.x(), p.z(), -p.y()}; }
Eigen::Vector3d z_up(const Eigen::Vector3d& p) { return {p.x(), -p.z(), p.y()}; }

void require_faces(const std::vector<Triangle>& faces, std::size_t vertices) {
  if (faces.empty()) throw InputError("", "faces", "the mesh has none");
  for (std::size_t f = 0; f < faces.size(); ++f) {
    for (const std::int32_t corner : faces[f]) {
      if (corner < 0 || static_cast<std::size_t>(corner) >= vertices) {
        throw InputError("", "faces[" + std::to_string(f) + "]", "refers to a vertex that does not exist");
      }
    }
  }
}

Eigen::Vector3f face_normal(const AnymateMesh& mesh, const Triangle& face) {
  const auto corner = [&](std::size_t i) -> const Eigen::Vector3f& {
    return mesh.vertices[static_cast<std::size_t>(face[i])];
  };
  const Eigen::Vector3f normal = (corner(1) - corner(0)).cross(corner(2) - corner(0));
  const float length = normal.norm();
  return length > 0.0f ? Eigen::Vector3f(normal / length) : Eigen::Vector3f::UnitY();
}

torch::Tensor empty_features(std::size_t rows) { return torch::empty({static_cast<std::int64_t>(rows), 6}); }

float* put(const Eigen::Vector3f& value, float* out) { return std::copy_n(value.data(), 3, out); }

}  // namespace

AnymateFrame AnymateFrame::of(const std::vector<Eigen::Vector3f>& vertices) {
  for (std::size_t v = 0; v < vertices.size(); ++v) {
    if (!vertices[v].allFinite()) throw InputError("", "vertices[" + std::to_string(v) + "]", "is not finite");
  }
  const Box box = bounding_box(vertices);
  if (!(box.longest_side() > 0.0)) throw InputError("", "vertices", "the mesh has no extent");
  AnymateFrame frame;
  frame.center_ = box.center();
  frame.scale_ = 2.0 / box.longest_side();
  return frame;
}

Eigen::Vector3d AnymateFrame::into(const Eigen::Vector3d& point) const { return y_up((point - center_) * scale_); }
Eigen::Vector3d AnymateFrame::out_of(const Eigen::Vector3d& point) const { return z_up(point) / scale_ + center_; }

AnymateMesh anymate_mesh(const std::vector<Eigen::Vector3f>& vertices, const std::vector<Triangle>& faces) {
  require_faces(faces, vertices.size());
  AnymateMesh mesh;
  mesh.frame = AnymateFrame::of(vertices);
  mesh.faces = faces;
  mesh.vertices.reserve(vertices.size());
  for (const Eigen::Vector3f& vertex : vertices) {
    mesh.vertices.emplace_back(mesh.frame.into(vertex.cast<double>()).cast<float>());
  }
  return mesh;
}

torch::Tensor surface_features(const AnymateMesh& mesh, const std::vector<geometry::SurfacePoint>& points) {
  torch::Tensor features = empty_features(points.size());
  float* out = features.data_ptr<float>();
  for (const geometry::SurfacePoint& point : points) {
    out = put(geometry::position(point, mesh.vertices, mesh.faces).cast<float>(), out);
    out = put(face_normal(mesh, mesh.faces[static_cast<std::size_t>(point.face)]), out);
  }
  return features;
}

torch::Tensor vertex_features(const AnymateMesh& mesh) {
  const std::vector<Eigen::Vector3f> normals = vertex_normals(mesh.vertices, mesh.faces);
  torch::Tensor features = empty_features(mesh.vertices.size());
  float* out = features.data_ptr<float>();
  for (std::size_t v = 0; v < mesh.vertices.size(); ++v) out = put(normals[v], put(mesh.vertices[v], out));
  return features;
}

torch::Tensor solid_cells(const AnymateMesh& mesh) {
  Mesh surface;
  surface.vertices = mesh.vertices;
  surface.faces = mesh.faces;
  const rig::WeldedSurface welded = rig::weld_surface(surface);
  if (!welded.has_extent) throw InputError("", "faces", "the mesh has no extent");
  // Along the longest side a cell of theirs is a cell of ours.
  const rig::SolidVoxels solid = rig::solid_voxels(welded, {}, kGridSide, /*validate=*/false);
  std::vector<std::int8_t> cells;
  for (int i = 0; i < kGridSide; ++i) {
    for (int j = 0; j < kGridSide; ++j) {
      for (int k = 0; k < kGridSide; ++k) {
        const Eigen::Vector3d middle =
            Eigen::Vector3d(i + 0.5, j + 0.5, k + 0.5) * (2.0 / kGridSide) - Eigen::Vector3d::Ones();
        const Eigen::Vector3d place = solid.block.measured(welded.to_unit(middle)).array().floor();
        const int x = static_cast<int>(place.x()), y = static_cast<int>(place.y()), z = static_cast<int>(place.z());
        if (!solid.block.holds(x, y, z) || !solid.is_solid(solid.block.index(x, y, z))) continue;
        for (const int index : {i, j, k}) cells.push_back(static_cast<std::int8_t>(index));
      }
    }
  }
  torch::Tensor tensor = torch::empty({static_cast<std::int64_t>(cells.size() / 3), 3}, torch::kInt8);
  std::copy(cells.begin(), cells.end(), tensor.data_ptr<std::int8_t>());
  return tensor;
}

}  // namespace anigen::loaders
