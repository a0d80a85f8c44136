#pragma once
#include <filesystem>
#include <string>
#include <vector>

#include "anigen/models/voxel_picture.h"

namespace anigen::models {

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

}  // namespace anigen::models
