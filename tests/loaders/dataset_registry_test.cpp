#include "anigen/loaders/datasets/dataset_registry.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <fstream>
#include <sstream>

#include "anigen/core/atomic_file.h"
#include "anigen/core/error.h"
#include "tests/loaders/published_dataset.h"
#include "tests/support/paths.h"

namespace anigen::loaders {
namespace {

class DatasetRegistry : public ::testing::Test {
 protected:
  test::TemporaryFolder folder_;
  test::PublishedSample sample_{folder_.path()};

  std::string error_of(const std::string& name, const Json& args) {
    try {
      test::make_published(sample_, name, args);
    } catch (const InputError& error) {
      return error.what();
    }
    return "no error";
  }
  // Replaces every occurrence of a word in metadata.csv.
  void edit_metadata(const std::string& from, const std::string& to) {
    std::string text = read_file(folder_ / "metadata.csv");
    for (std::size_t at = 0; (at = text.find(from, at)) != std::string::npos; at += to.size()) {
      text.replace(at, from.size(), to);
    }
    write_file_atomically(folder_ / "metadata.csv", text);
  }
};

bool has(const std::string& text, const std::string& part) { return text.find(part) != std::string::npos; }

TEST_F(DatasetRegistry, KnowsTheNamesOfThePublishedConfigs) {
  const std::vector<std::string>& names = dataset_names();
  for (const char* name : {"AniGenSparseStructure", "AniGenSparseFeat2Skeleton",
                           "ImageConditionedAniGenSparseStructureLatent", "AniGenImageConditionedSLat"}) {
    EXPECT_NE(std::find(names.begin(), names.end(), name), names.end()) << name;
  }
}

TEST_F(DatasetRegistry, UnknownNamesNameTheNearestKnownOne) {
  const std::string error = error_of("AniGenSparseStructur", Json::object());
  EXPECT_TRUE(has(error, "/dataset/name")) << error;
  EXPECT_TRUE(has(error, "did you mean 'AniGenSparseStructure'")) << error;
  EXPECT_TRUE(has(error_of("zzz", Json::object()), "AniGenSLat")) << "lists what there is";
  EXPECT_TRUE(has(error_of("AniGenSparseFeat2Render", Json::object()), "not supported"));
}

TEST_F(DatasetRegistry, ArgumentsAreChecked) {
  Json args = test::feature_args();
  args["skl_dilation_itr"] = 2;
  EXPECT_TRUE(has(error_of("AniGenSparseFeat2Skeleton", args), "did you mean 'skl_dilation_iter'"));
  args = test::feature_args();
  args["resolution"] = 48;
  const std::string error = error_of("AniGenSparseFeat2Skeleton", args);
  EXPECT_TRUE(has(error, "must divide 64") && has(error, "/dataset/args/resolution")) << error;
  args = test::feature_args();
  args.erase("image_size");
  EXPECT_TRUE(has(error_of("AniGenSparseFeat2Skeleton", args), "image_size"));
  EXPECT_TRUE(has(error_of("AniGenSLat", Json::object()), "latent_model"));
  args = test::latent_args();
  args["normalization"] = {{"mean", Json::array({1.0, 2.0})}, {"std", Json::array({1.0})}};
  EXPECT_TRUE(has(error_of("AniGenImageConditionedSLat", args), "normalization"));
  args["normalization"] = {{"mean", Json::array({1.0})}, {"std", Json::array({0.0})}};
  EXPECT_TRUE(has(error_of("AniGenImageConditionedSLat", args), "must be positive"));
}

TEST_F(DatasetRegistry, ArgumentsWithoutEffectInThePublishedCodeAreAccepted) {
  Json args = test::feature_args();
  args["joint_merge_res"] = 64;
  args["resolution"] = 64;
  EXPECT_EQ(test::make_published(sample_, "AniGenSparseFeat2Skeleton", args).train->size(), 3u);
  args = test::latent_args();
  args["max_num_voxels"] = 1;
  args["slat_dec_path"] = "ckpts/anigen/slat_dae";
  EXPECT_EQ(test::make_published(sample_, "AniGenImageConditionedSLat", args).train->size(), 3u) << "not applied";
}

TEST_F(DatasetRegistry, EveryClassAppliesItsFilters) {
  const auto count = [&](const char* name, const Json& args) {
    return test::make_published(sample_, name, args).train->size();
  };
  Json args = test::feature_args();
  args["max_num_voxels"] = 5;
  EXPECT_EQ(count("AniGenSparseFeat2Skeleton", args), 2u);
  args = test::feature_args();
  args["test_mode"] = true;
  EXPECT_EQ(count("AniGenSparseFeat2Skeleton", args), 3u) << "is_test false";
  args["is_test"] = true;
  EXPECT_TRUE(has(error_of("AniGenSparseFeat2Skeleton", args), "is_test true"));
  args = test::feature_args();
  args["model"] = "other";
  EXPECT_TRUE(has(error_of("AniGenSparseFeat2Skeleton", args), "feature_other"));
  args = test::feature_args();
  args["instances"] = Json::array({"asset1"});
  EXPECT_EQ(count("AniGenSparseFeat2Skeleton", args), 1u);
  EXPECT_TRUE(has(error_of("AniGenSparseStructure", {{"min_aesthetic_score", 9.0}}), "none of the 3 rows"));

  // asset1 becomes bad skin, asset2 bad skeleton.
  std::istringstream lines(read_file(folder_ / "metadata.csv"));
  std::string edited;
  for (std::string line; std::getline(lines, line);) {
    if (line.rfind("asset1", 0) == 0) line = "asset1,6.5,True,5,True,True,True,True,True,False,False";
    if (line.rfind("asset2", 0) == 0) line = "asset2,6.5,True,6,True,True,True,True,False,True,False";
    edited += line + "\n";
  }
  write_file_atomically(folder_ / "metadata.csv", edited);
  EXPECT_EQ(count("AniGenSparseStructure", Json::object()), 3u) << "looks at voxelized and score only";
  EXPECT_EQ(count("AniGenSparseFeat2Skeleton", test::feature_args()), 2u);
  args = test::feature_args();
  args["filter_bad_skin"] = true;
  EXPECT_EQ(count("AniGenSparseFeat2Skeleton", args), 1u);
  EXPECT_EQ(count("ImageConditionedAniGenSparseStructureLatent", test::structure_latent_args()), 1u);
  EXPECT_EQ(count("AniGenImageConditionedSLat", test::latent_args()), 1u);
}

TEST_F(DatasetRegistry, MissingColumnsAreNamed) {
  edit_metadata("is_bad_skin", "elsewhere");
  EXPECT_TRUE(has(error_of("AniGenSparseFeat2Skeleton", test::feature_args()), "is_bad_skin"));
  edit_metadata("cond_rendered", "not_rendered");
  EXPECT_TRUE(has(error_of("AniGenImageConditionedSLat", test::latent_args()), "cond_rendered"));
  EXPECT_EQ(error_of("AniGenSLat", {{"latent_model", "slat"}}), "no error");
}

TEST_F(DatasetRegistry, HeldOutAssetsAreASourceOfTheirOwn) {
  std::ofstream(folder_ / "held_out.txt") << "asset2\n";
  Json args = test::latent_args();
  args["eval_split"] = "held_out.txt";
  const Datasets data = test::make_published(sample_, "AniGenImageConditionedSLat", args);
  EXPECT_EQ(data.train->size(), 2u);
  ASSERT_NE(data.eval, nullptr);
  EXPECT_EQ(data.eval->load({{0, 0}})->ids, std::vector<std::string>{"asset2"});
}

}  // namespace
}  // namespace anigen::loaders
