#include "anigen/loaders/datasets/structured_latent_dataset.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>

#include "anigen/core/atomic_file.h"
#include "anigen/core/error.h"
#include "anigen/loaders/latent_normalization.h"
#include "tests/loaders/published_dataset.h"

namespace anigen::loaders {
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
    for (const char* name : {"000_normal.png", "001_normal.png"}) {
      io::write_png(sample_.condition(i) / name, test::PublishedSample::picture(127, 127, 255));
    }
  }
  EXPECT_EQ(first({{"condition", "normal"}})->cond.select(1, 2).max().item<float>(), 1.0f);
  EXPECT_LT(first({})->cond.select(1, 2).max().item<float>(), 0.5f);
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
}  // namespace anigen::loaders
