#include "anigen/rig/embedding/solid_surface.h"

#include <algorithm>
#include <numeric>
#include <string>
#include <tuple>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"

namespace anigen::rig {
namespace {

Box checked_box(const Mesh& mesh) {
  if (mesh.faces.empty()) throw InputError("", "mesh.faces", "a mesh without faces has no inside to put a skeleton in");
  Box box;
  for (std::size_t f = 0; f < mesh.faces.size(); ++f) {
    for (const std::int32_t v : mesh.faces[f]) {
      if (v < 0 || at(v) >= mesh.vertices.size()) {
        throw InputError("", "mesh.faces[" + std::to_string(f) + "]", "there is no vertex " + std::to_string(v));
      }
      const Eigen::Vector3f& vertex = mesh.vertices[at(v)];
      if (!vertex.allFinite()) {
        throw InputError("", "mesh.vertices[" + std::to_string(v) + "]", "the vertex is not finite");
      }
      box.extend(vertex.cast<double>());
    }
  }
  if (!(box.longest_side() > 0.0)) {
    throw InputError("", "mesh", "all vertices of its faces lie in one point, so it has no extent");
  }
  return box;
}

/// For every vertex that a face uses the first one in the same place; -1 for others.
std::vector<int> welded(const Mesh& mesh) {
  std::vector<char> used(mesh.vertices.size(), 0);
  for (const Triangle& face : mesh.faces) {
    for (const std::int32_t v : face) used[at(v)] = 1;
  }
  std::vector<int> order;
  for (std::size_t v = 0; v < used.size(); ++v) {
    if (used[v] != 0) order.push_back(static_cast<int>(v));
  }
  const auto place = [&](int v) {
    const Eigen::Vector3f& p = mesh.vertices[at(v)];
    return std::make_tuple(p.x(), p.y(), p.z());
  };
  std::sort(order.begin(), order.end(), [&](int a, int b) {
    const auto pa = place(a), pb = place(b);
    return pa != pb ? pa < pb : a < b;
  });
  std::vector<int> first(mesh.vertices.size(), -1);
  for (std::size_t i = 0; i < order.size(); ++i) {
    const bool same = i > 0 && place(order[i]) == place(order[i - 1]);
    first[at(order[i])] = same ? first[at(order[i - 1])] : order[i];
  }
  return first;
}

double area_of(const SolidSurface& surface, const std::vector<int>& faces) {
  double sum = 0.0;
  for (const int f : faces) {
    const Triangle& t = surface.faces[at(f)];
    const Eigen::Vector3d& a = surface.vertices[at(t[0])];
    sum += (surface.vertices[at(t[1])] - a).cross(surface.vertices[at(t[2])] - a).norm();
  }
  return sum;
}

std::vector<std::vector<int>> connected_parts(const SolidSurface& surface) {
  std::vector<int> root(surface.vertices.size());
  std::iota(root.begin(), root.end(), 0);
  const auto find = [&](int v) {
    while (root[at(v)] != v) v = root[at(v)] = root[at(root[at(v)])];
    return v;
  };
  for (const Triangle& t : surface.faces) {
    root[at(find(t[1]))] = find(t[0]);
    root[at(find(t[2]))] = find(t[0]);
  }
  std::vector<int> part_of(surface.vertices.size(), -1);
  std::vector<std::vector<int>> parts;
  for (std::size_t f = 0; f < surface.faces.size(); ++f) {
    int& part = part_of[at(find(surface.faces[f][0]))];
    if (part < 0) {
      part = static_cast<int>(parts.size());
      parts.emplace_back();
    }
    parts[at(part)].push_back(static_cast<int>(f));
  }
  std::vector<double> areas;
  for (const auto& part : parts) areas.push_back(area_of(surface, part));
  std::vector<std::size_t> order(parts.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) { return areas[a] > areas[b]; });
  std::vector<std::vector<int>> sorted;
  for (const std::size_t part : order) sorted.push_back(std::move(parts[part]));
  return sorted;
}

}  // namespace

SolidSurface solid_surface(const Mesh& mesh, double size) {
  const Box box = checked_box(mesh);
  SolidSurface surface;
  surface.from_mesh.scale = size / box.longest_side();
  surface.from_mesh.offset = -surface.from_mesh.scale * box.center();
  std::vector<int> first = welded(mesh);
  std::vector<int> number(mesh.vertices.size(), -1);
  for (std::size_t v = 0; v < first.size(); ++v) {
    if (first[v] < 0) continue;
    if (at(first[v]) == v) {
      number[v] = static_cast<int>(surface.vertices.size());
      surface.vertices.push_back(surface.from_mesh.scale * mesh.vertices[v].cast<double>() + surface.from_mesh.offset);
    }
  }
  std::vector<Triangle> all;
  for (const Triangle& face : mesh.faces) {
    const Triangle t{number[at(first[at(face[0])])], number[at(first[at(face[1])])], number[at(first[at(face[2])])]};
    all.push_back(t);
    if (t[0] != t[1] && t[1] != t[2] && t[2] != t[0]) surface.faces.push_back(t);
  }
  if (surface.faces.empty()) surface.faces = std::move(all);
  surface.parts = connected_parts(surface);
  return surface;
}

}  // namespace anigen::rig
