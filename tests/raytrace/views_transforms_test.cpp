#include "anigen/raytrace/views/transforms_json.h"

#include <gtest/gtest.h>

#include <fstream>
#include <limits>
#include <sstream>

#include "anigen/core/error.h"
#include "anigen/core/json.h"
#include "tests/raytrace/views_support.h"
#include "tests/support/paths.h"

namespace anigen::raytrace {
namespace {

Transforms sample() {
  Rng rng(1, "views");
  Similarity normalisation;
  normalisation.scale = 0.1 + 0.2;  // not a short decimal
  normalisation.offset = {1.0 / 3.0, -2e-17, 4e7};
  return make_transforms(condition_views(24, rng), normalisation);
}

/// What refuses the text; fails the test when nothing does.
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
}  // namespace anigen::raytrace
