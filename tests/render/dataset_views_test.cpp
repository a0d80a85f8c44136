#include <gtest/gtest.h>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>

#include "anigen/core/error.h"
#include "anigen/core/parallel.h"
#include "anigen/io/arrays/npz.h"
#include "anigen/render/dataset_views.h"
#include "anigen/render/shading.h"
#include "tests/render/shapes.h"
#include "tests/render/views_support.h"
#include "tests/support/paths.h"

namespace anigen::render {

namespace {

using test::frame_at;

ViewImages view_of(const Asset& asset, const Frame& frame, int size) {
  ViewOptions options;
  options.size = size;
  options.geometry = options.mean_normal = true;
  return render_view(Scene(asset), frame, options);
}

std::array<int, 4> encoded_pixel(const io::Image& image, int x, int y) {
  const std::uint8_t* p = image.pixel(x, y);
  return {p[0], p[1], p[2], p[3]};
}

TEST(ViewEncoding, WorldNormalsAsColours) {
  const Asset wall = test::wall();
  const io::Image image = encode_world_normals(view_of(wall, frame_at(-90, 0, 6.0), 32));
  EXPECT_EQ(encoded_pixel(image, 16, 16), (std::array<int, 4>{128, 0, 128, 255}));  // −Y
  EXPECT_EQ(encoded_pixel(image, 0, 0), (std::array<int, 4>{0, 0, 0, 0}));
}

TEST(ViewEncoding, ConditionNormalsAreThoseOfTheViewersFrame) {
  // Square to the camera from any side: (127, 127, 255).
  for (const double yaw : {-90.0, 90.0}) {
    const Frame frame = frame_at(yaw, 0, 6.0);
    EXPECT_EQ(encoded_pixel(encode_condition_normals(view_of(test::wall(), frame, 32), frame), 16, 16),
              (std::array<int, 4>{127, 127, 255, 255}));
  }
  // A sphere: red grows to the right, green upwards, whatever the camera; blue is largest in the middle.
  const Asset sphere = test::sphere(0.5f);
  for (const auto& [yaw, pitch] : {std::pair{20.0, 10.0}, std::pair{200.0, -60.0}}) {
    const Frame frame = frame_at(yaw, pitch);
    const io::Image image = encode_condition_normals(view_of(sphere, frame, 64), frame);
    EXPECT_GT(encoded_pixel(image, 46, 32)[0], 180);
    EXPECT_LT(encoded_pixel(image, 18, 32)[0], 75);
    EXPECT_GT(encoded_pixel(image, 32, 18)[1], 180);
    EXPECT_LT(encoded_pixel(image, 32, 46)[1], 75);
    EXPECT_GT(encoded_pixel(image, 32, 32)[2], 250);
  }
}

TEST(ViewEncoding, ConditionNormalsHaveTheAlphaOfTheColours) {
  const Asset sphere = test::sphere(0.5f);
  const Frame frame = frame_at(0, 0);
  const ViewImages view = view_of(sphere, frame, 64);
  const io::Image image = encode_condition_normals(view, frame);
  int partial = 0;
  for (std::size_t i = 0; i < view.coverage.size(); ++i) {
    ASSERT_EQ(image.rgba[4 * i + 3], view.color.rgba[4 * i + 3]);
    const bool edge = image.rgba[4 * i + 3] > 0 && image.rgba[4 * i + 3] < 255;
    partial += edge;
    // Straight alpha: at the silhouette the normals are perpendicular to the view, not faded.
    ASSERT_LT(edge ? image.rgba[4 * i + 2] : 0, 190);
  }
  EXPECT_GT(partial, 40);
}

TEST(ViewEncoding, DepthSurvivesThePictureToHalfAStep) {
  const ViewImages view = view_of(test::sphere(0.5f), frame_at(0, 0), 40);
  int width = 0, height = 0;
  const std::vector<float> depth = decode_depth_png(encode_depth_png(view), "depth.png", width, height);
  ASSERT_EQ(width, 40);
  ASSERT_EQ(height, 40);
  for (std::size_t i = 0; i < depth.size(); ++i) {
    ASSERT_NEAR(depth[i], view.depth[i], 0.5 / kDepthUnits + 1e-6);
    ASSERT_EQ(depth[i] > 0.0f, view.mask[i] == 1);
  }
}

TEST(ViewEncoding, DepthsBeyondSixteenBitsAreRefused) {
  ViewImages view = view_of(test::sphere(0.5f), frame_at(0, 0), 8);
  view.depth[9] = 13.2f;
  EXPECT_THROW(encode_depth_png(view), InputError);
  view.depth[9] = std::nanf("");
  EXPECT_THROW(encode_depth_png(view), InputError);
}

TEST(ViewEncoding, DamagedDepthPicturesAreRefused) {
  const std::vector<std::uint8_t> good = encode_depth_png(view_of(test::sphere(0.5f), frame_at(0, 0), 40));
  int width = 0, height = 0;
  for (const std::size_t length : {std::size_t{0}, std::size_t{7}, std::size_t{30}, good.size() / 2}) {
    EXPECT_THROW(
        decode_depth_png({good.begin(), good.begin() + static_cast<std::ptrdiff_t>(length)}, "x", width, height),
        InputError)
        << length;
  }
  EXPECT_THROW(decode_depth_png(io::encode_png(io::Image(4, 4)), "colour.png", width, height), InputError);
}

TEST(ViewEncoding, ArraysHoldTheExactNumbers) {
  test::TemporaryFolder folder;
  const ViewImages view = view_of(test::sphere(0.5f), frame_at(0, 0), 12);
  io::write_npz(folder / "view.npz", view_arrays(view));
  const io::NamedArrays arrays = io::read_npz(folder / "view.npz");
  ASSERT_NE(io::find(arrays, "depth"), nullptr);
  EXPECT_EQ(io::find(arrays, "depth")->as<float>(), view.depth);
  EXPECT_EQ(io::find(arrays, "normal")->shape, (std::vector<std::int64_t>{12, 12, 3}));
  EXPECT_EQ(io::find(arrays, "mask")->dtype, io::Dtype::kU8);
  EXPECT_EQ(io::find(arrays, "face"), nullptr);  // not asked for
}

TEST(ViewEncoding, MissingChannelsAreNamed) {
  ViewOptions options;
  options.size = 8;
  const ViewImages view = render_view(Scene(test::cube()), frame_at(0, 0), options);
  EXPECT_THROW(encode_world_normals(view), InputError);
  EXPECT_THROW(encode_condition_normals(view, frame_at(0, 0)), InputError);
  EXPECT_THROW(encode_depth_png(view), InputError);
  EXPECT_TRUE(view_arrays(view).empty());
}

}  // namespace

namespace {

using test::cube;
using test::frame_at;

ViewOptions everything(int size) {
  ViewOptions options;
  options.size = size;
  options.mean_normal = options.geometry = options.visibility = true;
  return options;
}

std::size_t pixel_at(int x, int y, int size) { return static_cast<std::size_t>(y * size + x); }

TEST(RenderView, CubeSeenSquareHasItsAnalyticMaskDepthAndNormal) {
  const Asset asset = cube();
  ViewOptions options = everything(64);
  options.flat_normals = true;
  const ViewImages view = render_view(Scene(asset), frame_at(0, 0), options);
  // The near face x = 0.5 is at depth 1.5; its half side 0.5 covers this many pixels from the centre.
  const double reach = 32.0 * 0.5 / 1.5 / std::tan(M_PI / 9);
  for (int y = 0; y < 64; ++y) {
    for (int x = 0; x < 64; ++x) {
      const std::size_t i = pixel_at(x, y, 64);
      const bool inside = std::max(std::abs(x + 0.5 - 32), std::abs(y + 0.5 - 32)) < reach;
      ASSERT_EQ(view.mask[i], inside ? 1 : 0) << x << ", " << y;
      ASSERT_NEAR(view.depth[i], inside ? 1.5 : 0.0, 1e-5);
      ASSERT_LT((view.normal[i] - Eigen::Vector3f(inside ? 1.0f : 0.0f, 0, 0)).norm(), 1e-6f);
      ASSERT_EQ(view.face[i] >= 0, inside);
      if (inside) {
        ASSERT_LE(view.face[i], 1);
        // The point that the barycentrics name projects to the pixel's centre.
        Eigen::Vector3d point = Eigen::Vector3d::Zero();
        for (std::size_t k = 0; k < 3; ++k) {
          const auto corner = asset.mesh.faces[static_cast<std::size_t>(view.face[i])][k];
          point += view.barycentric[i][static_cast<Eigen::Index>(k)] *
                   asset.mesh.vertices[static_cast<std::size_t>(corner)].cast<double>();
        }
        const Eigen::Vector3d pixel = view_camera(frame_at(0, 0), 64).project(point);
        ASSERT_LT((pixel - Eigen::Vector3d(x + 0.5, y + 0.5, 1.5)).norm(), 1e-3);
      }
    }
  }
}

TEST(RenderView, SphereHasItsAnalyticDepthNormalAndArea) {
  const Asset asset = test::sphere(0.5f, 128, 256);
  const Frame frame = frame_at(35, 20);
  const ViewImages view = render_view(Scene(asset), frame, everything(96));
  const Camera camera = view_camera(frame, 96);
  int compared = 0;
  for (int y = 0; y < 96; ++y) {
    for (int x = 0; x < 96; ++x) {
      const Eigen::Vector3d ray = camera.ray(x + 0.5, y + 0.5);
      // |eye + t · ray| = 0.5
      const double a = ray.squaredNorm(), b = camera.eye.dot(ray), c = camera.eye.squaredNorm() - 0.25;
      const double inside = b * b - a * c;
      const std::size_t i = pixel_at(x, y, 96);
      if (inside < 0.05) continue;  // where the surface turns away, the polyhedron differs visibly
      const double depth = (-b - std::sqrt(inside)) / a;
      const Eigen::Vector3d normal = (camera.eye + depth * ray) / 0.5;
      ASSERT_EQ(view.mask[i], 1);
      ASSERT_NEAR(view.depth[i], depth, 5e-4);
      ASSERT_GT(view.normal[i].cast<double>().dot(normal), 0.9999);
      ++compared;
    }
  }
  EXPECT_GT(compared, 1500);
  const double radius = 48.0 * 0.5 / std::sqrt(4.0 - 0.25) / std::tan(M_PI / 9);
  const double area = std::accumulate(view.coverage.begin(), view.coverage.end(), 0.0);
  EXPECT_NEAR(area / (M_PI * radius * radius), 1.0, 0.005);
}

TEST(RenderView, EdgesAreAveragedAndAlphaIsStraight) {
  const Asset asset = cube();
  ViewOptions options = everything(64);
  options.samples_per_axis = 4;
  options.shadows = false;
  const ViewImages view = render_view(Scene(asset), frame_at(0, 0), options);
  const double side = 64.0 * 0.5 / 1.5 / std::tan(M_PI / 9);
  EXPECT_NEAR(std::accumulate(view.coverage.begin(), view.coverage.end(), 0.0), side * side, 0.02 * side * side);
  int partial = 0;
  for (std::size_t i = 0; i < view.coverage.size(); ++i) {
    ASSERT_EQ(view.color.rgba[4 * i + 3], std::lround(255.0f * view.coverage[i]));
    partial += view.coverage[i] > 0.0f && view.coverage[i] < 1.0f;
  }
  EXPECT_GT(partial, 200);
  // Seen square, a pixel at the border has the colour of its neighbour inside, however little of it is covered.
  const double reach = 32.0 * 0.5 / 1.5 / std::tan(M_PI / 9);
  const int border = 32 + static_cast<int>(reach);
  ASSERT_LT(view.coverage[pixel_at(border, 20, 64)], 1.0f);
  ASSERT_GT(view.coverage[pixel_at(border, 20, 64)], 0.0f);
  for (int c = 0; c < 3; ++c) EXPECT_NEAR(view.color.pixel(border, 20)[c], view.color.pixel(border - 1, 20)[c], 2);
}

TEST(RenderView, CentresDoNotDependOnTheNumberOfSamples) {
  const Asset asset = test::sphere(0.5f, 24, 48);
  const Scene scene(asset);
  ViewOptions options = everything(30);  // no multiple of a tile
  const ViewImages two = render_view(scene, frame_at(10, 10), options);
  options.samples_per_axis = 3;
  const ViewImages three = render_view(scene, frame_at(10, 10), options);
  options.color = options.mean_normal = false;
  const ViewImages bare = render_view(scene, frame_at(10, 10), options);
  EXPECT_EQ(two.depth, three.depth);
  EXPECT_EQ(two.face, bare.face);
  EXPECT_EQ(three.mask, bare.mask);
  EXPECT_TRUE(bare.color.rgba.empty());
  EXPECT_TRUE(bare.coverage.empty());
  EXPECT_EQ(bare.depth.size(), 900u);
}

TEST(RenderView, LightComesFromAboveAndStandsStillInTheWorld) {
  const Asset asset = test::sphere(0.5f);
  const Scene scene(asset);
  ViewOptions options;
  options.size = 64;
  const auto centre = [&](double yaw, double pitch) {
    return static_cast<int>(render_view(scene, frame_at(yaw, pitch), options).color.pixel(32, 32)[1]);
  };
  EXPECT_GT(centre(0, 80), centre(0, -80) + 60);
  const double key_yaw = std::atan2(1.0, 4.0) * 180.0 / M_PI;
  EXPECT_GT(centre(key_yaw, 20), centre(key_yaw + 180, 20) + 15);
  EXPECT_LT(centre(0, 80), 255);  // not burnt out
}

TEST(RenderView, ObjectsCastShadowsOnThemselves) {
  // A roof over a floor, on the way from the floor's middle to the key light.
  Asset asset = cube();
  for (Eigen::Vector3f& v : asset.mesh.vertices) v = Eigen::Vector3f(v.x(), v.y(), 0.02f * v.z() - 0.2f);
  const std::size_t first = asset.mesh.vertices.size();
  for (const Eigen::Vector3f& v : cube().mesh.vertices)
    asset.mesh.vertices.push_back(0.2f * v + Eigen::Vector3f(0.32f, 0.08f, 0.3f));
  for (const Triangle& face : cube().mesh.faces) {
    Triangle moved = face;
    for (std::int32_t& index : moved) index += static_cast<std::int32_t>(first);
    asset.mesh.faces.push_back(moved);
  }
  const Scene scene(asset);
  ViewOptions options;
  options.size = 65;
  const Frame above = frame_at(180, 89);
  const int lit = render_view(scene, frame_at(180, 60),
                              [&] {
                                ViewOptions bare = options;
                                bare.shadows = false;
                                return bare;
                              }())
                      .color.pixel(32, 37)[1];
  const int shadowed = render_view(scene, frame_at(180, 60), options).color.pixel(32, 37)[1];
  EXPECT_LT(shadowed, lit - 30);
  EXPECT_EQ(render_view(scene, above, options).color.pixel(32, 32)[3], 255);
}

/// A wall whose texture is opaque only where u ≥ 0.5, before a plain one.
Asset torn_wall(std::uint8_t alpha_left) {
  io::Image picture(64, 64, 0xFF0000FFu);
  for (int y = 0; y < 64; ++y) {
    for (int x = 0; x < 32; ++x) picture.pixel(x, y)[3] = alpha_left;
  }
  Asset asset = test::wall_with(picture);
  for (int k = 0; k < 4; ++k) {
    asset.mesh.vertices.push_back(asset.mesh.vertices[static_cast<std::size_t>(k)] + Eigen::Vector3f(0, 1, 0));
    asset.mesh.uvs.push_back({0, 0});
  }
  asset.mesh.faces.push_back({4, 5, 6});
  asset.mesh.faces.push_back({4, 6, 7});
  asset.mesh.face_materials = {0, 0, -1, -1};
  return asset;
}

TEST(RenderView, TransparentTexelsArePassedThrough) {
  const Frame front = frame_at(-90, 0, 4.0);
  ViewOptions options = everything(48);
  const auto depth = [&](const Asset& asset, float cutoff, int x) {
    const Scene scene(asset);
    return ViewRenderer(scene, cutoff).render(front, options).depth[pixel_at(x, 24, 48)];
  };
  EXPECT_NEAR(depth(torn_wall(0), 0.5f, 15), 5.0, 1e-4);    // through the hole
  EXPECT_NEAR(depth(torn_wall(0), 0.5f, 32), 4.0, 1e-4);    // the red half
  EXPECT_NEAR(depth(torn_wall(120), 0.5f, 15), 5.0, 1e-4);  // 120 / 255 < 0.5
  EXPECT_NEAR(depth(torn_wall(135), 0.5f, 15), 4.0, 1e-4);
  EXPECT_NEAR(depth(torn_wall(0), 0.0f, 15), 4.0, 1e-4);  // holes switched off

  const Asset asset = torn_wall(0);
  const ViewImages view = render_view(Scene(asset), front, options);
  EXPECT_GT(view.color.pixel(32, 24)[0], view.color.pixel(32, 24)[1] + 80);  // red
  EXPECT_NEAR(view.color.pixel(15, 24)[0], view.color.pixel(15, 24)[1], 2);  // grey, from behind
}

TEST(RenderView, AlphaThatWouldEraseAMaterialIsIgnored) {
  Asset asset = torn_wall(0);
  for (Eigen::Vector2f& uv : asset.mesh.uvs) uv.x() *= 0.45f;  // the whole wall lies in the transparent half
  const Scene scene(asset);
  const ViewImages view = render_view(scene, frame_at(-90, 0, 4.0), everything(48));
  EXPECT_NEAR(view.depth[pixel_at(15, 24, 48)], 4.0, 1e-4);
  EXPECT_NEAR(view.depth[pixel_at(32, 24, 48)], 4.0, 1e-4);
}

TEST(Cutout, LightPassesThroughHoles) {
  const Asset asset = torn_wall(0);
  const Scene scene(asset);
  const SurfaceColor colors(scene, {});
  const Cutout holes(scene, colors, 0.5f);
  const Eigen::Vector3f towards(0, -1, 0);
  EXPECT_FALSE(holes.occluded({-0.5f, 0.5f, 0.0f}, towards, 10.0f));
  EXPECT_TRUE(holes.occluded({0.5f, 0.5f, 0.0f}, towards, 10.0f));
  EXPECT_FALSE(holes.occluded({0.5f, 0.5f, 0.0f}, towards, 0.25f));  // the wall is farther away
}

TEST(Cutout, MaterialsThatSayWhatAlphaMeansAreTakenAtTheirWord) {
  Asset asset = torn_wall(0);
  const auto is_hole = [&](float x) {
    const Scene scene(asset);
    const SurfaceColor colors(scene, {});
    return !Cutout(scene, colors, 0.5f).occluded({x, 0.5f, 0.0f}, {0, -1, 0}, 10.0f);
  };
  EXPECT_TRUE(is_hole(-0.5f)) << "nobody knows, and half of the wall remains";
  Material& material = asset.materials[0];
  material.alpha_mode = AlphaMode::kOpaque;
  EXPECT_FALSE(is_hole(-0.5f));
  material.alpha_mode = AlphaMode::kMask;
  EXPECT_TRUE(is_hole(-0.5f));
  EXPECT_FALSE(is_hole(0.5f));
  material.alpha_cutoff = 0.0f;
  EXPECT_FALSE(is_hole(-0.5f)) << "no alpha is below 0";
  material.alpha_cutoff = 0.5f;
  material.base_color.w() = 0.25f;
  EXPECT_TRUE(is_hole(0.5f)) << "the factor counts";
  material.base_color.w() = 1.0f;
  for (Eigen::Vector2f& uv : asset.mesh.uvs) uv.x() *= 0.45f;  // the whole wall lies in the transparent half
  EXPECT_TRUE(is_hole(0.5f)) << "a mask may take all of it";
  material.alpha_mode = AlphaMode::kBlend;
  EXPECT_FALSE(is_hole(0.5f)) << "glass stays";
}

TEST(RenderView, TheSameBytesOnAnyNumberOfThreads) {
  const Asset asset = torn_wall(0);
  const Scene scene(asset);
  ViewOptions options = everything(50);
  options.occlusion_rays = 2;
  const int before = thread_count();
  set_thread_count(1);
  const ViewImages one = render_view(scene, frame_at(-70, 25, 4.0), options);
  set_thread_count(4);
  const ViewImages four = render_view(scene, frame_at(-70, 25, 4.0), options);
  set_thread_count(before);
  EXPECT_EQ(one.color.rgba, four.color.rgba);
  EXPECT_EQ(one.coverage, four.coverage);
  EXPECT_EQ(one.depth, four.depth);
  EXPECT_EQ(one.normal, four.normal);
  EXPECT_EQ(one.mean_normal, four.mean_normal);
  EXPECT_EQ(one.face, four.face);
}

TEST(RenderView, BundlesAgreeWithSingleRays) {
  const Asset asset = test::sphere(0.5f, 24, 48);
  const Scene scene(asset);
  const Frame frame = frame_at(-40, 30);
  const Camera camera = view_camera(frame, 40);
  const ViewImages view = render_view(scene, frame, everything(40));
  int hits = 0;
  for (int y = 0; y < 40; ++y) {
    for (int x = 0; x < 40; ++x) {
      const Hit hit = scene.trace(camera.eye, camera.ray(x + 0.5, y + 0.5));
      const std::size_t i = pixel_at(x, y, 40);
      ASSERT_EQ(hit.face >= 0, view.mask[i] == 1) << x << ", " << y;
      if (hit.face < 0) continue;
      ++hits;
      ASSERT_NEAR(hit.distance, view.depth[i], 1e-5);
      ASSERT_LT((hit.normal - view.normal[i]).norm(), 1e-3f);
    }
  }
  EXPECT_GT(hits, 300);
}

TEST(RenderView, AnObjectWithoutFacesIsAnEmptyPicture) {
  Asset asset = cube();
  asset.mesh.faces.clear();
  const ViewImages view = render_view(Scene(asset), frame_at(0, 0), everything(16));
  EXPECT_EQ(std::count(view.mask.begin(), view.mask.end(), 1), 0);
  EXPECT_EQ(*std::max_element(view.color.rgba.begin(), view.color.rgba.end()), 0);
}

TEST(RenderView, RefusesWhatIsOutOfRange) {
  const Asset asset = cube();
  const Scene scene(asset);
  const auto refuses = [&](int size, int samples, int occlusion) {
    ViewOptions options;
    options.size = size;
    options.samples_per_axis = samples;
    options.occlusion_rays = occlusion;
    EXPECT_THROW(render_view(scene, frame_at(0, 0), options), InputError);
  };
  refuses(0, 1, 0);
  refuses(1 << 20, 1, 0);
  refuses(8, 0, 0);
  refuses(8, 1, -1);
  Frame frame = frame_at(0, 0);
  frame.camera_angle_x = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THROW(render_view(scene, frame), InputError);
  frame = frame_at(0, 0);
  frame.camera_to_world(1, 1) = std::numeric_limits<double>::infinity();
  EXPECT_THROW(render_view(scene, frame), InputError);
  EXPECT_THROW(ViewRenderer(scene, 2.0f), InputError);
}

}  // namespace

}  // namespace anigen::render
