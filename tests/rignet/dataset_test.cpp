#include "anigen/rignet/dataset.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <set>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/geometry/primitives.h"
#include "tests/data/synthetic_dataset.h"
#include "tests/support/paths.h"

namespace anigen::rignet {
namespace {

// A closed tube along the Z axis of the Z-up frame, from z = 0 to z = 1.
Mesh tube(int rings, int sides, double radius) {
  Mesh mesh;
  for (int r = 0; r <= rings; ++r) {
    for (int s = 0; s < sides; ++s) {
      const double angle = 2.0 * kPi * s / sides;
      mesh.vertices.emplace_back(static_cast<float>(radius * std::cos(angle)),
                                 static_cast<float>(radius * std::sin(angle)), static_cast<float>(r) / rings);
    }
  }
  for (int r = 0; r < rings; ++r) {
    for (int s = 0; s < sides; ++s) {
      const int a = r * sides + s, b = r * sides + (s + 1) % sides;
      mesh.faces.push_back({a, b, b + sides});
      mesh.faces.push_back({a, b + sides, a + sides});
    }
  }
  for (const int ring : {0, rings}) {
    const auto middle = static_cast<std::int32_t>(mesh.vertices.size());
    mesh.vertices.emplace_back(0.0F, 0.0F, static_cast<float>(ring) / rings);
    for (int s = 0; s < sides; ++s) {
      const int a = ring * sides + s, b = ring * sides + (s + 1) % sides;
      mesh.faces.push_back(ring == 0 ? Triangle{b, a, middle} : Triangle{a, b, middle});
    }
  }
  return mesh;
}

RignetMesh seen(const Mesh& mesh, std::size_t most = 5000) { return rignet_mesh(mesh.vertices, mesh.faces, most); }

TEST(RignetFrame, IsUprightWithItsFloorAtZeroAndHalfOfAnymates) {
  const std::vector<Eigen::Vector3f> corners = {{1, 2, 3}, {5, 2, 3}, {1, 4, 3}, {1, 2, 4}};
  const RignetFrame frame = RignetFrame::of(corners);
  EXPECT_LT((frame.into({5, 4, 4}) - Eigen::Vector3d(0.5, 0.25, -0.25)).norm(), 1e-12);
  EXPECT_NEAR(frame.into({1, 2, 3}).y(), 0.0, 1e-12);
  const Eigen::Vector3d point(1.5, 2.5, 3.5);
  EXPECT_LT((frame.out_of(frame.into(point)) - point).norm(), 1e-12);
  EXPECT_LT((frame.to_anymate(frame.into(point)) - anymate::AnymateFrame::of(corners).into(point)).norm(), 1e-12);
}

TEST(RignetMesh, LargeMeshesAreSimplifiedAndSeamsAreWelded) {
  const Mesh ball = geometry::icosphere(4, 0.5);  // 2,562 vertices
  const RignetMesh whole = seen(ball), small = seen(ball, 400);
  EXPECT_EQ(whole.vertices.size(), ball.vertices.size());
  EXPECT_LE(small.vertices.size(), 600u);
  EXPECT_GE(small.vertices.size(), 200u);

  Mesh heap;  // the same faces, each with corners of its own
  for (const Triangle& face : ball.faces) {
    const auto first = static_cast<std::int32_t>(heap.vertices.size());
    for (const std::int32_t corner : face) heap.vertices.push_back(ball.vertices[at(corner)]);
    heap.faces.push_back({first, first + 1, first + 2});
  }
  EXPECT_EQ(seen(heap).vertices.size(), ball.vertices.size());

  Mesh loose = heap;  // and apart from each other, so that no edge can collapse for two faces
  for (std::size_t v = 0; v < loose.vertices.size(); ++v)
    loose.vertices[v] *= 1.0F + 1e-3F * static_cast<float>(v / 3 % 7);
  const RignetMesh torn = seen(loose, 400);
  EXPECT_LE(torn.vertices.size(), 600u);
  EXPECT_FALSE(torn.faces.empty());
}

TEST(SurfacePaths, GoAlongTheSurface) {
  const RignetMesh ball = seen(geometry::icosphere(3, 0.5));
  const SurfacePaths paths(ball, 2000, 0);
  const auto from = paths.from({0});
  const Eigen::Vector3d middle(0.0, 0.5, 0.0);
  for (std::size_t v = 0; v < ball.vertices.size(); ++v) {
    const Eigen::Vector3d a = ball.vertices[0].cast<double>() - middle, b = ball.vertices[v].cast<double>() - middle;
    const double arc = 0.5 * std::acos(std::clamp(a.dot(b) / (a.norm() * b.norm()), -1.0, 1.0));
    EXPECT_GE(from[v].distance, 0.97 * arc) << v;
    EXPECT_LE(from[v].distance, 1.2 * arc + 1e-6) << v;
    EXPECT_EQ(from[v].source, 0);
  }
  for (const auto& reached : paths.within(5, 0.2)) {
    EXPECT_NE(reached.vertex, 5);
    EXPECT_LT(reached.distance, 0.2);
    EXPECT_NEAR(reached.distance, paths.from({5})[at(reached.vertex)].distance, 1e-9);
  }
  EXPECT_EQ(paths.from({}).front().source, -1);
}

std::set<std::int64_t> sources_of(const EdgeSet& edges, std::int64_t target) {
  const auto first = edges.offsets[target].item<std::int64_t>(), last = edges.offsets[target + 1].item<std::int64_t>();
  std::set<std::int64_t> sources;
  for (std::int64_t e = first; e < last; ++e) sources.insert(edges.sources[e].item<std::int64_t>());
  EXPECT_EQ(static_cast<std::int64_t>(sources.size()), last - first) << "nobody twice";
  return sources;
}

TEST(RignetEdgesOfMeshes, RingsAreThoseOfFacesAndBallsAreSmall) {
  const RignetMesh ball = seen(geometry::icosphere(5, 0.5), 20000);
  const SurfacePaths paths(ball, 500, 3);
  const MeshGraph graph = mesh_graph(ball, paths, 3);
  std::map<std::int64_t, std::set<std::int64_t>> ring;
  for (const Triangle& face : ball.faces) {
    for (const std::int32_t a : face) ring[a].insert(face.begin(), face.end());
  }
  bool has_more_than_ten = false;
  for (std::int64_t v = 0; v < graph.vertices.size(0); v += 17) {
    EXPECT_EQ(sources_of(graph.ring, v), ring[v]) << v;
    const std::set<std::int64_t> near = sources_of(graph.ball, v);
    EXPECT_TRUE(near.count(v) > 0);
    EXPECT_LE(near.size(), 11u);
    has_more_than_ten = has_more_than_ten || paths.within(static_cast<std::int32_t>(v), 0.06).size() > 10;
    for (const std::int64_t other : near)
      EXPECT_LT((graph.vertices[v] - graph.vertices[other]).norm().item<double>(), 0.06);
  }
  EXPECT_TRUE(has_more_than_ten) << "so that some were drawn";
  EXPECT_TRUE(torch::equal(graph.ball.sources, mesh_graph(ball, paths, 3).ball.sources));
  EXPECT_FALSE(torch::equal(graph.ball.sources, mesh_graph(ball, paths, 4).ball.sources));
}

TEST(SolidShape, KnowsInsideFromOutside) {
  const Mesh ball = geometry::icosphere(4, 0.5);
  const SolidShape solid(ball.vertices, ball.faces);
  EXPECT_TRUE(solid.holds(Eigen::Vector3d(0, 0.5, 0)));
  EXPECT_FALSE(solid.holds(Eigen::Vector3d(0.45, 0.95, 0.45)));
  EXPECT_FALSE(solid.holds(Eigen::Vector3d(40, 0, 0)));
  // Half a unit inside, half outside, 101 samples.
  const SolidShape::Way way = solid.way({0, 0.5, 0}, {1, 0.5, 0});
  EXPECT_NEAR(way.inside, 0.5, 0.03);
  EXPECT_NEAR(way.outside, 50, 3);
  const SolidShape::Ways ways = solid.ways({{0, 0.5, 0}, {0, 0.7, 0}, {1, 0.5, 0}});
  EXPECT_EQ(ways.inside[0][1].item<float>(), 1.0F);
  EXPECT_EQ(ways.outside[2][0].item<float>(), ways.outside[0][2].item<float>());
  EXPECT_TRUE(
      torch::equal(solid.holds(torch::tensor({{0.0F, 0.5F, 0.0F}, {0.0F, 1.5F, 0.0F}})), torch::tensor({true, false})));
}

TEST(JointAttention, LooksAroundJointsAndAtSixVerticesAtLeast) {
  const RignetMesh mesh = seen(tube(60, 24, 0.05));
  // Up is y now; the bone runs from 0.2 to 0.7.
  const std::vector<Eigen::Vector3d> joints = {{0, 0.2, 0}, {0, 0.7, 0}};
  const torch::Tensor attention = joint_attention(mesh, joints, {0, 0});
  for (std::size_t v = 0; v < mesh.vertices.size(); ++v) {
    const float y = mesh.vertices[v].y();
    const bool is_near = std::min(std::abs(y - 0.2F), std::abs(y - 0.7F)) < 0.025F;
    if (attention[static_cast<std::int64_t>(v)].item<float>() > 0.0F) {
      EXPECT_TRUE(is_near) << y;
    }
  }
  EXPECT_GT(attention.sum().item<double>(), 48.0) << "rings of 24 vertices around both";
  EXPECT_EQ(joint_attention(mesh, {{0, 0.5, 0}}, {0}).sum().item<double>(), 6.0) << "a joint without a bone";
}

TEST(BoneSlots, DistancesAreStraightWhereABoneIsSeenAndGoAroundWhereNot) {
  const RignetMesh mesh = seen(tube(40, 16, 0.05));
  const SurfacePaths paths(mesh, 1000, 0);
  // Two bones in a row, one above the other.
  const BoneEnds bones{{{0, 0.1, 0}, {0, 0.5, 0}}, {{0, 0.5, 0}, {0, 0.9, 0}}};
  const std::vector<double> distances = volumetric_distances(mesh, paths, bones);
  const auto slots = bone_slots(distances, bones, 5);
  for (std::size_t v = 0; v < mesh.vertices.size(); ++v) {
    const double y = mesh.vertices[v].y();
    if (y > 0.12 && y < 0.48) {
      EXPECT_NEAR(distances[2 * v], 0.05, 0.002) << "beside the first bone";
      EXPECT_EQ(slots.bones[static_cast<std::int64_t>(v)][0].item<std::int64_t>(), 0);
    }
    if (y > 0.8) {
      EXPECT_GT(distances[2 * v], y - 0.5) << "no nearer than straight";
      EXPECT_EQ(slots.bones[static_cast<std::int64_t>(v)][0].item<std::int64_t>(), 1);
    }
  }
  EXPECT_EQ((slots.bones.slice(1, 2) == -1).all().item<bool>(), true) << "there are only two bones";
  const torch::Tensor features = slots.features.view({-1, 5, kBoneNumbers});
  EXPECT_EQ(features.slice(1, 2).abs().max().item<float>(), 0.0F);
  const auto first = slots.bones.select(1, 0);
  EXPECT_TRUE(torch::equal(features.select(1, 0).select(1, 7), first.to(torch::kFloat32))) << "the second is the tip";
  EXPECT_LE(features.select(2, 6).max().item<float>(), 100.0F);
}

class RignetData : public ::testing::Test {
 protected:
  void SetUp() override { test::write_synthetic_dataset(folder_.path(), 10); }
  RignetDatasetOptions options(Task task) {
    RignetDatasetOptions options;
    options.data_dir = folder_.path().string();
    options.conversion.points = 120;
    options.conversion.mesh.geodesic_samples = 100;
    options.conversion.task = task;
    return options;
  }
  test::TemporaryFolder folder_;
};

TEST_F(RignetData, SamplesHoldWhatTheirTaskAsksFor) {
  RignetDatasetOptions held_out = options(Task::kSkinning);
  held_out.eval_fraction = 0.4;
  const RignetDatasets sets = open_rignet(held_out);
  ASSERT_NE(sets.held_out, nullptr);
  EXPECT_EQ(sets.train->samples() + sets.held_out->samples(), 10u);
  EXPECT_FALSE(sets.train->sample(0).rig.points_cloud.defined()) << "points are for scores";
  const RignetSample& sample = sets.held_out->sample(0);
  const std::int64_t vertices = sample.graph.vertices.size(0);
  EXPECT_EQ(sample.slots.bones.sizes(), (std::vector<std::int64_t>{vertices, 5}));
  EXPECT_LE(sample.weights.sum(1).max().item<double>(), 1.0 + 1e-5);
  EXPECT_GT(sample.weights.sum(1).mean().item<double>(), 0.6) << "most of a vertex's weight is on its nearest bones";
  // Points as Anymate's models are measured on, found again on the graph.
  const torch::Tensor corners = sample.graph.vertices.index_select(0, sample.corners.flatten()).view({120, 3, 3});
  const torch::Tensor places = (corners * sample.shares.unsqueeze(2)).sum(1);
  const torch::Tensor points = in_rignet_frame(sample.rig.points_cloud.narrow(1, 0, 3), sample.frame);
  EXPECT_LT((places - points).abs().max().item<double>(), 1e-4);

  const RignetSample joints = open_rignet(options(Task::kJoints)).train->sample(0);
  EXPECT_GE(joints.attention.sum().item<double>(), 6.0);
  EXPECT_FALSE(joints.inside.defined());
  const RignetSample pairs = open_rignet(options(Task::kConnectivity)).train->sample(0);
  EXPECT_EQ(pairs.inside.sizes(), (std::vector<std::int64_t>{pairs.joints.size(0), pairs.joints.size(0)}));
  EXPECT_FALSE(pairs.attention.defined());
}

TEST_F(RignetData, TruthIsThatOfAnymatesData) {
  const RignetSample ours = open_rignet(options(Task::kConnectivity)).train->sample(0);
  anymate::AnymateConversion conversion;
  conversion.points = 120;
  data::AssetId id;
  id.root = folder_.path();
  id.id = ours.rig.name;
  const auto theirs = anymate::convert_rig(data::read_rigged_item(id), conversion);
  EXPECT_TRUE(torch::equal(ours.rig.joints, theirs.joints));
  EXPECT_TRUE(torch::equal(ours.rig.conns, theirs.conns));
  EXPECT_TRUE(torch::equal(ours.rig.bones, theirs.bones));
  const auto back = in_anymate_frame(ours.joints, ours.frame);
  EXPECT_NEAR(back[1].x(), theirs.joints[1][0].item<double>(), 1e-6);
  EXPECT_NEAR(back[1].y(), theirs.joints[1][1].item<double>(), 1e-6);
}

TEST_F(RignetData, WhatIsTooLargeIsLeftOutAndNothingLeftIsAnError) {
  RignetDatasetOptions small = options(Task::kJoints);
  small.max_bones = 6;
  EXPECT_LT(open_rignet(small).train->samples(), 10u);
  small.max_bones = 2;
  EXPECT_THROW(open_rignet(small), InputError);
}

}  // namespace
}  // namespace anigen::rignet
