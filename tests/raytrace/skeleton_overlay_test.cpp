#include "anigen/raytrace/skeleton_overlay.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "anigen/core/error.h"
#include "anigen/raytrace/picture.h"
#include "tests/raytrace/shapes.h"

namespace anigen::raytrace {
namespace {

Camera front_camera(int size) {
  Orbit orbit;
  orbit.yaw_degrees = orbit.pitch_degrees = 0;
  return orbit_camera(orbit, {}, size, size);
}

TEST(SkeletonOverlay, DrawsOverThePictureWhereTheBoneIs) {
  Asset asset = test::sphere(1.0f, 24, 48);
  asset.skeleton = skeleton_from_joints({{0, 0, -0.6}, {0, 0, 0.6}}, {-1, 0});
  PictureOptions options;
  options.view.yaw_degrees = options.view.pitch_degrees = 0;
  options.width = options.height = 256;
  const io::Image bare = render(asset, options);
  options.skeleton = true;
  const io::Image drawn = render(asset, options);
  int changed = 0, off_axis = 0;
  for (int y = 0; y < 256; ++y) {
    for (int x = 0; x < 256; ++x) {
      const bool differs = !std::equal(bare.pixel(x, y), bare.pixel(x, y) + 4, drawn.pixel(x, y));
      changed += differs;
      off_axis += differs && std::abs(x - 127.5) > 8;
    }
  }
  EXPECT_GT(changed, 150);
  EXPECT_EQ(off_axis, 0);
  // The middle of the bone has the bone's colour.
  EXPECT_NEAR(drawn.pixel(128, 128)[0], 255 * options.skeleton_style.bone.x(), 2);
  EXPECT_NEAR(drawn.pixel(128, 128)[2], 255 * options.skeleton_style.bone.z(), 2);
}

TEST(SkeletonOverlay, StandsOutOnWhiteAndOnBlack) {
  const Camera camera = front_camera(128);
  for (const std::uint32_t fill : {0xFFFFFFFFu, 0x000000FFu}) {
    io::Image image(128, 128, fill);
    const int ground = image.pixel(0, 0)[1];
    draw_skeleton(image, camera, {{0, 0, -0.4}, {0, 0, 0.4}}, {-1, 0});
    int darkest = 255, brightest = 0;
    for (int x = 0; x < 128; ++x) {
      darkest = std::min<int>(darkest, image.pixel(x, 64)[1]);
      brightest = std::max<int>(brightest, image.pixel(x, 64)[1]);
    }
    EXPECT_GT(std::max(brightest - ground, ground - darkest), 100) << std::hex << fill;
  }
}

TEST(SkeletonOverlay, TapersFromParentToChild) {
  io::Image image(256, 256, 0xFFFFFFFFu);
  draw_skeleton(image, front_camera(256), {{0, 0, -0.4}, {0, 0, 0.4}}, {-1, 0});
  const auto width = [&](int y) {
    int count = 0;
    for (int x = 0; x < 256; ++x) count += image.pixel(x, y)[2] < 200;
    return count;
  };
  EXPECT_GT(width(180), width(76));  // the parent is below
}

TEST(SkeletonOverlay, MakesTransparentPicturesOpaqueWhereItDraws) {
  io::Image image(64, 64, 0);
  draw_skeleton(image, front_camera(64), {{0, 0, 0}}, {-1});
  EXPECT_EQ(image.pixel(32, 32)[3], 255);
  EXPECT_EQ(image.pixel(2, 2)[3], 0);
}

TEST(SkeletonOverlay, LeavesOutWhatIsBehindTheCamera) {
  io::Image image(64, 64, 0);
  const io::Image before = image;
  draw_skeleton(image, front_camera(64), {{0, -1e3, 0}, {0, -2e3, 0.1}}, {-1, 0});
  EXPECT_EQ(image.rgba, before.rgba);
}

TEST(SkeletonOverlay, BonesSkipJointsThatAreNotShown) {
  // A detour to the right between two joints on the vertical; without it the bone is straight.
  const std::vector<Eigen::Vector3d> joints{{0, 0, -0.4}, {0.4, 0, 0}, {0, 0, 0.4}};
  io::Image detour(128, 128), straight(128, 128), two(128, 128);
  draw_skeleton(detour, front_camera(128), joints, {-1, 0, 1});
  draw_skeleton(straight, front_camera(128), joints, {-1, 0, 1}, {}, {true, false, true});
  draw_skeleton(two, front_camera(128), {joints[0], joints[2]}, {-1, 0});
  EXPECT_NE(detour.rgba, straight.rgba);
  EXPECT_EQ(straight.rgba, two.rgba);
  io::Image circle(8, 8);
  draw_skeleton(circle, front_camera(8), joints, {2, 0, 1}, {}, {true, false, false});  // ends
  EXPECT_THROW(draw_skeleton(circle, front_camera(8), joints, {-1, 0, 1}, {}, {true}), InputError);
}

TEST(SkeletonOverlay, RefusesBadSkeletons) {
  io::Image image(8, 8);
  const Camera camera = front_camera(8);
  EXPECT_THROW(draw_skeleton(image, camera, {{0, 0, 0}}, {}), InputError);
  EXPECT_THROW(draw_skeleton(image, camera, {{0, 0, 0}}, {1}), InputError);
  EXPECT_THROW(draw_skeleton(image, camera, {{0, NAN, 0}}, {-1}), InputError);
}

}  // namespace
}  // namespace anigen::raytrace
