#include "anigen/motions/retargeted.h"

#include <gtest/gtest.h>
#include <algorithm>
#include <cmath>
#include <fstream>
#include <limits>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/motions/contact.h"
#include "anigen/motions/gaits.h"
#include "tests/motions/made_bodies.h"
#include "tests/support/paths.h"

namespace anigen::motions {

namespace {

/// A clip as a motion that came out of a file.
SourceClip as_source(const Asset& asset, const BodyMotion& motion, int frames) {
  return {metrics::motion_of(to_clip(motion, asset.skeleton), asset.skeleton, frames), analyse(asset)};
}

/// A biped of twice the size with arms bound downwards.
Asset tall_biped() {
  Asset asset = test::made_biped();
  const Body body = analyse(asset);
  Poser poser(body);
  lower_arms(poser);
  const JointMotions lowered = poser.motions();
  std::vector<Eigen::Vector3d> places = asset.skeleton.positions();
  for (std::size_t j = 0; j < places.size(); ++j) places[j] = 2.0 * lowered[j](places[j]);
  for (std::size_t v = 0; v < asset.mesh.vertices.size(); ++v) {
    const int joint = asset.skin.row(v)[0].joint;
    asset.mesh.vertices[v] = (2.0 * lowered[at(joint)](asset.mesh.vertices[v].cast<double>())).cast<float>();
  }
  asset.skeleton = skeleton_from_joints(places, asset.skeleton.parents, asset.skeleton.names);
  return asset;
}

TEST(Retargeting, LimbToLimbKeepsDirectionsAcrossBindPoses) {
  const Asset source = test::made_biped(), target = tall_biped();
  const Body source_body = analyse(source), body = analyse(target);
  const BodyMotion walk = make_motion(source_body, "walk");
  const Retargeted moved = retarget_to(body, as_source(source, walk, static_cast<int>(walk.times.size())));
  EXPECT_TRUE(moved.by_limbs);
  ASSERT_EQ(moved.motion.poses.size(), walk.poses.size());
  for (std::size_t f = 0; f < walk.poses.size(); f += 5) {
    for (const int i : body.of_kind(LimbKind::kArm)) {
      // Limbs come in one order for both: they have the same names and sides.
      const Limb &arm = body.limbs[at(i)], &other = source_body.limbs[at(i)];
      const auto upper = [f](const Body& of, const Limb& limb, const BodyMotion& motion) {
        const auto place = [&](int joint) { return motion.poses[f][at(joint)](of.figure.tree.positions[at(joint)]); };
        return Eigen::Vector3d((place(limb.joints[1]) - place(limb.joints[0])).normalized());
      };
      EXPECT_LT((upper(body, arm, moved.motion) - upper(source_body, other, walk)).norm(), 1e-6);
    }
  }
}

TEST(Retargeting, StandingFeetStayWhereTheyStand) {
  const Asset source = test::made_biped(), target = tall_biped();
  const Body body = analyse(target);
  MotionOptions options;
  options.travel = true;  // feet of a walk that goes somewhere stand still
  const BodyMotion walk = make_motion(analyse(source), "walk", options);
  const Retargeted moved = retarget_to(body, as_source(source, walk, static_cast<int>(walk.times.size())));
  EXPECT_GT(moved.standing, walk.times.size() / 2);
  EXPECT_LT(foot_slide(body, moved.motion, to_clip(moved.motion, target.skeleton), target.skeleton), 0.01);
}

TEST(Retargeting, TurnsTheSourceToFaceAsTheBodyDoes) {
  const Asset asset = test::made_biped();
  const Body body = analyse(asset);
  MotionOptions options;
  options.travel = true;
  metrics::Similarity quarter;
  quarter.rotation = Eigen::AngleAxisd(0.5 * kPi, Eigen::Vector3d::UnitZ()).toRotationMatrix();
  const metrics::Motion turned =
      metrics::transformed(quarter, as_source(asset, make_motion(body, "walk", options), 30).motion);
  const BodyMotion moved = retarget_to(body, source_clip(turned, asset.skeleton.names)).motion;
  const Eigen::Vector3d way = moved.poses.back()[0].shift - moved.poses.front()[0].shift;
  EXPECT_GT(way.dot(body.figure.forward), 0.9 * way.norm());
}

TEST(Retargeting, OtherBodiesTakeItByTransport) {
  const Asset source = test::made_biped(), target = test::made_quadruped();
  const BodyMotion walk = make_motion(analyse(source), "walk");
  const Retargeted moved = retarget_to(analyse(target), as_source(source, walk, 10));
  EXPECT_FALSE(moved.by_limbs);
  EXPECT_EQ(moved.motion.poses.size(), 10U);
  Asset animated = target;
  animated.animations = {to_clip(moved.motion, target.skeleton)};
  EXPECT_TRUE(validate(animated).empty());
}

TEST(Retargeting, NothingSinksBelowTheGround) {
  const Asset source = test::made_biped(), target = test::made_quadruped();
  SourceClip clip = as_source(source, make_motion(analyse(source), "walk"), 10);
  for (std::size_t f = 5; f < clip.motion.frames.size(); ++f) {
    for (Eigen::Vector3d& shift : clip.motion.frames[f].shifts) shift.z() -= clip.body.figure.height;
  }
  const Body body = analyse(target);
  const Retargeted moved = retarget_to(body, clip);
  EXPECT_GT(moved.raised, 0.1);
  double lowest = std::numeric_limits<double>::infinity();
  for (const JointMotions& pose : moved.motion.poses) {
    for (std::size_t v = 0; v < target.mesh.vertices.size(); ++v) {
      const auto joint = at(target.skin.row(v)[0].joint);
      lowest = std::min(lowest, pose[joint](target.mesh.vertices[v].cast<double>()).z());
    }
  }
  EXPECT_NEAR(lowest, body.figure.box.low.z(), 1e-5 * body.figure.height);
}

TEST(Retargeting, ClipsAreReadAtTheirOwnLength) {
  const test::TemporaryFolder folder;
  std::ofstream(folder / "turn.bvh")
      << "HIERARCHY\nROOT hip\n{\nOFFSET 0 0 0\nCHANNELS 1 Xrotation\nJOINT foot\n{\nOFFSET 0 -1 0\n}\n}\nMOTION\n"
         "Frames: 3\nFrame Time: 0.5\n0\n90\n0\n";
  const SourceClip clip = read_clip((folder / "turn.bvh").string(), {});
  EXPECT_EQ(clip.motion.frames.size(), 31U);  // one second at 30 frames
  EXPECT_THROW(read_clip((folder / "none.bvh").string(), {}), InputError);
}

}  // namespace

}  // namespace anigen::motions
