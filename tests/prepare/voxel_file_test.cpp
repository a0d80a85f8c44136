#include "anigen/prepare/voxels/voxel_file.h"

#include <gtest/gtest.h>

#include "anigen/core/atomic_file.h"
#include "anigen/core/error.h"
#include "tests/support/paths.h"

namespace anigen::prepare {
namespace {

using geometry::Voxel;

TEST(VoxelFile, RoundTripInPublishedForm) {
  const test::TemporaryFolder folder;
  const auto path = folder / "voxels/a.ply";
  const std::vector<Voxel> voxels = {{0, 0, 0}, {0, 63, 2}, {31, 32, 33}, {63, 63, 63}};
  write_voxel_ply(path, voxels, 64);
  EXPECT_EQ(read_voxel_ply(path, 64), voxels);
  const std::string bytes = read_file(path);
  EXPECT_EQ(bytes.substr(0, 37), "ply\nformat binary_little_endian 1.0\nc");
  const std::size_t end = bytes.find("end_header\n") + 11;
  EXPECT_NE(bytes.find("element vertex 4\nproperty float x\nproperty float y\nproperty float z\nend_header\n"),
            std::string::npos);
  ASSERT_EQ(bytes.size(), end + 4 * 12);
  // The first centre is -0.5 + 0.5/64 = -0.4921875, exactly 0xBEFC0000.
  EXPECT_EQ(bytes.substr(end, 4), std::string("\x00\x00\xFC\xBE", 4));
}

TEST(VoxelFile, EqualSetsGiveEqualBytes) {
  const test::TemporaryFolder folder;
  write_voxel_ply(folder / "a.ply", {{1, 2, 3}, {0, 5, 0}, {0, 0, 9}}, 10);
  write_voxel_ply(folder / "b.ply", {{0, 0, 9}, {1, 2, 3}, {0, 5, 0}, {0, 0, 9}}, 10);
  EXPECT_EQ(read_file(folder / "a.ply"), read_file(folder / "b.ply"));
}

TEST(VoxelFile, RowsKeepTheFilesOrderAndRepetitions) {
  const test::TemporaryFolder folder;
  write_file_atomically(folder / "a.ply",
                        "ply\nformat ascii 1.0\nelement vertex 3\nproperty double x\nproperty double y\n"
                        "property double z\nend_header\n0.3 0.3 0.3\n-0.5 -0.5 -0.5\n0.3 0.3 0.3\n");
  EXPECT_EQ(read_voxel_rows(folder / "a.ply", 10), (std::vector<Voxel>{{8, 8, 8}, {0, 0, 0}, {8, 8, 8}}));
  EXPECT_EQ(read_voxel_ply(folder / "a.ply", 10), (std::vector<Voxel>{{0, 0, 0}, {8, 8, 8}}));
}

TEST(VoxelFile, RefusesBadInput) {
  const test::TemporaryFolder folder;
  EXPECT_THROW(write_voxel_ply(folder / "a.ply", {}, 64), InputError);
  EXPECT_THROW(write_voxel_ply(folder / "a.ply", {{0, 0, 64}}, 64), InputError);
  EXPECT_THROW(write_voxel_ply(folder / "a.ply", {{0, 0, 0}}, 0), InputError);
  EXPECT_FALSE(std::filesystem::exists(folder / "a.ply"));
  EXPECT_THROW(read_voxel_ply(folder / "missing.ply", 64), InputError);
  write_voxel_ply(folder / "b.ply", {{0, 0, 0}, {1, 1, 1}}, 64);
  const std::string bytes = read_file(folder / "b.ply");
  write_file_atomically(folder / "c.ply", bytes.substr(0, bytes.size() - 1));
  EXPECT_THROW(read_voxel_ply(folder / "c.ply", 64), InputError);
  write_file_atomically(folder / "d.ply",
                        "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\n"
                        "property float z\nend_header\n0 0 0\n0 0 0.5\n");
  try {
    read_voxel_ply(folder / "d.ply", 64);
    FAIL() << "a point outside the cube was accepted";
  } catch (const InputError& error) {
    EXPECT_EQ(error.file(), (folder / "d.ply").string());
    EXPECT_EQ(error.place(), "vertex 1");
  }
}

}  // namespace
}  // namespace anigen::prepare
