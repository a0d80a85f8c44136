#include "anigen/eval/ground_truth.h"

#include <gtest/gtest.h>

#include "anigen/core/atomic_file.h"
#include "anigen/io/rigs/shape_source.h"
#include "tests/support/paths.h"
#include "tests/support/rig_files.h"

namespace anigen::eval {
namespace {

TEST(GroundTruth, AgreesWithTheGeneralReaderOfDataSets) {
  const test::TemporaryFolder folder;
  test::RigFile rig;
  rig.skin[0] = 0;  // a vertex without weights
  rig.skin[1] = 0;
  rig.skin[9] = 3;  // and one whose weights do not sum to 1
  test::write_rig_npz(folder / "skeleton" / "sample" / "skeleton_voxelized.npz", rig);
  write_file_atomically(folder / "metadata.csv", "sha256\nsample\n");
  const io::RiggedShape shape = io::open_source(folder.path())->read("sample");
  const GroundTruth truth = read_ground_truth(folder.path(), "sample");
  EXPECT_EQ(to_dense(shape.skin, 3), truth.skin);
  EXPECT_EQ(shape.mesh.vertices, truth.vertices);
  EXPECT_EQ(shape.mesh.faces, truth.faces);
  EXPECT_EQ(shape.joints.parents, truth.parents);
}

TEST(GroundTruth, RefusesBrokenTreesByJoint) {
  const test::TemporaryFolder folder;
  test::RigFile rig;
  rig.parents = {-1, 2, 1};
  test::write_rig_npz(folder / "skeleton" / "sample" / "skeleton_voxelized.npz", rig);
  EXPECT_EQ(test::refusal([&] { read_ground_truth(folder.path(), "sample"); }),
            "joint 1: is its own ancestor: the skeleton has a cycle");
}

}  // namespace
}  // namespace anigen::eval
