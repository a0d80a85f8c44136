#include <gtest/gtest.h>
#include <filesystem>
#include <limits>

#include "anigen/core/error.h"
#include "anigen/geometry/primitives.h"
#include "anigen/io/gltf/gltf.h"
#include "tests/rigging/binding_shapes.h"
#include "tests/support/paths.h"
#include "tests/support/rig_files.h"

namespace anigen::rigging {

namespace {

using namespace anigen::test;

/// Files of people: parts that overlap and float, seams, joints that nothing hangs on, hundreds of them.
TEST(BindingAssets, EveryRealMeshGetsSoundRowsFromEveryBinding) {
  const std::filesystem::path folder = test::assets_dir() / "rigged";
  if (!std::filesystem::exists(folder)) GTEST_SKIP() << folder << " does not exist";
  std::size_t bodies = 0;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(folder)) {
    const std::filesystem::path& file = entry.path();
    if (file.extension() != ".glb" && file.extension() != ".gltf") continue;
    if (file.parent_path().filename() == "negative") continue;
    SCOPED_TRACE(file.string());
    const Asset asset = io::read_gltf(file).asset;
    const Body body{asset.mesh, asset.skeleton};
    for (const SkinBinding binding : kAllBindings) {
      const SkinWeights skin = bound(binding, body, coarse(48));
      ASSERT_NO_FATAL_FAILURE(expect_sound(skin, body));
    }
    ++bodies;
  }
  EXPECT_GT(bodies, 0u);
}

}  // namespace

namespace {

using namespace anigen::test;

/// Meshes as people have them: nothing here may crash, hang or give weights that are none.
class HostileInput : public testing::TestWithParam<SkinBinding> {
 protected:
  static SkinWeights sound(const Body& body) {
    SkinWeights skin = bound(GetParam(), body);
    expect_sound(skin, body);
    return skin;
  }
  static std::string refused(const Body& body) {
    return refusal([&] { bound(GetParam(), body); });
  }
};
INSTANTIATE_TEST_SUITE_P(Of, HostileInput, testing::ValuesIn(kAllBindings),
                         [](const auto& info) { return to_string(info.param); });

TEST_P(HostileInput, NumbersThatAreNone) {
  const float nan = std::numeric_limits<float>::quiet_NaN(), infinity = std::numeric_limits<float>::infinity();
  Body body = two_bones();
  body.mesh.vertices[7].y() = nan;
  EXPECT_EQ(refused(body), "mesh.vertices[7]: the position is not finite");
  body.mesh.vertices[7].y() = infinity;
  EXPECT_EQ(refused(body), "mesh.vertices[7]: the position is not finite");
  body = two_bones();
  body.skeleton.bind[1](0, 3) = static_cast<double>(nan);
  EXPECT_EQ(refused(body), "skeleton joint 1: the position is not finite");
}

TEST_P(HostileInput, SkeletonsThatAreNone) {
  Body body = two_bones();
  body.skeleton.parents = {-1, 2, 1};
  EXPECT_EQ(refused(body), "skeleton joint 1: its parent 2 does not come before it");
  body.skeleton.bind.pop_back();
  EXPECT_EQ(refused(body), "skeleton: 2 bind matrices for 3 joints");
  body.skeleton = Skeleton();
  EXPECT_EQ(refused(body), "skeleton: there is no joint to bind to");
}

TEST_P(HostileInput, NoVerticesGiveNoRows) {
  Body body = two_bones();
  body.mesh = Mesh();
  EXPECT_EQ(bound(GetParam(), body).rows(), 0u);
}

TEST_P(HostileInput, PointsWithoutFaces) {
  Body body = two_bones();
  body.mesh.faces.clear();
  const SkinWeights skin = sound(body);
  for (std::size_t v = 0; v < skin.rows(); ++v) {
    if (body.mesh.vertices[v].x() < -0.2F) {
      EXPECT_EQ(skin.row(v)[0].joint, 0);
    }
  }
  body.mesh.vertices.resize(1);
  sound(body);
}

TEST_P(HostileInput, FacesWithoutArea) {
  Body body = two_bones();
  const SkinWeights skin = sound(body);
  const std::size_t faces = body.mesh.faces.size();
  for (std::size_t f = 0; f < faces; f += 3) {
    const Triangle face = body.mesh.faces[f];
    body.mesh.faces.push_back({face[0], face[0], face[1]});
    body.mesh.faces.push_back({face[0], face[0], face[0]});
    body.mesh.faces.push_back(face);
  }
  EXPECT_EQ(differing_rows(sound(body), skin), 0u);
  // A strip of three places on a line, in the middle of nowhere, and nothing but such strips.
  body.mesh.vertices.insert(body.mesh.vertices.end(), {{0.0F, 1.0F, 0.0F}, {0.5F, 1.0F, 0.0F}, {1.0F, 1.0F, 0.0F}});
  const auto last = static_cast<std::int32_t>(body.mesh.vertices.size());
  body.mesh.faces.push_back({last - 3, last - 2, last - 1});
  sound(body);
  body.mesh.faces.assign(1, {last - 3, last - 2, last - 1});
  sound(body);
}

TEST_P(HostileInput, AMeshInOnePoint) {
  Body body = two_bones();
  for (Eigen::Vector3f& p : body.mesh.vertices) p = {0.5F, 0.1F, 0.0F};
  const SkinWeights skin = sound(body);
  EXPECT_EQ(skin.row(0)[0].joint, 1);
  EXPECT_TRUE(same_row(skin, 0, skin, skin.rows() - 1));
}

TEST_P(HostileInput, StrayVerticesTakeNothingFromTheOthers) {
  Body body = two_bones();
  const SkinWeights skin = sound(body);
  const std::size_t vertices = body.mesh.vertices.size();
  body.mesh.vertices.insert(body.mesh.vertices.end(), {{1e6F, 0.0F, 0.0F}, {-0.5F, 0.0F, 0.0F}, {0.0F, 3e38F, 0.0F}});
  const SkinWeights more = sound(body);
  for (std::size_t v = 0; v < vertices; ++v) ASSERT_TRUE(same_row(more, v, skin, v));
  EXPECT_EQ(more.row(vertices + 1)[0].joint, 0);
}

TEST_P(HostileInput, WindingDoesNotMatter) {
  Body body = two_bones();
  const SkinWeights skin = sound(body);
  for (Triangle& face : body.mesh.faces) std::swap(face[1], face[2]);
  EXPECT_LT(largest_difference(sound(body), skin, 3), 1e-6F);
  for (std::size_t f = 0; f < body.mesh.faces.size(); f += 7) std::swap(body.mesh.faces[f][1], body.mesh.faces[f][2]);
  EXPECT_LT(largest_difference(sound(body), skin, 3), 0.1F);
}

TEST_P(HostileInput, HolesDoLittleHarm) {
  Body body = two_bones();
  const SkinWeights skin = sound(body);
  std::vector<Triangle> kept;
  for (const Triangle& face : body.mesh.faces) {
    const Eigen::Vector3f& p = body.mesh.vertices[at(face[0])];
    if (std::abs(p.x() - 0.3F) > 0.12F || p.z() < 0.05F) kept.push_back(face);
  }
  ASSERT_LT(kept.size() + 20, body.mesh.faces.size());
  body.mesh.faces = kept;
  const SkinWeights holed = sound(body);
  for (std::size_t v = 0; v < skin.rows(); ++v) {
    const Eigen::Vector3f& p = body.mesh.vertices[v];
    if (std::abs(p.x() - 0.3F) < 0.2F && p.z() > 0.0F) continue;  // the hole's own rim
    for (int joint = 0; joint < 3; ++joint)
      ASSERT_NEAR(weight_of(holed, v, joint), weight_of(skin, v, joint), 0.1F) << p.transpose();
  }
}

TEST_P(HostileInput, ASheet) {
  Body body;
  append_box(body.mesh, {-1.0, -0.2, 0.0}, {1.0, 0.2, 0.0}, 12);  // both sides at one place, and its rim folded flat
  body.skeleton = two_bones().skeleton;
  const SkinWeights skin = sound(body);
  for (std::size_t v = 0; v < skin.rows(); ++v) {
    const float x = body.mesh.vertices[v].x();
    if (std::abs(x) > 0.1F && std::abs(x) < 0.8F) {
      EXPECT_EQ(skin.row(v)[0].joint, x < 0.0F ? 0 : 1);
    }
  }
}

TEST_P(HostileInput, OneJoint) {
  Body body = two_bones();
  body.skeleton = skeleton_from_joints({{0.3, 0.0, 0.0}}, {-1});
  const SkinWeights skin = sound(body);
  for (std::size_t v = 0; v < skin.rows(); ++v) EXPECT_EQ(skin.row(v)[0].weight, 1.0F);
}

TEST_P(HostileInput, BonesWithoutLength) {
  Body body = two_bones();
  body.skeleton = skeleton_from_joints({{-0.6, 0, 0}, {-0.6, 0, 0}, {0.6, 0, 0}, {0.6, 0, 0}}, {-1, 0, 1, 2});
  const SkinWeights skin = sound(body);
  EXPECT_LE(skin.row(0)[0].joint, 1);
  EXPECT_GE(skin.row(skin.rows() - 1)[0].joint, 1);
}

TEST_P(HostileInput, JointsOutsideTheMesh) {
  Body body = two_bones();
  body.skeleton =
      skeleton_from_joints({{-0.9, 0, 0}, {0, 0, 0}, {0.9, 0, 0}, {0.5, 2.0, 0}, {0.5, 1e30, 0}}, {-1, 0, 1, 0, 3});
  sound(body);
  body.skeleton = skeleton_from_joints({{-0.6, 3.0, 0.0}, {0.6, 3.0, 0.0}}, {-1, -1});
  const SkinWeights skin = sound(body);
  for (std::size_t v = 0; v < skin.rows(); ++v) {
    const float x = body.mesh.vertices[v].x();
    if (std::abs(x) > 0.1F) {
      EXPECT_EQ(skin.row(v)[0].joint, x < 0.0F ? 0 : 1) << x;
    }
  }
}

TEST_P(HostileInput, APartThatFloatsBesideTheBody) {
  Body body = two_bones();
  const SkinWeights skin = sound(body);
  const std::size_t vertices = body.mesh.vertices.size();
  append_box(body.mesh, {-0.7, 0.3, -0.05}, {-0.5, 0.4, 0.05}, 3);
  const SkinWeights more = sound(body);
  for (std::size_t v = vertices; v < more.rows(); ++v) EXPECT_EQ(more.row(v)[0].joint, 0);
  EXPECT_LT(largest_difference(limit_influences(skin, 4), skin, 3), 1e-6F);
}

TEST_P(HostileInput, HugeAndTinyUnits) {
  for (const double scale : {1e30, 1e-30}) {
    Body body = two_bones();
    for (Eigen::Vector3f& p : body.mesh.vertices) p *= static_cast<float>(scale);
    body.skeleton = skeleton_from_joints({{-0.9 * scale, 0, 0}, {0, 0, 0}, {0.9 * scale, 0, 0}}, {-1, 0, 1});
    const SkinWeights skin = sound(body);
    EXPECT_EQ(skin.row(20)[0].joint, 0);
  }
}

TEST_P(HostileInput, ManyVertices) {
  // A factorisation of 160000 unknowns takes seconds.
  const int subdivisions = GetParam() == SkinBinding::kHeat ? 6 : 7;
  Body body{geometry::icosphere(subdivisions, 1.0),
            skeleton_from_joints({{-0.8, 0, 0}, {0, 0, 0}, {0.8, 0, 0}}, {-1, 0, 1})};
  ASSERT_GT(body.mesh.vertices.size(), 40000u);
  const SkinWeights skin = sound(body);
  for (std::size_t v = 0; v < skin.rows(); v += 97) {
    const float x = body.mesh.vertices[v].x();
    if (std::abs(x) > 0.3F && std::abs(x) < 0.7F) {
      EXPECT_EQ(skin.row(v)[0].joint, x < 0.0F ? 0 : 1) << x;
    }
  }
}

TEST_P(HostileInput, ABadFace) {
  if (GetParam() == SkinBinding::kNearest) return;  // has no use for faces
  Body body = two_bones();
  body.mesh.faces[4][1] = -1;
  EXPECT_EQ(refused(body), "mesh.faces[4]: there is no vertex -1");
  body.mesh.faces[4][1] = 1 << 30;
  EXPECT_EQ(refused(body), "mesh.faces[4]: there is no vertex 1073741824");
}

TEST(GeodesicVoxels, WhatNoBoneReachesIsBoundStraight) {
  Body body = two_bones();
  const std::size_t vertices = body.mesh.vertices.size();
  append_box(body.mesh, {-0.7, 0.5, -0.05}, {-0.5, 0.6, 0.05}, 1);
  body.skeleton = skeleton_from_joints({{-0.9, 0, 0}, {-0.3, 0, 0}, {0.3, 0, 0}, {0.9, 0, 0}}, {-1, 0, 1, 2});
  BindingOptions options = coarse();
  options.geodesic.falloff = 0.0;
  const SkinWeights skin = bound(SkinBinding::kGeodesicVoxels, body, options);
  for (std::size_t v = vertices; v < skin.rows(); ++v) {
    ASSERT_EQ(skin.row_size(v), 3u);  // the three nearest by 1/d²
    EXPECT_EQ(weight_of(skin, v, 3), 0.0F);
    const Eigen::Vector3f& p = body.mesh.vertices[v];
    const double first = std::hypot(p.y(), p.z()), second = std::hypot(p.x() + 0.3F, first);
    EXPECT_NEAR(weight_of(skin, v, 0) / weight_of(skin, v, 1), (second * second) / (first * first), 1e-3);
  }
}

TEST(BoneHeat, APartWithoutHeatIsWarmedByItsNearestBones) {
  // A shell around the capsule sees the bones through the capsule only.
  Body body = two_bones();
  const std::size_t vertices = body.mesh.vertices.size();
  const Mesh shell = capsule(1.3, 0.3, 48, 16);
  for (const Eigen::Vector3f& p : shell.vertices) body.mesh.vertices.push_back(p);
  for (Triangle face : shell.faces) {
    for (std::int32_t& v : face) v += static_cast<std::int32_t>(vertices);
    body.mesh.faces.push_back(face);
  }
  const SkinWeights skin = bound(SkinBinding::kHeat, body);
  expect_sound(skin, body);
  for (std::size_t v = vertices; v < skin.rows(); ++v) {
    const float x = body.mesh.vertices[v].x();
    if (std::abs(x) > 0.1F && std::abs(x) < 0.7F) {
      EXPECT_EQ(skin.row(v)[0].joint, x < 0.0F ? 0 : 1) << x;
    }
    if (std::abs(x) < 0.01F) {
      EXPECT_NEAR(weight_of(skin, v, 0), weight_of(skin, v, 1), 0.05F);
    }
  }
}

TEST(BindingOptions, OutOfRangeAreRefused) {
  const Body body = two_bones();
  const auto refused = [&](SkinBinding binding, const BindingOptions& options) {
    return refusal([&] { bound(binding, body, options); });
  };
  for (const int resolution : {-1, 1, 513, 1 << 30}) {
    EXPECT_EQ(refused(SkinBinding::kGeodesicVoxels, coarse(resolution)),
              "resolution: must be between 2 and 512, not " + std::to_string(resolution));
  }
  for (const double falloff : {-0.1, 1.1, std::numeric_limits<double>::quiet_NaN()}) {
    BindingOptions options = coarse();
    options.geodesic.falloff = falloff;
    EXPECT_EQ(refused(SkinBinding::kGeodesicVoxels, options).rfind("falloff: must be between 0 and 1", 0), 0u);
  }
  for (const double heat : {0.0, -1.0, std::numeric_limits<double>::infinity()}) {
    BindingOptions options;
    options.heat.heat = heat;
    EXPECT_EQ(refused(SkinBinding::kHeat, options).rfind("heat: must be a finite number above 0", 0), 0u);
  }
  for (const int resolution : {2, 3, 512}) {
    const SkinWeights skin = bound(SkinBinding::kGeodesicVoxels, body, coarse(resolution));
    expect_sound(skin, body);
  }
}

}  // namespace

}  // namespace anigen::rigging
