#pragma once
#include <cstdint>
#include <vector>

namespace anigen::sparse {

/// One product of a convolution; see TapPlan.
struct TapLink {
  std::int64_t tap, from_child, to_child, matrix;
};

/// Which rows a convolution over the neighbours of N voxels joins, by which matrix. For every link and every row r
/// whose neighbour q = neighbours[tap][r] exists:
///   out[r · to_children + to_child] += in[q · from_children + from_child] · W[matrix]
/// No two links have the same matrix, and links of one to_child follow one another.
struct TapPlan {
  std::int64_t from_children = 1, to_children = 1;
  std::vector<TapLink> links;

  std::int64_t matrices() const { return static_cast<std::int64_t>(links.size()); }
};

/// A 3×3×3 convolution: matrix t is that of tap t (Support::neighbours).
TapPlan submanifold_plan();

/// A 3×3×3 convolution on the subdivided support of features that eight children share. The 27 neighbours of a child
/// lie in eight voxels of the coarse support, so that eight products with sums of weights are enough. Matrix (child · 8
/// + side): `side` counts these voxels, x slowest, along each axis the lower one first.
TapPlan subdivision_plan();

/// The way back, from rows of the output to rows of the input, each matrix to be transposed: the neighbour relation is
/// symmetric, tap t of p is q where tap 26 − t of q is p.
TapPlan reversed(const TapPlan& plan);

}  // namespace anigen::sparse
