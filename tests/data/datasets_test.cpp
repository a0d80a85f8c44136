#include <gtest/gtest.h>
#include <algorithm>
#include <filesystem>
#include <fstream>
#include <set>
#include <sstream>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/data/batches.h"
#include "anigen/data/datasets.h"
#include "anigen/data/latent_files.h"
#include "tests/data/published_dataset.h"
#include "tests/support/paths.h"

// Order, determinism, resume and broken assets: what holds for every dataset read from disk.

namespace anigen::data {

namespace {

using test::PublishedSample;

class PublishedOnDisk : public ::testing::Test {
 protected:
  test::TemporaryFolder folder_;
  PublishedSample sample_{folder_.path()};

  Datasets features(Json args, std::uint64_t seed = 1) {
    const Json defaults = test::feature_args();
    for (const auto& [key, value] : defaults.items()) {
      if (!args.contains(key)) args[key] = value;
    }
    return test::make_published(sample_, "AniGenSparseFeat2Skeleton", args, seed);
  }
  void break_features(int i) { std::ofstream(sample_.features(i)) << "broken"; }
};

bool equal(const Batch& first, const Batch& second) {
  const auto& a = dynamic_cast<const FeatureSkeletonBatch&>(first);
  const auto& b = dynamic_cast<const FeatureSkeletonBatch&>(second);
  return a.ids == b.ids && torch::equal(a.feats.coords, b.feats.coords) && torch::equal(a.feats.feats, b.feats.feats) &&
         torch::equal(a.feats_skl.coords, b.feats_skl.coords) && torch::equal(a.image, b.image) &&
         torch::equal(a.extrinsics, b.extrinsics);
}

TEST_F(PublishedOnDisk, BatchesDoNotDependOnWorkersNorOnWhereARunBegan) {
  const Json args = {{"skl_dilation_iter", 2}, {"skl_dilation_random_aug", true}, {"bucket_by_voxels", true}};
  const Datasets data = features(args);
  std::vector<std::vector<StepBatches>> runs;
  for (const std::size_t workers : {0u, 1u, 3u}) {
    Prefetcher loader(data.train, 9, 0, {2, 2, workers, 3});
    runs.emplace_back();
    for (int step = 0; step < 9; ++step) runs.back().push_back(loader.next());
  }
  const Datasets reopened = features(args);
  Prefetcher resumed(reopened.train, 9, 2 * 5, {2, 2, 2, 2});
  for (std::size_t step = 0; step < 9; ++step) {
    const StepBatches later = step >= 5 ? resumed.next() : StepBatches();
    ASSERT_EQ(runs[0][step].size(), 2u);
    for (std::size_t part = 0; part < 2; ++part) {
      EXPECT_TRUE(equal(*runs[1][step][part], *runs[0][step][part]));
      EXPECT_TRUE(equal(*runs[2][step][part], *runs[0][step][part]));
      if (!later.empty()) {
        EXPECT_TRUE(equal(*later[part], *runs[0][step][part]));
      }
    }
  }
}

TEST_F(PublishedOnDisk, RandomChoicesFollowSeedAndPosition) {
  const Json args = {{"skl_dilation_iter", 2}, {"skl_dilation_random_aug", true}};
  const Datasets one = features(args, 1), two = features(args, 2);
  int by_seed = 0, by_position = 0;
  for (std::uint64_t position = 0; position < 10; ++position) {
    by_seed += equal(*one.train->load({{0, position}}), *two.train->load({{0, position}})) ? 0 : 1;
    by_position += equal(*one.train->load({{0, position}}), *one.train->load({{0, position + 1}})) ? 0 : 1;
  }
  EXPECT_GT(by_seed, 0);
  EXPECT_GT(by_position, 0);
}

TEST_F(PublishedOnDisk, EveryAssetHasADrawHoweverOftenItRepeats) {
  StructureLatentOptions options;
  options.latent_model = "ss";
  const StructureLatentDataset data({{sample_.root(), PublishedSample::id(0), 3},
                                     {sample_.root(), PublishedSample::id(1), 1},
                                     {sample_.root(), PublishedSample::id(2), 2}},
                                    options, 0);
  ASSERT_EQ(data.size(), 6u);
  ASSERT_EQ(data.assets(), 3u);
  for (std::size_t i = 0; i < 3; ++i) {
    EXPECT_EQ(data.load({Draw{data.item_of(i), 0}})->ids.front(), PublishedSample::id(static_cast<int>(i)));
  }
  EXPECT_EQ(data.item_of(1), 3u);
}

TEST_F(PublishedOnDisk, MissingFilesAreCountedAndNamedBeforeTraining) {
  std::filesystem::remove(sample_.rig(1));
  try {
    features(Json::object());
    FAIL() << "expected an error";
  } catch (const InputError& error) {
    const std::string message = error.what();
    EXPECT_NE(message.find("1 of 3"), std::string::npos) << message;
    EXPECT_NE(message.find(sample_.rig(1).string()), std::string::npos) << message;
  }
  EXPECT_EQ(features({{"skip_broken", true}}).train->size(), 2u);
}

TEST_F(PublishedOnDisk, ABrokenAssetIsAnErrorUnlessItMayBeSkipped) {
  break_features(1);
  EXPECT_THROW(features(Json::object()).train->load({{1, 0}}), InputError);
  EXPECT_NO_THROW(features(Json::object()).train->load({{0, 0}, {2, 1}}));

  const Datasets first = features({{"skip_broken", true}}), second = features({{"skip_broken", true}});
  std::set<std::string> replaced_by;
  for (std::uint64_t position = 0; position < 20; ++position) {
    const auto a = first.train->load({{1, position}}), b = second.train->load({{1, position}});
    ASSERT_EQ(a->ids.size(), 1u) << "a step consumes as many draws as without broken assets";
    EXPECT_TRUE(equal(*a, *b)) << "the replacement is a function of seed and position";
    replaced_by.insert(a->ids.front());
  }
  EXPECT_EQ(replaced_by, (std::set<std::string>{"asset0", "asset2"}));
  const auto broken = dynamic_cast<const AssetDataset&>(*first.train).broken();
  ASSERT_EQ(broken.size(), 1u) << "counted once";
  EXPECT_NE(broken.at("asset1").find(sample_.features(1).string()), std::string::npos);
}

TEST_F(PublishedOnDisk, WhenNothingCanBeReadItIsAnErrorAfterAll) {
  for (int i = 0; i < PublishedSample::kAssets; ++i) break_features(i);
  try {
    features({{"skip_broken", true}}).train->load({{0, 0}});
    FAIL() << "expected an error";
  } catch (const InputError& error) {
    EXPECT_NE(std::string(error.what()).find("3 assets cannot be read"), std::string::npos) << error.what();
  }
}

TEST_F(PublishedOnDisk, SplitOfStructuredLatentsBalancesVoxels) {
  const Datasets data = test::make_published(sample_, "AniGenImageConditionedSLat", test::latent_args());
  // 4, 5 and 6 voxels: the heaviest alone, then 5 and 4 together, by falling load.
  const auto packs = data.train->split({{0, 10}, {1, 11}, {2, 12}}, 2);
  ASSERT_EQ(packs.size(), 2u);
  ASSERT_EQ(packs[0].size(), 1u);
  EXPECT_EQ(packs[0][0].item, 2u);
  ASSERT_EQ(packs[1].size(), 2u);
  EXPECT_EQ(packs[1][0].item, 1u);
  EXPECT_EQ(packs[1][0].position, 11u);
  EXPECT_EQ(packs[1][1].item, 0u);
  EXPECT_EQ(data.train->split({{0, 0}}, 4).size(), 1u) << "no empty micro-batch";
}

TEST_F(PublishedOnDisk, VoxelsAreCountedInTheFilesWhereMetadataDoesNotSay) {
  std::ofstream csv(folder_ / "metadata.csv");
  csv << "sha256,latent_slat,cond_rendered\nasset0,True,True\nasset1,True,True\nasset2,True,True\n";
  csv.close();
  Json args = test::latent_args();
  args["bucket_by_voxels"] = true;
  const Datasets data = test::make_published(sample_, "AniGenImageConditionedSLat", args);
  EXPECT_EQ(data.train->bucket_loads(), (std::vector<std::uint64_t>{4, 5, 6}));
}

TEST_F(PublishedOnDisk, OtherClassesSplitContiguously) {
  const Datasets data = features(Json::object());
  const auto parts = data.train->split({{0, 0}, {1, 1}, {2, 2}, {0, 3}, {1, 4}}, 2);
  ASSERT_EQ(parts.size(), 2u);
  EXPECT_EQ(parts[0].size(), 2u);
  EXPECT_EQ(parts[1][0].position, 2u);
  EXPECT_TRUE(data.train->bucket_loads().empty()) << "no buckets unless asked for";
}

}  // namespace

namespace {

class ConditionPictures : public testing::Test {
 protected:
  std::unique_ptr<StructureLatentBatch> first(const std::string& condition) {
    Json args = test::structure_latent_args();
    if (!condition.empty()) args["condition"] = condition;
    const Datasets data = test::make_published(sample_, "ImageConditionedAniGenSparseStructureLatent", args);
    return test::load<StructureLatentBatch>(*data.train, {{0, 0}});
  }
  void write_normals() {
    for (int i = 0; i < test::PublishedSample::kAssets; ++i) {
      for (const char* name : {"000_normal.png", "001_normal.png"})
        io::write_png(sample_.condition(i) / name, test::PublishedSample::picture(127, 127, 255));
    }
  }
  test::TemporaryFolder folder_;
  test::PublishedSample sample_{folder_ / "data"};
};

TEST_F(ConditionPictures, NormalsAreReadFromTheirOwnFilesCroppedAndMaskedAsColours) {
  write_normals();
  const torch::Tensor normals = first("normal")->cond[0], colors = first("color")->cond[0];
  // Background in one is background in the other; inside, a surface square to the camera.
  const torch::Tensor object = colors[1] > 0;
  EXPECT_TRUE(torch::equal(normals[2] > 0, object));
  EXPECT_TRUE(torch::equal(normals[2], object.to(torch::kFloat32)));
  EXPECT_NEAR(normals[0].max().item<float>(), 127.0f / 255.0f, 1e-6f);
  EXPECT_TRUE(torch::equal(first("")->cond, first("color")->cond)) << "published default";
}

bool same_latents(const Batch& first, const Batch& second) {
  const auto same_voxels = [](const RaggedVoxels& a, const RaggedVoxels& b) {
    return torch::equal(a.coords, b.coords) && torch::equal(a.feats, b.feats);
  };
  if (const auto* a = dynamic_cast<const StructureLatentBatch*>(&first)) {
    const auto& b = dynamic_cast<const StructureLatentBatch&>(second);
    return torch::equal(a->x_0, b.x_0) && torch::equal(a->x_0_skl, b.x_0_skl) && torch::equal(a->cond, b.cond);
  }
  const auto& a = dynamic_cast<const StructuredLatentBatch&>(first);
  const auto& b = dynamic_cast<const StructuredLatentBatch&>(second);
  return same_voxels(a.x_0, b.x_0) && same_voxels(a.x_0_skl, b.x_0_skl) && torch::equal(a.cond, b.cond);
}

TEST_F(ConditionPictures, ACacheGivesTheSameBatchesWithoutReadingFilesAgain) {
  const char* const classes[] = {"ImageConditionedAniGenSparseStructureLatent", "AniGenImageConditionedSLat"};
  for (const char* name : classes) {
    Json args = name == classes[0] ? test::structure_latent_args() : test::latent_args();
    const Datasets plain = test::make_published(sample_, name, args);
    args["cache_mb"] = 16;
    const Datasets cached = test::make_published(sample_, name, args);
    std::vector<std::unique_ptr<Batch>> first;
    for (std::uint64_t position = 0; position < 12; ++position) {
      first.push_back(plain.train->load({{position % 3, position}}));
      EXPECT_TRUE(same_latents(*cached.train->load({{position % 3, position}}), *first.back()))
          << name << " " << position;
    }
    const std::filesystem::path away = folder_ / "away";
    std::filesystem::rename(sample_.root() / "renders_cond", away);
    for (std::uint64_t position = 0; position < 12; ++position)
      EXPECT_TRUE(same_latents(*cached.train->load({{position % 3, position}}), *first[position]))
          << name << " " << position;
    EXPECT_THROW(plain.train->load({{0, 0}}), InputError);
    std::filesystem::rename(away, sample_.root() / "renders_cond");
  }
}

TEST(ReadCache, ReadsOnceWhatFitsAndTheRestEachTime) {
  ReadCache<int> cache(10);
  int reads = 0;
  const auto value_of = [&](const char* key, std::uintmax_t bytes) {
    return *cache.get(
        key, [&] { return ++reads; }, [&](int) { return bytes; });
  };
  EXPECT_EQ(value_of("a", 6), 1);
  EXPECT_EQ(value_of("a", 6), 1);
  EXPECT_EQ(value_of("b", 6), 2) << "6 and 6 are more than 10";
  EXPECT_EQ(value_of("b", 6), 3);
  EXPECT_EQ(value_of("c", 4), 4);
  EXPECT_EQ(value_of("c", 4), 4);
}

TEST_F(ConditionPictures, MissingNormalsAndOtherWordsAreErrors) {
  try {
    first("normal");
    FAIL() << "expected an error";
  } catch (const InputError& error) {
    EXPECT_NE(std::string(error.what()).find("_normal.png"), std::string::npos) << error.what();
    EXPECT_NE(std::string(error.what()).find("--view-geometry"), std::string::npos) << error.what();
  }
  EXPECT_THROW(first("depth"), InputError);
}

TEST_F(ConditionPictures, AssetsWithoutNormalsAreFoundBeforeTraining) {
  write_normals();
  std::filesystem::remove(sample_.condition(1) / "000_normal.png");
  Json args = test::structure_latent_args();
  args["condition"] = "normal";
  const auto open = [&] { return test::make_published(sample_, "ImageConditionedAniGenSparseStructureLatent", args); };
  EXPECT_THROW(open(), InputError);
  args["skip_broken"] = true;
  const Datasets data = open();
  EXPECT_EQ(data.train->size(), 2u);
  // A damaged list of views is that asset's problem, not the dataset's.
  std::ofstream(sample_.condition(2) / "transforms.json") << "{";
  EXPECT_EQ(open().train->size(), 1u);
}

}  // namespace

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
    for (std::size_t at = 0; (at = text.find(from, at)) != std::string::npos; at += to.size())
      text.replace(at, from.size(), to);
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

namespace {

using torch::Tensor;

class StructuredLatents : public ::testing::Test {
 protected:
  Datasets make(Json args) {
    Json all = test::latent_args();
    if (!args.is_null()) all.update(args);
    return test::make_published(sample_, "AniGenImageConditionedSLat", all);
  }
  std::unique_ptr<StructuredLatentBatch> first(Json args) {
    return test::load<StructuredLatentBatch>(*make(std::move(args)).train, {{0, 0}});
  }
  std::string error_of(const Json& args) {
    try {
      make(args);
    } catch (const InputError& error) {
      return error.what();
    }
    return "no error";
  }
  // As `anigen-encode slat` leaves them: the NPZ has statistics of every channel, the JSON normalises geometry only.
  void write_statistics() {
    io::write_npz(folder_ / "data/latents/slat_statistics.npz",
                  {{"feats_mean", io::NdArray::from(std::vector<float>(16, 2.0f), {16})},
                   {"feats_std", io::NdArray::from(std::vector<float>(16, 4.0f), {16})},
                   {"feats_skl_mean", io::NdArray::from(std::vector<float>(4, 0.5f), {4})},
                   {"feats_skl_std", io::NdArray::from(std::vector<float>(4, 0.5f), {4})}});
    std::vector<double> mean(16, 2.0), deviation(16, 4.0);
    std::fill(mean.begin() + 8, mean.end(), 0.0);
    std::fill(deviation.begin() + 8, deviation.end(), 1.0);
    const Json json = {{"assets", 3},
                       {"normalization",
                        {{"mean", mean},
                         {"std", deviation},
                         {"mean_skl", std::vector<double>(4, 0.0)},
                         {"std_skl", std::vector<double>(4, 1.0)}}}};
    write_file_atomically(folder_ / "data/latents/slat_statistics.json", json.dump());
  }

  test::TemporaryFolder folder_;
  test::PublishedSample sample_{folder_ / "data"};
};

TEST_F(StructuredLatents, StatisticsMayComeFromTheFilesOfTheEncoder) {
  write_statistics();
  const auto plain = first({}), json = first({{"normalization", "latents/slat_statistics.json"}}),
             npz = first({{"normalization", "latents/slat_statistics.npz"}});
  const Tensor raw = plain->x_0.feats, raw_skl = plain->x_0_skl.feats;
  EXPECT_TRUE(torch::equal(json->x_0.feats.slice(1, 0, 8), (raw.slice(1, 0, 8) - 2.0) / 4.0));
  EXPECT_TRUE(torch::equal(json->x_0.feats.slice(1, 8), raw.slice(1, 8)));
  EXPECT_TRUE(torch::equal(json->x_0_skl.feats, raw_skl));
  EXPECT_TRUE(torch::equal(npz->x_0.feats, (raw - 2.0) / 4.0));
  EXPECT_TRUE(torch::equal(npz->x_0_skl.feats, (raw_skl - 0.5) / 0.5));
  EXPECT_NE(error_of({{"normalization", "latents/other.json"}}).find("other.json"), std::string::npos);
  write_file_atomically(folder_ / "data/latents/empty.json", "{}");
  EXPECT_NE(error_of({{"normalization", "latents/empty.json"}}).find("normalization"), std::string::npos);
}

TEST_F(StructuredLatents, StatisticsMayHaveTheNamesOfThePipeline) {
  const Json shape = {{"mean", std::vector<double>(16, 1.0)}, {"std", std::vector<double>(16, 2.0)}},
             skeleton = {{"mean", std::vector<double>(4, 1.0)}, {"std", std::vector<double>(4, 2.0)}};
  const auto plain = first({});
  for (const char* name : {"slat_skl", "slat_skel"}) {
    const auto nested = first({{"normalization", {{"slat", shape}, {name, skeleton}}}});
    EXPECT_TRUE(torch::equal(nested->x_0.feats, (plain->x_0.feats - 1.0) / 2.0));
    EXPECT_TRUE(torch::equal(nested->x_0_skl.feats, (plain->x_0_skl.feats - 1.0) / 2.0));
  }
}

TEST_F(StructuredLatents, ARunKeepsTheNumbersOfItsStatistics) {
  write_statistics();
  Json dataset = {{"name", "AniGenImageConditionedSLat"}, {"args", test::latent_args()}};
  dataset["args"]["data_dir"] = sample_.root().string();
  dataset["args"]["normalization"] = "latents/slat_statistics.npz";
  write_out_statistics(dataset, "config.json");
  EXPECT_EQ(dataset["args"]["normalization"], (Json{{"mean", std::vector<double>(16, 2.0)},
                                                    {"std", std::vector<double>(16, 4.0)},
                                                    {"mean_skl", std::vector<double>(4, 0.5)},
                                                    {"std_skl", std::vector<double>(4, 0.5)}}));
  const Json before = dataset;
  write_out_statistics(dataset, "config.json");
  EXPECT_EQ(dataset, before);
  dataset["args"]["normalization"] = "missing.json";
  EXPECT_THROW(write_out_statistics(dataset, "config.json"), InputError);
}

TEST_F(StructuredLatents, WithoutRigsOnlyTheirJointsAreCounted) {
  const auto batch = first({{"load_rigs", false}, {"use_joint_num_cond", true}});
  EXPECT_TRUE(batch->rigs.joints.empty());
  EXPECT_TRUE(torch::equal(batch->joints_num, torch::tensor({2}, torch::kInt64)));
  std::filesystem::remove_all(folder_ / "data/skeleton");
  EXPECT_FALSE(first({{"load_rigs", false}})->joints_num.defined());
  EXPECT_NE(error_of({{"load_rigs", false}, {"use_joint_num_cond", true}}).find("skeleton_voxelized"),
            std::string::npos);
  EXPECT_NE(error_of({}).find("skeleton_voxelized"), std::string::npos);
  EXPECT_NE(error_of({{"load_rigs", false}, {"load_cubvh", true}}).find("load_rigs"), std::string::npos);
}

TEST_F(StructuredLatents, LargeAssetsMayBeLeftOut) {
  EXPECT_EQ(make({{"max_num_voxels", 4}}).train->size(), 3u) << "has no effect in the published class either";
  const Datasets data = make({{"voxel_limit", 5}});
  ASSERT_EQ(data.train->size(), 2u);
  EXPECT_EQ(test::load<StructuredLatentBatch>(*data.train, {{1, 0}})->ids.front(), "asset1");
  EXPECT_NE(error_of({{"voxel_limit", 3}}).find("num_voxels"), std::string::npos);
}

TEST_F(StructuredLatents, NormalsCanBeTheCondition) {
  EXPECT_NE(error_of({{"condition", "normal"}}).find("_normal.png"), std::string::npos);
  for (int i = 0; i < test::PublishedSample::kAssets; ++i) {
    for (const char* name : {"000_normal.png", "001_normal.png"})
      io::write_png(sample_.condition(i) / name, test::PublishedSample::picture(127, 127, 255));
  }
  EXPECT_EQ(first({{"condition", "normal"}})->cond.select(1, 2).max().item<float>(), 1.0f);
  EXPECT_LT(first({})->cond.select(1, 2).max().item<float>(), 0.5f);
}

TEST_F(StructuredLatents, SeenVoxelsComeWithTheirView) {
  // Asset 0 alone has latents at the voxels that a flow saw in view 1, a red one; views 0 are blue.
  std::filesystem::create_directories(folder_ / "data/latents/seen");
  for (int i = 0; i < test::PublishedSample::kAssets; ++i) {
    io::write_png(sample_.condition(i) / "000.png", test::PublishedSample::picture(0, 0, 255));
    io::write_png(sample_.condition(i) / "001.png", test::PublishedSample::picture(255, 0, 0));
  }
  io::NamedArrays arrays = test::PublishedSample::latent_arrays(1);
  const std::filesystem::path file = folder_ / "data/latents/seen/asset0.npz";
  io::write_npz(file, arrays);
  EXPECT_THROW(make({{"seen_models", {"misspelt"}}}), InputError);
  Json args = {{"seen_models", {"seen"}}, {"seen_share", 1.0}};
  EXPECT_THROW(first(args), InputError) << "the view is missing";
  arrays.emplace_back("view", io::NdArray::from(std::vector<std::int64_t>{1}, {1}));
  io::write_npz(file, arrays);
  const Datasets data = make(args);
  for (std::uint64_t position = 0; position < 8; ++position) {
    const auto seen = test::load<StructuredLatentBatch>(*data.train, {{0, position}});
    EXPECT_EQ(seen->x_0.coords.size(0), 5) << "latents of the file";
    EXPECT_GT(seen->cond.select(1, 0).max().item<float>(), 0.9f);
    EXPECT_LT(seen->cond.select(1, 2).max().item<float>(), 0.1f);
    const auto own = test::load<StructuredLatentBatch>(*data.train, {{2, position}});
    EXPECT_EQ(own->x_0.coords.size(0), 6) << "not in that folder";
  }
  args["seen_share"] = 0.0;
  EXPECT_EQ(first(args)->x_0.coords.size(0), 4);
  arrays.back().second = io::NdArray::from(std::vector<std::int64_t>{7}, {1});
  io::write_npz(file, arrays);
  args["seen_share"] = 1.0;
  try {
    first(args);
    ADD_FAILURE() << "there is no view 7";
  } catch (const InputError& error) {
    EXPECT_NE(std::string(error.what()).find("view 7"), std::string::npos) << error.what();
  }
}

TEST_F(StructuredLatents, MicroBatchesHoldEquallyManyVoxels) {
  const Datasets data = make({});
  // Assets of 4, 5 and 6 voxels: the heaviest alone is lighter than the other two together.
  const auto packs = data.train->split({{0, 10}, {1, 11}, {2, 12}}, 2);
  ASSERT_EQ(packs.size(), 2u);
  ASSERT_EQ(packs[0].size(), 1u);
  EXPECT_EQ(packs[0][0].item, 2u);
  EXPECT_EQ(packs[0][0].position, 12u) << "a draw keeps its place, which names its random numbers";
  ASSERT_EQ(packs[1].size(), 2u);
  EXPECT_EQ(packs[1][0].item, 1u);
  EXPECT_EQ(data.train->split({{0, 0}}, 4).size(), 1u);
}

}  // namespace

}  // namespace anigen::data
