#include "anigen/shape_field/flexicubes.h"

#include <algorithm>
#include <functional>
#include <numeric>
#include <utility>
#include <vector>

#include "anigen/shape_field/dual_vertices.h"
#include "anigen/shape_field/grid.h"

namespace anigen::shape_field {

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
  row[static_cast<std::size_t>(faces[0].axis) + 1] = static_cast<std::int16_t>(2 * faces[0].side - 1);
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

// A grid edge has four cubes around it. Seen from each in ascending order, the edge's lower end is this corner.
constexpr std::array<std::array<int, 4>, 3> kCornersAroundEdge = {{{6, 2, 4, 0}, {5, 1, 4, 0}, {3, 1, 2, 0}}};

// Edges at a vertex that is their first end, in the order of their second ends; y-edges are stored from high to low.
constexpr std::array<int, 3> kAxesInOrder = {1, 2, 0};

struct SurfaceCubes {
  GridSet numbers;
  std::vector<std::uint8_t> cases;
};

// Cubes with some but not all corners inside. Every one of them touches an inside vertex, so that only cubes around
// those are looked at.
SurfaceCubes find_surface_cubes(const GridSet& inside, const GridNumbering& grid) {
  GridSet around = inside;
  for (const int axis : {2, 1, 0}) around = with_shifted(around, -grid.step(axis));
  around.erase(std::remove_if(around.begin(), around.end(), [&](std::int64_t n) { return !grid.is_cube(n); }),
               around.end());
  std::vector<std::uint8_t> cases(around.size(), 0);
  for (int corner = 0; corner < kCubeCorners; ++corner) {
    match_shifted(inside, around, grid.corner_step(corner), [&](std::int64_t i, std::int64_t found) {
      std::uint8_t& cube_case = cases[static_cast<std::size_t>(i)];
      if (found >= 0) cube_case = static_cast<std::uint8_t>(cube_case | 1 << corner);
    });
  }
  SurfaceCubes cubes;
  for (std::size_t i = 0; i < around.size(); ++i) {
    if (cases[i] == FlexicubesTables::kCases - 1) continue;  // none is 0: each touches an inside vertex
    cubes.numbers.push_back(around[i]);
    cubes.cases.push_back(cases[i]);
  }
  return cubes;
}

// Two cubes that share their ambiguous face must connect it the same way. All cubes decide by the original cases.
void decide_ambiguous_faces(SurfaceCubes& cubes, const GridNumbering& grid) {
  const auto& ambiguity = flexicubes_tables().ambiguity;
  std::vector<std::uint8_t> decided = cubes.cases;
  for (std::size_t i = 0; i < decided.size(); ++i) {
    const auto& row = ambiguity[cubes.cases[i]];
    if (row[0] == 0) continue;
    // A step out of the grid ends at a number that no cube has.
    const std::int64_t across = cubes.numbers[i] + grid.number(row[1], row[2], row[3]);
    const auto place = std::lower_bound(cubes.numbers.begin(), cubes.numbers.end(), across);
    if (place == cubes.numbers.end() || *place != across) continue;
    const auto neighbour = static_cast<std::size_t>(place - cubes.numbers.begin());
    if (ambiguity[cubes.cases[neighbour]][0] != 0) decided[i] = static_cast<std::uint8_t>(row[4]);
  }
  cubes.cases = std::move(decided);
}

// Links of a set of places to the rows of a table that holds some of them, each at most once.
RowLinks link_places(const GridSet& places, const GridSet& table, const std::vector<std::int32_t>& table_rows) {
  RowLinks links{torch::empty({static_cast<std::int64_t>(places.size())}, torch::kInt64),
                 torch::full({static_cast<std::int64_t>(table.size()), 1}, -1, torch::kInt32)};
  std::int64_t* targets = links.targets.data_ptr<std::int64_t>();
  std::int32_t* sources = links.sources.data_ptr<std::int32_t>();
  match_shifted(table, places, 0, [&](std::int64_t i, std::int64_t found) {
    targets[i] = found < 0 ? -1 : table_rows[static_cast<std::size_t>(found)];
    if (found >= 0) sources[targets[i]] = static_cast<std::int32_t>(i);
  });
  return links;
}

Tensor int32_tensor(const std::vector<std::int32_t>& values) {
  const Tensor tensor = torch::empty({static_cast<std::int64_t>(values.size())}, torch::kInt32);
  std::copy(values.begin(), values.end(), tensor.data_ptr<std::int32_t>());
  return tensor;
}

// Dual vertices are numbered by the number of groups of their cube, then by cube, then by group.
void number_duals(const std::vector<std::uint8_t>& cases, DualTopology& topology) {
  const FlexicubesTables& tables = flexicubes_tables();
  std::array<std::int32_t, FlexicubesTables::kMostGroups + 2> next{};  // by number of groups
  for (const std::uint8_t cube_case : cases)
    next[static_cast<std::size_t>(tables.counts[cube_case]) + 1] += tables.counts[cube_case];
  for (std::size_t groups = 1; groups < next.size(); ++groups) next[groups] += next[groups - 1];
  topology.duals = next.back();
  std::vector<std::int32_t> first_dual, first_crossing;
  std::int32_t crossings = 0;
  for (const std::uint8_t cube_case : cases) {
    std::int32_t& dual = next[static_cast<std::size_t>(tables.counts[cube_case])];
    first_dual.push_back(dual);
    dual += tables.counts[cube_case];
    first_crossing.push_back(crossings);
    crossings += tables.crossings[cube_case];
  }
  topology.crossings = crossings;
  topology.first_dual = int32_tensor(first_dual);
  topology.first_crossing = int32_tensor(first_crossing);
  topology.cases = torch::empty({static_cast<std::int64_t>(cases.size())}, torch::kUInt8);
  std::copy(cases.begin(), cases.end(), topology.cases.data_ptr<std::uint8_t>());
}

void link_cube_corners(const GridSet& cubes, const GridSet& vertices, const GridNumbering& grid,
                       DualTopology& topology) {
  topology.corners = torch::empty({static_cast<std::int64_t>(cubes.size()), kCubeCorners}, torch::kInt32);
  topology.corner_sources = torch::full({static_cast<std::int64_t>(vertices.size()), kCubeCorners}, -1, torch::kInt32);
  std::int32_t* corners = topology.corners.data_ptr<std::int32_t>();
  std::int32_t* sources = topology.corner_sources.data_ptr<std::int32_t>();
  for (int corner = 0; corner < kCubeCorners; ++corner) {
    match_shifted(vertices, cubes, grid.corner_step(corner), [&](std::int64_t cube, std::int64_t vertex) {
      corners[cube * kCubeCorners + corner] = static_cast<std::int32_t>(vertex);
      sources[vertex * kCubeCorners + corner] = static_cast<std::int32_t>(cube * kCubeCorners + corner);
    });
  }
}

// Sign of the field at the surface vertices. The winding asks for > 0 and the topology for < 0, which differ at 0.
struct VertexSigns {
  std::vector<std::uint8_t> inside, positive;
};

VertexSigns vertex_signs(const CubeField& field, const DualTopology& topology) {
  const Tensor sdf = field.sdf.detach();
  const Tensor negative = sdf.lt(0).to(torch::kCPU).contiguous(), above = sdf.gt(0).to(torch::kCPU).contiguous();
  const bool *is_negative = negative.data_ptr<bool>(), *is_above = above.data_ptr<bool>();
  const std::int64_t* rows = topology.vertices.targets.data_ptr<std::int64_t>();
  const auto count = static_cast<std::size_t>(topology.vertices.targets.size(0));
  VertexSigns signs{std::vector<std::uint8_t>(count, 0), std::vector<std::uint8_t>(count, 1)};
  for (std::size_t i = 0; i < count; ++i) {
    if (rows[i] < 0) continue;  // no active cube: +1
    signs.inside[i] = is_negative[rows[i]] ? 1 : 0;
    signs.positive[i] = is_above[rows[i]] ? 1 : 0;
  }
  return signs;
}

struct QuadCorner {
  std::int32_t cube;
  std::int8_t edge;  // of the cube
};
using Quad = std::array<QuadCorner, 4>;

// The cubes around the grid edge along an axis from a lower end, ascending; false at the boundary of the grid.
bool cubes_around(const std::int32_t* corner_sources, int axis, Quad& quad) {
  for (std::size_t i = 0; i < quad.size(); ++i) {
    const int corner = kCornersAroundEdge[static_cast<std::size_t>(axis)][i];
    if (corner_sources[corner] < 0) return false;
    quad[i] = {corner_sources[corner] / kCubeCorners, static_cast<std::int8_t>(edge_from_corner(corner, axis))};
  }
  return true;
}

// Position of the second end of the edges along an axis whose first end is each vertex; −1: not a surface vertex.
std::vector<std::int32_t> second_ends(const GridSet& vertices, const GridNumbering& grid, int axis) {
  std::vector<std::int32_t> ends(vertices.size());
  const std::int64_t step = axis == 1 ? -grid.step(1) : grid.step(axis);
  match_shifted(vertices, vertices, step, [&](std::int64_t i, std::int64_t found) {
    ends[static_cast<std::size_t>(i)] = static_cast<std::int32_t>(found);
  });
  return ends;
}

// Quads in order: those of edges whose first end is outside, then the others; each in the order of edges.
std::vector<Quad> find_quads(const GridSet& vertices, const GridNumbering& grid, const VertexSigns& signs,
                             const Tensor& corner_sources) {
  const std::array<std::vector<std::int32_t>, 3> ends = {second_ends(vertices, grid, 0), second_ends(vertices, grid, 1),
                                                         second_ends(vertices, grid, 2)};
  const std::int32_t* sources = corner_sources.data_ptr<std::int32_t>();
  std::vector<Quad> outward, inward;
  for (std::size_t first = 0; first < vertices.size(); ++first) {
    for (const int axis : kAxesInOrder) {
      const std::int32_t end = ends[static_cast<std::size_t>(axis)][first];
      if (end < 0) continue;
      const auto second = static_cast<std::size_t>(end);
      if (signs.inside[first] == signs.inside[second]) continue;
      Quad q{};
      if (!cubes_around(sources + (axis == 1 ? second : first) * kCubeCorners, axis, q)) continue;
      if (signs.positive[first] != 0) {
        outward.push_back(Quad{q[0], q[1], q[3], q[2]});
      } else {
        inward.push_back(Quad{q[2], q[3], q[1], q[0]});
      }
    }
  }
  outward.insert(outward.end(), inward.begin(), inward.end());
  return outward;
}

void link_quads(const std::vector<Quad>& quads, DualTopology& topology) {
  const FlexicubesTables& tables = flexicubes_tables();
  const auto corners = static_cast<std::int64_t>(4 * quads.size());
  const auto links_to = [&](std::int64_t rows, std::int64_t slots) {
    return RowLinks{torch::empty({corners}, torch::kInt64), torch::full({rows, slots}, -1, torch::kInt32)};
  };
  topology.quad_duals = links_to(topology.duals, FlexicubesTables::kMostEdges);
  topology.quad_cubes = links_to(topology.cubes(), kCubeEdges);
  std::int64_t* duals = topology.quad_duals.targets.data_ptr<std::int64_t>();
  std::int64_t* cubes = topology.quad_cubes.targets.data_ptr<std::int64_t>();
  std::int32_t* dual_sources = topology.quad_duals.sources.data_ptr<std::int32_t>();
  std::int32_t* cube_sources = topology.quad_cubes.sources.data_ptr<std::int32_t>();
  const std::uint8_t* cases = topology.cases.data_ptr<std::uint8_t>();
  const std::int32_t* first_dual = topology.first_dual.data_ptr<std::int32_t>();
  std::int32_t entry = 0;
  for (const Quad& quad : quads) {
    for (const QuadCorner& corner : quad) {
      const auto edge = static_cast<std::size_t>(corner.edge);
      const std::uint8_t cube_case = cases[corner.cube];
      const std::int64_t dual = first_dual[corner.cube] + tables.group_of_edge[cube_case][edge];
      duals[entry] = dual;
      cubes[entry] = corner.cube;
      dual_sources[dual * FlexicubesTables::kMostEdges + tables.slot_of_edge[cube_case][edge]] = entry;
      cube_sources[corner.cube * kCubeEdges + corner.edge] = entry;
      ++entry;
    }
  }
}

constexpr double kWeightRange = 0.99;  // weights lie in 1 ± 0.99, gamma in [0.005, 0.995]

ExtractedSurface empty_surface(const CubeField& field, bool training) {
  ExtractedSurface surface;
  surface.vertices = torch::zeros({0, 3}, field.sdf.options());
  surface.faces = torch::zeros({0, 3}, field.sdf.options().dtype(torch::kInt64));
  surface.attributes = torch::zeros({0, field.attributes.size(1)}, field.sdf.options());
  if (training) surface.deviation = torch::zeros({0}, field.sdf.options());
  return surface;
}

// Signed distance, position and attributes at the grid vertices of surface cubes. @return [S, 4 + A]
Tensor vertex_rows(const CubeField& field, const DualTopology& topology) {
  const RowLinks links = topology.vertices.to(field.sdf.device());
  const Tensor outside = links.targets.lt(0).to(field.sdf.scalar_type()).unsqueeze(1);  // +1 where no cube is active
  const Tensor sdf = gather_rows(field.sdf.unsqueeze(1), links) + outside;
  const Tensor deform = gather_rows(field.deform, links);
  return torch::cat({sdf, vertex_positions(topology.vertex_places, deform, field.resolution, field.sdf),
                     gather_rows(field.attributes, links)},
                    1);
}

struct SurfaceWeights {
  Tensor beta, alpha, gamma;  // [Q, 12], [Q, 8], [Q, 1]
};

SurfaceWeights surface_weights(const CubeField& field, const DualTopology& topology) {
  const Tensor raw = gather_rows(field.weights, topology.weights.to(field.sdf.device()));
  const std::vector<Tensor> parts = raw.split_with_sizes({12, 8, 1}, 1);
  // β, α = 1 + 0.99 tanh(·), γ = 0.005 + 0.99 σ(·)
  const auto around_one = [](const Tensor& part) { return torch::tanh(part) * kWeightRange + 1.0; };
  return {around_one(parts[0]), around_one(parts[1]), torch::sigmoid(parts[2]) * kWeightRange + 0.005};
}

// A = γ_0 γ_2 and B = γ_1 γ_3, the products over the diagonals of each quad. @return [F, 1] each
struct DiagonalWeights {
  DiagonalWeights(const Tensor& gamma, const RowLinks& quad_cubes) {
    const std::vector<Tensor> corner = gather_rows(gamma, quad_cubes).view({-1, 4}).split(1, 1);
    first = corner[0] * corner[2];
    second = corner[1] * corner[3];
  }
  Tensor first, second;
};

// Columns of the quads as triangles. @param quads [F, 4 or 5] @return [F · columns / 3, 3]
Tensor triangles(const Tensor& quads, const std::vector<std::int64_t>& columns) {
  const Tensor index = torch::tensor(columns, quads.options());
  return quads.index_select(1, index).view({-1, 3});
}

// Two triangles along the diagonal with the larger of A and B.
Tensor split_quads(const Tensor& quads, const DiagonalWeights& weights) {
  const auto as_rows = [](const Tensor& faces) { return faces.view({-1, 6}); };
  const Tensor along_first = as_rows(triangles(quads, {0, 1, 2, 0, 2, 3}));
  const Tensor along_second = as_rows(triangles(quads, {0, 1, 3, 3, 1, 2}));
  return torch::where(weights.first.gt(weights.second), along_first, along_second).reshape({-1, 3});
}

// Centre (A (v_0 + v_2)/2 + B (v_1 + v_3)/2) / (A + B + 1e-8) of each quad. @param values [D, ch] @return [F, ch]
Tensor quad_centres(const Tensor& values, const RowLinks& quad_duals, const DiagonalWeights& weights) {
  const std::vector<Tensor> corner = gather_rows(values, quad_duals).view({-1, 4, values.size(1)}).unbind(1);
  const Tensor first = (corner[0] + corner[2]) / 2.0, second = (corner[1] + corner[3]) / 2.0;
  return (first * weights.first + second * weights.second) / (weights.first + weights.second + 1e-8);
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

DualTopology dual_topology(const CubeField& field) {
  RECORD_USER_SCOPE("surface extraction: topology");
  const GridNumbering grid{field.resolution + 1};
  const GridSet active_vertices = grid_numbers(field.vertices, grid);
  TORCH_CHECK(std::is_sorted(active_vertices.begin(), active_vertices.end(), std::less_equal<>()),
              "the vertices of a field are sorted and differ");
  const Tensor negative = field.sdf.detach().lt(0).to(torch::kCPU).contiguous();
  const bool* is_inside = negative.data_ptr<bool>();
  GridSet inside;
  for (std::size_t i = 0; i < active_vertices.size(); ++i) {
    if (is_inside[i]) inside.push_back(active_vertices[i]);
  }
  SurfaceCubes cubes = find_surface_cubes(inside, grid);
  TORCH_CHECK(cubes.numbers.size() < (std::size_t{1} << 27), "too many surface cubes");  // 4F counts in 31 bits
  decide_ambiguous_faces(cubes, grid);
  GridSet vertices = cubes.numbers;
  for (const int axis : {2, 1, 0}) vertices = with_shifted(vertices, grid.step(axis));

  DualTopology topology;
  number_duals(cubes.cases, topology);
  link_cube_corners(cubes.numbers, vertices, grid, topology);
  topology.vertex_places = grid_places(vertices, grid);
  std::vector<std::int32_t> identity(active_vertices.size());
  for (std::size_t i = 0; i < identity.size(); ++i) identity[i] = static_cast<std::int32_t>(i);
  topology.vertices = link_places(vertices, active_vertices, identity);
  const std::vector<std::int64_t> active_numbers = grid_numbers(field.coords, grid);
  const std::vector<std::int32_t> order = sorting_order(active_numbers);
  GridSet active_cubes;
  active_cubes.reserve(order.size());
  for (const std::int32_t row : order) active_cubes.push_back(active_numbers[static_cast<std::size_t>(row)]);
  topology.weights = link_places(cubes.numbers, active_cubes, order);
  link_quads(find_quads(vertices, grid, vertex_signs(field, topology), topology.corner_sources), topology);
  return topology;
}

ExtractedSurface flexicubes(const CubeField& field, bool training) {
  const DualTopology topology = dual_topology(field);
  if (topology.cubes() == 0) return empty_surface(field, training);
  const torch::Device device = field.sdf.device();
  const SurfaceWeights weights = surface_weights(field, topology);
  const DualVertices duals =
      dual_vertices(vertex_rows(field, topology), weights.alpha, weights.beta, topology, training);

  const RowLinks quad_duals = topology.quad_duals.to(device), quad_cubes = topology.quad_cubes.to(device);
  const Tensor quads = quad_duals.targets.view({-1, 4});
  const DiagonalWeights diagonals(training ? weights.gamma : weights.gamma.detach(), quad_cubes);
  Tensor values = duals.values;
  ExtractedSurface surface;
  if (training) {
    const Tensor centres = quad_centres(values, quad_duals, diagonals);
    const Tensor index = torch::arange(quads.size(0), quads.options()).unsqueeze(1) + topology.duals;
    surface.faces = triangles(torch::cat({quads, index}, 1), {0, 1, 4, 1, 2, 4, 2, 3, 4, 3, 0, 4});
    values = torch::cat({values, centres});
    surface.deviation = duals.deviation;
  } else {
    surface.faces = split_quads(quads, diagonals);
  }
  const std::vector<Tensor> parts = values.split_with_sizes({3, values.size(1) - 3}, 1);
  surface.vertices = parts[0].contiguous();
  surface.attributes = parts[1].contiguous();
  return surface;
}

}  // namespace anigen::shape_field
