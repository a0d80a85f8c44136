#include "anigen/loaders/rignet/rignet_mesh.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <map>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/geometry/simplify.h"
#include "anigen/rig/binding/welded_surface.h"

namespace anigen::loaders {
namespace {

constexpr double kTolerance = 1.5;     // of the number of vertices asked for, before the surface is torn
constexpr double kFirstCells = 128.0;  // along the longest side, of the grid then
constexpr double kFewerCells = 0.85;

struct Surface {
  std::vector<Eigen::Vector3f> vertices;
  std::vector<Triangle> faces;
};

// The vertices that faces name, in order.
Surface without_strays(const Surface& surface) {
  std::vector<std::int32_t> number(surface.vertices.size(), -1);
  for (const Triangle& face : surface.faces) {
    for (const std::int32_t corner : face) number[at(corner)] = 0;
  }
  Surface kept;
  for (std::size_t v = 0; v < number.size(); ++v) {
    if (number[v] < 0) continue;
    number[v] = static_cast<std::int32_t>(kept.vertices.size());
    kept.vertices.push_back(surface.vertices[v]);
  }
  for (const Triangle& face : surface.faces) {
    kept.faces.push_back({number[at(face[0])], number[at(face[1])], number[at(face[2])]});
  }
  return kept;
}

Surface welded(const std::vector<Eigen::Vector3f>& vertices, const std::vector<Triangle>& faces) {
  Mesh mesh;
  mesh.vertices = vertices;
  mesh.faces = faces;
  const rig::WeldedSurface whole = rig::weld_surface(mesh);
  if (!whole.has_extent || whole.faces.empty()) throw InputError("", "faces", "the mesh has no extent");
  Surface surface;
  for (const Eigen::Vector3d& place : whole.places) {
    surface.vertices.emplace_back((whole.center + whole.size * place).cast<float>());
  }
  surface.faces = whole.faces;
  return without_strays(surface);
}

// Vertices of one cell become one at their mean; faces that no longer have three are gone.
Surface snapped(const Surface& surface, double cell) {
  std::map<std::array<std::int64_t, 3>, std::int32_t> cells;
  std::vector<std::int32_t> number;
  std::vector<Eigen::Vector3d> sums;
  std::vector<double> counts;
  for (const Eigen::Vector3f& vertex : surface.vertices) {
    const auto key = [&](int axis) { return std::llround(std::floor(vertex[axis] / cell)); };
    const auto [place, is_new] = cells.try_emplace({key(0), key(1), key(2)}, static_cast<std::int32_t>(sums.size()));
    if (is_new) {
      sums.emplace_back(Eigen::Vector3d::Zero());
      counts.push_back(0.0);
    }
    sums[at(place->second)] += vertex.cast<double>();
    counts[at(place->second)] += 1.0;
    number.push_back(place->second);
  }
  Surface coarse;
  for (std::size_t v = 0; v < sums.size(); ++v) coarse.vertices.emplace_back((sums[v] / counts[v]).cast<float>());
  for (const Triangle& face : surface.faces) {
    const Triangle corners = {number[at(face[0])], number[at(face[1])], number[at(face[2])]};
    if (corners[0] == corners[1] || corners[1] == corners[2] || corners[2] == corners[0]) continue;
    coarse.faces.push_back(corners);
  }
  return without_strays(coarse);
}

Surface coarsened(Surface surface, double longest_side, std::size_t most_vertices) {
  if (surface.vertices.size() <= most_vertices) return surface;
  const double share = static_cast<double>(most_vertices) / static_cast<double>(surface.vertices.size());
  const auto faces = static_cast<std::size_t>(share * static_cast<double>(surface.faces.size()));
  const Mesh mesh = geometry::simplify(surface.vertices, surface.faces, std::max<std::size_t>(faces, 4)).mesh;
  Surface coarse = without_strays({mesh.vertices, mesh.faces});
  const auto enough = static_cast<std::size_t>(kTolerance * static_cast<double>(most_vertices));
  for (double cells = kFirstCells; coarse.vertices.size() > enough && cells >= 1.0; cells *= kFewerCells) {
    Surface torn = snapped(surface, longest_side / cells);
    if (torn.faces.empty()) break;
    coarse = std::move(torn);
  }
  return coarse;
}

}  // namespace

RignetFrame RignetFrame::of(const std::vector<Eigen::Vector3f>& vertices) {
  RignetFrame frame;
  frame.anymate_ = AnymateFrame::of(vertices);
  frame.floor_ = frame.anymate_.into(bounding_box(vertices).low).y();
  return frame;
}

Eigen::Vector3d RignetFrame::from_anymate(const Eigen::Vector3d& point) const {
  return 0.5 * (point - Eigen::Vector3d(0.0, floor_, 0.0));
}

Eigen::Vector3d RignetFrame::to_anymate(const Eigen::Vector3d& point) const {
  return 2.0 * point + Eigen::Vector3d(0.0, floor_, 0.0);
}

Eigen::Vector3d RignetFrame::into(const Eigen::Vector3d& point) const { return from_anymate(anymate_.into(point)); }
Eigen::Vector3d RignetFrame::out_of(const Eigen::Vector3d& point) const { return anymate_.out_of(to_anymate(point)); }

RignetMesh rignet_mesh(const std::vector<Eigen::Vector3f>& vertices, const std::vector<Triangle>& faces,
                       std::size_t most_vertices) {
  RignetMesh mesh;
  mesh.frame = RignetFrame::of(vertices);
  const Surface surface = coarsened(welded(vertices, faces), bounding_box(vertices).longest_side(), most_vertices);
  for (const Eigen::Vector3f& vertex : surface.vertices) {
    mesh.vertices.emplace_back(mesh.frame.into(vertex.cast<double>()).cast<float>());
  }
  mesh.faces = surface.faces;
  return mesh;
}

}  // namespace anigen::loaders
