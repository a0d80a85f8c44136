#include <gtest/gtest.h>
#include <Eigen/LU>
#include <cmath>
#include <fstream>
#include <limits>
#include <sstream>

#include "anigen/core/config.h"
#include "anigen/core/error.h"
#include "anigen/render/cameras_json.h"
#include "anigen/render/dataset_views.h"
#include "tests/render/views_support.h"
#include "tests/support/paths.h"

namespace anigen::render {

namespace {

Eigen::Vector3d eye(const ViewCamera& view) { return camera_to_world(view).topRightCorner<3, 1>(); }

TEST(ViewPlan, ThreeQuartersOfTheViewsAreAbove) {
  for (const std::size_t n : {12u, 24u, 150u}) {
    std::size_t above = 0;
    for (const ViewCamera& view : feature_views(n, 0.5, 0.25)) above += view.pitch > 0.0;
    EXPECT_NEAR(static_cast<double>(above) / static_cast<double>(n), 0.75, 1.0 / static_cast<double>(n)) << n;
  }
}

TEST(ViewPlan, DirectionsFillTheSphereEvenly) {
  // Within the upper hemisphere the heights of evenly spread directions are uniform, and so are the azimuths.
  std::vector<int> heights(5), octants(8);
  const auto views = feature_views(800, 0.3, 0.7);
  for (const ViewCamera& view : views) {
    const Eigen::Vector3d direction = eye(view) / view.radius;
    if (direction.z() > 0.0) ++heights[std::min<std::size_t>(4, static_cast<std::size_t>(5.0 * direction.z()))];
    const double turn = std::atan2(direction.y(), direction.x()) / (2 * M_PI) + 0.5;
    ++octants[std::min<std::size_t>(7, static_cast<std::size_t>(8.0 * turn))];
  }
  for (const int count : heights) EXPECT_NEAR(count, 120, 2);
  for (const int count : octants) EXPECT_NEAR(count, 100, 3);
}

TEST(ViewPlan, FeatureCamerasAreThePublishedOnes) {
  const auto views = feature_views(24, 0.1, 0.9);
  ASSERT_EQ(views.size(), 24u);
  for (const ViewCamera& view : views) {
    EXPECT_EQ(view.radius, 2.0);
    EXPECT_DOUBLE_EQ(view.fov, 40.0 * M_PI / 180.0);
    const Eigen::Vector3d expected(2 * std::cos(view.yaw) * std::cos(view.pitch),
                                   2 * std::sin(view.yaw) * std::cos(view.pitch), 2 * std::sin(view.pitch));
    EXPECT_LT((eye(view) - expected).norm(), 1e-12);
  }
}

TEST(ViewPlan, ConditionCamerasHoldTheCubeAndFollowTheirDistribution) {
  Rng rng(7, "views");
  const auto views = condition_views(4000, rng);
  double mean = 0.0, lowest = 10.0, highest = 0.0;
  for (const ViewCamera& view : views) {
    EXPECT_NEAR(std::sin(0.5 * view.fov) * view.radius, std::sqrt(0.75), 1e-12);  // the sphere just fits
    lowest = std::min(lowest, view.fov * 180 / M_PI);
    highest = std::max(highest, view.fov * 180 / M_PI);
    mean += 1.0 / (view.radius * view.radius) / static_cast<double>(views.size());
  }
  EXPECT_GE(lowest, 10.0 - 1e-9);
  EXPECT_LT(lowest, 13.0);
  EXPECT_LE(highest, 70.0 + 1e-9);
  EXPECT_GT(highest, 69.0);
  // 1/r² is uniform between sin²(5°)/0.75 and sin²(35°)/0.75; its mean over 4000 draws varies by 0.002.
  const auto inverse_square = [](double degrees) { return std::pow(std::sin(degrees * M_PI / 180), 2) / 0.75; };
  EXPECT_NEAR(mean, 0.5 * (inverse_square(5) + inverse_square(35)), 0.008);
}

TEST(ViewPlan, FrontCamerasFaceTheObject) {
  Rng rng(7, "views");
  const auto views = front_views(400, rng);
  ASSERT_EQ(views.size(), 400u);
  for (std::size_t i = 0; i < views.size(); ++i) {
    EXPECT_NEAR(std::sin(0.5 * views[i].fov) * views[i].radius, std::sqrt(0.75), 1e-12);
    const double side = (views[i].yaw + 0.5 * M_PI) * 180 / M_PI, height = views[i].pitch * 180 / M_PI;
    EXPECT_GE(side, -60.0 + 120.0 * static_cast<double>(i) / 400.0 - 1e-9);  // one camera in each part of the range
    EXPECT_LE(side, -60.0 + 120.0 * static_cast<double>(i + 1) / 400.0 + 1e-9);
    EXPECT_GE(height, -5.0);
    EXPECT_LE(height, 30.0);
    EXPECT_LT(eye(views[i]).y(), 0.0);  // objects face −Y
  }
  EXPECT_THROW(front_views(0, rng), InputError);
}

TEST(ViewPlan, TheSameSeedGivesTheSameCameras) {
  Rng first(3, "views", 5), second(3, "views", 5), other(3, "views", 6);
  const auto a = condition_views(24, first), b = condition_views(24, second), c = condition_views(24, other);
  for (std::size_t i = 0; i < a.size(); ++i) {
    EXPECT_EQ(camera_to_world(a[i]), camera_to_world(b[i]));
    EXPECT_NE(camera_to_world(a[i]), camera_to_world(c[i]));
  }
}

TEST(ViewPlan, MatricesAreRotationsThatLookAtTheOriginEvenAtThePoles) {
  for (const double pitch : {-90.0, -30.0, 0.0, 75.0, 90.0}) {
    const Eigen::Matrix4d matrix = test::frame_at(123.0, pitch).camera_to_world;
    const Eigen::Matrix3d axes = matrix.topLeftCorner<3, 3>();
    EXPECT_LT((axes.transpose() * axes - Eigen::Matrix3d::Identity()).norm(), 1e-12);
    EXPECT_NEAR(axes.determinant(), 1.0, 1e-12);
    EXPECT_LT((Eigen::Vector3d(matrix.topRightCorner<3, 1>()) - 2.0 * axes.col(2)).norm(), 1e-12);  // looks along −Z
    EXPECT_GE(axes(2, 1), -1e-12);                                                                  // +Z is up
  }
}

TEST(ViewPlan, RefusesNonsense) {
  Rng rng(1, "views");
  EXPECT_THROW(feature_views(0, 0, 0), InputError);
  EXPECT_THROW(condition_views(0, rng), InputError);
  EXPECT_THROW(preview_turn(0), InputError);
  EXPECT_THROW(camera_to_world({0, 0, -1, 1}), InputError);
  EXPECT_THROW(camera_to_world({0, 0, 2, 0}), InputError);
  EXPECT_THROW(camera_to_world({0, 0, 2, 3.2}), InputError);
  EXPECT_THROW(camera_to_world({std::numeric_limits<double>::quiet_NaN(), 0, 2, 1}), InputError);
}

TEST(Projection, CentreCornersAndBack) {
  const Frame frame = test::frame_at(0, 0);
  const Eigen::Matrix4d world_to_camera = extrinsics(frame);
  const Eigen::Matrix3d normalised = intrinsics(frame);
  const Eigen::Vector3d centre = project({0, 0, 0}, world_to_camera, normalised);
  EXPECT_LT((centre - Eigen::Vector3d(0.5, 0.5, 2.0)).norm(), 1e-12);
  // From +X: +Y is to the right, +Z is up and so towards small v.
  EXPECT_GT(project({0, 0.1, 0}, world_to_camera, normalised).x(), 0.5);
  EXPECT_LT(project({0, 0, 0.1}, world_to_camera, normalised).y(), 0.5);
  // At depth 2 the picture is 2 · 2 tan 20° wide.
  const double half = 2.0 * std::tan(M_PI / 9);
  EXPECT_LT((project({0, half, half}, world_to_camera, normalised) - Eigen::Vector3d(1, 0, 2)).norm(), 1e-12);
  const Eigen::Vector3d point(0.2, -0.3, 0.4);
  EXPECT_LT((unproject(project(point, world_to_camera, normalised), world_to_camera, normalised) - point).norm(),
            1e-12);
}

TEST(Projection, ClipSpaceRunsFromNearToFar) {
  const Eigen::Matrix4d clip = clip_projection(intrinsics_of(1.0), 1.0, 3.0);
  const Eigen::Vector4d near = clip * Eigen::Vector4d(0, 0, 1, 1), far = clip * Eigen::Vector4d(0, 0, 3, 1);
  EXPECT_NEAR(near.z() / near.w(), 0.0, 1e-12);
  EXPECT_NEAR(far.z() / far.w(), 1.0, 1e-12);
  EXPECT_THROW(clip_projection(intrinsics_of(1.0), 3.0, 1.0), InputError);
  EXPECT_THROW(intrinsics_of(0.0), InputError);
  EXPECT_THROW(extrinsics_of(Eigen::Matrix4d::Zero()), InputError);
}

TEST(PreviewViews, MeasureYawFromTheYAxis) {
  ViewCamera preview{0.3, 0.2, 2.0, 1.0};
  const Eigen::Vector3d expected(2 * std::sin(0.3) * std::cos(0.2), 2 * std::cos(0.3) * std::cos(0.2),
                                 2 * std::sin(0.2));
  EXPECT_LT((eye(from_preview(preview)) - expected).norm(), 1e-12);
}

}  // namespace

namespace {

Transforms sample() {
  Rng rng(1, "views");
  Similarity normalisation;
  normalisation.scale = 0.1 + 0.2;  // not a short decimal
  normalisation.offset = {1.0 / 3.0, -2e-17, 4e7};
  return make_transforms(condition_views(24, rng), normalisation);
}

/// Error that refuses the text; fails the test when nothing does.
InputError refusal(const std::string& text) {
  try {
    parse_transforms(text, "hostile.json");
  } catch (const InputError& error) {
    EXPECT_EQ(error.file(), "hostile.json") << error.what();
    return error;
  }
  ADD_FAILURE() << "accepted: " << text.substr(0, 200);
  return InputError("", "", "");
}

/// A good file with the value at a JSON pointer replaced.
std::string with(const std::string& pointer, const Json& value) {
  Json json = Json::parse(format_transforms(sample()));
  json[Json::json_pointer(pointer)] = value;
  return json.dump();
}

std::string without(const std::string& parent, const std::string& key) {
  Json json = Json::parse(format_transforms(sample()));
  json[Json::json_pointer(parent)].erase(key);
  return json.dump();
}

TEST(TransformsJson, RoundTripIsExactAndBytesAreDeterministic) {
  test::TemporaryFolder folder;
  const Transforms written = sample();
  write_transforms(folder / "transforms.json", written);
  const Transforms read = read_transforms(folder / "transforms.json");
  EXPECT_EQ(read.scale, written.scale);
  EXPECT_EQ(read.offset, written.offset);
  EXPECT_EQ(read.aabb.low, written.aabb.low);
  EXPECT_EQ(read.aabb.high, written.aabb.high);
  ASSERT_EQ(read.frames.size(), 24u);
  for (std::size_t i = 0; i < read.frames.size(); ++i) {
    EXPECT_EQ(read.frames[i].file_path, written.frames[i].file_path);
    EXPECT_EQ(read.frames[i].camera_angle_x, written.frames[i].camera_angle_x);
    EXPECT_EQ(read.frames[i].camera_to_world, written.frames[i].camera_to_world);
  }
  EXPECT_EQ(read.frames[7].file_path, "007.png");
  EXPECT_EQ(format_transforms(read), format_transforms(written));
  std::ifstream file(folder / "transforms.json", std::ios::binary);
  std::stringstream bytes;
  bytes << file.rdbuf();
  EXPECT_EQ(bytes.str(), format_transforms(written));
}

TEST(TransformsJson, HasThePublishedKeys) {
  const Json json = Json::parse(format_transforms(sample()));
  EXPECT_EQ(json.at("aabb"), Json::parse("[[-0.5,-0.5,-0.5],[0.5,0.5,0.5]]"));
  EXPECT_TRUE(json.at("scale").is_number());
  EXPECT_EQ(json.at("offset").size(), 3u);
  const Json& frame = json.at("frames").at(0);
  EXPECT_EQ(frame.at("file_path"), "000.png");
  EXPECT_TRUE(frame.at("camera_angle_x").is_number());
  EXPECT_EQ(frame.at("transform_matrix").size(), 4u);
}

TEST(TransformsJson, ReadsAFileWrittenByHand) {
  // From +X at distance 2: right is +Y, up is +Z, back is +X.
  const Transforms read = parse_transforms(
      R"({"frames": [{"file_path": "./train/r_0.png", "camera_angle_x": 0.7, "sharpness": 3,
          "transform_matrix": [[0,0,1,2],[1,0,0,0],[0,1,0,0],[0,0,0,1]]}], "w": 512})",
      "hand.json");
  ASSERT_EQ(read.frames.size(), 1u);
  EXPECT_EQ(read.scale, 1.0);
  const Eigen::Vector4d seen = extrinsics(read.frames[0]) * Eigen::Vector4d(0.5, 0.25, 0.125, 1.0);
  EXPECT_LT((seen - Eigen::Vector4d(0.25, -0.125, 1.5, 1.0)).norm(), 1e-12);  // x right, y down, z forward
  EXPECT_NEAR(intrinsics(read.frames[0])(0, 0), 0.5 / std::tan(0.35), 1e-12);
}

TEST(TransformsJson, RefusesEveryTruncation) {
  const std::string text = format_transforms(sample());
  for (std::size_t length = 0; length + 2 < text.size(); length += 97) refusal(text.substr(0, length));
}

TEST(TransformsJson, RefusesWrongTypesAndShapesByPlace) {
  EXPECT_EQ(refusal("[]").place(), "");
  EXPECT_EQ(refusal("{\"frames\": 3}").place(), "/frames");
  EXPECT_EQ(refusal("{\"frames\": []}").place(), "/frames");
  EXPECT_EQ(refusal("{\"frames\": [[]]}").place(), "/frames/0");
  EXPECT_EQ(refusal(without("", "frames")).place(), "");
  EXPECT_EQ(refusal(without("/frames/3", "transform_matrix")).place(), "/frames/3");
  EXPECT_EQ(refusal(with("/frames/2/file_path", 7)).place(), "/frames/2/file_path");
  EXPECT_EQ(refusal(with("/frames/2/camera_angle_x", "0.7")).place(), "/frames/2/camera_angle_x");
  EXPECT_EQ(refusal(with("/frames/2/transform_matrix/1/2", nullptr)).place(), "/frames/2/transform_matrix/1/2");
  EXPECT_EQ(refusal(with("/aabb", Json::parse("[[0,0],[1,1]]"))).place(), "/aabb/0");
  EXPECT_EQ(refusal(with("/aabb/0/0", 0.75)).place(), "/aabb");
  EXPECT_EQ(refusal(with("/scale", 0)).place(), "/scale");
  EXPECT_EQ(refusal(with("/offset", Json::parse("[1,2]"))).place(), "/offset");
}

TEST(TransformsJson, RefusesMatricesThatAreNoRigidMotion) {
  const std::string place = "/frames/1/transform_matrix";
  Json matrix = Json::parse("[[0,0,1,2],[1,0,0,0],[0,1,0,0]]");
  EXPECT_EQ(refusal(with(place, matrix)).place(), place);  // 3 × 4
  matrix.push_back(Json::parse("[0,0,0]"));
  EXPECT_EQ(refusal(with(place, matrix)).place(), place + "/3");
  matrix[3] = Json::parse("[0,0,0,2]");
  EXPECT_EQ(refusal(with(place, matrix)).place(), place);
  matrix[3] = Json::parse("[0,0,0,1]");
  EXPECT_NO_THROW(parse_transforms(with(place, matrix), "good.json"));
  matrix[0][2] = 1.5;  // stretched
  EXPECT_EQ(refusal(with(place, matrix)).place(), place);
  matrix[0][2] = -1.0;  // mirrored
  EXPECT_EQ(refusal(with(place, matrix)).place(), place);
  matrix[0] = Json::parse("[0,0,1,1e300]");
  EXPECT_EQ(refusal(with(place, matrix)).place(), place);
}

TEST(TransformsJson, RefusesNumbersThatAreNotFinite) {
  std::string text = format_transforms(sample());
  const std::size_t start = text.find(':', text.find("\"camera_angle_x\"")) + 1;
  ASSERT_NE(start, std::string::npos + 1);
  const std::size_t end = text.find(',', start);
  for (const char* bad : {"NaN", "Infinity", "1e999", "-1", "0", "3.15", "{}"}) {
    std::string changed = text;
    changed.replace(start, end - start, bad);
    refusal(changed);
  }
}

TEST(TransformsJson, RefusesPathsThatLeaveTheFolder) {
  const std::string place = "/frames/0/file_path";
  for (const char* bad :
       {"", "/etc/passwd", "../secret.png", "views/../../secret.png", "a\\b.png", "C:/x.png", "a\nb.png"}) {
    EXPECT_EQ(refusal(with(place, bad)).place(), place) << bad;
  }
  EXPECT_NO_THROW(parse_transforms(with(place, "views/..png"), "good.json"));
}

TEST(TransformsJson, RefusesToWriteWhatItWouldNotRead) {
  test::TemporaryFolder folder;
  const auto refuses = [&](const auto& change) {
    Transforms transforms = sample();
    change(transforms);
    EXPECT_THROW(write_transforms(folder / "transforms.json", transforms), InputError);
    EXPECT_FALSE(std::filesystem::exists(folder / "transforms.json"));
  };
  refuses([](Transforms& t) { t.frames.clear(); });
  refuses([](Transforms& t) { t.frames[0].file_path = "../x.png"; });
  refuses([](Transforms& t) { t.frames[0].file_path = "\xff.png"; });
  refuses([](Transforms& t) { t.frames[5].camera_angle_x = std::numeric_limits<double>::quiet_NaN(); });
  refuses([](Transforms& t) { t.frames[5].camera_to_world(0, 3) = std::numeric_limits<double>::infinity(); });
  refuses([](Transforms& t) { t.scale = -1.0; });
  refuses([](Transforms& t) { t.aabb.low.x() = 2.0; });
}

}  // namespace

}  // namespace anigen::render
