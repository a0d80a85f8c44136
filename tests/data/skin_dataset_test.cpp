#include "anigen/data/skin_dataset.h"

#include <gtest/gtest.h>

#include <fstream>
#include <numeric>
#include <set>

#include "anigen/core/error.h"
#include "anigen/data/batches.h"
#include "tests/data/synthetic_dataset.h"
#include "tests/support/paths.h"

namespace anigen::data {
namespace {

class SkinData : public ::testing::Test {
 protected:
  void SetUp() override { test::write_synthetic_dataset(folder_.path(), 7); }
  SkinDataset dataset(const SkinDataset::Options& options) {
    return {select_assets(folder_.path().string(), {}), options};
  }
  static SkinDataset::Options options() {
    SkinDataset::Options o;
    o.seed = 3;
    o.num_skin_samples = 50;
    o.augmentations.rotation = Augmentations::Rotation::kAny;
    o.augmentations.joint_jitter = 0.1;
    o.augmentations.merge_joints = 0.5;
    o.augmentations.blend_sampling = 0.5;
    o.augmentations.sharpen = 0.2;
    return o;
  }
  test::TemporaryFolder folder_;
};

bool equal(const SkinBatch& a, const SkinBatch& b) {
  bool same = a.ids == b.ids;
  for (std::size_t i = 0; same && i < a.skin.size(); ++i) {
    same = torch::equal(a.skin[i], b.skin[i]) && torch::equal(a.joints[i], b.joints[i]) &&
           torch::equal(a.parents[i], b.parents[i]);
  }
  return same;
}

TEST(SampleOrder, EveryEpochIsAPermutationAndAnyPlaceCanBeAskedFor) {
  SampleOrder order(7, 5);
  const std::vector<Draw> draws = order.draws(0, 70);
  std::set<std::vector<std::size_t>> epochs;
  for (std::size_t epoch = 0; epoch < 10; ++epoch) {
    std::vector<std::size_t> items;
    for (std::size_t i = 0; i < 7; ++i) items.push_back(draws[7 * epoch + i].item);
    epochs.insert(items);
    std::sort(items.begin(), items.end());
    EXPECT_EQ(items, (std::vector<std::size_t>{0, 1, 2, 3, 4, 5, 6}));
  }
  EXPECT_GT(epochs.size(), 8u) << "epochs differ";
  SampleOrder other(7, 5);
  for (const std::uint64_t first : {33u, 2u, 60u}) {
    const std::vector<Draw> part = other.draws(first, 9);
    for (std::size_t i = 0; i < 9; ++i) EXPECT_EQ(part[i].item, draws[first + i].item);
  }
}

TEST_F(SkinData, RowsSumToOneAndShapesAgree) {
  const SkinDataset data = dataset(options());
  const auto batch = data.load({{0, 10}, {4, 11}});
  const auto& rigs = dynamic_cast<const SkinBatch&>(*batch);
  ASSERT_EQ(rigs.ids, (std::vector<std::string>{"rig000", "rig004"}));
  for (std::size_t i = 0; i < 2; ++i) {
    EXPECT_EQ(rigs.skin[i].size(0), 50);
    EXPECT_EQ(rigs.skin[i].size(1), rigs.joints[i].size(0));
    EXPECT_EQ(rigs.parents[i].size(0), rigs.joints[i].size(0));
    EXPECT_LT((rigs.skin[i].sum(1) - 1).abs().max().item<float>(), 1e-5f);
    EXPECT_GE(rigs.skin[i].min().item<float>(), 0.0f);
  }
}

TEST_F(SkinData, WithoutSamplingTheVerticesComeOut) {
  SkinDataset::Options plain;
  plain.num_skin_samples = 0;
  const SkinDataset data = dataset(plain);
  const auto batch = data.load({{2, 0}});
  const std::vector<float> expected = to_dense(data.item(2)->skin, data.item(2)->joints.size());
  const torch::Tensor skin = dynamic_cast<const SkinBatch&>(*batch).skin[0];
  ASSERT_EQ(static_cast<std::size_t>(skin.numel()), expected.size());
  for (std::size_t i = 0; i < expected.size(); ++i) EXPECT_FLOAT_EQ(skin.data_ptr<float>()[i], expected[i]);
  EXPECT_EQ(data.vertices_of(2, 10)->skin[0].size(0), 10);
  EXPECT_TRUE(torch::equal(data.vertices_of(2, 0)->skin[0], skin));
}

// Uniform over the area: with t uniform along each tube, the mean weight of a bone's child is ½ of its share.
TEST_F(SkinData, PointsAreUniformOverTheSurface) {
  const RiggedItem item = read_rigged_item({folder_.path(), "rig000"});
  const SkinSampler sampler(item, false);
  Rng rng(1, "t");
  std::vector<double> hits(item.faces.size(), 0.0);
  constexpr int kDraws = 60'000;
  for (int i = 0; i < kDraws; ++i) ++hits[static_cast<std::size_t>(sampler.draw(0.0, rng).face)];
  // All faces of the tubes have the same area: binomial with p = 1/F, five standard deviations.
  const double p = 1.0 / static_cast<double>(item.faces.size());
  for (const double count : hits) EXPECT_NEAR(count / kDraws, p, 5 * std::sqrt(p / kDraws));
}

TEST_F(SkinData, BlendSamplingPrefersBlendedPlaces) {
  const RiggedItem item = read_rigged_item({folder_.path(), "rig001"});
  const SkinSampler sampler(item, true);
  const std::vector<int> same{0, 1, 2, 3, 4};
  const auto mean_blend = [&](double share) {
    Rng rng(1, "t");
    double sum = 0;
    for (int i = 0; i < 4000; ++i) {
      std::vector<float> row(5, 0.0f);
      add_weights_at(item, sampler.draw(share, rng), same, row.data());
      sum += 1.0 - *std::max_element(row.begin(), row.end());
    }
    return sum / 4000;
  };
  // Along a tube the blend is min(t, 1 − t): ¼ in the mean, ⅓ when drawn in proportion to itself.
  EXPECT_NEAR(mean_blend(0.0), 0.25, 0.02);
  EXPECT_NEAR(mean_blend(1.0), 1.0 / 3.0, 0.02);
}

TEST_F(SkinData, BatchesDoNotDependOnWorkersNorOnWhereARunBegan) {
  const auto data = std::make_shared<const SkinDataset>(dataset(options()));
  std::vector<std::vector<StepBatches>> runs;
  for (const std::size_t workers : {0u, 1u, 3u}) {
    Prefetcher loader(data, 9, 0, {5, 2, workers, 3});
    runs.emplace_back();
    for (int step = 0; step < 8; ++step) runs.back().push_back(loader.next());
  }
  Prefetcher resumed(data, 9, 5 * 5, {5, 2, 2, 2});
  for (std::size_t step = 0; step < 8; ++step) {
    ASSERT_EQ(runs[0][step].size(), 2u);
    const StepBatches later = step >= 5 ? resumed.next() : StepBatches();
    for (std::size_t part = 0; part < 2; ++part) {
      const auto& expected = dynamic_cast<const SkinBatch&>(*runs[0][step][part]);
      EXPECT_TRUE(equal(dynamic_cast<const SkinBatch&>(*runs[1][step][part]), expected));
      EXPECT_TRUE(equal(dynamic_cast<const SkinBatch&>(*runs[2][step][part]), expected));
      if (!later.empty()) {
        EXPECT_TRUE(equal(dynamic_cast<const SkinBatch&>(*later[part]), expected));
      }
    }
  }
  EXPECT_FALSE(equal(dynamic_cast<const SkinBatch&>(*runs[0][0][0]), dynamic_cast<const SkinBatch&>(*runs[0][1][0])));
}

TEST_F(SkinData, ReadingFromDiskEveryTimeGivesTheSame) {
  const SkinDataset memory = dataset(options());
  SkinDataset::Options none = options();
  none.memory_budget = 0;
  const SkinDataset disk = dataset(none);
  const auto a = memory.load({{1, 4}}), b = disk.load({{1, 4}});
  EXPECT_TRUE(equal(dynamic_cast<const SkinBatch&>(*a), dynamic_cast<const SkinBatch&>(*b)));
}

TEST_F(SkinData, BrokenAssetsAreCountedAndNamed) {
  std::ofstream(test::rig_file(folder_.path(), "rig002")) << "broken";
  std::filesystem::remove(test::rig_file(folder_.path(), "rig005"));
  try {
    dataset(options());
    FAIL() << "expected an error";
  } catch (const InputError& error) {
    const std::string message = error.what();
    EXPECT_NE(message.find("2 of 7"), std::string::npos) << message;
    EXPECT_NE(message.find("rig002"), std::string::npos) << message;
    EXPECT_NE(message.find("rig005"), std::string::npos) << message;
  }
  SkinDataset::Options skip = options();
  skip.skip_broken = true;
  EXPECT_EQ(dataset(skip).size(), 5u);
}

TEST_F(SkinData, AnErrorWhileLoadingReachesTheCaller) {
  SkinDataset::Options none = options();
  none.memory_budget = 0;
  const auto data = std::make_shared<const SkinDataset>(dataset(none));
  std::filesystem::remove(test::rig_file(folder_.path(), "rig003"));
  Prefetcher loader(data, 9, 0, {7, 1, 2, 2});
  EXPECT_THROW(loader.next(), InputError);
}

}  // namespace
}  // namespace anigen::data
