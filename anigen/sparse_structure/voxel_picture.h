#pragma once
#include <filesystem>
#include <string>
#include <vector>

#include "anigen/io/image.h"
#include "anigen/nn/torch.h"

namespace anigen::sparse_structure {

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

/// One line of a contact sheet: a label, perhaps an ordinary picture, then pictures of voxels.
struct VoxelSheetRow {
  std::string label;
  std::vector<VoxelPair> cells;
  io::Image picture = {};  ///< shown before the cells; without pixels: none
};

/// Pixels on a side of a cell.
inline constexpr int kVoxelCellSize = 192;

/// Rows of pictures (voxel_picture) with captions as one PNG, written atomically. Shorter rows end in empty cells.
/// @param columns captions of the cells, from the left; may be fewer @throws Error without rows, or as voxel_picture
void write_voxel_sheet(const std::filesystem::path& png, const std::vector<VoxelSheetRow>& rows,
                       const std::vector<std::string>& columns = {});

}  // namespace anigen::sparse_structure
