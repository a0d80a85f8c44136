#include "anigen/rigging/skin_features.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <numeric>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/core/parallel.h"
#include "tests/rigging/binding_shapes.h"

namespace anigen::rigging {
namespace {

using test::Body;

SkinFeatureOptions coarse_features(std::size_t candidates = kSkinCandidates) { return {candidates, 64}; }

std::vector<std::int32_t> all_places(const SkinFeatures& features) {
  std::vector<std::int32_t> places(features.places());
  std::iota(places.begin(), places.end(), 0);
  return places;
}

/// Features of each vertex and joint.
class VertexFeatures {
 public:
  explicit VertexFeatures(const Body& body, const SkinFeatureOptions& options = coarse_features())
      : features_(body.mesh, body.skeleton, options), pairs_(features_.pairs(all_places(features_))) {}

  const SkinFeatures& of_asset() const { return features_; }
  const SkinPairs& pairs() const { return pairs_; }
  /// Null when the joint is no candidate.
  const float* at_vertex(std::size_t vertex, int joint) const {
    const auto place = static_cast<std::size_t>(features_.place_of_vertex()[vertex]);
    for (std::size_t c = 0; c < features_.candidates(); ++c) {
      const std::size_t pair = place * features_.candidates() + c;
      if (pairs_.joints[pair] == joint) return &pairs_.features[pair * kSkinPairFeatures];
    }
    return nullptr;
  }

 private:
  SkinFeatures features_;
  SkinPairs pairs_;
};

/// The body in another frame: turned, scaled and moved.
Body moved(const Body& body, const Eigen::Matrix3d& turn, double scale, const Eigen::Vector3d& shift) {
  const auto place = [&](const Eigen::Vector3d& p) { return Eigen::Vector3d(scale * (turn * p) + shift); };
  Body result;
  result.mesh = body.mesh;
  for (Eigen::Vector3f& vertex : result.mesh.vertices) vertex = place(vertex.cast<double>()).cast<float>();
  std::vector<Eigen::Vector3d> joints;
  for (const Eigen::Vector3d& joint : body.skeleton.positions()) joints.push_back(place(joint));
  result.skeleton = skeleton_from_joints(joints, body.skeleton.parents);
  return result;
}

/// Mean over vertices and joints of the difference of each feature.
std::vector<double> differences(const Body& body, const VertexFeatures& a, const VertexFeatures& b) {
  std::vector<double> sum(kSkinPairFeatures, 0.0);
  double count = 0.0;
  for (std::size_t v = 0; v < body.mesh.vertices.size(); ++v) {
    for (int j = 0; j < static_cast<int>(body.skeleton.size()); ++j) {
      const float *first = a.at_vertex(v, j), *second = b.at_vertex(v, j);
      if (first == nullptr || second == nullptr) {
        ADD_FAILURE() << "joint " << j << " is no candidate of vertex " << v;
        return sum;
      }
      for (std::size_t f = 0; f < kSkinPairFeatures; ++f) sum[f] += std::abs(first[f] - second[f]);
      count += 1.0;
    }
  }
  for (double& value : sum) value /= count;
  return sum;
}

TEST(SkinFeatures, AreTheSameInAFrameTurnedByRightAngles) {
  const Body body = test::two_fingers();
  const Eigen::Matrix3d turn = Eigen::AngleAxisd(kPi / 2.0, Eigen::Vector3d::UnitZ()).toRotationMatrix();
  const VertexFeatures here(body), there(moved(body, turn, 3.0, {5.0, -2.0, 1.0}));
  const std::vector<double> difference = differences(body, here, there);
  // Voxels lie alike; what rounding of positions to single precision leaves.
  for (std::size_t f = 0; f < kSkinPairFeatures; ++f) EXPECT_LT(difference[f], 0.02) << "feature " << f;
  for (std::size_t f = 0; f < kSkinAssetFeatures; ++f)
    EXPECT_NEAR(here.of_asset().asset()[f], there.of_asset().asset()[f], 0.02) << "feature " << f;
}

TEST(SkinFeatures, AreNearlyTheSameInAnyFrame) {
  const Eigen::Matrix3d turn = Eigen::AngleAxisd(0.7, Eigen::Vector3d(1.0, 2.0, -0.5).normalized()).toRotationMatrix();
  for (const bool fingers : {false, true}) {
    const Body body = fingers ? test::two_fingers() : test::two_bones();
    const VertexFeatures here(body), there(moved(body, turn, 0.01, {0.3, 0.0, -4.0}));
    const std::vector<double> difference = differences(body, here, there);
    for (std::size_t f = 0; f < kSkinPairFeatures; ++f) {
      // Voxels lie along other axes: the gap between the fingers is one of them wide, and closes. Rays through the gap
      // graze a surface, and see a bone or not by rounding.
      const bool by_voxels = f == kGeodesicLog || f == kGeodesicAround || f == kShellGeodesic;
      const bool by_rays = f == kHeatLog || f == kHeatAround || f == kShellHeat || f == kSurfaceHeat;
      if (by_voxels && fingers) continue;
      EXPECT_LT(difference[f], by_voxels            ? 0.2
                               : by_rays && fingers ? 0.15
                                                    : 0.05)
          << "feature " << f << (fingers ? " of fingers" : " of a capsule");
    }
  }
}

TEST(SkinFeatures, DoNotDependOnTheNumberOfThreads) {
  const Body body = test::two_fingers();
  const int before = thread_count();
  set_thread_count(1);
  const VertexFeatures alone(body);
  set_thread_count(3);
  const VertexFeatures together(body);
  set_thread_count(before);
  EXPECT_EQ(alone.pairs().joints, together.pairs().joints);
  EXPECT_EQ(alone.pairs().features, together.pairs().features);
  EXPECT_EQ(alone.of_asset().asset(), together.of_asset().asset());
}

TEST(SkinFeatures, DoNotDependOnTheOrderOfVertices) {
  const Body body = test::two_bones();
  Body reversed = body;
  const auto last = static_cast<std::int32_t>(body.mesh.vertices.size() - 1);
  std::reverse(reversed.mesh.vertices.begin(), reversed.mesh.vertices.end());
  for (Triangle& face : reversed.mesh.faces) {
    for (std::int32_t& corner : face) corner = last - corner;
  }
  const VertexFeatures a(body), b(reversed);
  for (std::size_t v = 0; v < body.mesh.vertices.size(); ++v) {
    for (int j = 0; j < 3; ++j) {
      const float *first = a.at_vertex(v, j), *second = b.at_vertex(static_cast<std::size_t>(last) - v, j);
      ASSERT_TRUE(first != nullptr && second != nullptr);
      for (std::size_t f = 0; f < kSkinPairFeatures; ++f) EXPECT_NEAR(first[f], second[f], 1e-4) << v << ", " << f;
    }
  }
}

TEST(SkinFeatures, SayWhereAVertexIs) {
  const Body body = test::two_bones();
  const VertexFeatures features(body);
  // A vertex above the middle of the first bone, which lies 0.2 below it; the capsule's ring there.
  std::size_t vertex = 0;
  for (std::size_t v = 0; v < body.mesh.vertices.size(); ++v) {
    if (std::abs(body.mesh.vertices[v].x() + 0.45F) < std::abs(body.mesh.vertices[vertex].x() + 0.45F)) vertex = v;
  }
  const float *own = features.at_vertex(vertex, 0), *next = features.at_vertex(vertex, 1),
              *tip = features.at_vertex(vertex, 2);
  ASSERT_TRUE(own != nullptr && next != nullptr && tip != nullptr);
  EXPECT_NEAR(own[kAlongBone], (body.mesh.vertices[vertex].x() + 0.9) / 0.9, 1e-3);
  EXPECT_LT(next[kAlongBone], 0.0F);
  EXPECT_NEAR(own[kFacing], -1.0, 0.02) << "the bone is straight behind the surface";
  EXPECT_NEAR(own[kBoneDistance] / own[kBoneLength], 0.2 / 0.9, 0.01);
  EXPECT_EQ(own[kDistanceRank], 0.0F);
  EXPECT_EQ(own[kDistanceRatio], 0.0F);
  EXPECT_GT(tip[kDistanceRatio], next[kDistanceRatio]);
  EXPECT_GT(own[kHeatLog], next[kHeatLog]);
  EXPECT_GT(own[kGeodesicLog], next[kGeodesicLog]);
  EXPECT_EQ(own[kHops], 0.0F);
  EXPECT_FLOAT_EQ(tip[kHops], 2.0F / 8.0F);
  EXPECT_FLOAT_EQ(tip[kDepthStep], 0.5F);
  EXPECT_EQ(own[kLeaf], 0.0F);
  EXPECT_EQ(tip[kLeaf], 1.0F);
  EXPECT_EQ(tip[kDepth], 1.0F);
  EXPECT_EQ(own[kShellSize], 1.0F) << "one shell";
  EXPECT_EQ(own[kShellReach], 0.0F);
}

TEST(SkinFeatures, TellShellsApart) {
  const Body body = test::two_fingers();  // a palm and two fingers, each a shell
  const VertexFeatures features(body);
  EXPECT_NEAR(features.of_asset().asset()[kShellCount], 0.25 * std::log(3.0), 1e-6);
  const auto& shells = features.of_asset().shell_of_place();
  const auto& places = features.of_asset().place_of_vertex();
  const std::size_t thin = body.mesh.vertices.size() - 1;  // of the thin finger
  const float *own = features.at_vertex(thin, 3), *other = features.at_vertex(thin, 1);
  ASSERT_TRUE(own != nullptr && other != nullptr);
  EXPECT_GT(own[kShellHeatShare], other[kShellHeatShare]);
  EXPECT_LT(own[kShellReach], other[kShellReach]);
  for (std::size_t p = 0; p < features.of_asset().places(); ++p) {
    for (const auto* n = features.of_asset().neighbors_begin(p); n != features.of_asset().neighbors_end(p); ++n)
      EXPECT_EQ(shells[p], shells[static_cast<std::size_t>(*n)]);
  }
  EXPECT_NE(shells[static_cast<std::size_t>(places[thin])], shells[static_cast<std::size_t>(places[0])]);
}

TEST(SkinFeatures, CandidatesHoldTheNearestBoneAndTheClassicalChoice) {
  const Body body = test::two_fingers();
  const VertexFeatures features(body, coarse_features(3));
  ASSERT_EQ(features.of_asset().candidates(), 3U);
  const SkinWeights nearest = test::bound(SkinBinding::kNearest, body), heat = test::bound(SkinBinding::kHeat, body);
  for (std::size_t v = 0; v < body.mesh.vertices.size(); ++v) {
    EXPECT_NE(features.at_vertex(v, heat.row(v)->joint), nullptr) << v;
    // Bones that share an end are equally near beyond it, up to rounding.
    if (features.at_vertex(v, nearest.row(v)->joint) != nullptr) continue;
    float least = std::numeric_limits<float>::max();
    for (int j = 0; j < 5; ++j) {
      if (const float* pair = features.at_vertex(v, j)) least = std::min(least, pair[kDistanceRatio]);
    }
    EXPECT_LT(least, 1e-3F) << v;
  }
}

TEST(SkinFeatures, FewerJointsThanCandidatesLeavePlacesEmpty) {
  const VertexFeatures features(test::two_bones());
  const std::size_t count = features.of_asset().candidates();
  ASSERT_EQ(count, kSkinCandidates);
  for (std::size_t p = 0; p < features.of_asset().places(); ++p) {
    for (std::size_t c = 0; c < count; ++c) {
      const std::int32_t joint = features.pairs().joints[p * count + c];
      EXPECT_EQ(joint < 0, c >= 3) << p;
      if (joint >= 0) continue;
      const float* pair = &features.pairs().features[(p * count + c) * kSkinPairFeatures];
      EXPECT_NEAR(std::exp(pair[kHeatLog]), kClassicalFloor, 1e-8);
      EXPECT_EQ(pair[kBoneDistance], 0.0F);
    }
  }
}

TEST(SkinFeatures, RefuseWhatCannotBeBound) {
  Body body = test::two_bones();
  EXPECT_THROW(SkinFeatures(body.mesh, body.skeleton, coarse_features(0)), InputError);
  EXPECT_THROW(SkinFeatures(body.mesh, Skeleton(), coarse_features()), InputError);
  body.mesh.vertices[3].x() = std::numeric_limits<float>::quiet_NaN();
  EXPECT_THROW(SkinFeatures(body.mesh, body.skeleton, coarse_features()), InputError);
}

}  // namespace
}  // namespace anigen::rigging
