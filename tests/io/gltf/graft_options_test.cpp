#include <gtest/gtest.h>
#include <Eigen/Geometry>
#include <string>
#include <vector>

#include "anigen/asset/rigged_asset.h"
#include "anigen/core/error.h"
#include "anigen/io/gltf/graft.h"
#include "tests/io/gltf/gltf_import_support.h"
#include "tests/io/small_asset.h"
#include "tests/support/parsed_gltf.h"
#include "tests/support/paths.h"

// Options of grafts for engines: another place, other names, extensions of the file's top level.

namespace anigen::io {

namespace {

using test::ParsedGltf;

class GraftOptionsOfEngines : public testing::Test {
 protected:
  GraftOptionsOfEngines() {
    write_gltf(folder_ / "in.glb", test::small_asset());
    own_ = read_gltf(folder_ / "in.glb").asset;
  }
  GraftReport graft(const Skeleton& skeleton, const GraftOptions& options) const {
    return graft_rig(folder_ / "in.glb", skeleton, own_.skin, folder_ / "out.glb", options);
  }

  test::TemporaryFolder folder_;
  Asset own_;
};

TEST_F(GraftOptionsOfEngines, NamesOfOwnJointsChangeAlone) {
  GraftOptions options;
  for (std::size_t j = 0; j < own_.skeleton.size(); ++j) options.names.push_back("new_" + std::to_string(j));
  EXPECT_TRUE(graft(own_.skeleton, options).own_joints);
  const Asset back = read_gltf(folder_ / "out.glb").asset;
  EXPECT_EQ(back.skeleton.names, options.names);
  EXPECT_EQ(back.animations.size(), own_.animations.size()) << "they move the joints as before";
  options.names.pop_back();
  EXPECT_THROW(graft(own_.skeleton, options), InputError);
}

TEST_F(GraftOptionsOfEngines, ReplacedJointsAreNewOnesInTheirPlaces) {
  GraftOptions options;
  options.replace = true;
  EXPECT_FALSE(graft(own_.skeleton, options).own_joints);
  EXPECT_GT(ParsedGltf(folder_ / "out.glb").json["nodes"].size(), ParsedGltf(folder_ / "in.glb").json["nodes"].size());
}

TEST_F(GraftOptionsOfEngines, APlacementMovesTheMesh) {
  Eigen::Affine3d placement = Eigen::Affine3d::Identity();
  placement.translate(Eigen::Vector3d(1, -2, 0.5)).scale(3.0);
  GraftOptions options;
  options.replace = true;
  options.placement = placement.matrix();
  Skeleton skeleton = own_.skeleton;
  for (Eigen::Matrix4d& bind : skeleton.bind)
    bind.topRightCorner<3, 1>() = (placement.matrix() * bind.col(3)).head<3>();
  skeleton.rest = bind_pose(skeleton);
  graft(skeleton, options);
  const Asset back = read_gltf(folder_ / "out.glb").asset;
  const std::vector<Eigen::Vector3f> rested =
      skin_vertices(back, forward_kinematics(back.skeleton.parents, back.skeleton.rest));
  ASSERT_EQ(back.mesh.vertices.size(), own_.mesh.vertices.size());
  for (std::size_t v = 0; v < own_.mesh.vertices.size(); ++v) {
    const Eigen::Vector3f wanted = (placement * own_.mesh.vertices[v].cast<double>()).cast<float>();
    const float rounding = 1e-6F * (1.0F + wanted.norm());
    EXPECT_LE((rested[v] - wanted).norm(), 4 * rounding) << "vertex " << v;
    EXPECT_LE((back.mesh.vertices[v] - wanted).norm(), 4 * rounding) << "vertex " << v;
  }
}

TEST_F(GraftOptionsOfEngines, ExtensionsKnowTheNodes) {
  for (const bool replace : {false, true}) {
    GraftOptions options;
    options.replace = replace;
    options.extensions = [](const std::vector<int>& nodes) { return Json{{"TEST_joints", {{"nodes", nodes}}}}; };
    graft(own_.skeleton, options);
    const Json json = ParsedGltf(folder_ / "out.glb").json;
    EXPECT_EQ(json["extensionsUsed"], Json::array({"TEST_joints"}));
    const std::vector<int> nodes = json["extensions"]["TEST_joints"]["nodes"].get<std::vector<int>>();
    ASSERT_EQ(nodes.size(), own_.skeleton.size());
    for (std::size_t j = 0; j < nodes.size(); ++j)
      EXPECT_EQ(json["nodes"][static_cast<std::size_t>(nodes[j])]["name"], own_.skeleton.names[j]) << replace;
  }
  ExportOptions options;
  options.extensions = [](const std::vector<int>& nodes) { return Json{{"TEST_joints", {{"nodes", nodes}}}}; };
  write_gltf(folder_ / "new.vrm", own_, options);
  const Json json = ParsedGltf(folder_ / "new.vrm").json;
  EXPECT_EQ(json["extensionsUsed"], Json::array({"TEST_joints"}));
  EXPECT_EQ(json["extensions"]["TEST_joints"]["nodes"].size(), own_.skeleton.size());
}

}  // namespace

}  // namespace anigen::io
