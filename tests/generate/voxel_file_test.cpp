#include "anigen/generate/voxel_file.h"

#include <gtest/gtest.h>

#include <functional>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/io/arrays/npz.h"
#include "tests/support/paths.h"

namespace anigen::generate {
namespace {

constexpr std::int64_t kVoxelSide = 16;

sparse_structure::VoxelPair some_voxels() {
  sparse_structure::VoxelPair voxels{torch::zeros({kVoxelSide, kVoxelSide, kVoxelSide}, torch::kBool),
                                     torch::zeros({kVoxelSide, kVoxelSide, kVoxelSide}, torch::kBool)};
  voxels.shape.slice(0, 3, 16).slice(1, 0, 5).slice(2, 7, 9).fill_(true);
  voxels.skeleton.slice(0, 4, 9).slice(1, 2, 3).slice(2, 8, 9).fill_(true);
  return voxels;
}

io::NdArray bytes_array(std::vector<std::uint8_t> values, std::vector<std::int64_t> shape) {
  return {io::Dtype::kU8, std::move(shape), std::move(values)};
}

std::string npz_contents(const io::NamedArrays& arrays) {
  const test::TemporaryFolder folder;
  io::write_npz(folder / "v.npz", arrays);
  return read_file(folder / "v.npz");
}

/// Three arrays that are right, but for one that is replaced.
std::string with_array(const std::string& name, const io::NdArray& array) {
  io::NamedArrays arrays = {{"shape", bytes_array({1, 2, 3}, {1, 3})},
                            {"skeleton", bytes_array({1, 2, 3, 4, 5, 6}, {2, 3})},
                            {"resolution", io::NdArray::from<std::int64_t>({kVoxelSide}, {1})}};
  for (auto& [known, held] : arrays) {
    if (known == name) held = array;
  }
  return npz_contents(arrays);
}

void expect_no_voxels(const std::string& contents, const std::string& words) {
  try {
    voxels_of_npz(contents, "that.npz", kVoxelSide, true);
    ADD_FAILURE() << "accepted; expected: " << words;
  } catch (const InputError& error) {
    EXPECT_EQ(error.file(), "that.npz");
    EXPECT_NE(std::string(error.what()).find(words), std::string::npos) << error.what();
  }
}

TEST(VoxelFile, HoldsWhatWasFound) {
  const sparse_structure::VoxelPair voxels = some_voxels();
  const std::string contents = npz_of_voxels(voxels);
  const sparse_structure::VoxelPair read = voxels_of_npz(contents, "that.npz", kVoxelSide, true);
  EXPECT_TRUE(torch::equal(read.shape, voxels.shape));
  EXPECT_TRUE(torch::equal(read.skeleton, voxels.skeleton));
  EXPECT_EQ(npz_of_voxels(read), contents);
}

TEST(VoxelFile, OfTheShapeAloneHasNoSkeleton) {
  sparse_structure::VoxelPair voxels = some_voxels();
  voxels.skeleton.fill_(false);
  const std::string contents = npz_of_voxels(voxels);
  EXPECT_TRUE(torch::equal(voxels_of_npz(contents, "that.npz", kVoxelSide, false).shape, voxels.shape));
  expect_no_voxels(contents, "skeleton: has no voxels");
}

TEST(VoxelFile, IsRefusedWithItsNameAndPlace) {
  const std::string contents = npz_of_voxels(some_voxels());
  for (std::size_t size = 0; size < contents.size(); size += 7)
    EXPECT_THROW(voxels_of_npz(contents.substr(0, size), "that.npz", kVoxelSide, true), InputError) << size;
  for (std::size_t i = 0; i < contents.size(); i += 5) {  // damaged: refused, or voxels of that grid
    std::string damaged = contents;
    damaged[i] = static_cast<char>(damaged[i] ^ 0x55);
    try {
      EXPECT_EQ(voxels_of_npz(damaged, "that.npz", kVoxelSide, true).shape.size(0), kVoxelSide);
    } catch (const InputError&) {
    }
  }
  expect_no_voxels("not an archive", "that.npz");
  expect_no_voxels(with_array("shape", io::NdArray::from<float>({1, 2, 3}, {1, 3})), "shape: holds float32, not uint8");
  expect_no_voxels(with_array("shape", bytes_array({1, 2, 3, 4}, {2, 2})), "not of shape");
  expect_no_voxels(with_array("shape", bytes_array({}, {0, 3})), "shape: has no voxels");
  expect_no_voxels(with_array("skeleton", bytes_array({1, 2, 3, 4, 16, 6}, {2, 3})),
                   "skeleton, row 1: lies outside the grid of 16");
  expect_no_voxels(with_array("resolution", io::NdArray::from<std::int64_t>({64}, {1})), "a grid of 64");
  expect_no_voxels(with_array("resolution", io::NdArray::from<std::int64_t>({16, 16}, {2})), "not one number");
  expect_no_voxels(npz_contents({{"shape", bytes_array({1, 2, 3}, {1, 3})}}), "skeleton: is missing");
  EXPECT_THROW(voxels_of_npz(contents, "that.npz", 64, true), InputError) << "of another grid";
}

}  // namespace
}  // namespace anigen::generate
