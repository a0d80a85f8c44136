#include "anigen/rigging/bodies.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <string>
#include <utility>

#include "anigen/core/disjoint_sets.h"
#include "anigen/core/numeric.h"
#include "anigen/rigging/surface.h"

namespace anigen::rigging {

namespace {

constexpr double kBodiesApart = 0.05;  ///< of the mesh's diagonal, along one axis at least
constexpr double kLeastBodyDiagonal = 0.5, kLeastBodyArea = 0.3;
constexpr std::size_t kMostComponents = 1024, kMostBodies = 8;

struct BodyGroup {
  Box box;
  double area = 0.0;
};

/// Largest gap along one axis; negative where the boxes overlap.
double box_gap(const Box& a, const Box& b) { return (a.low - b.high).cwiseMax(b.low - a.high).maxCoeff(); }

/// Group of each component: those whose boxes come near, transitively. A component without faces has none (-1).
std::vector<int> grouped_components(const std::vector<BodyGroup>& components, double least_gap,
                                    std::vector<BodyGroup>& groups) {
  std::vector<std::size_t> order;
  for (std::size_t c = 0; c < components.size(); ++c) {
    if (components[c].area > 0.0) order.push_back(c);
  }
  std::sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
    return std::make_pair(components[a].box.low.x(), a) < std::make_pair(components[b].box.low.x(), b);
  });
  // Groups' boxes grow as they join: until nothing does, for a group may come near another by a member of its own.
  DisjointSets joined(components.size());
  std::vector<Box> boxes(components.size());
  for (const std::size_t c : order) boxes[c] = components[c].box;
  for (bool grew = true; grew;) {
    grew = false;
    for (std::size_t i = 0; i < order.size(); ++i) {
      for (std::size_t k = i + 1; k < order.size(); ++k) {
        const std::size_t a = joined.find(order[i]), b = joined.find(order[k]);
        if (a == b || box_gap(boxes[a], boxes[b]) > least_gap) continue;
        joined.join(a, b);
        boxes[a].extend(boxes[b].low);
        boxes[a].extend(boxes[b].high);
        grew = true;
      }
    }
  }
  std::vector<int> of(components.size(), -1), of_set(components.size(), -1);
  for (const std::size_t c : order) {
    const std::size_t set = joined.find(c);
    if (of_set[set] < 0) {
      of_set[set] = static_cast<int>(groups.size());
      groups.push_back({boxes[set], 0.0});
    }
    of[c] = of_set[set];
    groups[at(of[c])].area += components[c].area;
  }
  return of;
}

/// Body of each group: that of large ones their own, of small ones the nearest. Fewer than two, or too many: empty.
std::vector<int> bodies_of_groups(const std::vector<BodyGroup>& groups, std::vector<Box>& bodies) {
  BodyGroup largest;
  for (const BodyGroup& group : groups) {
    if (group.area > largest.area) largest = group;
  }
  std::vector<int> of(groups.size(), -1);
  for (std::size_t g = 0; g < groups.size(); ++g) {
    if (groups[g].box.diagonal() < kLeastBodyDiagonal * largest.box.diagonal()) continue;
    if (groups[g].area < kLeastBodyArea * largest.area) continue;
    of[g] = static_cast<int>(bodies.size());
    bodies.push_back(groups[g].box);
  }
  if (bodies.size() < 2 || bodies.size() > kMostBodies) return {};
  return of;
}

int nearest_body(const Box& box, const std::vector<Box>& bodies) {
  int nearest = 0;
  double least = INFINITY;
  for (std::size_t b = 0; b < bodies.size(); ++b) {
    const Eigen::Vector3d gap =
        (box.low - bodies[b].high).cwiseMax(bodies[b].low - box.high).cwiseMax(Eigen::Vector3d::Zero());
    if (gap.norm() >= least) continue;
    least = gap.norm();
    nearest = static_cast<int>(b);
  }
  return nearest;
}

}  // namespace

std::vector<SeparateBody> separate_bodies(const Mesh& mesh) {
  const WeldedSurface surface = weld_surface(mesh);
  const SurfaceParts parts = surface_parts(surface);
  std::vector<BodyGroup> components(parts.size());
  Box whole;
  for (std::size_t p = 0; p < surface.places.size(); ++p)
    components[at(parts.of_place[p])].box.extend(surface.places[p]);
  std::size_t with_faces = 0;
  for (std::size_t c = 0; c < components.size(); ++c) {
    components[c].area = parts.areas[c];
    if (!(components[c].area > 0.0)) continue;
    ++with_faces;
    whole.extend(components[c].box.low);
    whole.extend(components[c].box.high);
  }
  if (with_faces < 2 || with_faces > kMostComponents) return {};
  std::vector<BodyGroup> groups;
  std::vector<int> of_component = grouped_components(components, kBodiesApart * whole.diagonal(), groups);
  std::vector<Box> boxes;
  std::vector<int> of_group = bodies_of_groups(groups, boxes);
  if (of_group.empty()) return {};
  std::vector<std::size_t> order(boxes.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
    return std::make_pair(boxes[a].low.x(), a) < std::make_pair(boxes[b].low.x(), b);
  });
  std::vector<int> rank(boxes.size());
  for (std::size_t i = 0; i < order.size(); ++i) rank[order[i]] = static_cast<int>(i);
  for (std::size_t c = 0; c < components.size(); ++c) {
    int body = of_component[c] < 0 ? -1 : of_group[at(of_component[c])];
    if (body < 0) body = nearest_body(of_component[c] < 0 ? components[c].box : groups[at(of_component[c])].box, boxes);
    of_component[c] = rank[at(body)];
  }
  std::vector<SeparateBody> bodies(boxes.size());
  std::vector<std::int32_t> index(mesh.vertices.size());
  const auto body_of = [&](std::int32_t vertex) {
    return at(of_component[at(parts.of_place[at(surface.of_vertex[at(vertex)])])]);
  };
  for (std::size_t v = 0; v < mesh.vertices.size(); ++v) {
    SeparateBody& body = bodies[body_of(static_cast<std::int32_t>(v))];
    index[v] = static_cast<std::int32_t>(body.vertices.size());
    body.vertices.push_back(static_cast<std::int32_t>(v));
    body.mesh.vertices.push_back(mesh.vertices[v]);
    if (!mesh.normals.empty()) body.mesh.normals.push_back(mesh.normals[v]);
  }
  for (const Triangle& face : mesh.faces)
    bodies[body_of(face[0])].mesh.faces.push_back({index[at(face[0])], index[at(face[1])], index[at(face[2])]});
  return bodies;
}

Skeleton joined_skeleton(const std::vector<Skeleton>& skeletons) {
  std::vector<Eigen::Vector3d> positions{Eigen::Vector3d::Zero()};
  std::vector<int> parents{-1};
  std::vector<std::string> names{"root"};
  for (std::size_t b = 0; b < skeletons.size(); ++b) {
    const Skeleton& skeleton = skeletons[b];
    const int first = static_cast<int>(positions.size());
    const std::vector<Eigen::Vector3d> places = skeleton.positions();
    positions[0] += places[0] / static_cast<double>(skeletons.size());
    for (std::size_t j = 0; j < skeleton.size(); ++j) {
      positions.push_back(places[j]);
      parents.push_back(skeleton.parents[j] < 0 ? 0 : first + skeleton.parents[j]);
      names.push_back("body_" + std::to_string(b + 1) + "_" + skeleton.names[j]);
    }
  }
  return skeleton_from_joints(positions, parents, names);
}

SkinWeights joined_skin(const std::vector<SeparateBody>& bodies, const std::vector<SkinWeights>& skins,
                        const std::vector<Skeleton>& skeletons, std::size_t vertices) {
  std::vector<std::pair<std::size_t, std::size_t>> row_of(vertices);  // body, row
  std::vector<std::int32_t> first{1};
  for (std::size_t b = 0; b < bodies.size(); ++b) {
    first.push_back(first.back() + static_cast<std::int32_t>(skeletons[b].size()));
    for (std::size_t v = 0; v < bodies[b].vertices.size(); ++v) row_of[at(bodies[b].vertices[v])] = {b, v};
  }
  SkinWeights skin;
  skin.offsets.reserve(vertices + 1);
  for (const auto& [body, row] : row_of) {
    const std::size_t begin = skin.influences.size();
    skin.append_copy(skins[body], row);
    for (std::size_t i = begin; i < skin.influences.size(); ++i) skin.influences[i].joint += first[body];
  }
  return skin;
}

}  // namespace anigen::rigging
