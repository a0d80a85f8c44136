#include "anigen/raytrace/views/view_encoding.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>

#include "anigen/core/error.h"
#include "anigen/io/npz.h"
#include "tests/raytrace/shapes.h"
#include "tests/raytrace/views_support.h"
#include "tests/support/paths.h"

namespace anigen::raytrace {
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
    EXPECT_EQ(pixel(encode_condition_normals(view_of(test::wall(), frame, 32), frame), 16, 16),
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
}  // namespace anigen::raytrace
