// A hand-made dataset in the published layout comes out of every dataset class as the tensors the reference describes.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <map>

#include "anigen/data/datasets.h"
#include "anigen/data/latent_files.h"
#include "tests/data/published_dataset.h"
#include "tests/support/paths.h"

namespace anigen::data {
namespace {

using test::PublishedSample;
using torch::Tensor;

class PublishedClasses : public ::testing::Test {
 protected:
  test::TemporaryFolder folder_;
  PublishedSample sample_{folder_.path()};

  Datasets make(const std::string& name, Json args) { return test::make_published(sample_, name, std::move(args)); }
};

void expect_surface_coords(const RaggedVoxels& voxels, const std::vector<int>& assets) {
  ASSERT_EQ(voxels.coords.scalar_type(), torch::kInt32);
  std::int64_t row = 0;
  for (std::size_t b = 0; b < assets.size(); ++b) {
    ASSERT_EQ(voxels.lengths[b], 4 + assets[b]);
    for (int n = 0; n < 4 + assets[b]; ++n, ++row) {
      const auto voxel = PublishedSample::voxel(assets[b], n);
      const Tensor expected = torch::tensor(
          {static_cast<int>(b), static_cast<int>(voxel[0]), static_cast<int>(voxel[1]), static_cast<int>(voxel[2])},
          torch::kInt32);
      EXPECT_TRUE(torch::equal(voxels.coords[row], expected)) << voxels.coords[row];
    }
  }
  EXPECT_EQ(voxels.coords.size(0), row);
}

TEST_F(PublishedClasses, SparseStructureIsOccupancy) {
  const Datasets data = make("AniGenSparseStructure", {{"skl_dilation_iter", 2}});
  ASSERT_EQ(data.train->size(), 3u);
  EXPECT_EQ(data.eval, nullptr);
  const auto batch = test::load<SparseStructureBatch>(*data.train, {{1, 0}, {0, 1}});
  EXPECT_EQ(batch->ids, (std::vector<std::string>{"asset1", "asset0"}));
  for (const Tensor& grid : {batch->ss, batch->ss_skl}) {
    EXPECT_EQ(grid.scalar_type(), torch::kInt64);
    EXPECT_EQ(grid.sizes(), (std::vector<std::int64_t>{2, 1, 64, 64, 64}));
  }
  EXPECT_EQ(batch->ss[0].sum().item<int>(), 5);
  EXPECT_EQ(batch->ss[1].sum().item<int>(), 4);
  for (int n = 0; n < 5; ++n) {
    const auto v = PublishedSample::voxel(1, n);
    EXPECT_EQ(batch->ss[0][0][v[0]][v[1]][v[2]].item<int>(), 1);
  }
  // Voxels (32, 32, 33) and (0, 32, 33), each a cube of side 5, the second cut to 3 by the grid's border.
  EXPECT_EQ(batch->ss_skl[0].sum().item<int>(), 125 + 75);
  EXPECT_EQ(batch->ss_skl[0][0][34][30][35].item<int>(), 1);
  EXPECT_EQ(batch->ss_skl[0][0][35][30][35].item<int>(), 0);
}

TEST_F(PublishedClasses, SparseStructureAtAnotherResolutionPoolsVoxels) {
  const Datasets data = make("AniGenSparseStructure", {{"resolution", 32}});
  const auto batch = test::load<SparseStructureBatch>(*data.train, {{0, 0}});
  EXPECT_EQ(batch->ss.size(2), 32);
  // (10, 20, 63) (11, 20, 62) (12, 20, 61) (13, 20, 60), halved: two and two fall together.
  EXPECT_EQ(batch->ss.sum().item<int>(), 2);
  EXPECT_EQ(batch->ss[0][0][5][10][31].item<int>(), 1);
  EXPECT_EQ(batch->ss[0][0][6][10][30].item<int>(), 1);
}

TEST_F(PublishedClasses, FeatureSkeletonMergesVoxelsAtALowerResolution) {
  Json args = test::feature_args();
  args["resolution"] = 32;
  const auto coarse = test::load<FeatureSkeletonBatch>(*make("AniGenSparseFeat2Skeleton", args).train, {{2, 0}});
  const auto places = coarse->feats.coords.to(torch::kLong);
  std::map<std::array<std::int64_t, 3>, std::vector<int>> members;
  for (int n = 0; n < 6; ++n) {
    const auto voxel = test::PublishedSample::voxel(2, n);
    members[std::array<std::int64_t, 3>{voxel[0] / 2, voxel[1] / 2, voxel[2] / 2}].push_back(n);
  }
  ASSERT_EQ(places.size(0), static_cast<std::int64_t>(members.size()));
  std::int64_t row = 0;
  for (const auto& [place, rows] : members) {
    for (int axis = 0; axis < 3; ++axis) EXPECT_EQ(places[row][axis + 1].item<std::int64_t>(), place[axis]);
    for (int c = 0; c < test::PublishedSample::kChannels; ++c) {
      double sum = 0.0;
      for (const int n : rows) sum += test::PublishedSample::feature(2, n, c);
      EXPECT_FLOAT_EQ(coarse->feats.feats[row][c].item<float>(), static_cast<float>(sum / (rows.size() + 1.0)));
    }
    ++row;
  }
  EXPECT_LT(coarse->feats_skl.coords.slice(1, 1).max().item<std::int64_t>(), 32);
}

TEST_F(PublishedClasses, FeatureSkeletonHasAllPacks) {
  const Datasets data = make("AniGenSparseFeat2Skeleton", test::feature_args());
  const auto batch = test::load<FeatureSkeletonBatch>(*data.train, {{2, 0}, {0, 1}});
  expect_surface_coords(batch->feats, {2, 0});
  EXPECT_EQ(batch->feats.feats.sizes(), (std::vector<std::int64_t>{10, 3}));
  EXPECT_EQ(batch->feats.feats.scalar_type(), torch::kFloat32);
  EXPECT_EQ(batch->feats.feats[5][2].item<float>(), PublishedSample::feature(2, 5, 2));
  EXPECT_EQ(batch->feats.feats[6][0].item<float>(), PublishedSample::feature(0, 0, 0));

  // Without dilation: the rows of the file, in its order, repetitions included.
  EXPECT_EQ(batch->feats_skl.feats.sizes(), (std::vector<std::int64_t>{6, 0}));
  const Tensor skeleton = torch::tensor({{32, 32, 33}, {0, 32, 33}, {32, 32, 33}}, torch::kInt32);
  EXPECT_TRUE(torch::equal(batch->feats_skl.coords.slice(0, 3, 6).slice(1, 1, 4), skeleton));

  const RigBatch& rigs = batch->rigs;
  ASSERT_EQ(rigs.joints.size(), 2u);
  EXPECT_TRUE(torch::equal(rigs.joints[0], torch::tensor({{0.0f, 0.0f, -0.25f}, {0.0f, 0.0f, 0.25f}})));
  EXPECT_TRUE(torch::equal(rigs.parents[0], torch::tensor({-1, 0}, torch::kInt32)));
  EXPECT_TRUE(torch::equal(rigs.skin[0], torch::tensor({{1.0f, 0.0f}, {1.0f, 0.0f}, {0.25f, 0.75f}})));
  EXPECT_TRUE(torch::equal(rigs.faces[0], torch::tensor({0, 1, 2}, torch::kInt32).reshape({1, 3})))
      << "dtype as stored";
  EXPECT_EQ(rigs.vertices[1].sizes(), (std::vector<std::int64_t>{3, 3}));
  EXPECT_TRUE(rigs.surfaces.empty());
  EXPECT_EQ(batch->is_bad_skin, (std::vector<bool>{false, false}));
}

TEST_F(PublishedClasses, ViewsAreRandomFramesWithTheirCamera) {
  const Datasets data = make("AniGenSparseFeat2Skeleton", test::feature_args());
  const Tensor front = torch::tensor({{1, 0, 0, 0}, {0, 0, -1, 0}, {0, 1, 0, 2}, {0, 0, 0, 1}}).to(torch::kFloat32);
  const Tensor side = torch::tensor({{0, 1, 0, 0}, {0, 0, -1, 0}, {-1, 0, 0, 2}, {0, 0, 0, 1}}).to(torch::kFloat32);
  int fronts = 0;
  constexpr int kDraws = 40;
  for (std::uint64_t position = 0; position < kDraws; ++position) {
    const auto batch = test::load<FeatureSkeletonBatch>(*data.train, {{1, position}});
    const bool is_front = batch->image[0][0][6][4].item<float>() > 0.5f;
    fronts += is_front ? 1 : 0;
    const float red = is_front ? 200.0f : 20.0f;
    EXPECT_EQ(batch->image[0][0][6][4].item<float>(), red / 255.0f);
    EXPECT_EQ(batch->image[0][0][0][0].item<float>(), 1.0f) << "colour is not multiplied by alpha";
    EXPECT_EQ(batch->alpha[0][6][4].item<float>(), 1.0f);
    EXPECT_EQ(batch->alpha[0][5][4].item<float>(), 0.0f);
    EXPECT_LT((batch->extrinsics[0] - (is_front ? front : side)).abs().max().item<float>(), 1e-6f);
    EXPECT_NEAR(batch->intrinsics[0][0][0].item<float>(), 1.3737387f, 1e-5f) << "½ / tan 20°";
    EXPECT_EQ(batch->intrinsics[0][1][2].item<float>(), 0.5f);
  }
  EXPECT_GT(fronts, 0);
  EXPECT_LT(fronts, kDraws);
}

TEST_F(PublishedClasses, SkeletonVoxelsAreDilatedInOrder) {
  Json args = test::feature_args();
  args["skl_dilation_iter"] = 2;
  const auto batch = test::load<FeatureSkeletonBatch>(*make("AniGenSparseFeat2Skeleton", args).train, {{0, 0}});
  const Tensor coords = batch->feats_skl.coords.to(torch::kInt64);
  ASSERT_EQ(coords.size(0), 200);
  const Tensor key = (coords.select(1, 1) * 64 + coords.select(1, 2)) * 64 + coords.select(1, 3);
  EXPECT_TRUE((key.slice(0, 1) > key.slice(0, 0, -1)).all().item<bool>()) << "lexicographic, each once";
  EXPECT_EQ(key[0].item<std::int64_t>(), (0 * 64 + 30) * 64 + 31);
}

TEST_F(PublishedClasses, RandomDilationLiesBetweenTheSmallAndTheLargeOne) {
  Json args = test::feature_args();
  args["skl_dilation_iter"] = 2;
  args["skl_dilation_random_aug"] = true;
  const Datasets data = make("AniGenSparseFeat2Skeleton", args);
  int random = 0;
  for (std::uint64_t position = 0; position < 20; ++position) {
    const std::int64_t count = test::load<FeatureSkeletonBatch>(*data.train, {{0, position}})->feats_skl.lengths[0];
    // Side 3: 27 + 18; side 5: 125 + 75; side 7: 343 + 196.
    EXPECT_GE(count, 27 + 18);
    EXPECT_LE(count, 343 + 196);
    random += count == 200 ? 0 : 1;
  }
  EXPECT_GT(random, 0) << "probability ½ per sample";
  EXPECT_LT(random, 20);
}

TEST_F(PublishedClasses, SkinMayAccumulateDownTheTreeAndSolversComeOnDemand) {
  Json args = test::feature_args();
  args["skin_accum_as_flow"] = true;
  args["load_cubvh"] = true;
  const Datasets data = make("AniGenSparseFeat2Skeleton", args);
  const auto first = test::load<FeatureSkeletonBatch>(*data.train, {{0, 0}});
  const auto again = test::load<FeatureSkeletonBatch>(*data.train, {{0, 9}});
  EXPECT_TRUE(torch::equal(first->rigs.skin[0], torch::tensor({{1.0f, 0.0f}, {1.0f, 0.0f}, {1.0f, 0.75f}})));
  ASSERT_EQ(first->rigs.surfaces.size(), 1u);
  EXPECT_EQ(first->rigs.surfaces[0], again->rigs.surfaces[0]) << "built once";
  EXPECT_NEAR(first->rigs.surfaces[0]->query(Eigen::Vector3d(0.0, 0.3, 0.0)).distance, 0.3, 1e-12);
}

TEST_F(PublishedClasses, StructureLatentsComeWithACroppedConditionOnBlack) {
  const Datasets data = make("ImageConditionedAniGenSparseStructureLatent", test::structure_latent_args());
  const auto batch = test::load<StructureLatentBatch>(*data.train, {{1, 0}, {2, 1}});
  EXPECT_EQ(batch->x_0.sizes(), (std::vector<std::int64_t>{2, 8, 2, 2, 2}));
  EXPECT_EQ(batch->x_0_skl.sizes(), (std::vector<std::int64_t>{2, 4, 2, 2, 2}));
  EXPECT_EQ(batch->x_0[1][3][1][0][1].item<float>(), 2.0f + (3 * 8 + 5) / 64.0f);
  EXPECT_EQ(batch->x_0_skl[0][0][0][0][1].item<float>(), -1.0f - 1 / 64.0f);
  // The object is [4, 8) × [6, 12): centre (5.5, 8.5), half-size 1.2 · 5 / 2 = 3, box [2, 8) × [5, 11).
  EXPECT_EQ(batch->cond.sizes(), (std::vector<std::int64_t>{2, 3, 6, 6}));
  for (int b = 0; b < 2; ++b) {
    const Tensor cond = batch->cond[b];
    const bool first = cond[0][1][2].item<float>() > 0.5f;
    for (int y = 0; y < 6; ++y) {
      for (int x = 0; x < 6; ++x) {
        const bool object = x >= 2 && y >= 1;
        EXPECT_EQ(cond[1][y][x].item<float>(), object ? (first ? 100.0f : 40.0f) / 255.0f : 0.0f) << x << " " << y;
      }
    }
  }
}

TEST_F(PublishedClasses, ColoursOfTransparentPixelsDoNotBleedIntoTheCondition) {
  Json args = test::structure_latent_args();
  args["image_size"] = 24;
  const Datasets data = make("ImageConditionedAniGenSparseStructureLatent", args);
  const std::vector<Draw> draws{{0, 0}, {0, 1}, {0, 2}, {0, 3}};
  const Tensor beside_white = test::load<StructureLatentBatch>(*data.train, draws)->cond;
  for (const char* name : {"000.png", "001.png"}) {
    io::Image image = io::read_image(sample_.condition(0) / name);
    for (std::size_t i = 0; i < image.rgba.size(); i += 4) {
      if (image.rgba[i + 3] == 0) std::fill_n(image.rgba.begin() + static_cast<std::ptrdiff_t>(i), 3, std::uint8_t{0});
    }
    io::write_png(sample_.condition(0) / name, image);
  }
  EXPECT_TRUE(torch::equal(test::load<StructureLatentBatch>(*data.train, draws)->cond, beside_white));
  EXPECT_GT(((beside_white > 0) & (beside_white < 0.07)).sum().item<int>(), 0) << "edges are soft after resizing";
}

TEST_F(PublishedClasses, UnconditionedClassesReadNoImages) {
  std::filesystem::remove_all(folder_.path() / "renders_cond");
  EXPECT_THROW(make("AniGenImageConditionedSLat", test::latent_args()), InputError);
  const auto structure =
      test::load<StructureLatentBatch>(*make("AniGenSparseStructureLatent", {{"latent_model", "ss"}}).train, {{0, 0}});
  EXPECT_FALSE(structure->cond.defined());
  const auto latent =
      test::load<StructuredLatentBatch>(*make("AniGenSLat", {{"latent_model", "slat"}}).train, {{0, 0}});
  EXPECT_FALSE(latent->cond.defined());
  EXPECT_EQ(latent->x_0.feats.size(1), 16);
}

TEST_F(PublishedClasses, StructuredLatentsAreNormalisedPerChannelAndKeepRawSkin) {
  Json args = test::latent_args();
  std::vector<double> mean(16, 0.0), deviation(16, 1.0);
  mean[3] = 2.0;
  deviation[3] = 4.0;
  args["normalization"] = {{"mean", mean}, {"std", deviation}, {"mean_skl", {0, 0, 0, 0}}, {"std_skl", {1, 2, 1, 1}}};
  args["use_joint_num_cond"] = true;
  const auto batch =
      test::load<StructuredLatentBatch>(*make("AniGenImageConditionedSLat", args).train, {{1, 0}, {2, 1}});
  expect_surface_coords(batch->x_0, {1, 2});
  EXPECT_EQ(batch->x_0.feats.sizes(), (std::vector<std::int64_t>{11, 16}));
  EXPECT_EQ(batch->x_0.feats[7][5].item<float>(), 202.0f + 5 / 16.0f);
  EXPECT_EQ(batch->x_0.feats[7][3].item<float>(), (202.0f + 3 / 16.0f - 2.0f) / 4.0f);
  EXPECT_EQ(batch->x_0_skl.feats[3][1].item<float>(), 0.5f);
  EXPECT_TRUE(torch::equal(batch->x_0_skl.coords[3], torch::tensor({1, 30, 31, 33}, torch::kInt32)));
  EXPECT_TRUE(torch::equal(batch->rigs.skin[0], torch::tensor({{1.0f, 0.0f}, {0.0f, 0.0f}, {1.0f, 3.0f}})));
  EXPECT_TRUE(torch::equal(batch->joints_num, torch::tensor({2, 2}, torch::kInt64)));
  EXPECT_EQ(batch->cond.sizes(), (std::vector<std::int64_t>{2, 3, 6, 6}));
}

TEST_F(PublishedClasses, StructureLatentsAreNormalisedFromFiles) {
  io::write_npz(folder_ / "stats.npz", {{"feats_mean", io::NdArray::from(std::vector<float>(8, 1.0f), {1, 8, 1, 1, 1})},
                                        {"feats_std", io::NdArray::from(std::vector<float>(8, 2.0f), {8})},
                                        {"feats_skl_mean", io::NdArray::from(std::vector<float>(4, 0.0f), {4})},
                                        {"feats_skl_std", io::NdArray::from(std::vector<float>(4, 0.0f), {4})}});
  Json args = test::structure_latent_args();
  for (const char* key : {"normalization", "normalization_skl"}) args[key] = (folder_ / "stats.npz").string();
  const Datasets data = make("ImageConditionedAniGenSparseStructureLatent", args);
  const auto batch = test::load<StructureLatentBatch>(*data.train, {{2, 0}});
  EXPECT_EQ(batch->x_0[0][0][0][0][1].item<float>(), (2.0f + 1 / 64.0f - 1.0f) / 2.0f);
  EXPECT_FLOAT_EQ(batch->x_0_skl[0][0][0][0][1].item<float>(), (-2.0f - 1 / 64.0f) / 1e-3f) << "clipped from below";
}

TEST_F(PublishedClasses, StatisticsMayBeListedAndFilesAreWrittenOut) {
  io::write_npz(folder_ / "stats.npz", {{"feats_mean", io::NdArray::from(std::vector<float>(8, 1.0f), {8})},
                                        {"feats_std", io::NdArray::from(std::vector<float>(8, 2.0f), {8})},
                                        {"feats_skl_mean", io::NdArray::from(std::vector<float>(4, 0.5f), {4})},
                                        {"feats_skl_std", io::NdArray::from(std::vector<float>(4, 0.0f), {4})}});
  Json dataset = {{"name", "ImageConditionedAniGenSparseStructureLatent"}, {"args", test::structure_latent_args()}};
  dataset["args"]["data_dir"] = folder_.path().string() + ",elsewhere";
  for (const char* key : {"normalization", "normalization_skl"}) dataset["args"][key] = "stats.npz";
  write_out_statistics(dataset, "config.json");
  const Json& args = dataset["args"];
  EXPECT_EQ(args["normalization"], (Json{{"mean", std::vector<double>(8, 1.0)}, {"std", std::vector<double>(8, 2.0)}}));
  EXPECT_EQ(args["normalization_skl"]["mean"], Json(std::vector<double>(4, 0.5)));

  Json listed = test::structure_latent_args();
  listed["normalization"] = args["normalization"];
  const Datasets data = make("ImageConditionedAniGenSparseStructureLatent", listed);
  const auto batch = test::load<StructureLatentBatch>(*data.train, {{2, 0}});
  EXPECT_EQ(batch->x_0[0][0][0][0][1].item<float>(), (2.0f + 1 / 64.0f - 1.0f) / 2.0f);

  const Json before = dataset;
  write_out_statistics(dataset, "config.json");
  EXPECT_EQ(dataset, before);
  dataset["args"]["normalization"] = "missing.npz";
  EXPECT_THROW(write_out_statistics(dataset, "config.json"), InputError);
  dataset["name"] = "AniGenSparseStructure";
  EXPECT_NO_THROW(write_out_statistics(dataset, "config.json"));
}

}  // namespace
}  // namespace anigen::data
