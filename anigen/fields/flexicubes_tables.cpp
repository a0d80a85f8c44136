#include "anigen/fields/flexicubes_tables.h"

#include <algorithm>
#include <numeric>
#include <vector>

namespace anigen::fields {
namespace {

bool corner_inside(int cube_case, int corner) { return (cube_case >> corner & 1) != 0; }

bool edge_crosses(int cube_case, int edge) {
  const auto& [a, b] = kEdgeCorners[static_cast<std::size_t>(edge)];
  return corner_inside(cube_case, a) != corner_inside(cube_case, b);
}

bool edge_touches(int edge, int corner) {
  const auto& [a, b] = kEdgeCorners[static_cast<std::size_t>(edge)];
  return a == corner || b == corner;
}

struct CubeFace {
  int axis, side;

  bool has_corner(int corner) const { return (corner >> axis & 1) == side; }
  bool has_edge(int edge) const {
    const auto& [a, b] = kEdgeCorners[static_cast<std::size_t>(edge)];
    return has_corner(a) && has_corner(b);
  }
};

constexpr std::array<CubeFace, 6> kCubeFaces = {{{0, 0}, {0, 1}, {1, 0}, {1, 1}, {2, 0}, {2, 1}}};

std::vector<int> crossing_edges(int cube_case, const CubeFace& face) {
  std::vector<int> edges;
  for (int edge = 0; edge < kCubeEdges; ++edge) {
    if (face.has_edge(edge) && edge_crosses(cube_case, edge)) edges.push_back(edge);
  }
  return edges;
}

int inside_count(int cube_case) {
  int count = 0;
  for (int corner = 0; corner < 8; ++corner) count += corner_inside(cube_case, corner) ? 1 : 0;
  return count;
}

std::vector<CubeFace> ambiguous_faces(int cube_case) {
  std::vector<CubeFace> faces;
  for (const CubeFace& face : kCubeFaces) {
    if (crossing_edges(cube_case, face).size() == 4) faces.push_back(face);
  }
  return faces;
}

// Labels of edges: joined edges get one label, the smaller of the two.
class EdgeLabels {
 public:
  EdgeLabels() { std::iota(labels_.begin(), labels_.end(), 0); }
  void join(int a, int b) {
    const int kept = std::min(label(a), label(b)), dropped = std::max(label(a), label(b));
    std::replace(labels_.begin(), labels_.end(), dropped, kept);
  }
  int label(int edge) const { return labels_[static_cast<std::size_t>(edge)]; }

 private:
  std::array<int, kCubeEdges> labels_{};
};

// On a face with two crossing edges the surface connects them; on one with four it cuts off each inside corner.
EdgeLabels connected_edges(int cube_case) {
  EdgeLabels labels;
  for (const CubeFace& face : kCubeFaces) {
    const std::vector<int> edges = crossing_edges(cube_case, face);
    if (edges.size() == 2) labels.join(edges[0], edges[1]);
    if (edges.size() != 4) continue;
    for (int corner = 0; corner < 8; ++corner) {
      if (!face.has_corner(corner) || !corner_inside(cube_case, corner)) continue;
      std::vector<int> at_corner;
      for (const int edge : edges) {
        if (edge_touches(edge, corner)) at_corner.push_back(edge);
      }
      labels.join(at_corner[0], at_corner[1]);
    }
  }
  return labels;
}

int smallest_corner(int cube_case, const std::vector<int>& group, bool inside) {
  int smallest = 8;
  for (const int edge : group) {
    for (const int corner : kEdgeCorners[static_cast<std::size_t>(edge)]) {
      if (corner_inside(cube_case, corner) == inside) smallest = std::min(smallest, corner);
    }
  }
  return smallest;
}

std::vector<std::vector<int>> edge_groups(int cube_case) {
  const EdgeLabels labels = connected_edges(cube_case);
  std::vector<std::vector<int>> groups;
  for (int first = 0; first < kCubeEdges; ++first) {
    if (!edge_crosses(cube_case, first) || labels.label(first) != first) continue;  // labels are smallest edges
    std::vector<int> group;
    for (int edge = first; edge < kCubeEdges; ++edge) {
      if (edge_crosses(cube_case, edge) && labels.label(edge) == first) group.push_back(edge);
    }
    groups.push_back(group);
  }
  // The published tables order two cut-off outside corners by those corners, everything else by inside corners.
  const bool two_outside = inside_count(cube_case) == 6 && groups.size() == 2 && ambiguous_faces(cube_case).empty();
  std::stable_sort(groups.begin(), groups.end(), [&](const std::vector<int>& a, const std::vector<int>& b) {
    return smallest_corner(cube_case, a, !two_outside) < smallest_corner(cube_case, b, !two_outside);
  });
  return groups;
}

void fill_groups(FlexicubesTables& tables, int cube_case) {
  const auto c = static_cast<std::size_t>(cube_case);
  for (auto& group : tables.groups[c]) group.fill(-1);
  tables.group_of_edge[c].fill(-1);
  tables.slot_of_edge[c].fill(-1);
  const std::vector<std::vector<int>> groups = edge_groups(cube_case);
  tables.counts[c] = static_cast<std::int16_t>(groups.size());
  for (std::size_t g = 0; g < groups.size(); ++g) {
    for (std::size_t slot = 0; slot < groups[g].size(); ++slot) {
      const auto edge = static_cast<std::size_t>(groups[g][slot]);
      tables.groups[c][g][slot] = static_cast<std::int16_t>(edge);
      tables.group_of_edge[c][edge] = static_cast<std::int8_t>(g);
      tables.slot_of_edge[c][edge] = static_cast<std::int8_t>(slot);
      ++tables.crossings[c];
    }
  }
}

void fill_ambiguity(FlexicubesTables& tables, int cube_case) {
  const std::vector<CubeFace> faces = ambiguous_faces(cube_case);
  if (faces.size() != 1 || inside_count(cube_case) < 5) return;
  auto& row = tables.ambiguity[static_cast<std::size_t>(cube_case)];
  row[0] = 1;
  row[static_cast<std::size_t>(1 + faces[0].axis)] = static_cast<std::int16_t>(2 * faces[0].side - 1);
  row[4] = static_cast<std::int16_t>(FlexicubesTables::kCases - 1 - cube_case);
}

FlexicubesTables make_tables() {
  FlexicubesTables tables;
  for (int cube_case = 0; cube_case < FlexicubesTables::kCases; ++cube_case) {
    fill_groups(tables, cube_case);
    fill_ambiguity(tables, cube_case);
  }
  return tables;
}

}  // namespace

int edge_from_corner(int corner, int axis) {
  const int other = corner | 1 << axis;
  int edge = 0;
  while (!(edge_touches(edge, corner) && edge_touches(edge, other))) ++edge;
  return edge;
}

const FlexicubesTables& flexicubes_tables() {
  static const FlexicubesTables tables = make_tables();
  return tables;
}

}  // namespace anigen::fields
