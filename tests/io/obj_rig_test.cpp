#include "anigen/io/obj_rig.h"

#include <gtest/gtest.h>

#include "anigen/core/error.h"
#include "anigen/core/json.h"
#include "anigen/io/obj.h"
#include "tests/io/small_asset.h"
#include "tests/support/paths.h"

namespace anigen::io {
namespace {

TEST(ObjRig, MeshAndRigInTheAxesOfTheFile) {
  const test::TemporaryFolder folder;
  const Asset asset = test::small_asset();
  write_obj_rig(folder / "a.obj", asset);
  const Mesh mesh = read_obj(folder / "a.obj");
  const Json rig = read_json(folder / "a.rig.json");
  ASSERT_EQ(mesh.vertices.size(), asset.mesh.vertices.size());
  const auto turned = [](const auto& p) { return std::array<double, 3>{p.x(), p.z(), -p.y()}; };  // Z up → Y up
  for (std::size_t v = 0; v < mesh.vertices.size(); ++v) {
    const auto expected = turned(asset.mesh.vertices[v]);
    for (int c = 0; c < 3; ++c) EXPECT_NEAR(mesh.vertices[v][c], expected[static_cast<std::size_t>(c)], 1e-6);
  }
  const auto positions = asset.skeleton.positions();
  ASSERT_EQ(rig["joints"].size(), positions.size());
  for (std::size_t j = 0; j < positions.size(); ++j) {
    EXPECT_EQ(rig["joints"][j]["name"], asset.skeleton.names[j]);
    EXPECT_EQ(rig["joints"][j]["parent"], asset.skeleton.parents[j]);
    for (std::size_t c = 0; c < 3; ++c) {
      EXPECT_NEAR(rig["joints"][j]["position"][c].get<double>(), turned(positions[j])[c], 1e-9);
    }
  }
  ASSERT_EQ(rig["skin"].size(), asset.mesh.vertices.size());
  EXPECT_EQ(rig["skin"][0][0][0], asset.skin.row(0)[0].joint);
  EXPECT_FLOAT_EQ(rig["skin"][0][0][1].get<float>(), asset.skin.row(0)[0].weight);
}

TEST(ObjRig, RefusesAMeshWithoutWeights) {
  const test::TemporaryFolder folder;
  Asset asset = test::small_asset();
  asset.skin = {};
  EXPECT_THROW(write_obj_rig(folder / "a.obj", asset), InputError);
  EXPECT_FALSE(std::filesystem::exists(folder / "a.obj"));
}

}  // namespace
}  // namespace anigen::io
