#include <gtest/gtest.h>
#include <string>

#include "anigen/engine/animate_request.h"
#include "anigen/engine/evaluate_request.h"
#include "anigen/engine/option_names.h"
#include "anigen/engine/prepare_request.h"
#include "anigen/engine/rig_request.h"

namespace anigen::engine {

namespace {

TEST(EngineRequests, OfOptionsLeftAloneAreThoseOfTheirOwnDefaults) {
  const rigging::RigRequest rig = rig_request({}), plain;
  EXPECT_EQ(rig.method.joints, rigging::JointSource::kAuto);
  EXPECT_EQ(rig.joints.keep_skeleton, plain.joints.keep_skeleton);
  EXPECT_EQ(rig.joints.templates, plain.joints.templates);
  EXPECT_EQ(rig.separate_bodies, plain.separate_bodies);
  EXPECT_EQ(rig.influences, plain.influences);
  EXPECT_EQ(rig.binding.geodesic.most_influences, plain.binding.geodesic.most_influences);
  EXPECT_EQ(rig.binding.heat.most_influences, plain.binding.heat.most_influences);
  EXPECT_EQ(rig.rigid_share, plain.rigid_share);
  EXPECT_FALSE(rig.edits.any());
  EXPECT_FALSE(rig.engine.any());

  const motions::MotionOptions motion = motion_options({}), usual;
  EXPECT_EQ(motion.frames, usual.frames);
  EXPECT_EQ(motion.fps, usual.fps);
  EXPECT_EQ(motion.speed, usual.speed);
  EXPECT_EQ(motion.travel, usual.travel);

  EXPECT_EQ(eval::to_json(pair_settings({})), eval::to_json(eval::PairSettings()));

  const anigen::prepare::PrepareOptions dataset = dataset_request({});
  anigen::prepare::StepPlan plan;
  plan.condition_views.size = 1024;  // as published; other pictures have 512
  EXPECT_EQ(dataset.plan.to_json(), plan.to_json());
  EXPECT_EQ(dataset.tables.split.to_json(), anigen::prepare::SplitOptions().to_json());
  EXPECT_EQ(dataset.tables.near_skeletons, anigen::prepare::TableOptions().near_skeletons);
}

TEST(EngineRequests, TryTemplatesFirstForAHumanoid) {
  EXPECT_FALSE(rig_request({}).joints.templates_first);
  rigging::RigRequest further;
  further.engine.humanoid = true;
  EXPECT_TRUE(rig_request({}, further).joints.templates_first);
}

TEST(EngineRequests, HaveEveryOptionOfARig) {
  RigOptions options;
  options.method = "auto";
  options.skin = "geovoxel";
  options.templates = {"fox"};
  options.keep_skeleton = options.separate_bodies = options.learned_joints = false;
  options.joints = 24;
  options.symmetric = options.add_joints = true;
  options.influences = 8;
  options.rigid_share = 0.75;
  options.bone_axes = "along";
  options.names = "unreal";
  options.height = 1.8;
  options.ground = options.root_bone = true;
  const rigging::RigRequest request = rig_request(options);
  EXPECT_EQ(request.method.binding, rigging::SkinBinding::kGeodesicVoxels);
  EXPECT_EQ(request.joints.templates, options.templates);
  EXPECT_FALSE(request.joints.keep_skeleton || request.separate_bodies || request.joints.learned);
  EXPECT_EQ(request.edits.joints, 24U);
  EXPECT_TRUE(request.edits.symmetric && request.edits.extend);
  EXPECT_EQ(request.influences, 8U);
  EXPECT_EQ(request.binding.heat.most_influences, 8U);
  EXPECT_EQ(request.binding.geodesic.most_influences, 8U);
  EXPECT_EQ(request.rigid_share, 0.75);
  EXPECT_EQ(request.engine.axes, rigging::BoneAxes::kAlong);
  EXPECT_EQ(request.engine.names, rigging::parse_name_style("unreal"));
  EXPECT_EQ(request.engine.height, 1.8);
  EXPECT_TRUE(request.engine.ground && request.engine.root_bone);
  EXPECT_TRUE(request.joints.templates_first) << "names of humans need all of their bones";
}

TEST(EngineRequests, KeepFurtherOptionsOfAProgram) {
  rigging::RigRequest rig;
  rig.joints.skeleton = "skeleton.glb";
  rig.binding.geodesic.resolution = 128;
  rig.graft = false;
  RigOptions options;
  options.method = "geovoxel";
  rig = rig_request(options, rig);
  EXPECT_EQ(rig.joints.skeleton, "skeleton.glb");
  EXPECT_EQ(rig.binding.geodesic.resolution, 128);
  EXPECT_FALSE(rig.graft);

  eval::PairSettings pair;
  pair.poses = 3;
  pair.transport = eval::TransportMethod::kSinkhorn;
  EvaluateOptions scores;
  scores.protocol = "rignet";
  scores.seed = 7;
  pair = pair_settings(scores, pair);
  EXPECT_EQ(pair.poses, 3);
  EXPECT_EQ(pair.transport, eval::TransportMethod::kSinkhorn);
  EXPECT_EQ(pair.seed, 7U);
  EXPECT_FALSE(pair.alignment.icp) << "by the protocol";

  anigen::prepare::PrepareOptions dataset;
  dataset.plan.poses.max_angle = 10;
  dataset.plan.views.samples_per_axis = 1;
  dataset.tables.limits.min_joints = 5;
  dataset.run.workers = 3;
  PrepareOptions prepared;
  prepared.cleaning = "anymate";
  prepared.views = 2;
  dataset = dataset_request(prepared, dataset);
  EXPECT_EQ(dataset.plan.poses.max_angle, 10);
  EXPECT_EQ(dataset.plan.views.samples_per_axis, 1);
  EXPECT_EQ(dataset.plan.views.count, 2U);
  EXPECT_EQ(dataset.tables.limits.min_joints, 5U);
  EXPECT_EQ(dataset.tables.near_skeletons, anigen::prepare::NearSkeletons::kDrop);
  EXPECT_EQ(dataset.run.workers, 3U);
}

TEST(EngineOptionNames, StandInMessagesInPlaceOfTheProgramsNames) {
  constexpr OptionName kNames[] = {{"--clean", "cleaning"}, {"--views", "views"}};
  EXPECT_EQ(in_library_words("--clean: none of these; --clean-set, --views 3 -- or --clean", kNames),
            "cleaning: none of these; --clean-set, views 3 -- or cleaning");
  EXPECT_EQ(in_library_words("", kNames), "");
  const auto rethrown = [&](const InputError& error) -> std::string {
    try {
      with_library_words(kNames, [&]() -> int { throw error; });
    } catch (const InputError& changed) {
      return changed.what();
    }
    return "nothing";
  };
  EXPECT_EQ(rethrown(InputError("a--clean.glb", "--clean", "is dirt")), "a--clean.glb: cleaning: is dirt");
  EXPECT_EQ(rethrown(InputError("--views", "three", "is no number")), "views: three: is no number");
  EXPECT_THROW(
      with_library_words(kNames, []() -> int { throw NotSupportedError("", "--clean", "soap, without --views"); }),
      NotSupportedError);
  try {
    with_library_words(kNames, []() -> int { throw NotSupportedError("", "--clean", "soap, without --views"); });
  } catch (const NotSupportedError& error) {
    EXPECT_STREQ(error.what(), "cleaning: not supported: soap, without views");
  }
}

}  // namespace

}  // namespace anigen::engine
