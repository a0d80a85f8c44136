// Order, determinism, resume and broken assets: what holds for every dataset read from disk.
#include "anigen/loaders/datasets/asset_dataset.h"

#include <gtest/gtest.h>

#include <fstream>
#include <set>

#include "anigen/core/error.h"
#include "anigen/loaders/datasets/feature_skeleton_dataset.h"
#include "anigen/loaders/datasets/structure_latent_dataset.h"
#include "anigen/loaders/datasets/structured_latent_dataset.h"
#include "anigen/loaders/prefetcher.h"
#include "tests/loaders/published_dataset.h"
#include "tests/support/paths.h"

namespace anigen::loaders {
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
    Prefetcher loader(*data.train, 9, 0, {2, 2, workers, 3});
    runs.emplace_back();
    for (int step = 0; step < 9; ++step) runs.back().push_back(loader.next());
  }
  const Datasets reopened = features(args);
  Prefetcher resumed(*reopened.train, 9, 2 * 5, {2, 2, 2, 2});
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
}  // namespace anigen::loaders
