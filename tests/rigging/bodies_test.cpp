#include "anigen/rigging/bodies.h"

#include <gtest/gtest.h>

#include "anigen/core/error.h"
#include "tests/rigging/binding_shapes.h"

namespace anigen::rigging {
namespace {

using Places = std::vector<std::pair<Eigen::Vector3d, Eigen::Vector3d>>;

Mesh boxes(const Places& places) {
  Mesh mesh;
  for (const auto& [low, high] : places) test::append_box(mesh, low, high, 3);
  return mesh;
}

TEST(SeparateBodies, AreToldWhereBodiesOfLikeSizeStandApart) {
  const Mesh mesh = boxes({{{3, 0, 0}, {4, 1, 2}}, {{0, 0, 0}, {1, 1, 2}}, {{0, 0, 2.01}, {1, 1, 2.5}}});
  const std::vector<SeparateBody> bodies = separate_bodies(mesh);
  ASSERT_EQ(bodies.size(), 2U);  // from the left; the second has the box above it, too
  EXPECT_EQ(bodies[0].mesh.vertices.size(), 2 * bodies[1].mesh.vertices.size());
  std::size_t faces = 0;
  std::vector<int> seen(mesh.vertices.size(), 0);
  for (const SeparateBody& body : bodies) {
    faces += body.mesh.faces.size();
    for (std::size_t v = 0; v < body.vertices.size(); ++v) {
      const auto whole = static_cast<std::size_t>(body.vertices[v]);
      ++seen[whole];
      EXPECT_EQ(body.mesh.vertices[v], mesh.vertices[whole]);
      EXPECT_EQ(body.mesh.vertices[v].x() > 2.0F, &body == &bodies[1]);
    }
  }
  EXPECT_EQ(faces, mesh.faces.size());
  EXPECT_EQ(seen, std::vector<int>(mesh.vertices.size(), 1));
}

TEST(SeparateBodies, AreNotToldOfOneBodyItsPartsOrACrowd) {
  EXPECT_TRUE(separate_bodies(boxes({{{0, 0, 0}, {1, 1, 2}}})).empty());
  // Overlapping, touching, and a small thing beside a large one.
  EXPECT_TRUE(separate_bodies(boxes({{{0, 0, 0}, {1, 1, 2}}, {{0.5, 0, 0}, {2, 1, 2}}})).empty());
  EXPECT_TRUE(separate_bodies(boxes({{{0, 0, 0}, {1, 1, 2}}, {{1.01, 0, 0}, {2, 1, 2}}})).empty());
  EXPECT_TRUE(separate_bodies(boxes({{{0, 0, 0}, {1, 1, 2}}, {{3, 0, 0}, {3.4, 0.4, 0.4}}})).empty());
  Places crowd;
  for (int i = 0; i < 9; ++i) crowd.push_back({{3.0 * i, 0, 0}, {3.0 * i + 1, 1, 2}});
  EXPECT_TRUE(separate_bodies(boxes(crowd)).empty());
  EXPECT_TRUE(separate_bodies(Mesh()).empty());
}

TEST(SeparateBodies, TakeSmallThingsAndStrayVerticesAlong) {
  Mesh mesh = boxes({{{0, 0, 0}, {1, 1, 2}}, {{4, 0, 0}, {5, 1, 2}}, {{3.4, 0, 0}, {3.6, 0.2, 0.2}}});
  mesh.vertices.push_back({1.2F, 0, 0});
  const std::vector<SeparateBody> bodies = separate_bodies(mesh);
  ASSERT_EQ(bodies.size(), 2U);
  EXPECT_EQ(bodies[0].vertices.back(), static_cast<std::int32_t>(mesh.vertices.size()) - 1);
  EXPECT_EQ(bodies[0].vertices.size() + bodies[1].vertices.size(), mesh.vertices.size());
  EXPECT_GT(bodies[1].vertices.size(), bodies[0].vertices.size());
}

TEST(SeparateBodies, OfABrokenMeshAreRefused) {
  Mesh mesh = boxes({{{0, 0, 0}, {1, 1, 2}}});
  mesh.faces.push_back({0, 1, 100000});
  EXPECT_THROW(separate_bodies(mesh), InputError);
}

TEST(JoinedBodies, HaveOneRootAndTheirOwnWeights) {
  const std::vector<Skeleton> skeletons{skeleton_from_joints({{0, 0, 0}, {0, 0, 1}}, {-1, 0}, {"a", "b"}),
                                        skeleton_from_joints({{4, 0, 0}, {4, 0, 1}}, {-1, 0}, {"a", "b"})};
  const Skeleton joined = joined_skeleton(skeletons);
  EXPECT_EQ(joined.parents, (std::vector<int>{-1, 0, 1, 0, 3}));
  EXPECT_EQ(joined.names, (std::vector<std::string>{"root", "body_1_a", "body_1_b", "body_2_a", "body_2_b"}));
  EXPECT_EQ(joined.positions()[0], Eigen::Vector3d(2, 0, 0));
  std::vector<SeparateBody> bodies(2);
  bodies[0].vertices = {0, 2};
  bodies[1].vertices = {1};
  std::vector<SkinWeights> skins(2);
  skins[0].append_row({{0, 1.0F}});
  skins[0].append_row({{0, 0.25F}, {1, 0.75F}});
  skins[1].append_row({{1, 1.0F}});
  const SkinWeights skin = joined_skin(bodies, skins, skeletons, 3);
  ASSERT_EQ(skin.rows(), 3U);
  EXPECT_EQ(skin.row(0)->joint, 1);
  EXPECT_EQ(skin.row(1)->joint, 4);
  EXPECT_EQ(skin.row(2)->joint, 2);
  EXPECT_FLOAT_EQ(skin.row(2)->weight, 0.75F);
}

}  // namespace
}  // namespace anigen::rigging
