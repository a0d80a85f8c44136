#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <limits>
#include <set>

#include "anigen/asset/normalize.h"
#include "anigen/asset/skinning.h"
#include "anigen/asset/validate.h"
#include "anigen/core/error.h"
#include "anigen/core/parallel.h"
#include "anigen/io/gltf.h"
#include "anigen/prepare/augment/own_motion.h"
#include "anigen/prepare/augment/pose_augmentation.h"
#include "anigen/prepare/augment/random_pose.h"
#include "anigen/prepare/creatures/creature.h"
#include "tests/prepare/augment_support.h"
#include "tests/support/paths.h"

namespace anigen::prepare {
namespace {

using Eigen::Vector3d;
using Eigen::Vector3f;

TEST(PoseAugmentation, RandomVariantKeepsBonesWeightsAndFaces) {
  Asset asset = tube(5);
  Provenance provenance;
  const std::optional<Asset> variant = posed_variant(asset, "tube", 7, 0, PoseAugmentation(), provenance);
  ASSERT_TRUE(variant.has_value());
  EXPECT_TRUE(validate(*variant).empty());
  EXPECT_EQ(provenance.kind, PoseKind::kRandom);
  EXPECT_GT(provenance.turned, 0u);
  EXPECT_LE(provenance.largest_angle, 60.0);
  const Box box = bounding_box(variant->mesh.vertices);
  EXPECT_NEAR(box.longest_side(), 1.0, 1e-6);
  EXPECT_LT(box.center().norm(), 1e-6);
  EXPECT_EQ(variant->mesh.faces, asset.mesh.faces);
  EXPECT_EQ(variant->skin.offsets, asset.skin.offsets);
  EXPECT_EQ(0, std::memcmp(variant->skin.influences.data(), asset.skin.influences.data(),
                           asset.skin.influences.size() * sizeof(Influence)));
  const std::vector<Vector3d> before = asset.skeleton.positions(), after = variant->skeleton.positions();
  for (std::size_t j = 1; j < before.size(); ++j) {
    EXPECT_NEAR((after[j] - after[j - 1]).norm(), provenance.renormalization.scale * (before[j] - before[j - 1]).norm(),
                1e-9);
  }
  // The new pose is the bind pose and the rest pose: skinning with the rest pose moves nothing.
  const std::vector<Vector3f> rest = skin_vertices(*variant, variant->skeleton.rest);
  for (std::size_t v = 0; v < rest.size(); ++v) EXPECT_LT((rest[v] - variant->mesh.vertices[v]).norm(), 1e-6f);
}

TEST(PoseAugmentation, DependsOnSeedIdAndKAloneAndNotOnThreads) {
  const Asset asset = tube(5);
  Provenance provenance;
  const auto make = [&](const char* id, std::uint64_t seed, std::size_t k) {
    return posed_variant(asset, id, seed, k, anything(), provenance).value();
  };
  const Asset first = make("a", 1, 0);
  EXPECT_TRUE(equal(first, make("a", 1, 0)));
  EXPECT_FALSE(equal(first, make("a", 1, 1)));
  EXPECT_FALSE(equal(first, make("a", 2, 0)));
  EXPECT_FALSE(equal(first, make("b", 1, 0)));

  const PoseAugmenter augmenter(asset, "a", 1, anything());
  std::vector<std::optional<Asset>> variants(8);
  std::vector<Provenance> provenances(8);
  const int threads = thread_count();
  set_thread_count(4);
  parallel_for(8, [&](std::size_t i) { variants[i] = augmenter.variant(7 - i, provenances[i]); });
  set_thread_count(threads);
  for (std::size_t i = 0; i < 8; ++i) EXPECT_TRUE(equal(variants[i].value(), make("a", 1, 7 - i))) << i;
}

TEST(PoseAugmentation, LeavesTheRootAloneWhenAsked) {
  PoseAugmentation options = anything();
  options.include_root = false;
  options.probability = 1.0;
  Provenance provenance;
  const Asset asset = tube(4);
  const Asset variant = posed_variant(asset, "a", 1, 0, options, provenance).value();
  EXPECT_EQ(provenance.turned, 3u);
  EXPECT_LT((variant.skeleton.bind[0].topLeftCorner<3, 3>() - Eigen::Matrix3d::Identity()).norm(), 1e-12);
  options.include_root = true;
  const Asset turned = posed_variant(asset, "a", 1, 0, options, provenance).value();
  EXPECT_EQ(provenance.turned, 4u);
  EXPECT_GT((turned.skeleton.bind[0].topLeftCorner<3, 3>() - Eigen::Matrix3d::Identity()).norm(), 1e-3);
}

TEST(PoseAugmentation, OneJointTurnsTheWholeObjectOrNothing) {
  const Asset asset = tube(1);
  Provenance provenance;
  const Asset variant = posed_variant(asset, "a", 1, 0, PoseAugmentation(), provenance).value();
  EXPECT_TRUE(validate(variant).empty());
  EXPECT_EQ(provenance.turned, 1u);
  EXPECT_NEAR(provenance.measures.area_ratio, 1.0, 1e-5);
  ASSERT_TRUE(provenance.measures.volume_ratio.has_value());
  EXPECT_NEAR(*provenance.measures.volume_ratio, 1.0, 1e-5);

  PoseAugmentation options;
  options.include_root = false;  // nothing left that could turn
  EXPECT_FALSE(posed_variant(asset, "a", 1, 0, options, provenance).has_value());
  ASSERT_EQ(provenance.rejections.size(), static_cast<std::size_t>(options.attempts));
  EXPECT_NE(provenance.rejections[0].find("unchanged"), std::string::npos) << provenance.rejections[0];
}

TEST(PoseAugmentation, OwnMotionStaysWithinTheClipAndSpreadsOverIt) {
  Asset asset = tube(3);
  asset.animations = {swing(80.0)};
  PoseAugmentation options = anything();
  const PoseAugmenter augmenter(asset, "a", 1, options);
  std::vector<double> times;
  bool blended = false;
  for (std::size_t k = 0; k < 13; ++k) {
    Provenance provenance;
    const Asset variant = augmenter.variant(k, provenance).value();
    EXPECT_EQ(provenance.kind, PoseKind::kAnimation);
    EXPECT_EQ(provenance.clip, "swing");
    EXPECT_TRUE(variant.animations.empty());
    EXPECT_TRUE(validate(variant).empty());
    // The swing is uniform in time, and a blend moves linearly along its arc.
    const double at = provenance.time + provenance.blend * (provenance.second_time - provenance.time);
    EXPECT_NEAR(swing_angle(variant), 40.0 * at, 1e-6);
    blended |= provenance.blend > 0.0;
    EXPECT_LT(provenance.blend, 0.5);
    times.push_back(provenance.time);
  }
  EXPECT_TRUE(blended);
  // 13 is a Fibonacci number, for which multiples of the golden ratio leave gaps of 1/13 · (1 ± 0.45) or so at most.
  std::sort(times.begin(), times.end());
  double widest = times.front() + 2.0 - times.back();  // around the end
  for (std::size_t i = 1; i < times.size(); ++i) widest = std::max(widest, times[i] - times[i - 1]);
  EXPECT_LT(widest, 1.5 * 2.0 / 13.0);
}

TEST(PoseAugmentation, EqualStepsAreEqualMovement) {
  // Still for 9 seconds, then a swing of one second: the poses come from the swing.
  Asset asset = tube(3);
  asset.animations = {swing(80.0)};
  Channel& channel = asset.animations[0].channels[0];
  channel.times = {0.0, 9.0, 10.0};
  channel.values.insert(channel.values.begin(), {0, 0, 0, 1});
  PoseAugmentation options = anything();
  options.blend_probability = 0.0;
  const PoseAugmenter augmenter(asset, "a", 1, options);
  for (std::size_t k = 0; k < 8; ++k) {
    Provenance provenance;
    ASSERT_TRUE(augmenter.variant(k, provenance).has_value());
    EXPECT_GT(provenance.time, 8.7);  // the clip is looked at in steps of 10/32 s
    EXPECT_EQ(provenance.second_time, provenance.time);
  }
}

TEST(PoseAugmentation, ClipsThatCannotBeUsedAreNamedAndPosesTurnRandom) {
  Asset asset = tube(3);
  Animation still = swing(0.0), point = swing(80.0), broken = swing(80.0), missing = swing(80.0), whole = swing(0.0);
  still.name = "still";
  point.name = "no length";
  point.channels[0].times = {0.5};
  point.channels[0].values.resize(4);
  broken.name = "broken";
  broken.channels[0].values[5] = std::numeric_limits<double>::quiet_NaN();
  missing.name = "missing";
  missing.channels[0].joint = 9;
  whole.name = "carried";  // the object as a whole goes somewhere
  whole.channels.push_back({0, ChannelPath::kTranslation, Interpolation::kLinear, {0, 1}, {0, 0, 0, 5, 5, 5}});
  Animation disorder = swing(80.0);
  disorder.name = "disorder";
  disorder.channels[0].times = {1.0, 1.0};
  asset.animations = {still, point, broken, missing, whole, disorder};
  Provenance provenance;
  const std::optional<Asset> variant = posed_variant(asset, "a", 1, 0, PoseAugmentation(), provenance);
  ASSERT_TRUE(variant.has_value());
  EXPECT_TRUE(validate(*variant).empty());
  EXPECT_EQ(provenance.kind, PoseKind::kRandom);
  const std::vector<std::string> expected{
      "still: it does not move the mesh",   "no length: it has no length",
      "broken: a key is not finite",        "missing: it moves a joint that is missing",
      "carried: it does not move the mesh", "disorder: key times do not increase"};
  EXPECT_EQ(provenance.unused_clips, expected);
  PoseAugmentation never;
  never.own_motion = false;
  asset.animations.push_back(swing(80.0));
  ASSERT_TRUE(posed_variant(asset, "a", 1, 0, never, provenance).has_value());
  EXPECT_EQ(provenance.kind, PoseKind::kRandom);
}

TEST(PoseAugmentation, AnimationsMayPlayAtAnotherSize) {
  // The skin is bound at size 1 and played at a hundredth: normalised again, that is the same motion.
  Asset asset = tube(3);
  asset.animations = {swing(80.0)};
  asset.animations[0].channels.push_back({0, ChannelPath::kScale, Interpolation::kLinear, {0.0}, {0.01, 0.01, 0.01}});
  Provenance provenance;
  const std::optional<Asset> variant = posed_variant(asset, "a", 1, 0, PoseAugmentation(), provenance);
  ASSERT_TRUE(variant.has_value());
  EXPECT_EQ(provenance.kind, PoseKind::kAnimation);
  EXPECT_TRUE(provenance.rejections.empty());
  EXPECT_NEAR(provenance.measures.scale, 0.01, 1e-4);
  EXPECT_NEAR(bounding_box(variant->mesh.vertices).longest_side(), 1.0, 1e-6);
  EXPECT_TRUE(validate(*variant).empty());
}

TEST(PoseAugmentation, AnimationThatHidesTheMeshFallsBackToRandomPoses) {
  Asset asset = tube(3);
  Animation hide = swing(60.0);
  hide.channels.push_back({0, ChannelPath::kScale, Interpolation::kLinear, {0, 1e-3}, {1, 1, 1, 0, 0, 0}});
  asset.animations = {hide};
  PoseAugmentation options;
  Provenance provenance;
  ASSERT_TRUE(posed_variant(asset, "a", 1, 0, options, provenance).has_value());
  EXPECT_EQ(provenance.kind, PoseKind::kRandom);
  EXPECT_EQ(provenance.attempt, static_cast<int>(provenance.rejections.size()));
  ASSERT_GE(provenance.rejections.size(), static_cast<std::size_t>(options.attempts));
  EXPECT_EQ(provenance.rejections[0].rfind("animation: ", 0), 0u) << provenance.rejections[0];
}

TEST(PoseAugmentation, RefusesBadOptionsAndBrokenAssets) {
  const Asset asset = tube(3);
  const auto refuses = [&](auto change) {
    PoseAugmentation options;
    change(options);
    EXPECT_THROW(PoseAugmenter(asset, "a", 0, options), InputError);
  };
  refuses([](PoseAugmentation& o) { o.probability = 1.5; });
  refuses([](PoseAugmentation& o) { o.probability = NAN; });
  refuses([](PoseAugmentation& o) { o.max_angle = -1.0; });
  refuses([](PoseAugmentation& o) { o.max_angle = 200.0; });
  refuses([](PoseAugmentation& o) { o.attempts = 0; });
  refuses([](PoseAugmentation& o) { o.limits.most_buried = NAN; });
  const auto refuses_asset = [&](auto change) {
    Asset bad = asset;
    change(bad);
    EXPECT_THROW(PoseAugmenter(bad, "a", 0), InputError);
  };
  refuses_asset([](Asset& a) { a.mesh.vertices[3].x() = NAN; });
  refuses_asset([](Asset& a) { a.mesh.faces[0][1] = 1000; });
  refuses_asset([](Asset& a) { a.mesh.faces.clear(); });
  refuses_asset([](Asset& a) { a.skeleton.parents[1] = 2; });
  refuses_asset([](Asset& a) { a.skin.influences[0].joint = 70; });
  refuses_asset([](Asset& a) {
    for (Vector3f& vertex : a.mesh.vertices) vertex.setZero();
  });
}

TEST(PoseAugmentation, ProvenanceTellsEverything) {
  Asset asset = tube(3);
  asset.animations = {swing(80.0)};
  Provenance provenance;
  ASSERT_TRUE(posed_variant(asset, "some id", 12, 3, PoseAugmentation(), provenance).has_value());
  const Json json = to_json(provenance);
  EXPECT_EQ(json.at("source"), "some id");
  EXPECT_EQ(json.at("seed"), 12);
  EXPECT_EQ(json.at("k"), 3);
  EXPECT_EQ(json.at("kind"), "animation");
  EXPECT_EQ(json.at("clip"), "swing");
  EXPECT_EQ(json.at("turned_joints"), 1);
  EXPECT_EQ(json.at("measures").at("finite"), true);
  EXPECT_EQ(json.at("rejections").size(), provenance.rejections.size());

  PoseAugmentation options;
  const std::string id = variant_id("some id", 12, 3, options);
  EXPECT_EQ(id.size(), 64u);
  options.max_angle = 59.0;
  const std::set<std::string> ids{id, variant_id("some id", 12, 4, {}), variant_id("some id", 13, 3, {}),
                                  variant_id("other id", 12, 3, {}), variant_id("some id", 12, 3, options)};
  EXPECT_EQ(ids.size(), 5u);
}

TEST(PoseAugmentation, CreaturesGiveSoundVariants) {
  for (const char* family : {"biped", "spider", "snake", "tree"}) {
    const Asset asset = make_creature(family, 20, 3);
    for (const bool own_motion : {true, false}) {
      PoseAugmentation options;
      options.own_motion = own_motion;
      Provenance provenance;
      const std::optional<Asset> variant = posed_variant(asset, family, 1, 0, options, provenance);
      ASSERT_TRUE(variant.has_value()) << family << ": " << to_json(provenance).dump();
      EXPECT_TRUE(validate(*variant).empty()) << family;
      EXPECT_LE(bounding_box(variant->mesh.vertices).longest_side(), 1.0 + 1e-6);
    }
  }
}

TEST(PoseAugmentation, RealAssetsGiveSoundVariants) {
  const std::filesystem::path folder = test::assets_dir() / "rigged";
  if (!std::filesystem::exists(folder)) GTEST_SKIP() << "real assets are missing: " << folder;
  for (const char* file : {"quadruped/khronos_fox.glb", "humanoid/cesium_man.gltf", "arthropod/q_spider.glb",
                           "fish/dcl_shark.glb", "synthetic/godot_unnormalised.glb"}) {
    Asset asset = io::read_gltf(folder / file).asset;
    normalize(asset);
    const PoseAugmenter augmenter(asset, file, 4);
    std::size_t made = 0;
    for (std::size_t k = 0; k < 2; ++k) {
      Provenance provenance;
      const std::optional<Asset> variant = augmenter.variant(k, provenance);
      if (!variant) {
        EXPECT_FALSE(provenance.rejections.empty());
        continue;
      }
      ++made;
      EXPECT_TRUE(validate(*variant).empty()) << file << ": " << validate(*variant).front();
      EXPECT_EQ(variant->mesh.faces, asset.mesh.faces);
      const std::vector<Vector3f> rest = skin_vertices(*variant, variant->skeleton.rest);
      for (std::size_t v = 0; v < rest.size(); ++v) {
        ASSERT_LT((rest[v] - variant->mesh.vertices[v]).norm(), 1e-4f) << file;
      }
    }
    EXPECT_GT(made, 0u) << file;
  }
}

}  // namespace
}  // namespace anigen::prepare
