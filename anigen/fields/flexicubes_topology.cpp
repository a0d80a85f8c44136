#include "anigen/fields/flexicubes_topology.h"

#include <algorithm>
#include <array>
#include <functional>
#include <utility>
#include <vector>

#include "anigen/fields/flexicubes_tables.h"
#include "anigen/fields/grid_sets.h"

namespace anigen::fields {
namespace {

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
  for (const std::uint8_t cube_case : cases) {
    next[static_cast<std::size_t>(tables.counts[cube_case]) + 1] += tables.counts[cube_case];
  }
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

}  // namespace

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

}  // namespace anigen::fields
