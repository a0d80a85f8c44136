#include <gtest/gtest.h>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <map>

#include "anigen/asset/rigged_asset.h"
#include "anigen/io/gltf/graft.h"
#include "tests/io/gltf/gltf_import_support.h"

// Grafts of the public files, where they are: their own rig, and another one.

namespace anigen::io {

namespace {

namespace fs = std::filesystem;

class GraftOfFile : public testing::TestWithParam<fs::path> {
 protected:
  test::TemporaryFolder folder_;
};

TEST_P(GraftOfFile, ItsOwnRigChangesNothing) {
  const Asset own = read_gltf(GetParam()).asset;
  GraftOptions options;
  options.influences = std::max<std::size_t>(4, own.skin.largest_row());
  const GraftReport report = graft_rig(GetParam(), own.skeleton, own.skin, folder_ / "out.glb", options);
  EXPECT_TRUE(report.own_joints);
  const Asset back = read_gltf(folder_ / "out.glb").asset;
  EXPECT_EQ(back.skeleton.names, own.skeleton.names);
  EXPECT_EQ(back.skeleton.parents, own.skeleton.parents);
  EXPECT_EQ(back.animations.size(), own.animations.size());
  EXPECT_EQ(back.mesh.faces.size(), own.mesh.faces.size());
  ASSERT_EQ(back.mesh.vertices.size(), own.mesh.vertices.size());
  if (report.copied_meshes > 0) return;  // copies are read behind the other meshes
  const double scale = bounding_box(own.mesh.vertices).diagonal();
  double moved = 0.0, reweighted = 0.0;
  for (std::size_t v = 0; v < own.mesh.vertices.size(); ++v) {
    moved = std::max(moved, static_cast<double>((back.mesh.vertices[v] - own.mesh.vertices[v]).norm()));
    std::map<int, double> apart;
    for (std::size_t k = 0; k < own.skin.row_size(v); ++k) apart[own.skin.row(v)[k].joint] += own.skin.row(v)[k].weight;
    for (std::size_t k = 0; k < back.skin.row_size(v); ++k)
      apart[back.skin.row(v)[k].joint] -= back.skin.row(v)[k].weight;
    for (const auto& [joint, weight] : apart) reweighted = std::max(reweighted, std::abs(weight));
  }
  EXPECT_LE(moved, 1e-5 * scale);
  EXPECT_LE(reweighted, 1e-6);
}

TEST_P(GraftOfFile, AnotherRigTakesTheMeshesAsTheyAre) {
  const Asset own = read_gltf(GetParam()).asset;
  const Box box = bounding_box(own.mesh.vertices);
  const Skeleton skeleton = skeleton_from_joints({box.low, box.center()}, {-1, 0}, {"below", "above"});
  const SkinWeights skin = test::cyclic_weights(own.mesh.vertices.size(), 2);
  const GraftReport report = graft_rig(GetParam(), skeleton, skin, folder_ / "out.glb");
  EXPECT_FALSE(report.own_joints);
  const Asset back = read_gltf(folder_ / "out.glb").asset;
  EXPECT_TRUE(validate(back).empty());
  EXPECT_EQ(back.skeleton.names, skeleton.names);
  ASSERT_EQ(back.mesh.vertices.size(), own.mesh.vertices.size());
  const Box after = bounding_box(back.mesh.vertices);
  EXPECT_LE((after.low - box.low).norm() + (after.high - box.high).norm(), 1e-4 * box.diagonal());
}

GTEST_ALLOW_UNINSTANTIATED_PARAMETERIZED_TEST(GraftOfFile);
INSTANTIATE_TEST_SUITE_P(Assets, GraftOfFile, testing::ValuesIn(test::rigged_files()),
                         [](const testing::TestParamInfo<fs::path>& file) {
                           std::string name = file.param.stem().string();
                           for (char& c : name) c = std::isalnum(static_cast<unsigned char>(c)) != 0 ? c : '_';
                           return name;
                         });

}  // namespace

}  // namespace anigen::io
