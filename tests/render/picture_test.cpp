#include <gtest/gtest.h>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "anigen/core/error.h"
#include "anigen/core/parallel.h"
#include "anigen/render/picture.h"
#include "tests/render/shapes.h"

namespace anigen::render {

namespace {

using test::sphere;
using test::wall;
using test::wall_with;

/// Unlit, small, straight from the front: what the hand calculations assume.
PictureOptions plain(PictureMode mode) {
  PictureOptions options;
  options.mode = mode;
  options.width = options.height = 128;
  options.view.yaw_degrees = options.view.pitch_degrees = 0.0;
  options.background.reset();
  options.light_weights = options.ambient_occlusion = options.shadows = false;
  return options;
}

std::array<int, 4> pixel(const io::Image& image, int x, int y) {
  const std::uint8_t* p = image.pixel(x, y);
  return {p[0], p[1], p[2], p[3]};
}

void expect_color(const std::array<int, 4>& actual, const Eigen::Vector3f& srgb, int tolerance) {
  for (int c = 0; c < 3; ++c)
    EXPECT_NEAR(actual[static_cast<std::size_t>(c)], 255.0f * srgb[c], tolerance) << "channel " << c;
}

TEST(Picture, SphereCoversItsAnalyticSilhouette) {
  const double radius = 0.7;
  PictureOptions options = plain(PictureMode::kNormals);
  options.width = 200;
  options.height = 160;
  options.samples_per_axis = 4;
  options.view.yaw_degrees = 40;
  options.view.pitch_degrees = 25;
  options.view.distance = 3.0;
  const io::Image image = render(sphere(static_cast<float>(radius)), options);
  double area = 0.0;
  for (std::size_t i = 3; i < image.rgba.size(); i += 4) area += image.rgba[i] / 255.0;
  // A sphere at distance d appears as a disc whose tangent radius is r / sqrt(d² − r²).
  const double tangent = std::tan(0.5 * options.view.fov_degrees * M_PI / 180);
  const double disc = radius / std::sqrt(9.0 - radius * radius) / tangent * 0.5 * options.height;
  EXPECT_NEAR(area / (M_PI * disc * disc), 1.0, 0.005);  // the mesh is a 48 × 96 polyhedron inside the sphere
}

TEST(Picture, FittedObjectStaysInsideThePicture) {
  for (const int width : {60, 128, 240}) {
    PictureOptions options = plain(PictureMode::kNormals);
    options.width = width;
    options.view.yaw_degrees = 123;
    options.view.pitch_degrees = -35;
    options.view.margin = 1.05;
    Asset asset = sphere(2.0f, 12, 24);
    for (Eigen::Vector3f& v : asset.mesh.vertices) v += Eigen::Vector3f(10, -4, 3);
    const io::Image image = render(asset, options);
    int border = 0, inside = 0;
    for (int y = 0; y < image.height; ++y) {
      for (int x = 0; x < image.width; ++x) {
        const bool edge = x == 0 || y == 0 || x == image.width - 1 || y == image.height - 1;
        (edge ? border : inside) += image.pixel(x, y)[3] > 0;
      }
    }
    EXPECT_EQ(border, 0);
    const int side = std::min(image.width, image.height);
    EXPECT_GT(inside, side * side / 2);  // a disc that fills the smaller side covers π/4 of it
  }
}

TEST(Picture, NormalAtTheCentreFacesTheViewer) {
  const Asset asset = sphere(1.0f);
  PictureOptions options = plain(PictureMode::kNormals);
  expect_color(pixel(render(asset, options), 64, 64), {0.5f, 0.0f, 0.5f}, 3);  // −Y
  options.view.yaw_degrees = 90;                                               // counter-clockwise from above: from +X
  expect_color(pixel(render(asset, options), 64, 64), {1.0f, 0.5f, 0.5f}, 3);
  options.view.pitch_degrees = 90;
  expect_color(pixel(render(asset, options), 64, 64), {0.5f, 0.5f, 1.0f}, 3);
}

TEST(Picture, BothSidesAreVisibleAndTurnedTowardsTheViewer) {
  PictureOptions options = plain(PictureMode::kNormals);
  expect_color(pixel(render(wall(), options), 64, 64), {0.5f, 0.0f, 0.5f}, 1);
  options.view.yaw_degrees = 180;
  expect_color(pixel(render(wall(), options), 64, 64), {0.5f, 1.0f, 0.5f}, 1);
}

TEST(Picture, TextureOriginIsTopLeft) {
  // Red, green / blue, white, in the order in which one reads.
  io::Image picture(2, 2);
  const std::array<std::array<int, 3>, 4> colors{{{255, 0, 0}, {0, 255, 0}, {0, 0, 255}, {255, 255, 255}}};
  for (int i = 0; i < 4; ++i) {
    for (std::size_t c = 0; c < 3; ++c)
      picture.pixel(i % 2, i / 2)[c] = static_cast<std::uint8_t>(colors[static_cast<std::size_t>(i)][c]);
  }
  const io::Image image = render(wall_with(picture), plain(PictureMode::kColor));
  const auto brightest = [&](int x, int y) {
    const std::array<int, 4> p = pixel(image, x, y);
    return std::array<bool, 3>{p[0] > 100, p[1] > 100, p[2] > 100};
  };
  // A quarter in from each corner of the wall is the centre of a texel.
  EXPECT_EQ(brightest(35, 35), (std::array<bool, 3>{true, false, false}));
  EXPECT_EQ(brightest(92, 35), (std::array<bool, 3>{false, true, false}));
  EXPECT_EQ(brightest(35, 92), (std::array<bool, 3>{false, false, true}));
  EXPECT_EQ(brightest(92, 92), (std::array<bool, 3>{true, true, true}));
}

TEST(Picture, ColourIsTextureTimesFactorTimesVertexColour) {
  // Ratios of linear values do not depend on the light, which is the same for both pictures.
  const auto linear = [](int value) {
    const double s = value / 255.0;
    return s <= 0.04045 ? s / 12.92 : std::pow((s + 0.055) / 1.055, 2.4);
  };
  Asset white = wall_with(io::Image(4, 4, 0xFFFFFFFFu)), tinted = white;
  white.materials[0].base_color = {0.5f, 0.5f, 0.5f, 1};
  tinted.materials[0].base_color = {0.5f, 0.25f, 0.5f, 1};
  tinted.mesh.colors.assign(4, {0.4f, 1.0f, 1.0f, 1.0f});
  const io::Image a = render(white, plain(PictureMode::kColor)), b = render(tinted, plain(PictureMode::kColor));
  const std::array<double, 3> expected{0.4, 0.5, 1.0};
  for (std::size_t c = 0; c < 3; ++c)
    EXPECT_NEAR(linear(b.pixel(64, 64)[c]) / linear(a.pixel(64, 64)[c]), expected[c], 0.02) << c;
}

TEST(Picture, WeightColoursAtKnownPoints) {
  Asset asset = wall();
  for (int v = 0; v < 4; ++v)
    asset.skin.append_row(v < 2 ? std::vector<Influence>{{3, 1.0f}} : std::vector<Influence>{{7, 1.0f}});
  const io::Image image = render(asset, plain(PictureMode::kWeights));
  // Left edge all joint 3, right edge all joint 7, the middle half of each.
  const Eigen::Vector3f left = joint_color(3), right = joint_color(7);
  int first = 0;
  while (image.pixel(first, 64)[3] < 255) ++first;
  const int last = 127 - first;
  expect_color(pixel(image, first, 64), left, 5);
  expect_color(pixel(image, last, 64), right, 5);
  expect_color(pixel(image, 64, 64), 0.5f * (left + right), 4);
}

TEST(Picture, WeightsCanBeOverriddenAndShownAsHeat) {
  Asset asset = wall();
  SkinWeights prediction;
  for (int v = 0; v < 4; ++v) {
    asset.skin.append_row({{0, 1.0f}});
    prediction.append_row({{1, 0.25f}, {2, 0.75f}});
  }
  PictureOptions options = plain(PictureMode::kWeights);
  options.weights = prediction;
  expect_color(pixel(render(asset, options), 64, 64), 0.25f * joint_color(1) + 0.75f * joint_color(2), 1);
  options.heat_joints = {1};
  expect_color(pixel(render(asset, options), 64, 64), heat_color(0.25f), 1);
  options.heat_joints = {1, 2};
  expect_color(pixel(render(asset, options), 64, 64), heat_color(1.0f), 1);
}

TEST(Picture, PosedVerticesMoveThePicture) {
  const Asset asset = sphere(1.0f, 16, 32);
  PictureOptions options = plain(PictureMode::kNormals);
  options.view.distance = 8.0;
  options.view.fit = Box{{-1, -1, -1}, {1, 1, 1}};
  const io::Image rest = render(asset, options);
  options.vertices = asset.mesh.vertices;
  EXPECT_EQ(render(asset, options).rgba, rest.rgba);
  for (Eigen::Vector3f& v : *options.vertices) v.x() += 1.0f;
  const io::Image moved = render(asset, options);
  EXPECT_EQ(moved.pixel(40, 64)[3], 0);
  EXPECT_EQ(rest.pixel(40, 64)[3], 255);
  // The normal follows the sphere: at its new centre it points at the eye.
  const Camera camera = picture_camera(Scene(asset, options.vertices), options);
  const Eigen::Vector3d center(1, 0, 0), at = camera.project(center);
  const Eigen::Vector3f normal = (camera.eye - center).normalized().cast<float>();
  expect_color(pixel(moved, static_cast<int>(at.x()), static_cast<int>(at.y())),
               0.5f * (normal + Eigen::Vector3f::Ones()), 8);
  options.vertices->pop_back();
  EXPECT_THROW(render(asset, options), InputError);
}

TEST(Picture, PosedNormalsTurnWithTheSurface) {
  // The wall turned by 90° about Z faces +X, and so must the normal that the file gave it.
  Asset asset = wall();
  asset.mesh.normals.assign(4, {0, -1, 0});
  PictureOptions options = plain(PictureMode::kNormals);
  options.view.yaw_degrees = 90;
  options.vertices = asset.mesh.vertices;
  for (Eigen::Vector3f& v : *options.vertices) v = {-v.y(), v.x(), v.z()};
  expect_color(pixel(render(asset, options), 64, 64), {1.0f, 0.5f, 0.5f}, 1);
}

TEST(Picture, BackgroundOpaqueOrTransparent) {
  PictureOptions options = plain(PictureMode::kColor);
  EXPECT_EQ(pixel(render(sphere(1.0f), options), 0, 0)[3], 0);
  EXPECT_EQ(pixel(render(sphere(1.0f), options), 64, 64)[3], 255);
  options.background = Eigen::Vector3f(1.0f, 0.5f, 0.0f);
  expect_color(pixel(render(sphere(1.0f), options), 0, 0), *options.background, 1);
  EXPECT_EQ(pixel(render(sphere(1.0f), options), 0, 0)[3], 255);
}

TEST(Picture, EmptyMeshGivesTheBackground) {
  PictureOptions options = plain(PictureMode::kColor);
  options.background = Eigen::Vector3f(0, 0, 1);
  options.ground_shadow = options.skeleton = options.ambient_occlusion = options.shadows = true;
  for (const PictureMode mode : {PictureMode::kColor, PictureMode::kNormals, PictureMode::kWeights}) {
    options.mode = mode;
    const io::Image image = render(Asset{}, options);
    for (std::size_t i = 0; i < image.rgba.size(); i += 4) {
      ASSERT_EQ(image.rgba[i], 0);
      ASSERT_EQ(image.rgba[i + 2], 255);
    }
  }
}

TEST(Picture, LightShadowsAndOcclusionDarken) {
  // Two spheres, one above the other: the lower one lies in shadow.
  Asset asset = sphere(1.0f, 24, 48);
  const Asset upper = asset;
  const auto offset = static_cast<std::int32_t>(asset.mesh.vertices.size());
  for (std::size_t v = 0; v < upper.mesh.vertices.size(); ++v) {
    asset.mesh.vertices.push_back(upper.mesh.vertices[v] + Eigen::Vector3f(0, 0, 2));
    asset.mesh.normals.push_back(upper.mesh.normals[v]);
  }
  for (const Triangle& face : upper.mesh.faces) {
    asset.mesh.faces.push_back({face[0] + offset, face[1] + offset, face[2] + offset});
  }
  const auto brightness = [&](bool shadows, bool occlusion) {
    PictureOptions options = plain(PictureMode::kColor);
    options.shadows = shadows;
    options.ambient_occlusion = occlusion;
    const io::Image image = render(asset, options);
    double sum = 0;
    for (std::size_t i = 0; i < image.rgba.size(); i += 4) sum += image.rgba[i];
    return sum;
  };
  const double bare = brightness(false, false);
  // The shadow falls on a small cap between the spheres; the occlusion is wider.
  EXPECT_LT(brightness(true, false), 0.998 * bare);
  EXPECT_GT(brightness(true, false), 0.95 * bare);
  EXPECT_LT(brightness(false, true), 0.99 * bare);
}

TEST(Picture, GroundShadowLiesUnderTheObject) {
  PictureOptions options = plain(PictureMode::kColor);
  options.view.pitch_degrees = 30;
  options.view.distance = 8.0;
  options.ground_shadow = true;
  const Asset asset = sphere(1.0f);
  const io::Image image = render(asset, options);
  int shadow = 0;
  for (std::size_t i = 0; i < image.rgba.size(); i += 4) shadow += image.rgba[i + 3] > 20 && image.rgba[i] == 0;
  EXPECT_GT(shadow, 100);
  EXPECT_EQ(image.pixel(2, 2)[3], 0);  // above the horizon of the floor's reach
}

TEST(Picture, TheSameBytesOnAnyNumberOfThreads) {
  Asset asset = sphere(1.0f, 24, 48);
  asset.skeleton = skeleton_from_joints({{0, 0, -0.5}, {0, 0, 0.5}}, {-1, 0});
  PictureOptions options;
  options.width = options.height = 96;
  options.ground_shadow = options.skeleton = true;
  const int before = thread_count();
  set_thread_count(1);
  const io::Image one = render(asset, options);
  set_thread_count(4);
  const io::Image four = render(asset, options);
  set_thread_count(before);
  EXPECT_EQ(one.rgba, four.rgba);
}

TEST(Picture, RefusesMalformedMeshes) {
  const PictureOptions options = plain(PictureMode::kColor);
  Asset nan = sphere(1.0f, 8, 16);
  nan.mesh.vertices[5].z() = std::numeric_limits<float>::quiet_NaN();
  try {
    render(nan, options);
    FAIL() << "a NaN vertex was accepted";
  } catch (const InputError& error) {
    EXPECT_NE(error.place().find("vertices[5]"), std::string::npos) << error.what();
    EXPECT_EQ(error.file(), "sphere");
  }
  Asset index = wall();
  index.mesh.faces[1][2] = 4;
  EXPECT_THROW(render(index, options), InputError);
  Asset uvs = wall();
  uvs.mesh.uvs.pop_back();
  EXPECT_THROW(render(uvs, options), InputError);
  Asset material = wall();
  material.mesh.face_materials = {0, 0};
  EXPECT_THROW(render(material, options), InputError);
  Asset picture = wall_with(io::Image(2, 2));
  picture.images[0].bytes.resize(10);
  EXPECT_THROW(render(picture, options), InputError);
  EXPECT_THROW(render(wall(), plain(PictureMode::kWeights)), InputError);  // no weights at all
}

TEST(Picture, RefusesOptionsOutOfRange) {
  const auto refuses = [](const auto& change) {
    PictureOptions options = plain(PictureMode::kColor);
    change(options);
    EXPECT_THROW(render(wall(), options), InputError);
  };
  refuses([](PictureOptions& o) { o.width = 0; });
  refuses([](PictureOptions& o) { o.height = 1 << 20; });
  refuses([](PictureOptions& o) { o.samples_per_axis = 0; });
  refuses([](PictureOptions& o) { o.view.fov_degrees = 180; });
  refuses([](PictureOptions& o) { o.view.pitch_degrees = NAN; });
  refuses([](PictureOptions& o) { o.view.distance = -1; });
  refuses([](PictureOptions& o) { o.view.fit = Box{{NAN, 0, 0}, {1, 1, 1}}; });
  refuses([](PictureOptions& o) { o.background = Eigen::Vector3f(NAN, 0, 0); });
  refuses([](PictureOptions& o) {
    o.skeleton = true;
    o.skeleton_style.thickness = 0;
  });
  refuses([](PictureOptions& o) {
    o.skeleton = true;
    o.joints = std::vector<Eigen::Vector3d>{{0, 0, 0}};
    o.parents = std::vector<int>{5};
  });
}

}  // namespace

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

}  // namespace anigen::render
