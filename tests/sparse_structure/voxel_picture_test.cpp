#include "anigen/sparse_structure/voxel_picture.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "anigen/core/error.h"
#include "tests/support/paths.h"

namespace anigen::sparse_structure {
namespace {

using torch::Tensor;

Tensor blank_grid(std::int64_t edge) { return torch::zeros({edge, edge, edge}, torch::kBool); }

bool is_background(const io::Image& image, int x, int y) {
  const io::Image blank = voxel_picture({}, 2);
  return std::equal(image.pixel(x, y), image.pixel(x, y) + 4, blank.pixel(0, 0));
}

struct Spot {
  double x = 0.0, y = 0.0;
  int pixels = 0;
};

/// Centre of everything drawn.
Spot drawn_spot(const io::Image& image) {
  Spot spot;
  for (int y = 0; y < image.height; ++y) {
    for (int x = 0; x < image.width; ++x) {
      if (is_background(image, x, y)) continue;
      spot.x += x;
      spot.y += y;
      ++spot.pixels;
    }
  }
  spot.x /= std::max(spot.pixels, 1);
  spot.y /= std::max(spot.pixels, 1);
  return spot;
}

TEST(VoxelPicture, TheMiddleVoxelLandsInTheMiddle) {
  Tensor grid = blank_grid(9);
  grid[4][4][4] = true;
  const Spot spot = drawn_spot(voxel_picture({grid, {}}, 96));
  EXPECT_GT(spot.pixels, 20);
  EXPECT_NEAR(spot.x, 47.5, 1.0);
  EXPECT_NEAR(spot.y, 47.5, 1.0);
}

TEST(VoxelPicture, AxesPointWhereTheyShould) {
  const auto place = [](int x, int y, int z) {
    Tensor grid = blank_grid(9);
    grid[x][y][z] = true;
    return drawn_spot(voxel_picture({{}, grid}, 96));
  };
  EXPECT_LT(place(4, 4, 8).y, place(4, 4, 0).y) << "z points up";
  EXPECT_GT(place(8, 4, 4).x, place(0, 4, 4).x) << "x points to the right";
  EXPECT_GT(place(4, 8, 4).x, place(4, 0, 4).x) << "y points to the right and away";
  EXPECT_LT(place(4, 8, 4).y, place(4, 0, 4).y);
}

TEST(VoxelPicture, TheSkeletonShowsThroughTheShape) {
  const Tensor solid = torch::ones({8, 8, 8}, torch::kBool);
  Tensor skeleton = blank_grid(8);
  skeleton.slice(0, 3, 5).slice(1, 3, 5).slice(2, 3, 5).fill_(true);
  const io::Image with = voxel_picture({solid, skeleton}, 64), without = voxel_picture({solid, {}}, 64);
  const auto warmth = [](const io::Image& image) { return int{image.pixel(32, 32)[0]} - int{image.pixel(32, 32)[2]}; };
  EXPECT_GT(warmth(with), 50) << "orange";
  EXPECT_LT(warmth(without), 0) << "grey-blue";
  // Many layers of shape in front do not hide it either: a shell around a shell.
  Tensor shells = blank_grid(8);
  for (int k = 0; k < 8; k += 2) shells[k].fill_(true);
  EXPECT_GT(warmth(voxel_picture({shells, skeleton}, 64)), 50);
}

TEST(VoxelPicture, RefusesGridsThatAreNone) {
  EXPECT_THROW(voxel_picture({torch::zeros({2, 2}, torch::kBool), {}}, 8), Error);
  EXPECT_THROW(voxel_picture({blank_grid(4), blank_grid(5)}, 8), Error);
}

TEST(VoxelSheet, HoldsEveryRowAndAPhotograph) {
  const test::TemporaryFolder folder;
  Tensor grid = blank_grid(4);
  grid[1][1][1] = true;
  VoxelSheetRow first{"first", {{grid, {}}, {{}, grid}}};
  first.picture = io::Image(400, 300);
  const VoxelSheetRow second{"second", {{grid, grid}}};
  write_voxel_sheet(folder / "new" / "sheet.png", {first, second}, {"a", "b"});
  const io::Image sheet = io::read_image(folder / "new" / "sheet.png");
  EXPECT_GE(sheet.width, 3 * kVoxelCellSize);
  EXPECT_GE(sheet.height, 2 * kVoxelCellSize);
  EXPECT_LT(sheet.width, 4 * kVoxelCellSize) << "a photograph is scaled into its cell";
  EXPECT_THROW(write_voxel_sheet(folder / "none.png", {}), Error);
}

}  // namespace
}  // namespace anigen::sparse_structure
