#pragma once
#include <cstddef>
#include <cstdint>
#include <vector>

namespace anigen::geometry {

/// An edge of an undirected graph: cutting it costs its capacity.
struct CutEdge {
  std::int32_t a, b;
  double capacity;  ///< ≥ 0
};

/// The cheapest cut between a source and a sink that are joined to some of the nodes by edges of capacity 1 (maximum
/// flow by push-relabel, Goldberg and Tarjan 1988). Capacities count to 1e-9; one that exceeds the number of nodes can
/// never be worth cutting and is taken for that number.
/// @return [nodes] 1 on the source's side. Of several cheapest cuts the one with the most nodes there: all that the
/// sink cannot be reached from. @throws InputError when an edge, a source or a sink is no node, or a capacity negative
/// or NaN
std::vector<char> source_side_of_min_cut(std::size_t nodes, const std::vector<CutEdge>& edges,
                                         const std::vector<std::int32_t>& sources,
                                         const std::vector<std::int32_t>& sinks);

}  // namespace anigen::geometry
