// Damaged and hostile files of a published dataset: every one is an error that names file and array.
#include <gtest/gtest.h>

#include <fstream>
#include <limits>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "tests/data/published_dataset.h"
#include "tests/support/paths.h"

namespace anigen::data {
namespace {

using io::NdArray;
using test::PublishedSample;

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();

class HostileFiles : public ::testing::Test {
 protected:
  test::TemporaryFolder folder_;
  PublishedSample sample_{folder_.path()};

  // Loads asset0; the error must name the file and the place.
  void expect_error(const std::string& dataset, const Json& args, const std::filesystem::path& file,
                    const std::string& place) {
    try {
      test::make_published(sample_, dataset, args).train->load({{0, 3}});
      FAIL() << "no error for " << file << " " << place;
    } catch (const InputError& error) {
      const std::string message = error.what();
      EXPECT_NE(message.find(file.string()), std::string::npos) << message;
      EXPECT_NE(message.find(place), std::string::npos) << message << "\nexpected: " << place;
    }
  }
  void expect_feature_error(const std::filesystem::path& file, const std::string& place) {
    expect_error("AniGenSparseFeat2Skeleton", test::feature_args(), file, place);
  }
  void expect_latent_error(const std::filesystem::path& file, const std::string& place) {
    expect_error("AniGenImageConditionedSLat", test::latent_args(), file, place);
  }
  static io::NamedArrays with(io::NamedArrays arrays, const std::string& name, const NdArray& array) {
    for (auto& entry : arrays) {
      if (entry.first == name) entry.second = array;
    }
    return arrays;
  }
};

TEST_F(HostileFiles, Features) {
  const io::NamedArrays good = PublishedSample::feature_arrays(0);
  std::vector<float> tokens(12, 0.0f);
  tokens[5] = kNan;
  io::write_npz(sample_.features(0), with(good, "patchtokens", PublishedSample::halves(tokens, {4, 3})));
  expect_feature_error(sample_.features(0), "patchtokens[1, 2]");
  tokens[5] = std::numeric_limits<float>::infinity();
  io::write_npz(sample_.features(0), with(good, "patchtokens", PublishedSample::halves(tokens, {4, 3})));
  expect_feature_error(sample_.features(0), "patchtokens[1, 2]");
  io::write_npz(sample_.features(0), with(good, "patchtokens", PublishedSample::halves(tokens, {3, 4})));
  expect_feature_error(sample_.features(0), "patchtokens");
  io::write_npz(sample_.features(0), with(good, "patchtokens", PublishedSample::halves(tokens, {12})));
  expect_feature_error(sample_.features(0), "has shape [12], expected [*, *]");

  std::vector<std::uint8_t> voxels{1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 64};
  io::write_npz(sample_.features(0), with(good, "indices", NdArray::from(voxels, {4, 3})));
  expect_feature_error(sample_.features(0), "indices[3, 2]");
  voxels = {1, 2, 3, 4, 5, 6, 7, 8, 9, 1, 2, 3};
  io::write_npz(sample_.features(0), with(good, "indices", NdArray::from(voxels, {4, 3})));
  expect_feature_error(sample_.features(0), "indices[3]");
  io::write_npz(sample_.features(0), with(good, "indices", NdArray::from(std::vector<float>(12, 0.5f), {4, 3})));
  expect_feature_error(sample_.features(0), "indices");
  io::write_npz(sample_.features(0), {good[0]});
  expect_feature_error(sample_.features(0), "patchtokens");
  io::write_npz(sample_.features(0), {{"indices", NdArray::from(std::vector<std::uint8_t>{}, {0, 3})},
                                      {"patchtokens", PublishedSample::halves({}, {0, 3})}});
  expect_feature_error(sample_.features(0), "no voxels");
}

TEST_F(HostileFiles, TruncatedArchivesAndGarbage) {
  const std::string whole = read_file(sample_.features(0));
  for (const std::size_t length : {std::size_t{0}, std::size_t{10}, whole.size() / 2, whole.size() - 1}) {
    std::ofstream(sample_.features(0), std::ios::binary) << whole.substr(0, length);
    expect_feature_error(sample_.features(0), "");
  }
}

TEST_F(HostileFiles, Voxels) {
  PublishedSample::write_centres(sample_.skeleton_voxels(0), {{1, 1, 1}, {5, 64, 5}});
  expect_feature_error(sample_.skeleton_voxels(0), "vertex 1");
  expect_error("AniGenSparseStructure", Json::object(), sample_.skeleton_voxels(0), "vertex 1");
  PublishedSample::write_centres(sample_.skeleton_voxels(0), {{-1.6, 1, 1}});
  expect_feature_error(sample_.skeleton_voxels(0), "vertex 0");
  PublishedSample::write_centres(sample_.skeleton_voxels(0), {{std::numeric_limits<double>::quiet_NaN(), 1, 1}});
  expect_feature_error(sample_.skeleton_voxels(0), "");
  PublishedSample::write_centres(sample_.skeleton_voxels(0), {});
  expect_feature_error(sample_.skeleton_voxels(0), "no vertices");
  // A little below the grid still is voxel 0, as the published reader truncates towards zero.
  PublishedSample::write_centres(sample_.skeleton_voxels(0), {{-1.4, 1, 1}});
  EXPECT_NO_THROW(test::make_published(sample_, "AniGenSparseStructure", Json::object()).train->load({{0, 0}}));
}

TEST_F(HostileFiles, Rigs) {
  const io::NamedArrays good = PublishedSample::rig_arrays();
  io::write_npz(sample_.rig(0), with(good, "skin", NdArray::from(std::vector<float>{1, 0, 0, kNan, 1, 0}, {3, 2})));
  expect_feature_error(sample_.rig(0), "skin[1, 1]");
  expect_latent_error(sample_.rig(0), "skin[1, 1]");
  io::write_npz(sample_.rig(0), with(good, "skin", NdArray::from(std::vector<float>(6, 0.5f), {2, 3})));
  expect_feature_error(sample_.rig(0), "has shape [2, 3], expected [3, 2]");
  constexpr std::int64_t kMany = 5000;
  io::NamedArrays many = with(good, "joints", NdArray::from(std::vector<float>(3 * kMany, 0.0f), {kMany, 3}));
  many = with(many, "parents", NdArray::from(std::vector<std::int64_t>(kMany, -1), {kMany}));
  many = with(many, "skin", NdArray::from(std::vector<float>(3 * kMany, 0.0f), {3, kMany}));
  io::write_npz(sample_.rig(0), many);
  expect_feature_error(sample_.rig(0), "5000 joints");
}

TEST_F(HostileFiles, Views) {
  std::filesystem::remove(sample_.view(0) / "000.png");
  std::filesystem::remove(sample_.view(0) / "001.png");
  expect_feature_error(sample_.view(0), ".png");
  std::ofstream(sample_.view(0) / "transforms.json") << R"({"frames": []})";
  expect_feature_error(sample_.view(0) / "transforms.json", "/frames");
  std::ofstream(sample_.view(0) / "transforms.json") << R"({"frames": [{"file_path": "../../x.png",
    "camera_angle_x": 0.7, "transform_matrix": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 2], [0, 0, 0, 1]]}]})";
  expect_feature_error(sample_.view(0) / "transforms.json", "/frames/0/file_path");
}

TEST_F(HostileFiles, ConditionViewsWithoutAnObject) {
  for (const char* name : {"000.png", "001.png"}) io::write_png(sample_.condition(0) / name, io::Image(8, 8, 0));
  expect_latent_error(sample_.condition(0), "alpha");
  io::Image dot(8, 8, 0);
  dot.pixel(3, 3)[3] = 255;
  for (const char* name : {"000.png", "001.png"}) io::write_png(sample_.condition(0) / name, dot);
  expect_latent_error(sample_.condition(0), "single pixel");
}

TEST_F(HostileFiles, Latents) {
  const io::NamedArrays good = PublishedSample::latent_arrays(0);
  std::vector<float> feats(64, 0.0f);
  feats[17] = kNan;
  io::write_npz(sample_.latent(0), with(good, "feats", NdArray::from(feats, {4, 16})));
  expect_latent_error(sample_.latent(0), "feats[1, 1]");
  io::write_npz(sample_.latent(0), with(good, "feats_skl", NdArray::from(std::vector<float>(12, 0.0f), {3, 4})));
  expect_latent_error(sample_.latent(0), "feats_skl");
  io::write_npz(sample_.latent(0), good);
  Json args = test::latent_args();
  args["normalization"] = {{"mean", std::vector<double>(8, 0.0)}, {"std", std::vector<double>(8, 1.0)}};
  expect_error("AniGenImageConditionedSLat", args, sample_.latent(0), "16 channels");

  const auto expect_structure_error = [&](const std::string& place) {
    expect_error("ImageConditionedAniGenSparseStructureLatent", test::structure_latent_args(),
                 sample_.structure_latent(0), place);
  };
  const io::NamedArrays structure = PublishedSample::structure_arrays(0);
  io::write_npz(sample_.structure_latent(0),
                with(structure, "mean_skl", NdArray::from(std::vector<float>(32, 0.0f), {4, 2, 4, 1})));
  expect_structure_error("mean_skl");
  std::vector<float> mean(64, 0.0f);
  mean[63] = kNan;
  io::write_npz(sample_.structure_latent(0), with(structure, "mean", NdArray::from(mean, {8, 2, 2, 2})));
  expect_structure_error("mean[7, 1, 1, 1]");
}

TEST_F(HostileFiles, AssetsThatDifferInChannelsCannotShareABatch) {
  io::write_npz(sample_.features(1), with(PublishedSample::feature_arrays(1), "patchtokens",
                                          PublishedSample::halves(std::vector<float>(10, 0.0f), {5, 2})));
  const Datasets data = test::make_published(sample_, "AniGenSparseFeat2Skeleton", test::feature_args());
  try {
    data.train->load({{0, 0}, {1, 1}});
    FAIL() << "no error";
  } catch (const InputError& error) {
    EXPECT_EQ(error.file(), "asset1");
    EXPECT_EQ(error.place(), "channels");
  }
}

}  // namespace
}  // namespace anigen::data
