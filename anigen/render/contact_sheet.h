#pragma once
#include <Eigen/Core>
#include <string>
#include <vector>

#include "anigen/io/image.h"

namespace anigen::render {

struct Tile {
  io::Image image;
  std::string caption;  ///< one line under the picture; empty: none. Other than ASCII shows as '?'
};

struct SheetOptions {
  int columns = 0;       ///< 0: as square as possible
  int gap = 12;          ///< pixels between tiles and around the sheet
  std::string title;     ///< above all tiles; empty: none
  int text_height = 14;  ///< of a capital letter in captions, pixels; titles are 1.5 times as high
  Eigen::Vector3f background{1.0f, 1.0f, 1.0f};  ///< sRGB
  Eigen::Vector3f text{0.13f, 0.14f, 0.16f};
};

/// Tiles in rows from the top left, each cell as large as the largest picture, pictures centred. Text too long for
/// its place shrinks to fit.
/// @throws InputError without tiles, on an option out of range, or when the sheet would exceed 16,384 pixels a side
io::Image contact_sheet(const std::vector<Tile>& tiles, const SheetOptions& options = {});

}  // namespace anigen::render
