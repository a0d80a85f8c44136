#include <gtest/gtest.h>
#include <cmath>
#include <functional>

#include "anigen/asset/rigged_asset.h"
#include "anigen/core/error.h"
#include "tests/asset/small_rig.h"

namespace anigen {

namespace {

TEST(SkinVertices, BindPoseGivesTheMesh) {
  const Asset asset = test::small_rig();
  const std::vector<Eigen::Vector3f> posed = skin_vertices(asset, asset.skeleton.bind);
  for (std::size_t v = 0; v < posed.size(); ++v) EXPECT_LT((posed[v] - asset.mesh.vertices[v]).norm(), 1e-6f);
}

TEST(SkinVertices, BlendsTheJointsMotions) {
  const Asset asset = test::small_rig();
  Pose pose = asset.skeleton.rest;
  pose[1].translation += Eigen::Vector3d(0, 0, 1);  // moves joint 1 and its child by (0, 0, 1)
  const std::vector<Eigen::Vector3f> posed = skin_vertices(asset, pose);
  const float expected[] = {0.0f, 0.5f, 0.75f, 1.0f};  // weight on joints 1 and 2
  for (std::size_t v = 0; v < posed.size(); ++v)
    EXPECT_NEAR(posed[v].z() - asset.mesh.vertices[v].z(), expected[v], 1e-6);
}

TEST(Normalize, FitsTheUnitBoxAndCommutesWithPosing) {
  const Asset original = test::small_rig();
  Asset asset = original;
  const Similarity applied = normalize(asset);
  const Box box = bounding_box(asset.mesh.vertices);
  EXPECT_NEAR(box.longest_side(), 1.0, 1e-6);
  EXPECT_LT(box.center().norm(), 1e-6);
  for (const double t : {0.0, 0.4, 1.3}) {
    const auto before = skin_vertices(original, sample(original.animations[0], original.skeleton, t));
    const auto after = skin_vertices(asset, sample(asset.animations[0], asset.skeleton, t));
    for (std::size_t v = 0; v < before.size(); ++v) {
      const Eigen::Vector3d expected = applied.scale * before[v].cast<double>() + applied.offset;
      EXPECT_LT((after[v].cast<double>() - expected).norm(), 1e-6);
    }
  }
}

TEST(Normalize, RefusesWhatHasNoExtent) {
  Asset asset = test::small_rig();
  for (Eigen::Vector3f& v : asset.mesh.vertices) v.setZero();
  EXPECT_THROW(normalize(asset), InputError);
  asset.mesh.vertices.clear();
  EXPECT_THROW(normalize(asset), InputError);
}

}  // namespace

namespace {

TEST(Validate, SoundAssetHasNoFindings) { EXPECT_TRUE(validate(test::small_rig()).empty()); }

TEST(Validate, PartsMayBeMissingWhereNoRigIsRequired) {
  const auto findings = [](const std::function<void(Asset&)>& change) {
    Asset asset = test::small_rig();
    change(asset);
    return validate(asset, 3, false);
  };
  const auto no_rig = [](Asset& a) {
    a.skeleton = {};
    a.skin = {};
    a.animations.clear();
  };
  const auto no_mesh = [](Asset& a) {
    a.mesh = {};
    a.skin = {};
  };
  EXPECT_TRUE(findings([](Asset&) {}).empty());
  EXPECT_TRUE(findings(no_rig).empty());
  EXPECT_TRUE(findings(no_mesh).empty());
  EXPECT_TRUE(findings([](Asset& a) { a.skin = {}; }).empty());
  EXPECT_TRUE(findings([&](Asset& a) {
                no_rig(a);
                a.mesh.faces.clear();
              }).empty())
      << "points";
  EXPECT_FALSE(findings([](Asset& a) { a = {}; }).empty()) << "neither mesh nor skeleton";
  EXPECT_FALSE(findings([](Asset& a) { a.skeleton = {}; }).empty()) << "weights for no joint";
  EXPECT_FALSE(findings([](Asset& a) { a.mesh.vertices.clear(); }).empty()) << "faces without vertices";
  EXPECT_FALSE(findings([&](Asset& a) {
                 no_rig(a);
                 a.mesh.faces[0][0] = 9;
               }).empty());
  EXPECT_FALSE(findings([](Asset& a) { a.mesh.faces.clear(); }).empty()) << "a skin moves a surface";
}

struct Damage {
  const char* word;  // what the finding must mention
  std::function<void(Asset&)> apply;
};

TEST(Validate, NamesEveryKindOfDamage) {
  const float nan = std::nanf("");
  const Damage damages[] = {
      {"vertices[1]", [=](Asset& a) { a.mesh.vertices[1].x() = nan; }},
      {"faces[1]", [](Asset& a) { a.mesh.faces[1][2] = 4; }},
      {"faces[0]", [](Asset& a) { a.mesh.faces[0][0] = -1; }},
      {"no faces", [](Asset& a) { a.mesh.faces.clear(); }},
      {"no vertices", [](Asset& a) { a.mesh.vertices.clear(); }},
      {"uvs has 1",
       [](Asset& a) {
         a.mesh.uvs.resize(1, {0, 0});
       }},
      {"normals[0]", [](Asset& a) { a.mesh.normals.assign(4, Eigen::Vector3f(2, 0, 0)); }},
      {"face_materials[0]",
       [](Asset& a) {
         a.mesh.face_materials = {3, -1};
       }},
      {"materials[0]",
       [](Asset& a) {
         a.materials.resize(1);
         a.materials[0].image = 0;
       }},
      {"no joints", [](Asset& a) { a.skeleton = {}; }},
      {"parents[0]", [](Asset& a) { a.skeleton.parents[0] = 1; }},
      {"parents[1]", [](Asset& a) { a.skeleton.parents[1] = 2; }},
      {"parents[2]", [](Asset& a) { a.skeleton.parents[2] = -1; }},
      {"names[2]", [](Asset& a) { a.skeleton.names[2] = "root"; }},
      {"names[1]", [](Asset& a) { a.skeleton.names[1] = ""; }},
      {"bind[1]", [](Asset& a) { a.skeleton.bind[1].topLeftCorner<3, 3>().setZero(); }},
      {"bind[0]", [=](Asset& a) { a.skeleton.bind[0](0, 3) = nan; }},
      {"rest[2]", [](Asset& a) { a.skeleton.rest[2].rotation.coeffs() *= 2; }},
      {"joint 9", [](Asset& a) { a.skin.influences[0].joint = 9; }},
      {"sum to", [](Asset& a) { a.skin.influences[0].weight = 0.5f; }},
      {"twice", [](Asset& a) { a.skin.influences[2].joint = a.skin.influences[1].joint; }},
      {"offsets", [](Asset& a) { a.skin.offsets.back() += 1; }},
      {"skin offsets[2]", [](Asset& a) { a.skin.offsets[2] = 100; }},
      {"skin rows has",
       [](Asset& a) {
         a.mesh.vertices.push_back({0, 0, 0});
       }},
      {"moves joint 5", [](Asset& a) { a.animations[0].channels[0].joint = 5; }},
      {"no keys", [](Asset& a) { a.animations[0].channels[0].times.clear(); }},
      {"do not increase",
       [](Asset& a) {
         a.animations[0].channels[0].times = {1.0, 1.0};
       }},
      {"not finite", [=](Asset& a) { a.animations[0].channels[0].values[3] = nan; }},
  };
  for (const Damage& damage : damages) {
    Asset asset = test::small_rig();
    damage.apply(asset);
    std::string all;
    for (const std::string& finding : validate(asset)) all += finding + "\n";
    EXPECT_NE(all.find(damage.word), std::string::npos) << "expected '" << damage.word << "' in:\n" << all;
  }
}

TEST(Validate, CountsInsteadOfRepeating) {
  Asset asset = test::small_rig();
  for (Eigen::Vector3f& v : asset.mesh.vertices) v.setConstant(std::nanf(""));
  const std::vector<std::string> findings = validate(asset, 2);
  ASSERT_EQ(findings.size(), 3u);
  EXPECT_NE(findings.back().find("2 more"), std::string::npos);
}

}  // namespace

}  // namespace anigen
