#include "anigen/prepare/cleaning.h"

#include <gtest/gtest.h>

#include <cmath>
#include <set>

#include "anigen/asset/rigged_asset.h"
#include "anigen/creatures/body.h"
#include "anigen/prepare/prepare_source.h"
#include "anigen/prepare/sources.h"
#include "tests/prepare/augment_support.h"
#include "tests/support/paths.h"
#include "tests/support/rig_files.h"

namespace anigen::prepare {
namespace {

/// A column of four levels within the unit box on these joints; level v is bound to joint `bound[v]`.
Asset column(const std::vector<Eigen::Vector3d>& joints, const std::vector<int>& parents,
             const std::vector<int>& bound) {
  Asset asset;
  asset.name = "column";
  for (int v = 0; v < 4; ++v) {
    const float z = -0.5f + static_cast<float>(v) / 3;
    asset.mesh.vertices.emplace_back(-0.1f, 0.0f, z);
    asset.mesh.vertices.emplace_back(0.1f, 0.1f, z);
    for (int side = 0; side < 2; ++side) asset.skin.append_row({{bound[static_cast<std::size_t>(v)], 1.0f}});
    if (v > 0) {
      asset.mesh.faces.push_back({2 * v - 2, 2 * v - 1, 2 * v});
      asset.mesh.faces.push_back({2 * v - 1, 2 * v + 1, 2 * v});
    }
  }
  asset.skeleton = skeleton_from_joints(joints, parents);
  return asset;
}

/// Turns one joint about x by 90 degrees within a second.
Animation turning(int joint) {
  Channel channel;
  channel.joint = joint;
  channel.path = ChannelPath::kRotation;
  channel.times = {0.0, 1.0};
  const double half = std::sqrt(0.5);
  channel.values = {0, 0, 0, 1, half, 0, 0, half};
  return {"turn", {channel}};
}

std::string dropped_by(Asset asset, const CleaningOptions& options, const ReadQuality& quality = {}) {
  try {
    clean(asset, quality, options, "file.glb");
    return "";
  } catch (const CleanedOut& out) {
    EXPECT_EQ(out.file(), "file.glb");
    EXPECT_EQ(out.finding().action, "dropped");
    return out.finding().rule + ": " + out.finding().detail;
  }
}

const std::vector<Eigen::Vector3d> kChain = {{0, 0, -0.5}, {0, 0, 0}, {0, 0, 0.3}};

TEST(Cleaning, DoesNothingByDefault) {
  Asset asset = column({{0, 0, -0.5}, {0, 0, -0.5}, {5, 0, 0}, {6, 0, 0}}, {-1, 0, 0, 0}, {0, 0, 0, 0});
  const Asset before = asset;
  EXPECT_TRUE(clean(asset, {0.1, 5}, {}, "").empty());
  EXPECT_EQ(asset.skeleton.names, before.skeleton.names);
}

TEST(Cleaning, CountsAreBounded) {
  CleaningOptions options;
  options.vertices = {9, 100};
  const Asset asset = column(kChain, {-1, 0, 1}, {0, 0, 1, 2});
  EXPECT_EQ(dropped_by(asset, options), "vertex_count: 8 vertices, at least 9");
  options.vertices = {0, 7};
  EXPECT_EQ(dropped_by(asset, options), "vertex_count: 8 vertices, at most 7");
  options.vertices = {8, 8};
  EXPECT_EQ(dropped_by(asset, options), "");
  options.joints = {4, 9};
  EXPECT_EQ(dropped_by(asset, options), "joint_count: 3 joints, at least 4");
}

TEST(Cleaning, SkeletonsOutsideTheMeshAreDropped) {
  CleaningOptions options;
  options.max_outside_share = 0.5;
  Asset asset = tube(3);  // 0.16 wide, along x from -0.5 to 0.5
  const auto with_joints = [&](const std::vector<Eigen::Vector3d>& joints) {
    asset.skeleton = skeleton_from_joints(joints, {-1, 0, 1});
    return asset;
  };
  EXPECT_EQ(dropped_by(with_joints({{0, 0, 0}, {3, 0, 0}, {4, 0, 0}}), options),
            "outside_mesh: 66.7 % of the joints lie outside the mesh, at most 50 %");
  EXPECT_EQ(dropped_by(with_joints({{0, 0, 0}, {3, 0, 0}, {0.2, 0, 0}}), options), "");
  EXPECT_EQ(outside_share({{0, 0, 0.08}, {0.5, 0, 0}}, asset.mesh), 0.0) << "on the surface is inside";
  // In the bounding box of a bent body, but not in it.
  for (Eigen::Vector3f& vertex : asset.mesh.vertices) vertex.z() += 4.0f * vertex.x() * vertex.x();
  EXPECT_EQ(outside_share({{0, 0, 0}, {0, 0, 0.5}, {0, 0, 0.9}, {0.25, 0, 0.25}}, asset.mesh), 0.5);
  Mesh cloth;
  cloth.vertices = {{0, 0, 0}, {1, 0, 0.1F}, {1, 1, 0}, {0, 1, 0.1F}};
  cloth.faces = {{0, 1, 2}, {0, 2, 3}};
  EXPECT_EQ(outside_share({{0.5, 0.5, 0.09}, {0.5, 0.5, 2}}, cloth), 0.5) << "a sheet has a box, but no inside";
}

TEST(Cleaning, WeightSumsAndNamesAreThoseOfTheFile) {
  CleaningOptions options;
  options.least_weight_sum = 0.9;
  const Asset asset = column(kChain, {-1, 0, 1}, {0, 0, 1, 2});
  EXPECT_EQ(dropped_by(asset, options, {0.85, 0}), "low_weight_sum: the weights of a vertex sum to 0.85, at least 0.9");
  EXPECT_EQ(dropped_by(asset, options, {0.9, 0}), "");
  options.drop_duplicate_names = true;
  EXPECT_EQ(dropped_by(asset, options, {1.0, 2}), "duplicate_joint_names: 2 joints have a name that another joint has");
}

TEST(Cleaning, DuplicateJointsMergeIntoTheFirst) {
  // 1 and 3 lie on 0 and 2; 4 hangs on 3.
  Asset asset =
      column({{0, 0, -0.5}, {0, 0, -0.499}, {0, 0, 0}, {0, 0, 0.001}, {0, 0, 0.3}}, {-1, 0, 1, 2, 3}, {1, 2, 3, 4});
  CleaningOptions options;
  options.duplicate_joints = DuplicateJoints::kMerge;
  options.merge_distance = 0.0025;
  const std::vector<CleaningFinding> findings = clean(asset, {}, options, "");
  ASSERT_EQ(findings.size(), 1u);
  EXPECT_EQ(findings[0].rule, "duplicate_joints");
  EXPECT_EQ(findings[0].action, "changed");
  EXPECT_EQ(findings[0].detail, "2 joints merged: joint_1 into joint_0, joint_3 into joint_2");
  EXPECT_TRUE(validate(asset).empty());
  EXPECT_EQ(asset.skeleton.names, (std::vector<std::string>{"joint_0", "joint_2", "joint_4"}));
  EXPECT_EQ(asset.skeleton.parents, (std::vector<int>{-1, 0, 1}));
  for (std::size_t level = 0; level < 4; ++level)
    EXPECT_EQ(asset.skin.row(2 * level)->joint, (std::vector<int>{0, 1, 1, 2})[level]);
  CleaningCounts counts;
  count(findings, counts);
  EXPECT_EQ(counts["duplicate_joints"]["changed"], 1u);
}

TEST(Cleaning, UnusedJointsArePruned) {
  const std::vector<Eigen::Vector3d> joints = {{0, 0, -0.5}, {0, 0, -0.2}, {0, 0, 0.1}, {0.05, 0, 0.2}, {0, 0, 0.3}};
  const Asset asset = column(joints, {-1, 0, 1, 2, 3}, {0, 2, 2, 2});  // 1 is used by nothing but its child; 3, 4 end
  CleaningOptions options;
  options.unused_joints = UnusedJoints::kPruneLeaves;
  Asset leaves = asset;
  EXPECT_EQ(clean(leaves, {}, options, "").at(0).detail, "2 joints without weights pruned: joint_3, joint_4");
  EXPECT_EQ(leaves.skeleton.parents, (std::vector<int>{-1, 0, 1}));
  options.unused_joints = UnusedJoints::kPruneAll;
  Asset all = asset;
  clean(all, {}, options, "");
  EXPECT_TRUE(validate(all).empty());
  EXPECT_EQ(all.skeleton.names, (std::vector<std::string>{"joint_0", "joint_2"}));
  EXPECT_EQ(all.skeleton.positions()[1], joints[2]);
}

TEST(Cleaning, AnUnusedRootLeavesTheTopNearestToTheMean) {
  Asset asset = column({{0, 0, 0}, {0.4, 0, 0}, {0.1, 0, 0}, {-0.3, 0, 0}}, {-1, 0, 0, 0}, {1, 2, 3, 3});
  CleaningOptions options;
  options.unused_joints = UnusedJoints::kPruneAll;
  clean(asset, {}, options, "");
  EXPECT_TRUE(validate(asset).empty());
  EXPECT_EQ(asset.skeleton.names, (std::vector<std::string>{"joint_2", "joint_1", "joint_3"}));
  EXPECT_EQ(asset.skeleton.parents, (std::vector<int>{-1, 0, 0}));
}

TEST(Cleaning, CoarserRigsKeepTheRootAndTheLongestBones) {
  // A chain with a short bone in its middle and a helper without weights at its end.
  const std::vector<Eigen::Vector3d> joints = {{0, 0, -0.5}, {0, 0, -0.1}, {0, 0, -0.05}, {0, 0, 0.2}, {0.4, 0, 0.2}};
  const Asset asset = column(joints, {-1, 0, 1, 2, 3}, {0, 1, 2, 3});
  const std::vector<char> weighted = weighted_joints(asset);
  EXPECT_EQ(coarser_heirs(asset.skeleton, weighted, 9), (std::vector<int>{0, 1, 2, 3, 4}));
  EXPECT_EQ(coarser_heirs(asset.skeleton, weighted, 4), (std::vector<int>{0, 1, 2, 3, 3})) << "the helper goes first";
  EXPECT_EQ(coarser_heirs(asset.skeleton, weighted, 3), (std::vector<int>{0, 1, 1, 3, 3})) << "then the short bone";
  EXPECT_EQ(coarser_heirs(asset.skeleton, weighted, 2), (std::vector<int>{0, 1, 1, 1, 1}))
      << "3 lies nearer to 1, which it hangs on now, than 1 to the root";
  EXPECT_EQ(coarser_heirs(asset.skeleton, weighted, 0), (std::vector<int>{0, 0, 0, 0, 0}));
}

TEST(Cleaning, ShareOfJointsIsDrawnForTheName) {
  const Asset asset = creatures::make_creature("snake", 1, 3);
  std::set<std::size_t> counts;
  for (int i = 0; i < 12; ++i) {
    const std::string name = "procedural/1/" + std::to_string(i);
    Asset coarse = asset, again = asset;
    const auto finding = coarsen_skeleton(coarse, {0.3, 1.0}, name);
    coarsen_skeleton(again, {0.3, 1.0}, name);
    EXPECT_EQ(coarse.skeleton.names, again.skeleton.names);
    EXPECT_TRUE(validate(coarse).empty());
    EXPECT_EQ(finding.has_value(), coarse.skeleton.size() < asset.skeleton.size());
    EXPECT_GE(coarse.skeleton.size(), static_cast<std::size_t>(0.3 * static_cast<double>(asset.skeleton.size())));
    counts.insert(coarse.skeleton.size());
  }
  EXPECT_GE(counts.size(), 5u);
  Asset two = column(kChain, {-1, 0, 1}, {0, 0, 1, 2});
  EXPECT_EQ(coarsen_skeleton(two, {0.1, 0.1}, "x")->detail, "2 of 3 joints kept");
  EXPECT_FALSE(coarsen_skeleton(two, {1.0, 1.0}, "x").has_value());
}

TEST(ImportAsset, CreaturesGetCoarserRigsToo) {
  const AssetSource source = procedural_sources(5, 1).front();
  CleaningOptions options;
  options.kept_joints = {0.4, 0.4};
  const Asset whole = import_asset(source).asset;
  const PreparedAsset coarse = import_asset(source, options, io::RigReader());
  EXPECT_EQ(coarse.asset.skeleton.size(),
            static_cast<std::size_t>(std::lround(0.4 * static_cast<double>(whole.skeleton.size()))));
  EXPECT_EQ(coarse.asset.mesh.vertices.size(), whole.mesh.vertices.size());
  ASSERT_EQ(coarse.record.findings.size(), 1u);
  EXPECT_EQ(coarse.record.findings[0].rule, "kept_joints");
}

TEST(Cleaning, WhatStaysMovesAsBefore) {
  // Joint 1 carries no weights but turns; 2 follows it, and 3 follows a root that moves, too.
  const std::vector<Eigen::Vector3d> joints = {{0, 0, -0.5}, {0, 0, 0}, {0, 0.1, 0.3}, {0.1, 0, -0.2}};
  Asset asset = column(joints, {-1, 0, 1, 0}, {0, 3, 2, 2});
  asset.animations = {turning(1)};
  Animation both = turning(1);
  both.channels.push_back(turning(0).channels[0]);
  asset.animations.push_back(both);
  Asset pruned = asset;
  CleaningOptions options;
  options.unused_joints = UnusedJoints::kPruneAll;
  clean(pruned, {}, options, "");
  EXPECT_TRUE(validate(pruned).empty());
  ASSERT_EQ(pruned.skeleton.size(), 3u);
  ASSERT_EQ(pruned.animations.size(), 2u);
  for (std::size_t a = 0; a < 2; ++a) {
    for (const double time : {0.0, 1.0}) {
      const auto before = skin_vertices(asset, sample(asset.animations[a], asset.skeleton, time));
      const auto after = skin_vertices(pruned, sample(pruned.animations[a], pruned.skeleton, time));
      for (std::size_t v = 0; v < before.size(); ++v) EXPECT_LT((before[v] - after[v]).norm(), 1e-5) << a << time << v;
    }
  }
}

TEST(Cleaning, HeirsMustStay) {
  Asset asset = column(kChain, {-1, 0, 1}, {0, 0, 1, 2});
  EXPECT_THROW(remove_joints(asset, {-1, -1, -1}), Error);
  EXPECT_THROW(remove_joints(asset, {0, 0}), Error);
  EXPECT_THROW(remove_joints(asset, {0, 2, 2}), Error) << "an heir comes before";
  EXPECT_THROW(remove_joints(asset, {-1, 1, 2}), Error) << "joint 0 has weights";
  EXPECT_EQ(weighted_joints(asset), (std::vector<char>{1, 1, 1}));
}

TEST(CleaningOptions, PresetsSurviveJsonAndAreChecked) {
  for (const std::string name : {"none", "anymate", "articulation-xl"}) {
    const Json json = cleaning_preset(name).to_json();
    EXPECT_EQ(CleaningOptions::from_json(json).to_json(), json) << name;
  }
  EXPECT_EQ(cleaning_preset("anymate").vertices.least, 129u);
  EXPECT_EQ(cleaning_preset("anymate").joints.most, 63u);
  EXPECT_THROW(cleaning_preset("anigen"), InputError);
  EXPECT_THROW(CleaningOptions::from_json({{"vertice", 3}}), InputError);
  EXPECT_THROW(CleaningOptions::from_json({{"vertices", {3, 2}}}), InputError);
  EXPECT_THROW(CleaningOptions::from_json({{"vertices", {-3, 2}}}), InputError);
  EXPECT_THROW(CleaningOptions::from_json({{"unused_joints", "burn"}}), InputError);
  EXPECT_THROW(CleaningOptions::from_json({{"max_outside_share", 1.5}}), InputError);
  EXPECT_THROW(CleaningOptions::from_json({{"drop_duplicate_names", 1}}), InputError);
  EXPECT_THROW(CleaningOptions::from_json({{"kept_joints", 0.5}}), InputError);
  EXPECT_THROW(CleaningOptions::from_json({{"kept_joints", {0.0, 1.0}}}), InputError);
  EXPECT_THROW(CleaningOptions::from_json({{"kept_joints", {0.5, 1.5}}}), InputError);
  EXPECT_EQ(CleaningOptions::from_json(parse_json("{\"joints\": [4, null]}", "memory")).joints.least, 4u);
}

TEST(Quality, FlagsFollowTheRecord) {
  AssetRecord record;
  record.num_joints = 10;
  record.num_vertices = 100;
  record.closest_bones = 1;
  EXPECT_TRUE(usable(record, {}));
  EXPECT_FALSE(bad_skin(record, {}));
  record.outside_share = 0.71;
  EXPECT_FALSE(usable(record, {}));
  record.lowest_weight_sum = 0.89;
  EXPECT_TRUE(bad_skin(record, {}));
}

TEST(ImportAsset, CleansWhatItReads) {
  const test::TemporaryFolder folder;
  test::RigFile rig;
  for (std::size_t v = 0; v < 6; ++v) {  // nothing on the last joint
    rig.skin[3 * v + 1] += rig.skin[3 * v + 2];
    rig.skin[3 * v + 2] = 0;
  }
  rig.skin[0] = 0.5f;
  test::write_rig_npz(folder / "in/a.npz", rig);
  const AssetSource source = find_assets({folder / "in"}).at(0);
  CleaningOptions options;
  options.unused_joints = UnusedJoints::kPruneLeaves;
  const PreparedAsset prepared = import_asset(source, options, io::RigReader());
  EXPECT_EQ(prepared.record.num_joints, 2u);
  EXPECT_EQ(prepared.record.findings.size(), 1u);
  EXPECT_NEAR(prepared.record.lowest_weight_sum, 0.5, 1e-6);
  EXPECT_TRUE(bad_skin(prepared.record, {}));
  options.least_weight_sum = 0.9;
  EXPECT_THROW(import_asset(source, options, io::RigReader()), CleanedOut);
}

}  // namespace
}  // namespace anigen::prepare
