// Clips of a mesh's own joints, in whatever order its file has these.
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <filesystem>
#include <string>
#include <vector>

#include "anigen/core/files.h"
#include "anigen/core/numeric.h"
#include "anigen/geometry/primitives.h"
#include "anigen/io/gltf/gltf.h"
#include "anigen/io/rigs/read_assimp.h"
#include "anigen/io/rigs/rig_listing.h"
#include "anigen/rigging/rig_meshes.h"
#include "anigen/rigging/write_rig.h"
#include "tests/support/paths.h"

namespace anigen::rigging {

namespace {

namespace fs = std::filesystem;

constexpr double kClipTimes[] = {0.0, 0.13, 0.4, 0.77, 1.0};

/// Keys at 0, 0.5 and 1 second.
Channel turning(int joint, const Eigen::Vector3d& axis, const std::vector<double>& angles) {
  Channel channel{joint, ChannelPath::kRotation, Interpolation::kLinear, {0.0, 0.5, 1.0}, {}};
  for (const double angle : angles) {
    const Eigen::Quaterniond q(Eigen::AngleAxisd(angle, axis.normalized()));
    channel.values.insert(channel.values.end(), {q.x(), q.y(), q.z(), q.w()});
  }
  return channel;
}

/// Two arms on a spine, depth first as most exporters write them, all axes turned, with two clips.
Asset armed_rig() {
  Skeleton skeleton =
      skeleton_from_joints({{0, 0, 0}, {0, 0, 1}, {0.5, 0, 1.5}, {1, 0, 1.6}, {-0.5, 0.1, 1.5}, {-1, 0.2, 1.6}},
                           {-1, 0, 1, 2, 1, 4}, {"root", "spine", "arm_l", "hand_l", "arm_r", "hand_r"});
  for (std::size_t j = 0; j < skeleton.size(); ++j) {
    const double step = 0.2 * static_cast<double>(j);
    const Eigen::AngleAxisd turn(0.3 + step, Eigen::Vector3d(1, 0.5, step).normalized());
    skeleton.bind[j].topLeftCorner<3, 3>() = turn.toRotationMatrix();
  }
  skeleton.rest = bind_pose(skeleton);
  Asset asset = geometry::skeleton_asset(skeleton);
  asset.name = "armed";
  const Channel step{
      0, ChannelPath::kTranslation, Interpolation::kLinear, {0.0, 0.5, 1.0}, {0, 0, 0, 0.3, 0.2, 0, 0, 0, 0.5}};
  asset.animations = {{"wave", {turning(2, {0, 1, 0.3}, {0.1, 1.3, 0.5}), turning(1, {0, 0, 1}, {0, 0.6, 0}), step}},
                      {"nod", {turning(5, {0.2, 1, 0.3}, {0, -1.2, 0.4}), turning(3, {1, 0, 0}, {0, 0.9, 0})}}};
  return asset;
}

Asset contents_of(const fs::path& file) {
  return io::has_extension(file, {".fbx"}) ? io::read_assimp(file).asset : io::read_gltf(file).asset;
}

/// For each joint of `before` the one of `after` that is bound in its place.
std::vector<int> joints_in_places(const Skeleton& before, const Skeleton& after) {
  const std::vector<Eigen::Vector3d> places = after.positions();
  std::vector<int> joints;
  for (const Eigen::Vector3d& wanted : before.positions()) {
    const auto nearest = std::min_element(places.begin(), places.end(), [&](const auto& a, const auto& b) {
      return (a - wanted).norm() < (b - wanted).norm();
    });
    EXPECT_LT((*nearest - wanted).norm(), 1e-4);
    joints.push_back(static_cast<int>(nearest - places.begin()));
  }
  return joints;
}

void expect_motion_of(const Asset& before, const Asset& after) {
  ASSERT_EQ(after.skeleton.size(), before.skeleton.size());
  ASSERT_EQ(after.animations.size(), before.animations.size());
  EXPECT_EQ(validate(after), std::vector<std::string>());
  const std::vector<int> joints = joints_in_places(before.skeleton, after.skeleton);
  for (std::size_t a = 0; a < before.animations.size(); ++a) {
    const Animation &was = before.animations[a], &is = after.animations[a];
    EXPECT_EQ(is.name, was.name);
    for (const double time : kClipTimes) {
      const auto one = forward_kinematics(before.skeleton.parents, sample(was, before.skeleton, time));
      const auto other = forward_kinematics(after.skeleton.parents, sample(is, after.skeleton, time));
      for (std::size_t j = 0; j < joints.size(); ++j) {
        EXPECT_LT((one[j] - other[at(joints[j])]).cwiseAbs().maxCoeff(), 1e-4)
            << was.name << " at " << time << ", " << before.skeleton.names[j];
      }
    }
  }
}

/// Corners of the faces, whose order stays where a reader numbers vertices anew.
std::vector<Eigen::Vector3f> posed_corners(const Asset& asset, const Animation& clip, double time) {
  const std::vector<Eigen::Vector3f> posed = skin_vertices(asset, sample(clip, asset.skeleton, time));
  std::vector<Eigen::Vector3f> corners;
  for (const Triangle& face : asset.mesh.faces) {
    for (const std::int32_t v : face) corners.push_back(posed[at(v)]);
  }
  return corners;
}

void expect_poses_of(const Asset& before, const Asset& after) {
  ASSERT_EQ(after.animations.size(), before.animations.size());
  for (std::size_t a = 0; a < before.animations.size(); ++a) {
    for (const double time : kClipTimes) {
      const std::vector<Eigen::Vector3f> was = posed_corners(before, before.animations[a], time),
                                         is = posed_corners(after, after.animations[a], time);
      ASSERT_EQ(is.size(), was.size());
      float most = 0.0F;
      for (std::size_t c = 0; c < was.size(); ++c) most = std::max(most, (is[c] - was[c]).norm());
      EXPECT_LT(most, 1e-3F) << before.animations[a].name << " at " << time;
    }
  }
}

class OwnClips : public testing::Test {
 protected:
  OwnClips() {
    io::write_gltf(folder_ / "own.glb", own_);
    request_.meshes = folder_ / "own.glb";
    request_.method = parse_rigging_method("auto", "nearest");
  }

  Asset rigged(const std::string& name) {
    request_.out = folder_ / name;
    const RigReport report = rig_meshes(request_).meshes.at(0);
    EXPECT_EQ(report.failure, "") << name;
    note_ = report.note;
    return contents_of(request_.out);
  }

  bool tells(const std::string& words) const { return note_.find(words) != std::string::npos; }

  test::TemporaryFolder folder_;
  const Asset own_ = armed_rig();
  RigRequest request_;
  std::string note_;
};

// Before, any branch gave joints another order than the file's, and FBX and USD lost all clips without a word.
TEST_F(OwnClips, FollowJointsInAnyOrder) {
  const Asset grafted = rigged("grafted.glb");
  expect_motion_of(own_, grafted);
  EXPECT_EQ(note_, "keeps its own joints");
  request_.graft = false;
  for (const char* const name : {"out.fbx", "out.glb"}) {
    const Asset back = rigged(name);
    EXPECT_EQ(note_, "keeps its own joints") << name;
    expect_motion_of(own_, back);
    expect_poses_of(grafted, back);
    const std::vector<int> joints = joints_in_places(own_.skeleton, back.skeleton);
    for (std::size_t j = 0; j < joints.size(); ++j)
      EXPECT_EQ(back.skeleton.names[at(joints[j])], own_.skeleton.names[j]) << name;
  }
  request_.meshes = folder_ / "out.fbx";
  const Asset again = rigged("again.glb");
  expect_motion_of(own_, again);
  expect_poses_of(grafted, again);
  request_.out = folder_ / "out.usda";
  EXPECT_EQ(rig_meshes(request_).meshes.at(0).failure, "");
  EXPECT_NE(read_file(request_.out).find("SkelAnimation"), std::string::npos);
}

TEST_F(OwnClips, FollowJointsThatGetOtherNames) {
  request_.engine.names = NameStyle::kChain;
  const Asset grafted = rigged("grafted.glb");
  expect_motion_of(own_, grafted);
  EXPECT_EQ(grafted.skeleton.names[0].rfind("chain_", 0), 0U) << grafted.skeleton.names[0];
  request_.graft = false;
  for (const char* const name : {"out.fbx", "out.glb"}) {
    const Asset back = rigged(name);
    EXPECT_EQ(note_, "keeps its own joints") << name;
    expect_motion_of(own_, back);
    expect_poses_of(grafted, back);
    const std::vector<int> joints = joints_in_places(grafted.skeleton, back.skeleton);
    for (std::size_t j = 0; j < joints.size(); ++j)
      EXPECT_EQ(back.skeleton.names[at(joints[j])], grafted.skeleton.names[j]) << name;
  }
}

TEST_F(OwnClips, AreLeftOutWithAWordWhereJointsAreNew) {
  const auto expect_new_joints = [&](const std::string& what) {
    EXPECT_TRUE(rigged("out.fbx").animations.empty()) << what;
    EXPECT_TRUE(tells("2 clips left out: ")) << what << ": " << note_;
    EXPECT_TRUE(tells("new joints in the places of its own")) << what << ": " << note_;
    EXPECT_FALSE(tells("keeps its own joints")) << what << ": " << note_;
    rigged("out.glb");
    EXPECT_TRUE(tells("move no mesh any more")) << what << ": " << note_;
    EXPECT_TRUE(tells("new joints in the places of its own")) << what << ": " << note_;
  };
  request_.engine.height = 1.0;
  expect_new_joints("height");
  request_.engine = {};
  request_.engine.axes = BoneAxes::kAlong;
  expect_new_joints("axes");
  request_.engine = {};
  request_.engine.root_bone = true;  // the nearest bone binds vertices to the root that there is
  expect_new_joints("root bone");
  request_.engine = {};
  request_.edits.joints = 4;
  expect_new_joints("joints");
}

TEST_F(OwnClips, StayWhereTheRootBoneIsThere) {
  request_.engine.root_bone = true;
  request_.learned.bind = [](const io::RiggedShape& shape, const Skeleton&) {
    SkinWeights skin;
    for (std::size_t v = 0; v < shape.mesh.vertices.size(); ++v) skin.append_row({{1, 1.0F}});
    return skin;
  };
  for (const char* const name : {"out.glb", "out.fbx"}) {
    expect_motion_of(own_, rigged(name));
    EXPECT_EQ(note_, "keeps its own joints, has a root bone already") << name;
  }
}

TEST_F(OwnClips, HaveFurtherJointsBehindThem) {
  const io::RiggedShape shape = io::rigged_shape(own_, "own", "own.glb");
  Asset asset = io::to_asset(shape);
  const auto number = [](const Skeleton& skeleton, const std::string& name) {
    return static_cast<int>(std::find(skeleton.names.begin(), skeleton.names.end(), name) - skeleton.names.begin());
  };
  ASSERT_NE(asset.skeleton.names, own_.skeleton.names) << "the order that rigging has";
  asset.skeleton.names.push_back("finger");
  asset.skeleton.parents.push_back(number(asset.skeleton, "hand_l"));
  asset.skeleton.bind.push_back(Eigen::Matrix4d::Identity());
  asset.skeleton.rest.emplace_back();
  const int arm = number(asset.skeleton, "arm_r");
  asset.skin = {};
  for (std::size_t v = 0; v < asset.mesh.vertices.size(); ++v) asset.skin.append_row({{v % 2 == 0 ? arm : 6, 1.0F}});
  RigReport report;
  add_own_clips(shape, asset.skeleton.names, asset, report);
  EXPECT_EQ(report.note, "");
  std::vector<std::string> names = own_.skeleton.names;
  names.push_back("finger");
  EXPECT_EQ(asset.skeleton.names, names);
  EXPECT_EQ(asset.skeleton.parents.back(), 3);
  EXPECT_EQ(asset.skin.row(0)->joint, 4);
  EXPECT_EQ(asset.skin.row(1)->joint, 6);
  EXPECT_EQ(asset.animations.size(), 2U);
}

TEST_F(OwnClips, AreLeftOutWithAWordOfASkeletonAlone) {
  request_.method = parse_rigging_method("auto", "none");
  request_.out = folder_ / "skeleton.glb";
  const RigReport report = rig_meshes(request_).meshes.at(0);
  EXPECT_EQ(report.failure, "");
  EXPECT_NE(report.note.find("2 clips left out: only the skeleton is written"), std::string::npos) << report.note;
}

TEST_F(OwnClips, SayWhatKeepsThemFromOtherJoints) {
  const io::RiggedShape shape = io::rigged_shape(own_, "own", "own.glb");
  const auto note_of = [&](const Asset& changed, const std::vector<std::string>& names) {
    Asset asset = changed;
    RigReport report;
    add_own_clips(shape, names, asset, report);
    EXPECT_TRUE(asset.animations.empty());
    EXPECT_EQ(asset.skeleton.names, changed.skeleton.names);
    return report.note;
  };
  const Asset same = io::to_asset(shape);
  const std::vector<std::string>& names = same.skeleton.names;
  EXPECT_EQ(note_of(same, {}), "2 clips left out: the joints are new");
  Asset moved = same, hung = same;
  moved.skeleton.bind[3](0, 3) += 0.1;
  EXPECT_EQ(note_of(moved, names), "2 clips left out: joints of the file were moved");
  hung.skeleton.parents[5] = 0;
  EXPECT_EQ(note_of(hung, names), "2 clips left out: joints of the file hang on others");
  std::vector<std::string> others = names;
  others[5] = "claw";
  EXPECT_EQ(note_of(same, others), "2 clips left out: joints of the file are not there");
}

}  // namespace

}  // namespace anigen::rigging
