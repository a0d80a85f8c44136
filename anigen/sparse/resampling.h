#pragma once
#include "anigen/sparse/sparse_tensor.h"

namespace anigen::sparse {

/// Features of each coarse voxel: sum over its members / (members + 1), as published: the zero that the sum starts from
/// is counted (reference autoencoders.md, 3.9). Rows sorted by item, x, y, z.
/// @param factor one for all axes, or one per axis @throws InputError for a factor below 1
SparseTensor downsample(const SparseTensor& x, const GridFactor& factor);
/// Every fine voxel takes the features of its coarse one. @param coarse on fine.coarsened(factor).support
SparseTensor upsample(const SparseTensor& coarse, const SupportPtr& fine, const GridFactor& factor);
/// Features repeated for the eight children of each voxel: on x.support->subdivided().
SparseTensor subdivide(const SparseTensor& x);

}  // namespace anigen::sparse
