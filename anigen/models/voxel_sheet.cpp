#include "anigen/models/voxel_sheet.h"

#include <algorithm>

#include "anigen/core/error.h"
#include "anigen/core/parallel.h"
#include "anigen/raytrace/contact_sheet.h"

namespace anigen::models {
namespace {

bool has_pixels(const io::Image& picture) { return picture.width > 0 && picture.height > 0; }

}  // namespace

void write_voxel_sheet(const std::filesystem::path& png, const std::vector<VoxelSheetRow>& rows,
                       const std::vector<std::string>& columns) {
  if (rows.empty()) throw Error(png.string() + ": a sheet of voxels needs at least one row");
  const bool pictures = std::any_of(rows.begin(), rows.end(), [](const auto& row) { return has_pixels(row.picture); });
  const std::size_t first = pictures ? 1 : 0;
  std::size_t width = 1;
  for (const VoxelSheetRow& row : rows) width = std::max(width, first + row.cells.size());

  std::vector<raytrace::Tile> tiles(rows.size() * width);
  parallel_for(tiles.size(), [&](std::size_t i) {
    const VoxelSheetRow& row = rows[i / width];
    const std::size_t column = i % width;
    raytrace::Tile& tile = tiles[i];
    tile.caption = column >= first && column - first < columns.size() ? columns[column - first] : "";
    if (column == 0) tile.caption = row.label + (tile.caption.empty() ? "" : ": " + tile.caption);
    if (column < first) {
      tile.image = has_pixels(row.picture) ? fitted_picture(row.picture, kVoxelCellSize)
                                           : io::Image(kVoxelCellSize, kVoxelCellSize);
    } else if (column - first < row.cells.size()) {
      tile.image = voxel_picture(row.cells[column - first], kVoxelCellSize);
    } else {
      tile.image = io::Image(kVoxelCellSize, kVoxelCellSize);
    }
  });
  raytrace::SheetOptions options;
  options.columns = static_cast<int>(width);
  options.text_height = 11;
  io::write_png(png, raytrace::contact_sheet(tiles, options));
}

}  // namespace anigen::models
