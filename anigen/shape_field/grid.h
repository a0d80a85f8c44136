#pragma once
#include <ATen/Parallel.h>
#include <algorithm>
#include <array>
#include <cstdint>
#include <vector>

#include "anigen/nn/torch.h"
#include "anigen/shape_field/cube_field.h"

namespace anigen::shape_field {

/// Corners of a cube: number k stands at offset (k & 1, k >> 1 & 1, k >> 2 & 1), x fastest
/// (docs/reference/autoencoders.md, 4.7).
inline constexpr int kCubeCorners = 8;

/// Places of a grid as single numbers, (x · side + y) · side + z: their order is the lexicographic one, and a step in
/// the grid adds a constant. The vertices of an R³ grid have side R + 1; its cubes are numbered with the same side, by
/// their lowest corner, so that going from a cube to a corner is a step as well.
struct GridNumbering {
  std::int64_t side = 0;

  std::int64_t number(std::int64_t x, std::int64_t y, std::int64_t z) const { return (x * side + y) * side + z; }
  std::int64_t step(int axis) const { return axis == 0 ? side * side : axis == 1 ? side : 1; }
  std::int64_t corner_step(int corner) const { return number(corner & 1, corner >> 1 & 1, corner >> 2 & 1); }
  std::array<std::int64_t, 3> place(std::int64_t number) const {
    return {number / (side * side), number / side % side, number % side};
  }
  bool is_cube(std::int64_t number) const;  ///< whether a cube has its lowest corner there
};

/// Numbers in ascending order, each once.
using GridSet = std::vector<std::int64_t>;

/// set ∪ (set + step), in linear time: a shifted set is still in order. Applied along the three axes it makes the
/// corners of cubes, or the cubes around vertices, without a hash table or a dense grid.
GridSet with_shifted(const GridSet& set, std::int64_t step);

/// The order that sorts numbers that are not negative; linear time.
std::vector<std::int32_t> sorting_order(const std::vector<std::int64_t>& numbers);

/// Numbers of the rows of a table of places. @param places [N, 3] integers, any device
std::vector<std::int64_t> grid_numbers(const Tensor& places, const GridNumbering& grid);

/// Places of numbers. @return [N, 3] int32
Tensor grid_places(const GridSet& set, const GridNumbering& grid);

/// Calls body(i, position of queries[i] + step in the set, or −1) for every i, in parallel.
template <typename Body>
void match_shifted(const GridSet& set, const GridSet& queries, std::int64_t step, const Body& body) {
  constexpr std::int64_t kGrain = 1 << 14;
  at::parallel_for(0, static_cast<std::int64_t>(queries.size()), kGrain, [&](std::int64_t begin, std::int64_t end) {
    const auto wanted_at = [&](std::int64_t i) { return queries[static_cast<std::size_t>(i)] + step; };
    auto place = std::lower_bound(set.begin(), set.end(), wanted_at(begin));
    for (std::int64_t i = begin; i < end; ++i) {
      const std::int64_t wanted = wanted_at(i);
      while (place != set.end() && *place < wanted) ++place;
      const bool found = place != set.end() && *place == wanted;
      body(i, found ? static_cast<std::int64_t>(place - set.begin()) : std::int64_t{-1});
    }
  });
}

struct NearestGridVertices {
  Tensor rows;     ///< [P, count] int64 rows of field.vertices, nearest first, ties by row
  Tensor squared;  ///< [P, count] fp64 squared distances
};

/// The grid vertices of a field nearest to points, by looking at the boxes of grid cells around each point; exact.
/// Entries beyond the number of vertices, or of points that are NaN, are row 0 at distance 0.
/// @param points [P, 3], any device @param deformed measure to field.positions(), else to field.grid_positions()
NearestGridVertices nearest_grid_vertices(const CubeField& field, const Tensor& points, std::int64_t count,
                                          bool deformed);

}  // namespace anigen::shape_field
