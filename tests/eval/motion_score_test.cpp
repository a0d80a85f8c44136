#include "anigen/eval/motion/motion_score.h"

#include <gtest/gtest.h>

#include "anigen/core/atomic_file.h"
#include "anigen/core/error.h"
#include "anigen/eval/comparison/evaluate_command.h"
#include "anigen/eval/motion/motion_file.h"
#include "anigen/eval/motion/retarget.h"
#include "anigen/eval/pair/pair_evaluation.h"
#include "anigen/io/gltf.h"
#include "tests/eval/rigged_walker.h"
#include "tests/support/paths.h"
#include "tests/support/rig_files.h"

namespace anigen::eval {
namespace {

namespace fs = std::filesystem;

constexpr char kBvh[] =
    "HIERARCHY\nROOT base\n{\nOFFSET 0 0 0\nCHANNELS 3 Xposition Yposition Zposition\nJOINT middle\n{\n"
    "OFFSET 0 50 0\nCHANNELS 1 Zrotation\nEnd Site\n{\nOFFSET 0 50 0\n}\n}\n}\n"
    "MOTION\nFrames: 3\nFrame Time: 0.1\n0 90 0 0\n5 90 0 30\n10 90 0 60\n";

/// A clip that turns one joint by an angle about Y, there and back.
Animation nod(int joint, double angle) {
  Channel channel{joint, ChannelPath::kRotation, Interpolation::kLinear, {0.0, 1.0, 2.0}, {}};
  for (const double a : {0.0, angle, 0.0}) {
    const Eigen::Quaterniond q(Eigen::AngleAxisd(a, Eigen::Vector3d::UnitY()));
    channel.values.insert(channel.values.end(), {q.x(), q.y(), q.z(), q.w()});
  }
  return {"nod", {channel}};
}

io::RiggedShape nodding_walker() {
  io::RiggedShape shape = test::rigged_walker();
  io::RigClips clips{skeleton_from_joints(shape.joints.positions, shape.joints.parents), {}};
  clips.animations = {{"still", {}}, nod(1, 0.8)};
  shape.clips = std::make_shared<io::RigClips>(clips);
  return shape;
}

PairSettings quick_motion() {
  PairSettings settings;
  settings.groups = {"motion"};
  settings.surface_samples = 1000;
  settings.motion_frames = 5;
  settings.alignment.icp = false;
  return settings;
}

TEST(MotionScore, TakesTheTruthsFirstClipThatMoves) {
  const io::RiggedShape truth = nodding_walker();
  const Motion own = truth_motion(truth, Similarity(), nullptr, 0, 5);
  EXPECT_EQ(own.name, "nod");
  ASSERT_EQ(own.frames.size(), 5u);
  EXPECT_NEAR(own.frames[2].turns[1].angularDistance(Eigen::Quaterniond::Identity()), 0.8, 1e-9);
  EXPECT_EQ(truth_motion(test::rigged_walker(), Similarity(), nullptr, 0, 5).name, "random poses");
  // A file that was turned on reading turns its clip with it.
  io::RiggedShape turned = truth;
  io::to_y_up(turned);
  const Eigen::Quaterniond turn = truth_motion(turned, Similarity(), nullptr, 0, 5).frames[2].turns[1];
  EXPECT_NEAR(Eigen::AngleAxisd(turn).axis().z(), -1.0, 1e-9);
  io::from_y_up(turned);
  EXPECT_LT((turned.clips_turn - Eigen::Matrix3d::Identity()).norm(), 1e-12);
}

TEST(MotionScore, IsZeroForTheSameRig) {
  const io::RiggedShape truth = nodding_walker();
  const PairResult result = evaluate_pair(test::rigged_walker(), truth, quick_motion());
  EXPECT_NEAR(result.value("motion_distance"), 0.0, 1e-6);
  EXPECT_NEAR(result.value("motion_distance_rest"), 0.0, 1e-6);
  EXPECT_EQ(result.details["motion"]["clip"], "nod");
  EXPECT_EQ(result.details["motion"]["distance"], "vertices");
  EXPECT_EQ(result.values.count("j2j"), 0u);

  // Other faces, so surfaces are compared and not vertices.
  io::RiggedShape other = test::rigged_walker();
  std::swap(other.mesh.faces.front(), other.mesh.faces.back());
  const PairResult surfaces = evaluate_pair(other, truth, quick_motion());
  EXPECT_EQ(surfaces.details["motion"]["distance"], "surfaces");
  EXPECT_NEAR(surfaces.value("motion_distance"), 0.0, 1e-5);
}

TEST(MotionScore, TellsTheRestFromTheMotion) {
  const io::RiggedShape truth = test::rigged_walker();
  io::RiggedShape aside = truth;
  for (Eigen::Vector3f& vertex : aside.mesh.vertices) vertex.x() += 0.02f;
  for (Eigen::Vector3d& joint : aside.joints.positions) joint.x() += 0.02;
  const Motion motion = truth_motion(truth, Similarity(), nullptr, 0, 6);
  const MotionScore moved = motion_score(truth, motion, aside, retarget(motion, aside.joints));
  EXPECT_TRUE(moved.by_vertex);
  EXPECT_NEAR(moved.rest, 0.02, 1e-6);
  EXPECT_NEAR(moved.moving, 0.02, 1e-5);
  EXPECT_GE(moved.largest, moved.moving);

  // Bound to the root alone: right at rest, wrong in motion.
  io::RiggedShape rigid = truth;
  rigid.skin = {};
  for (std::size_t v = 0; v < rigid.mesh.vertices.size(); ++v) rigid.skin.append_row({{0, 1.0f}});
  const MotionScore stiff = motion_score(truth, motion, rigid, retarget(motion, rigid.joints));
  EXPECT_EQ(stiff.rest, 0.0);
  EXPECT_GT(stiff.moving, 1e-3);
}

TEST(MotionScore, SaysWhatIsMissing) {
  const io::RiggedShape truth = test::rigged_walker();
  io::RiggedShape predicted = truth;
  predicted.skin = {};
  EXPECT_EQ(evaluate_pair(predicted, truth, quick_motion()).not_computed.at("motion_distance"),
            "the prediction has no skin weights");
  predicted = truth;
  predicted.mesh.faces.clear();
  EXPECT_EQ(evaluate_pair(predicted, truth, quick_motion()).not_computed.at("motion_distance"),
            "the prediction has no faces");
}

TEST(MotionFile, ReadsClipsByNameAndNumber) {
  const test::TemporaryFolder folder;
  Asset asset = to_asset(test::rigged_walker());
  Animation still = nod(2, 0.0), deep = nod(1, 0.8);
  still.name = "still";
  deep.name = "deep";
  asset.animations = {still, nod(1, 0.4), deep};
  io::write_gltf(folder / "clips.glb", asset);
  const std::string file = (folder / "clips.glb").string();
  EXPECT_EQ(read_motion(file, 3).described["clip"], "nod");
  EXPECT_EQ(read_motion(file + "#deep", 3).motion.name, "deep");
  EXPECT_EQ(read_motion(file + "#2", 3).motion.name, "deep");
  const auto refusal = [&](const std::string& text) { return test::refusal([&] { read_motion(text, 3); }); };
  EXPECT_NE(refusal(file + "#waltz").find("there are 'still', 'nod', 'deep'"), std::string::npos);
  EXPECT_NE(refusal(file + "#still").find("nothing moves"), std::string::npos);
  EXPECT_NE(refusal((folder / "none.bvh").string()).find("no such file"), std::string::npos);
  asset.animations.clear();
  io::write_gltf(folder / "mute.glb", asset);
  EXPECT_NE(refusal((folder / "mute.glb").string()).find("no clip"), std::string::npos);
  write_file_atomically(folder / "a.txt", "walk");
  EXPECT_NE(refusal((folder / "a.txt").string()).find("a motion is a .bvh"), std::string::npos);
  write_file_atomically(folder / "walk#1.bvh", kBvh);
  EXPECT_EQ(read_motion((folder / "walk#1.bvh").string(), 3).motion.frames.size(), 3u);
}

TEST(MotionPictures, ShowEveryMethodInAGivenMotion) {
  const test::TemporaryFolder folder;
  test::write_glb(folder / "truth" / "a.glb", {});
  test::write_glb(folder / "same" / "a.glb", {});
  write_file_atomically(folder / "walk.bvh", kBvh);
  EvaluationRequest request;
  request.predictions = {(folder / "same").string(), "none=" + (folder / "none").string()};
  test::write_glb(folder / "none" / "b.glb", {});
  request.truth = folder / "truth";
  request.out = folder / "out";
  request.settings = quick_motion();
  request.settings.motion_frames = 3;
  request.motion = (folder / "walk.bvh").string();
  request.motions_pictured = 1;
  request.pictured = 0;
  const Comparison comparison = run_evaluation(request);
  EXPECT_LT(comparison.results[0][0].value("motion_distance"), 1e-5);
  EXPECT_EQ(comparison.results[0][0].details["motion"]["clip"], "walk");
  EXPECT_EQ(comparison.settings["motion"]["joints"], 3);

  std::size_t pictures = 0, rigs = 0;
  for (const auto& entry : fs::recursive_directory_iterator(folder / "out" / "motion")) {
    pictures += entry.path().extension() == ".png";
    if (entry.path().extension() != ".glb") continue;
    ++rigs;
    const Asset moved = io::read_gltf(entry.path()).asset;
    ASSERT_EQ(moved.animations.size(), 1u);
    EXPECT_NEAR(moved.animations[0].duration(), 0.2, 1e-6);
  }
  EXPECT_EQ(pictures, 3u);
  EXPECT_EQ(rigs, 2u);
  EXPECT_NE(read_file(folder / "out" / "report.html").find("data-play"), std::string::npos);

  request.motion = (folder / "missing.bvh").string();
  EXPECT_THROW(run_evaluation(request), InputError);
}

}  // namespace
}  // namespace anigen::eval
