#include "anigen/io/rigs/shape_parts.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace anigen::io {
namespace {

std::size_t repeated_places(std::vector<Eigen::Vector3d> places) {
  const auto less = [](const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
    return std::lexicographical_compare(a.data(), a.data() + 3, b.data(), b.data() + 3);
  };
  std::sort(places.begin(), places.end(), less);
  return static_cast<std::size_t>(places.end() - std::unique(places.begin(), places.end()));
}

}  // namespace

std::int32_t first_root(const JointTree& tree) {
  const std::vector<int> all = roots(tree);
  return all.empty() ? 0 : all.front();
}

void set_skin(RiggedShape& shape, SkinRows& rows, std::int32_t fallback) {
  shape.skin = rows.finish(fallback, shape.notes);
  shape.unweighted = rows.unweighted();
  shape.lowest_weight_sum = rows.lowest_sum();
}

void set_dense_skin(const ArrayFields& fields, const std::string& name, RiggedShape& shape) {
  const std::size_t vertices = shape.mesh.vertices.size(), joints = shape.joints.size();
  const std::vector<float> weights =
      fields.reals(name, {static_cast<std::int64_t>(vertices), static_cast<std::int64_t>(joints)});
  SkinRows rows(vertices, joints, fields.file());
  for (std::size_t i = 0; i < weights.size(); ++i) {
    if (weights[i] == 0.0f) continue;
    const std::size_t v = i / joints, j = i % joints;
    rows.add(static_cast<std::int64_t>(v), static_cast<std::int64_t>(j), weights[i], name);
  }
  set_skin(shape, rows, first_root(shape.joints));
}

void set_normals(RiggedShape& shape, std::vector<Eigen::Vector3f> normals) {
  Mesh& mesh = shape.mesh;
  if (normals.empty()) return;
  if (normals.size() != mesh.vertices.size()) {
    shape.notes.push_back(std::to_string(normals.size()) + " normals for " + std::to_string(mesh.vertices.size()) +
                          " vertices were left out");
    return;
  }
  std::vector<Eigen::Vector3f> computed;
  for (std::size_t v = 0; v < normals.size(); ++v) {
    const float length = normals[v].stableNorm();
    if (length > 0.0f && normals[v].allFinite() && std::isfinite(length)) {
      normals[v] /= length;
      continue;
    }
    if (computed.empty()) computed = vertex_normals(mesh.vertices, mesh.faces);
    normals[v] = computed[v];
  }
  mesh.normals = std::move(normals);
}

RiggedShape shape_with_mesh(const ArrayFields& fields, const std::string& normals_name, const std::string& id,
                            const std::string& file) {
  RiggedShape shape;
  shape.id = id;
  shape.file = file;
  if (!fields.has("vertices")) return shape;
  shape.mesh.vertices = fields.points("vertices");
  if (fields.has("faces")) shape.mesh.faces = fields.triangles("faces", shape.mesh.vertices.size());
  if (fields.has(normals_name)) set_normals(shape, fields.unchecked_points(normals_name, 0));
  return shape;
}

void note_missing_parts(RiggedShape& shape) {
  if (shape.mesh.vertices.empty())
    shape.notes.push_back("no mesh: surface and skin metrics are not computed");
  else if (!shape.has_surface())
    shape.notes.push_back("no faces: the mesh is a point set");
  if (!shape.has_joints()) {
    shape.notes.push_back("no skeleton: skeleton and skin metrics are not computed");
    return;
  }
  const std::size_t repeated = repeated_places(shape.joints.positions);
  if (repeated > 0) shape.notes.push_back(std::to_string(repeated) + " joints lie exactly where another one does");
  const std::size_t trees = roots(shape.joints).size();
  if (trees > 1) shape.notes.push_back("a forest of " + std::to_string(trees) + " trees");
  if (!shape.mesh.vertices.empty() && !shape.has_skin())
    shape.notes.push_back("no skin weights: skin metrics are not computed");
}

}  // namespace anigen::io
