#pragma once
#include "anigen/io/image.h"
#include "anigen/nn/torch.h"

namespace anigen::models {

/// Occupancy of a shape and of its skeleton on one grid: bool [R, R, R], axes x, y, z. Either may be undefined.
struct VoxelPair {
  torch::Tensor shape, skeleton;
};

/// An isometric picture, seen from in front, right and above (the front is −y): the shape as a translucent grey-blue,
/// faces lit by their direction, the skeleton as opaque orange that shines through whatever lies before it. A pair
/// without grids gives an empty picture.
/// @param size pixels on a side @throws Error when a grid is no cube, or the two differ in size
io::Image voxel_picture(const VoxelPair& pair, int size);

/// [3, H, W] in [0, 1], anywhere, as an opaque picture.
io::Image picture_of_planes(const torch::Tensor& planes);

/// A picture scaled so that its longer side has that many pixels: a large photograph must not blow up a whole sheet.
io::Image fitted_picture(const io::Image& picture, int side);

}  // namespace anigen::models
