#include "anigen/rigging/surface.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>
#include <string>

#include "anigen/core/disjoint_sets.h"
#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/geometry/bones.h"

namespace anigen::rigging {

namespace {

void check_surface(const Mesh& mesh) {
  require_finite_vertices(mesh);
  for (std::size_t f = 0; f < mesh.faces.size(); ++f) {
    for (const std::int32_t v : mesh.faces[f]) {
      if (v >= 0 && at(v) < mesh.vertices.size()) continue;
      throw InputError("", "mesh.faces[" + std::to_string(f) + "]", "there is no vertex " + std::to_string(v));
    }
  }
}

/// 0 and −0 are one position.
std::array<float, 3> sortable(const Eigen::Vector3f& p) { return {p.x() + 0.0F, p.y() + 0.0F, p.z() + 0.0F}; }

/// Numbers the positions; places stay in the mesh's frame.
void number_places(const std::vector<Eigen::Vector3f>& vertices, WeldedSurface& surface) {
  std::vector<std::int32_t> order(vertices.size());
  std::iota(order.begin(), order.end(), 0);
  std::sort(order.begin(), order.end(),
            [&](std::int32_t a, std::int32_t b) { return sortable(vertices[at(a)]) < sortable(vertices[at(b)]); });
  surface.of_vertex.resize(vertices.size());
  for (std::size_t i = 0; i < order.size(); ++i) {
    const Eigen::Vector3f& vertex = vertices[at(order[i])];
    if (i == 0 || sortable(vertices[at(order[i - 1])]) != sortable(vertex))
      surface.places.push_back(vertex.cast<double>());
    surface.of_vertex[at(order[i])] = static_cast<std::int32_t>(surface.places.size() - 1);
  }
}

/// Lowest corner first, winding kept.
Triangle turned(const Triangle& face) {
  const auto lowest = static_cast<std::size_t>(std::min_element(face.begin(), face.end()) - face.begin());
  return {face[lowest], face[(lowest + 1) % 3], face[(lowest + 2) % 3]};
}

Triangle corner_set(Triangle face) {
  std::sort(face.begin(), face.end());
  return face;
}

std::vector<Triangle> welded_faces(const std::vector<Triangle>& faces, const std::vector<std::int32_t>& of_vertex) {
  std::vector<Triangle> welded;
  welded.reserve(faces.size());
  for (const Triangle& face : faces) {
    const Triangle corners = {of_vertex[at(face[0])], of_vertex[at(face[1])], of_vertex[at(face[2])]};
    if (corners[0] == corners[1] || corners[1] == corners[2] || corners[2] == corners[0]) continue;
    welded.push_back(turned(corners));
  }
  std::sort(welded.begin(), welded.end(), [](const Triangle& a, const Triangle& b) {
    const Triangle first = corner_set(a), second = corner_set(b);
    return first != second ? first < second : a < b;
  });
  const auto same = [](const Triangle& a, const Triangle& b) { return corner_set(a) == corner_set(b); };
  welded.erase(std::unique(welded.begin(), welded.end(), same), welded.end());
  return welded;
}

Eigen::Vector3d area_vector(const WeldedSurface& surface, const Triangle& face) {
  const Eigen::Vector3d& a = surface.places[at(face[0])];
  return 0.5 * (surface.places[at(face[1])] - a).cross(surface.places[at(face[2])] - a);
}

}  // namespace

WeldedSurface weld_surface(const Mesh& mesh) {
  check_surface(mesh);
  WeldedSurface surface;
  number_places(mesh.vertices, surface);
  surface.faces = welded_faces(mesh.faces, surface.of_vertex);
  // Vertices without a face do not count: a stray one far away would leave the rest a fraction of a voxel.
  Box box;
  for (const Triangle& face : surface.faces) {
    for (const std::int32_t place : face) box.extend(surface.places[at(place)]);
  }
  surface.has_extent = box.longest_side() > 0.0;
  if (surface.has_extent) {
    surface.center = box.center();
    surface.size = box.longest_side();
  }
  for (Eigen::Vector3d& place : surface.places) place = surface.to_unit(place);
  return surface;
}

SkinWeights rows_of_vertices(const SkinWeights& rows_of_places, const WeldedSurface& surface) {
  SkinWeights skin;
  skin.offsets.reserve(surface.of_vertex.size() + 1);
  for (const std::int32_t place : surface.of_vertex) skin.append_copy(rows_of_places, at(place));
  return skin;
}

bool SurfaceParts::encloses_space(std::size_t part) const {
  constexpr double kSphere = 1.0 / (6.0 * 1.7724538509055160);  // V / A^1.5 = 1 / (6 √π)
  constexpr double kLeast = 0.02;                               // flatter things are sheets
  return std::abs(volumes[part]) > kLeast * kSphere * std::pow(areas[part], 1.5);
}

SurfaceParts surface_parts(const WeldedSurface& surface) {
  DisjointSets joined(surface.places.size());
  for (const Triangle& face : surface.faces) {
    joined.join_lowest(at(face[0]), at(face[1]));
    joined.join_lowest(at(face[0]), at(face[2]));
  }
  SurfaceParts parts;
  parts.of_place.resize(surface.places.size());
  std::vector<std::int32_t> first;
  for (std::size_t p = 0; p < surface.places.size(); ++p) {
    const std::size_t lowest = joined.find(p);
    if (lowest == p) {
      parts.of_place[p] = static_cast<std::int32_t>(first.size());
      first.push_back(static_cast<std::int32_t>(lowest));
    } else {
      parts.of_place[p] = parts.of_place[lowest];
    }
  }
  parts.volumes.assign(first.size(), 0.0);
  parts.areas.assign(first.size(), 0.0);
  for (const Triangle& face : surface.faces) {
    const std::size_t part = at(parts.of_place[at(face[0])]);
    const Eigen::Vector3d vector = area_vector(surface, face);
    parts.volumes[part] += (surface.places[at(face[0])] - surface.places[at(first[part])]).dot(vector) / 3.0;
    parts.areas[part] += vector.norm();
  }
  return parts;
}

std::vector<Eigen::Vector3d> outward_normals(const WeldedSurface& surface, const SurfaceParts& parts) {
  std::vector<Eigen::Vector3d> normals(surface.places.size(), Eigen::Vector3d::Zero());
  for (const Triangle& face : surface.faces) {
    const std::size_t part = at(parts.of_place[at(face[0])]);
    const Eigen::Vector3d vector = area_vector(surface, face);
    const bool inverted = parts.volumes[part] < 0.0 && parts.encloses_space(part);
    for (const std::int32_t place : face) normals[at(place)] += inverted ? Eigen::Vector3d(-vector) : vector;
  }
  for (Eigen::Vector3d& normal : normals) {
    const double length = normal.stableNorm();
    normal = length > 0.0 ? Eigen::Vector3d(normal / length) : Eigen::Vector3d::Zero();
  }
  return normals;
}

void require_finite_vertices(const Mesh& mesh) {
  for (std::size_t v = 0; v < mesh.vertices.size(); ++v) {
    if (mesh.vertices[v].allFinite()) continue;
    throw InputError("", "mesh.vertices[" + std::to_string(v) + "]", "the position is not finite");
  }
}

void require_joints(const Skeleton& skeleton) {
  if (skeleton.size() == 0) throw InputError("", "skeleton", "there is no joint to bind to");
  if (skeleton.bind.size() != skeleton.size()) {
    throw InputError(
        "", "skeleton",
        std::to_string(skeleton.bind.size()) + " bind matrices for " + std::to_string(skeleton.size()) + " joints");
  }
  const std::vector<Eigen::Vector3d> positions = skeleton.positions();
  for (std::size_t j = 0; j < skeleton.size(); ++j) {
    const auto place = [&] { return "skeleton joint " + std::to_string(j); };
    if (!positions[j].allFinite()) throw InputError("", place(), "the position is not finite");
    if (skeleton.parents[j] < -1 || skeleton.parents[j] >= static_cast<int>(j))
      throw InputError("", place(), "its parent " + std::to_string(skeleton.parents[j]) + " does not come before it");
  }
}

std::vector<MovingBones> moving_bones(const Skeleton& skeleton, const WeldedSurface& surface) {
  require_joints(skeleton);
  constexpr double kFarthest = 1e6;
  std::vector<Eigen::Vector3f> joints;
  for (const Eigen::Vector3d& position : skeleton.positions())
    joints.push_back(surface.to_unit(position).cwiseMax(-kFarthest).cwiseMin(kFarthest).cast<float>());
  std::vector<MovingBones> bones(joints.size());
  const auto segments = geometry::bone_segments(joints, skeleton.parents);
  for (std::size_t j = 0; j < joints.size(); ++j) {
    bones[j].is_tip = true;
    for (const geometry::BoneSegment& segment : segments[j]) {
      bones[j].lines.push_back({segment.start.cast<double>(), segment.end.cast<double>()});
    }
  }
  for (const int parent : skeleton.parents) {
    if (parent >= 0) bones[at(parent)].is_tip = false;
  }
  return bones;
}

void join_lines(std::vector<MovingBones>& bones) {
  for (MovingBones& joint : bones) {
    if (joint.lines.size() < 2) continue;
    Eigen::Vector3d end = Eigen::Vector3d::Zero();
    for (const BoneLine& line : joint.lines) end += line.end / static_cast<double>(joint.lines.size());
    joint.lines = {{joint.lines.front().start, end}};
  }
}

double distance_to(const MovingBones& bones, const Eigen::Vector3d& point) {
  double nearest = std::numeric_limits<double>::infinity();
  for (const BoneLine& line : bones.lines)
    nearest = std::min(nearest, geometry::distance_to_segment(point, line.start, line.end));
  return nearest;
}

}  // namespace anigen::rigging
