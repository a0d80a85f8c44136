#include <gtest/gtest.h>
#include <cmath>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/numeric.h"
#include "anigen/core/random.h"
#include "anigen/eval/evaluate_command.h"
#include "anigen/eval/pair.h"
#include "anigen/io/gltf/gltf.h"
#include "anigen/metrics/motion.h"
#include "tests/eval/rigged_walker.h"
#include "tests/support/paths.h"
#include "tests/support/rig_files.h"

namespace anigen::metrics {

namespace {

using Eigen::Quaterniond;
using Eigen::Vector3d;

/// Pelvis, chest, head, two arms with hands, two legs with feet; no two sides quite alike.
JointTree figure() {
  JointTree tree;
  tree.positions = {{0, 0, 0},           {0, 0.02, 0.4},  {0, 0, 0.62},     {0.3, 0, 0.41},       {0.52, -0.05, 0.3},
                    {-0.3, 0, 0.4},      {-0.5, 0, 0.28}, {0.12, 0, -0.42}, {0.14, -0.12, -0.47}, {-0.12, 0.01, -0.4},
                    {-0.12, -0.1, -0.46}};
  tree.parents = {-1, 0, 1, 1, 3, 1, 5, 0, 7, 0, 9};
  return tree;
}

Quaterniond random_turn(Rng& rng) {
  return Quaterniond(
      Eigen::AngleAxisd(rng.uniform(0.0, 1.0), Vector3d(rng.normal(), rng.normal(), rng.normal()).normalized()));
}

/// The figure with joint axes of its own and a clip that turns every joint, moves the root and stretches one bone.
struct AnimatedFigure {
  explicit AnimatedFigure(std::uint64_t seed) {
    Rng rng(seed, "animated figure");
    const JointTree tree = figure();
    skeleton = skeleton_from_joints(tree.positions, tree.parents);
    for (Eigen::Matrix4d& bind : skeleton.bind) bind.topLeftCorner<3, 3>() = random_turn(rng).toRotationMatrix();
    skeleton.rest = bind_pose(skeleton);
    clip.name = "dance";
    for (int j = 0; j < static_cast<int>(tree.size()); ++j) {
      Channel turn{j, ChannelPath::kRotation, Interpolation::kLinear, {0.0, 0.4, 1.0}, {}};
      for (int key = 0; key < 3; ++key) {
        const Quaterniond q = skeleton.rest[at(j)].rotation * random_turn(rng);
        turn.values.insert(turn.values.end(), {q.x(), q.y(), q.z(), q.w()});
      }
      clip.channels.push_back(turn);
    }
    for (const int j : {0, 4}) {
      const Vector3d from = skeleton.rest[at(j)].translation, to = 1.3 * from + Vector3d(0.1, 0.2, 0.05);
      clip.channels.push_back({j,
                               ChannelPath::kTranslation,
                               Interpolation::kLinear,
                               {0.0, 1.0},
                               {from.x(), from.y(), from.z(), to.x(), to.y(), to.z()}});
    }
  }

  std::vector<Eigen::Matrix4d> world(const Animation& animation, double time) const {
    return forward_kinematics(skeleton.parents, sample(animation, skeleton, time));
  }

  Skeleton skeleton;
  Animation clip;
};

/// `fractions` more joints in every bone; the joints of the figure keep their numbers.
JointTree with_joints_in_bones(JointTree tree, const std::vector<double>& fractions) {
  const std::size_t count = tree.size();
  for (std::size_t j = 1; j < count; ++j) {
    int above = tree.parents[j];
    const Vector3d from = tree.positions[at(above)], to = tree.positions[j];
    for (const double fraction : fractions) {
      tree.positions.push_back(from + fraction * (to - from));
      tree.parents.push_back(above);
      above = static_cast<int>(tree.size()) - 1;
    }
    tree.parents[j] = above;
  }
  return tree;
}

std::vector<Vector3d> places(const Motion& motion, std::size_t frame) {
  const std::vector<RigidMotion> moved = rigid_motions(motion.joints, motion.frames[frame]);
  std::vector<Vector3d> result;
  for (std::size_t j = 0; j < moved.size(); ++j) result.push_back(moved[j](motion.joints.positions[j]));
  return result;
}

TEST(MotionRetarget, OntoItselfGivesTheSamePoses) {
  for (std::uint64_t seed = 0; seed < 4; ++seed) {
    const AnimatedFigure rig(seed);
    const JointTree tree = joint_tree(rig.skeleton);
    const Animation again = retarget(rig.clip, rig.skeleton, rig.skeleton, motion_plan(tree, tree), 6);
    for (int f = 0; f < 6; ++f) {
      const std::vector<Eigen::Matrix4d> before = rig.world(rig.clip, f / 5.0), after = rig.world(again, f / 5.0);
      for (std::size_t j = 0; j < before.size(); ++j) EXPECT_LT((before[j] - after[j]).cwiseAbs().maxCoeff(), 1e-5);
    }
  }
}

TEST(MotionRetarget, AxesOfJointsDoNotMatter) {
  const AnimatedFigure rig(1), other(2);
  const JointTree tree = joint_tree(rig.skeleton);
  const Animation moved = retarget(rig.clip, rig.skeleton, other.skeleton, motion_plan(tree, tree), 4);
  for (int f = 0; f < 4; ++f) {
    const std::vector<Eigen::Matrix4d> a = rig.world(rig.clip, f / 3.0), b = other.world(moved, f / 3.0);
    for (std::size_t j = 0; j < a.size(); ++j) {
      const Eigen::Matrix4d since_a = a[j] * rig.skeleton.bind[j].inverse();
      const Eigen::Matrix4d since_b = b[j] * other.skeleton.bind[j].inverse();
      EXPECT_LT((since_a - since_b).cwiseAbs().maxCoeff(), 1e-9) << f << ", joint " << j;
    }
  }
}

TEST(MotionRetarget, JointsInTheMiddleOfBonesChangeNothing) {
  const AnimatedFigure rig(3);
  const Motion source = motion_of(rig.clip, rig.skeleton, 5);
  for (const std::vector<double>& fractions : {std::vector<double>{0.5}, {0.8}, {0.2, 0.3, 0.7}}) {
    const JointTree target = with_joints_in_bones(source.joints, fractions);
    Motion rotations = source;  // bones that stretch would stretch in another place
    for (MotionFrame& frame : rotations.frames) frame.shifts.assign(frame.shifts.size(), frame.shifts[0]);
    const Motion moved = retarget(rotations, target);
    for (std::size_t f = 0; f < 5; ++f) {
      const std::vector<Vector3d> before = places(rotations, f), after = places(moved, f);
      for (std::size_t j = 0; j < before.size(); ++j) EXPECT_LT((before[j] - after[j]).norm(), 1e-6) << j;
    }
  }
}

TEST(MotionRetarget, TheOrderOfJointsChangesNothing) {
  const Motion source = pose_sequence(figure(), 5, "figure", 6);
  JointTree target = with_joints_in_bones(figure(), {0.4});
  Rng rng(7, "order");
  for (Vector3d& position : target.positions) position += 0.02 * Vector3d(rng.normal(), rng.normal(), rng.normal());
  const std::vector<std::size_t> name = rng.permutation(target.size());
  JointTree renamed = target;
  for (std::size_t j = 0; j < target.size(); ++j) {
    renamed.positions[name[j]] = target.positions[j];
    renamed.parents[name[j]] = target.parents[j] < 0 ? -1 : static_cast<int>(name[at(target.parents[j])]);
  }
  const Motion a = retarget(source, target), b = retarget(source, renamed);
  for (std::size_t f = 0; f < 6; ++f) {
    for (std::size_t j = 0; j < target.size(); ++j) {
      EXPECT_LT(a.frames[f].turns[j].angularDistance(b.frames[f].turns[name[j]]), 1e-7);
      EXPECT_LT((places(a, f)[j] - places(b, f)[name[j]]).norm(), 1e-9);
    }
  }
}

TEST(MotionRetarget, ABoneAcrossTwoTurnsByTheirMean) {
  Motion source;
  source.joints = {{{0, 0, 0}, {0.5, 0, 0}, {1, 0, 0}}, {-1, 0, 1}};
  const Quaterniond bent(Eigen::AngleAxisd(kPi / 3, Vector3d::UnitZ()));
  MotionFrame frame;
  frame.turns = {Quaterniond::Identity(), bent, bent};
  frame.shifts.assign(3, Vector3d::Zero());
  source.frames = {frame};
  JointTree target;
  target.positions = {Vector3d(0, 0, 0), Vector3d(1, 0, 0)};
  target.parents = {-1, 0};
  const Motion moved = retarget(source, target);
  const Quaterniond half(Eigen::AngleAxisd(kPi / 6, Vector3d::UnitZ()));
  EXPECT_LT(moved.frames[0].turns[0].angularDistance(half), 1e-6);
  EXPECT_LT(moved.frames[0].turns[1].angularDistance(bent), 1e-6);
}

TEST(MotionRetarget, WhatHasNoCounterpartMovesWithItsParent) {
  const Motion source = pose_sequence(figure(), 1, "figure", 6);
  JointTree target = figure();
  target.positions.push_back({0, 0.6, 0.1});
  target.parents.push_back(0);
  target.positions.push_back({0, 0.9, 0.3});
  target.parents.push_back(11);
  const Eigen::MatrixXd plan = motion_plan(target, source.joints);
  EXPECT_EQ(plan.row(12).sum(), 0.0);
  const Motion moved = retarget(source, target, plan);
  for (std::size_t f = 0; f < 6; ++f) {
    EXPECT_LT(moved.frames[f].turns[12].angularDistance(moved.frames[f].turns[0]), 1e-7);
    for (std::size_t j = 0; j < 11; ++j)
      EXPECT_LT(moved.frames[f].turns[j].angularDistance(source.frames[f].turns[j]), 1e-6) << j;
  }
}

TEST(MotionRetarget, AnotherBeingsMotionIsScaledAndStartsInPlace) {
  const AnimatedFigure rig(4);
  Motion source = motion_of(rig.clip, rig.skeleton, 5);
  for (MotionFrame& frame : source.frames) {
    for (Vector3d& shift : frame.shifts) shift += Vector3d(90, 5, 1);
  }
  JointTree target = figure();
  for (Vector3d& position : target.positions) position = 2.0 * position + Vector3d(5, 0, 0);
  const Motion moved = retarget_freely(source, target);
  EXPECT_LT(moved.frames[0].shifts[0].norm(), 1e-9);
  for (std::size_t f = 0; f < 5; ++f) {
    const Vector3d travel = source.frames[f].shifts[0] - source.frames[0].shifts[0];
    EXPECT_LT((moved.frames[f].shifts[0] - 2.0 * travel).norm(), 1e-6);
    for (std::size_t j = 0; j < target.size(); ++j)
      EXPECT_LT(moved.frames[f].turns[j].angularDistance(source.frames[f].turns[j]), 1e-6);
  }
}

TEST(MotionRetarget, RejectsPlansThatDoNotFit) {
  const Motion source = pose_sequence(figure(), 1, "figure", 2);
  EXPECT_THROW(retarget(source, figure(), Eigen::MatrixXd::Zero(10, 11)), InputError);
  EXPECT_THROW(retarget(source, figure(), Eigen::MatrixXd::Constant(11, 11, -1.0)), InputError);
  EXPECT_THROW(retarget(source, JointTree()), InputError);
  EXPECT_THROW(motion_plan(figure(), figure(), 0.0), InputError);
  EXPECT_THROW(to_animation(source, skeleton_from_joints({{0, 0, 0}}, {-1})), InputError);
}

TEST(MotionPlan, IsTheLengthOfSharedBones) {
  const Eigen::MatrixXd plan = motion_plan(figure(), figure());
  for (Eigen::Index j = 0; j < plan.rows(); ++j) EXPECT_NEAR(plan(j, j), plan.row(j).sum(), 1e-9);
  // Shoulder to hand, in sizes of the figure.
  const JointTree tree = figure();
  EXPECT_NEAR(plan(3, 3), (tree.positions[4] - tree.positions[3]).norm() / size_of(tree), 1e-9);
}

TEST(MotionPlan, TellsJointsInOnePlaceApart) {
  JointTree tree = figure();
  tree.positions.push_back(tree.positions[4]);
  tree.parents.push_back(4);
  tree.positions.push_back(tree.positions[4]);
  tree.parents.push_back(11);
  const Eigen::MatrixXd plan = motion_plan(tree, tree);
  for (Eigen::Index j = 0; j < plan.rows(); ++j) EXPECT_GT(plan(j, j), 0.99 * plan.row(j).sum()) << j;
}

TEST(PoseSequence, IsDecidedBySeedAndAsset) {
  const Motion first = pose_sequence(figure(), 3, "a", 12), again = pose_sequence(figure(), 3, "a", 12);
  ASSERT_EQ(first.frames.size(), 12u);
  const auto distance = [&](const Motion& other) {
    double sum = 0;
    for (std::size_t f = 0; f < 12; ++f) {
      for (std::size_t j = 0; j < 11; ++j) sum += first.frames[f].turns[j].angularDistance(other.frames[f].turns[j]);
    }
    return sum;
  };
  EXPECT_LT(distance(again), 1e-9);
  EXPECT_GT(distance(pose_sequence(figure(), 3, "b", 12)), 0.1);
  EXPECT_GT(distance(pose_sequence(figure(), 4, "a", 12)), 0.1);
  EXPECT_TRUE(moves(first));
  for (const Quaterniond& turn : first.frames[0].turns) EXPECT_LT(turn.angularDistance(Quaterniond::Identity()), 1e-9);
  EXPECT_THROW(pose_sequence(figure(), 3, "a", 0), InputError);
}

TEST(Motion, KnowsWhetherAnythingMovesAndWhatIsLeftOut) {
  AnimatedFigure rig(6);
  const Motion dance = motion_of(rig.clip, rig.skeleton, 5);
  EXPECT_TRUE(moves(dance));
  EXPECT_LT(dance.scaling, 1e-9);
  Animation still;
  EXPECT_FALSE(moves(motion_of(still, rig.skeleton, 5)));
  EXPECT_EQ(motion_of(still, rig.skeleton, 5).frames.size(), 1u);
  still.channels.push_back({2, ChannelPath::kScale, Interpolation::kLinear, {0.0, 1.0}, {1, 1, 1, 1.5, 1, 1}});
  EXPECT_NEAR(motion_of(still, rig.skeleton, 2).scaling, 0.5, 1e-9);
  EXPECT_THROW(motion_of(rig.clip, rig.skeleton, 0), InputError);
}

TEST(Motion, MovesWithASimilarity) {
  const AnimatedFigure rig(8);
  const Motion motion = motion_of(rig.clip, rig.skeleton, 3);
  Similarity similarity;
  similarity.scale = 0.7;
  similarity.rotation = Eigen::AngleAxisd(0.8, Vector3d(1, 2, -1).normalized()).toRotationMatrix();
  similarity.translation = {1, 2, 3};
  const Motion moved = transformed(similarity, motion);
  for (std::size_t f = 0; f < 3; ++f) {
    for (std::size_t j = 0; j < motion.joints.size(); ++j)
      EXPECT_LT((places(moved, f)[j] - similarity(places(motion, f)[j])).norm(), 1e-9);
  }
}

}  // namespace

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

eval::PairSettings quick_motion() {
  eval::PairSettings settings;
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
  const eval::PairResult result = eval::evaluate_pair(test::rigged_walker(), truth, quick_motion());
  EXPECT_NEAR(result.value("motion_distance"), 0.0, 1e-6);
  EXPECT_NEAR(result.value("motion_distance_rest"), 0.0, 1e-6);
  EXPECT_EQ(result.details["motion"]["clip"], "nod");
  EXPECT_EQ(result.details["motion"]["distance"], "vertices");
  EXPECT_EQ(result.values.count("j2j"), 0u);

  // Other faces, so surfaces are compared and not vertices.
  io::RiggedShape other = test::rigged_walker();
  std::swap(other.mesh.faces.front(), other.mesh.faces.back());
  const eval::PairResult surfaces = eval::evaluate_pair(other, truth, quick_motion());
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
  EXPECT_EQ(eval::evaluate_pair(predicted, truth, quick_motion()).not_computed.at("motion_distance"),
            "the prediction has no skin weights");
  predicted = truth;
  predicted.mesh.faces.clear();
  EXPECT_EQ(eval::evaluate_pair(predicted, truth, quick_motion()).not_computed.at("motion_distance"),
            "the prediction has no faces");
}

TEST(MotionFile, ReadsClipsByNameAndNumber) {
  const test::TemporaryFolder folder;
  Asset asset = io::to_asset(test::rigged_walker());
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
  eval::EvaluationRequest request;
  request.predictions = {(folder / "same").string(), "none=" + (folder / "none").string()};
  test::write_glb(folder / "none" / "b.glb", {});
  request.truth = folder / "truth";
  request.out = folder / "out";
  request.settings = quick_motion();
  request.settings.motion_frames = 3;
  request.motion = (folder / "walk.bvh").string();
  request.motions_pictured = 1;
  request.pictured = 0;
  const eval::Comparison comparison = eval::run_evaluation(request);
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
  EXPECT_THROW(eval::run_evaluation(request), InputError);
}

}  // namespace

}  // namespace anigen::metrics
