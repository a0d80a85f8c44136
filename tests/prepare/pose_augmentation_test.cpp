#include <gtest/gtest.h>
#include <Eigen/Geometry>
#include <cmath>
#include <cstring>
#include <limits>
#include <set>
#include <string>
#include <utility>

#include "anigen/asset/rigged_asset.h"
#include "anigen/core/error.h"
#include "anigen/core/parallel.h"
#include "anigen/creatures/body.h"
#include "anigen/io/gltf/gltf.h"
#include "anigen/prepare/pose_augmentation.h"
#include "anigen/prepare/poses.h"
#include "tests/prepare/augment_support.h"
#include "tests/support/paths.h"

namespace anigen::prepare {

namespace {

using Eigen::Vector3d;
using Eigen::Vector3f;

TEST(PoseChecks, TellCollapseFromPosing) {
  const Asset asset = tube(5);
  const PoseChecks checks(asset.mesh);
  const PoseLimits limits;
  const auto problem = [&](const auto& move) {
    std::vector<Vector3f> vertices = asset.mesh.vertices;
    for (Vector3f& vertex : vertices) vertex = move(vertex);
    return broken_limit(checks.measure(vertices), limits);
  };
  const auto starts = [](const std::string& text, const char* word) { return text.rfind(word, 0) == 0; };
  EXPECT_TRUE(starts(problem([](Vector3f v) { return v; }), "unchanged"));
  EXPECT_TRUE(starts(problem([](Vector3f v) { return Vector3f(v + Vector3f(2, 0, 0)); }), "unchanged"));
  // A gentle bend passes.
  EXPECT_EQ(problem([](Vector3f v) { return Vector3f(v.x(), v.y() + v.x() * v.x(), v.z()); }), "");
  EXPECT_TRUE(starts(problem([](Vector3f v) { return Vector3f(v * NAN); }), "not finite"));
  EXPECT_TRUE(starts(problem([](Vector3f v) { return Vector3f(v * 1e4f); }), "not finite"));
  // The size of the whole does not matter, since variants are normalised; its shape does.
  EXPECT_TRUE(starts(problem([](Vector3f v) { return Vector3f(v * 0.1f); }), "unchanged"));
  EXPECT_EQ(problem([](Vector3f v) { return Vector3f(0.1f * v.x(), 0.1f * (v.y() + v.x() * v.x()), 0.1f * v.z()); }),
            "");
  EXPECT_TRUE(starts(problem([](Vector3f) { return Vector3f(1, 2, 3); }), "vanished"));
  EXPECT_TRUE(
      starts(problem([](Vector3f v) { return Vector3f(v.x(), 1e-3f * v.y(), 1e-3f * v.z()); }), "bounding box"));
  const auto thin_half = [](Vector3f v) {
    const float factor = v.x() > 0.05f ? 0.1f : 1.0f;
    return Vector3f(v.x(), factor * v.y(), factor * v.z());
  };
  EXPECT_TRUE(starts(problem(thin_half), "surface"));
  EXPECT_TRUE(starts(problem([](Vector3f v) { return Vector3f(v.x(), 0.5f * v.y(), v.z() * 0.5f); }), "volume"));
  EXPECT_TRUE(starts(problem([](Vector3f v) { return Vector3f(v.x(), v.y(), -v.z()); }), "volume"));
  // One vertex far off pulls a few triangles after it.
  std::vector<Vector3f> torn = asset.mesh.vertices;
  torn[20].z() += 0.6f;
  EXPECT_GT(checks.measure(torn).stretched_share, limits.most_stretched);
  // The second half is pushed through the first: half of the surface lies inside or in the other half.
  PoseMeasures folded = checks.measure([&] {
    std::vector<Vector3f> vertices = asset.mesh.vertices;
    for (std::size_t v = 28; v < vertices.size(); ++v) {
      vertices[v].x() = -vertices[v].x();
      vertices[v].y() *= 0.5f;
      vertices[v].z() *= 0.5f;
    }
    return vertices;
  }());
  EXPECT_GT(folded.buried_share, limits.most_buried);
  EXPECT_THROW(checks.measure({}), InputError);
}

TEST(PoseChecks, VolumeNeedsAClosedSurface) {
  Asset asset = tube(2);
  std::vector<Vector3f> wider = asset.mesh.vertices;
  for (Vector3f& vertex : wider) vertex.y() *= 1.25f;
  const PoseMeasures measures = PoseChecks(asset.mesh).measure(wider);
  EXPECT_NEAR(measures.volume_ratio.value() * std::pow(measures.scale, 3), 1.25, 1e-5);
  asset.mesh.faces.pop_back();
  EXPECT_FALSE(PoseChecks(asset.mesh).measure(wider).volume_ratio.has_value());
}

}  // namespace

namespace {

using Eigen::Vector3d;
using Eigen::Vector3f;

TEST(RandomPose, VerticesAndJointsFollowTheReferencesFormula) {
  const Asset asset = tube(5);
  Rng rng(3, "test");
  const JointTurns turns = draw_turns(5, 1.0, 1.0, true, rng);
  const std::vector<Eigen::Matrix4d> world = turned_joints(asset.skeleton, turns);
  // Turn after turn, from the tip to the root: what lies beyond joint k is turned about where k lies in the bind pose.
  const std::vector<Vector3d> joints = asset.skeleton.positions();
  const auto carried = [&](Vector3d point, int joint) {
    for (int k = joint; k >= 0; k = asset.skeleton.parents[static_cast<std::size_t>(k)]) {
      const auto at = static_cast<std::size_t>(k);
      point = joints[at] + turns.rotations[at] * (point - joints[at]);
    }
    return point;
  };
  for (int j = 0; j < 5; ++j) {
    EXPECT_LT(
        (world[static_cast<std::size_t>(j)].topRightCorner<3, 1>() - carried(joints[static_cast<std::size_t>(j)], j))
            .norm(),
        1e-12);
  }
  const std::vector<Vector3f> posed = skin_vertices(asset, world);
  for (std::size_t v = 0; v < posed.size(); ++v) {
    Vector3d expected = Vector3d::Zero();
    for (std::size_t i = 0; i < asset.skin.row_size(v); ++i) {
      const Influence& influence = asset.skin.row(v)[i];
      expected +=
          static_cast<double>(influence.weight) * carried(asset.mesh.vertices[v].cast<double>(), influence.joint);
    }
    EXPECT_LT((posed[v].cast<double>() - expected).norm(), 1e-6) << v;  // single precision
  }
}

TEST(RandomPose, DrawsWhatTheOptionsSay) {
  Rng rng(1, "test");
  const std::size_t count = 20000;
  const JointTurns turns = draw_turns(count, 0.8, 60.0 * kRadians, false, rng);
  EXPECT_EQ(turns.angles[0], 0.0);  // the root was to be left alone
  std::size_t turned = 0;
  double sum = 0.0, most = 0.0;
  Vector3d mean_axis = Vector3d::Zero();
  for (std::size_t j = 1; j < count; ++j) {
    const Eigen::AngleAxisd turn(turns.rotations[j]);
    EXPECT_NEAR(turn.angle(), turns.angles[j], 1e-7);
    if (turns.angles[j] == 0.0) continue;
    ++turned;
    sum += turns.angles[j];
    most = std::max(most, turns.angles[j]);
    mean_axis += turn.axis();
  }
  // Five standard deviations each.
  EXPECT_NEAR(static_cast<double>(turned) / count, 0.8, 5.0 * 0.4 / std::sqrt(count));
  EXPECT_NEAR(sum / static_cast<double>(turned) / kRadians, 30.0, 5.0 * 17.4 / std::sqrt(turned));
  EXPECT_LE(most, 60.0 * kRadians);
  EXPECT_GT(most, 59.0 * kRadians);
  EXPECT_LT(mean_axis.norm() / static_cast<double>(turned), 5.0 / std::sqrt(turned));
}

TEST(BakePose, IdentityGivesTheAssetBack) {
  for (const Asset& asset : {tube(1), tube(4), creatures::make_creature("quadruped", 5, 1)}) {
    Asset baked = bake_pose(asset, asset.skeleton.bind, skin_vertices(asset, asset.skeleton.bind));
    normalize(baked);
    for (std::size_t v = 0; v < asset.mesh.vertices.size(); ++v) {
      EXPECT_LT((baked.mesh.vertices[v] - asset.mesh.vertices[v]).norm(), 1e-6f);
      EXPECT_LT((baked.mesh.normals[v] - asset.mesh.normals[v]).norm(), 1e-5f);
    }
    for (std::size_t j = 0; j < asset.skeleton.size(); ++j)
      EXPECT_LT((baked.skeleton.bind[j] - asset.skeleton.bind[j]).cwiseAbs().maxCoeff(), 1e-6);
    EXPECT_TRUE(baked.animations.empty());
  }
}

TEST(BakePose, NormalsTurnWithTheSurfaceAndSeamsStayShut) {
  // Two copies of one square that meet at a texture seam: the outer corners of the right one move, so the two halves of
  // the fan around a seam vertex turn differently.
  Asset asset;
  asset.mesh.vertices = {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}, {1, 0, 0}, {2, 0, 0}, {2, 1, 0}, {1, 1, 0}};
  asset.mesh.normals.assign(8, Vector3f(0, 0, 1));
  asset.mesh.faces = {{0, 1, 2}, {0, 2, 3}, {4, 5, 6}, {4, 6, 7}};
  asset.skeleton = skeleton_from_joints({{0, 0, 0}, {1, 0, 0}}, {-1, 0});
  for (const int joint : {0, 0, 0, 0, 0, 1, 1, 0}) asset.skin.append_row({{joint, 1.0f}});
  JointTurns turns;
  turns.rotations = {Eigen::Matrix3d::Identity(),
                     Eigen::AngleAxisd(-EIGEN_PI / 2, Vector3d::UnitY()).toRotationMatrix()};
  turns.angles = {0.0, EIGEN_PI / 2};
  const std::vector<Eigen::Matrix4d> world = turned_joints(asset.skeleton, turns);
  const Asset baked = bake_pose(asset, world, skin_vertices(asset, world));
  EXPECT_LT((baked.mesh.vertices[5] - Vector3f(1, 0, 1)).norm(), 1e-6f);
  EXPECT_LT((baked.mesh.normals[0] - Vector3f(0, 0, 1)).norm(), 1e-6f);
  EXPECT_LT((baked.mesh.normals[5] - Vector3f(-1, 0, 0)).norm(), 1e-6f);
  EXPECT_LT((baked.mesh.normals[1] - baked.mesh.normals[4]).norm(), 1e-6f);
  EXPECT_LT((baked.mesh.normals[2] - baked.mesh.normals[7]).norm(), 1e-6f);
  EXPECT_GT(baked.mesh.normals[1].z(), 0.3f);  // between the two sides
  EXPECT_LT(baked.mesh.normals[1].x(), -0.3f);
}

TEST(BakePose, ShearedFramesBecomeRotations) {
  Asset asset = tube(3);
  // A parent stretched along one axis under a turned child: relative to it the grandchild's frame is sheared.
  std::vector<Eigen::Matrix4d> world = asset.skeleton.bind;
  world[0].topLeftCorner<3, 3>() = Vector3d(1.0, 2.0, 1.0).asDiagonal();
  world[1].topLeftCorner<3, 3>() = Eigen::AngleAxisd(0.6, Vector3d::UnitZ()).toRotationMatrix();
  const Asset baked = bake_pose(asset, world, skin_vertices(asset, world));
  EXPECT_TRUE(validate(baked).empty());
  const std::vector<Eigen::Matrix4d> rest = forward_kinematics(baked.skeleton.parents, baked.skeleton.rest);
  for (std::size_t j = 0; j < 3; ++j) {
    EXPECT_LT((rest[j] - baked.skeleton.bind[j]).cwiseAbs().maxCoeff(), 1e-9);
    EXPECT_LT((world[j] - baked.skeleton.bind[j]).col(3).norm(), 1e-12);
  }
}

TEST(BakePose, NamesTheJointThatCollapses) {
  std::vector<Eigen::Matrix4d> world(3, Eigen::Matrix4d::Identity());
  EXPECT_FALSE(collapsed_joint(world).has_value());
  world[2](1, 1) = 0.0;
  EXPECT_EQ(collapsed_joint(world).value(), 2u);
  world[1](0, 3) = std::numeric_limits<double>::infinity();
  EXPECT_EQ(collapsed_joint(world).value(), 1u);
}

}  // namespace

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

TEST(PoseAugmentation, AxesAreScaledAfterThePose) {
  const Asset asset = tube(5);
  PoseAugmentation scaled = anything();
  scaled.anisotropic_scale = 0.4;
  Provenance plain_provenance, provenance;
  double least = 1.0, most = 1.0;
  for (std::size_t k = 0; k < 8; ++k) {
    const Asset plain = posed_variant(asset, "a", 1, k, anything(), plain_provenance).value();
    const Asset variant = posed_variant(asset, "a", 1, k, scaled, provenance).value();
    EXPECT_TRUE(validate(variant).empty());
    EXPECT_EQ(plain_provenance.axis_factors, Vector3d::Ones());
    const Vector3d factors = provenance.axis_factors;
    least = std::min(least, factors.minCoeff());
    most = std::max(most, factors.maxCoeff());
    // Both lie in the unit box, so only ratios of differences tell the factors.
    const Vector3f from = plain.mesh.vertices[0], to = variant.mesh.vertices[0];
    const double unit = provenance.renormalization.scale / plain_provenance.renormalization.scale;
    for (std::size_t v = 1; v < plain.mesh.vertices.size(); ++v) {
      const Vector3d expected = unit * factors.cwiseProduct((plain.mesh.vertices[v] - from).cast<double>());
      EXPECT_LT(((variant.mesh.vertices[v] - to).cast<double>() - expected).norm(), 1e-5);
    }
    const std::vector<Vector3d> joints = variant.skeleton.positions(), plain_joints = plain.skeleton.positions();
    for (std::size_t j = 1; j < joints.size(); ++j) {
      const Vector3d expected = unit * factors.cwiseProduct(plain_joints[j] - plain_joints[0]);
      EXPECT_LT((joints[j] - joints[0] - expected).norm(), 1e-6);
    }
  }
  EXPECT_LT(least, 0.85);
  EXPECT_GT(most, 1.15);
  EXPECT_GE(least, std::exp(-0.4));
  EXPECT_LE(most, std::exp(0.4));
  EXPECT_NE(variant_id("a", 1, 0, scaled), variant_id("a", 1, 0, anything()));
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

TEST(PoseAugmentation, KeyFramesAloneAreThoseOfTheClips) {
  Asset asset = tube(3);
  asset.animations = {swing(80.0), swing(40.0), swing(0.0)};
  asset.animations[1].name = "half";
  asset.animations[2].name = "still";
  Channel& channel = asset.animations[0].channels[0];
  channel.times = {0.0, 0.5, 2.0};
  channel.values.insert(channel.values.begin() + 4, {0, 0, std::sin(10 * kRadians), std::cos(10 * kRadians)});
  PoseAugmentation options = anything();
  options.key_frames = true;
  const PoseAugmenter augmenter(asset, "a", 1, options);
  std::set<std::pair<std::string, double>> seen;
  for (std::size_t k = 0; k < 5; ++k) {
    Provenance provenance;
    const Asset variant = augmenter.variant(k, provenance).value();
    EXPECT_EQ(provenance.kind, PoseKind::kAnimation);
    EXPECT_EQ(provenance.blend, 0.0);
    EXPECT_EQ(provenance.second_time, provenance.time);
    EXPECT_TRUE(seen.emplace(provenance.clip, provenance.time).second) << "no frame twice";
    const double wanted = provenance.time == 0.0       ? 0.0
                          : provenance.time == 0.5     ? 20.0
                          : provenance.clip == "swing" ? 80.0
                                                       : 40.0;
    EXPECT_NEAR(swing_angle(variant), wanted, 1e-6);
  }
  const std::set<std::pair<std::string, double>> keys{
      {"swing", 0.0}, {"swing", 0.5}, {"swing", 2.0}, {"half", 0.0}, {"half", 2.0}};
  EXPECT_EQ(seen, keys);
  Provenance provenance;
  EXPECT_FALSE(augmenter.variant(5, provenance).has_value());
  EXPECT_NE(provenance.rejections.at(0).find("5 key frames"), std::string::npos) << provenance.rejections[0];

  asset.animations.clear();
  EXPECT_FALSE(posed_variant(asset, "a", 1, 0, options, provenance).has_value()) << "no random pose in their place";
  options.own_motion = false;
  EXPECT_THROW(options.validate(), InputError);
  // Ids of what was made without the option stay.
  EXPECT_FALSE(settings_of(PoseAugmentation()).contains("key_frames"));
  EXPECT_NE(variant_id("a", 1, 0, options), variant_id("a", 1, 0, anything()));
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
  refuses([](PoseAugmentation& o) { o.anisotropic_scale = -0.1; });
  refuses([](PoseAugmentation& o) { o.anisotropic_scale = NAN; });
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
    const Asset asset = creatures::make_creature(family, 20, 3);
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
  if (!std::filesystem::exists(folder)) {
    GTEST_SKIP() << "real assets are missing: " << folder;
  }
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
      for (std::size_t v = 0; v < rest.size(); ++v)
        ASSERT_LT((rest[v] - variant->mesh.vertices[v]).norm(), 1e-4f) << file;
    }
    EXPECT_GT(made, 0u) << file;
  }
}

}  // namespace

}  // namespace anigen::prepare
