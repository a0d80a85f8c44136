#include <gtest/gtest.h>
#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string>

#include "anigen/core/config.h"
#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/random.h"
#include "anigen/io/image.h"
#include "anigen/nn/init.h"
#include "anigen/nn/state_dict.h"
#include "anigen/render/cameras_json.h"
#include "anigen/vision/condition.h"
#include "anigen/vision/dinov2.h"
#include "anigen/vision/voxel_features.h"
#include "tests/support/paths.h"
#include "tests/vision/deterministic_fill.h"

namespace anigen::vision {

namespace {

// A camera at (0, 0, -2) that looks along +z with x right and y down; at distance 2 it sees [-1, 1]².
Tensor extrinsics() {
  Tensor matrix = torch::eye(4);
  matrix[2][3] = 2.0;
  return matrix.unsqueeze(0);
}

Tensor intrinsics() {
  Tensor matrix = torch::eye(3);
  for (int axis = 0; axis < 2; ++axis) {
    matrix[axis][axis] = 1.0;
    matrix[axis][2] = 0.5;
  }
  return matrix.unsqueeze(0);
}

TEST(ProjectPoints, CentreCornersAndDepth) {
  const Tensor points =
      torch::tensor({{0.0F, 0.0F, 0.0F}, {-1.0F, -1.0F, 0.0F}, {1.0F, 0.5F, 0.0F}, {1.0F, 0.0F, 2.0F}});
  const Tensor uv = project_points(points, extrinsics(), intrinsics())[0];
  const Tensor expected = torch::tensor({{0.0F, 0.0F}, {-1.0F, -1.0F}, {1.0F, 0.5F}, {0.5F, 0.0F}});
  EXPECT_TRUE(torch::allclose(uv, expected, 1e-6, 1e-6)) << uv;
}

TEST(SamplePatches, BilinearBetweenPatchCentresRowByRow) {
  // Patches 0 1 / 2 3 of a 2 × 2 grid; their centres lie at ±0.5.
  const Tensor patches = torch::arange(4, torch::kFloat32).view({1, 4, 1});
  const Tensor uv =
      torch::tensor({{-0.5F, -0.5F}, {0.5F, -0.5F}, {-0.5F, 0.5F}, {0.0F, 0.0F}, {1.0F, -0.5F}}).unsqueeze(0);
  const Tensor found = sample_patches(patches, 2, 2, uv)[0].flatten();
  // The last lies on the picture's edge, half a patch beyond the last centre: half of patch 1, half nothing.
  EXPECT_TRUE(torch::allclose(found, torch::tensor({0.0F, 1.0F, 2.0F, 1.5F, 0.5F}), 1e-6, 1e-6)) << found;
}

TEST(SamplePatches, OutsideIsZeroWhateverTheNumber) {
  const Tensor patches = torch::ones({1, 1, 3});
  const float nan = std::nanf(""), infinite = INFINITY;
  const Tensor uv =
      torch::tensor({{3.0F, 0.0F}, {-1e30F, 0.0F}, {nan, 0.0F}, {0.0F, infinite}, {-infinite, nan}, {0.0F, 0.0F}})
          .unsqueeze(0);
  const Tensor found = sample_patches(patches, 1, 1, uv)[0];
  EXPECT_EQ(found.slice(0, 0, 5).abs().max().item<float>(), 0.0F) << found;
  EXPECT_EQ(found[5][2].item<float>(), 1.0F);
}

TEST(ViewMean, CountsEveryViewAndForgetsTheBatches) {
  torch::manual_seed(1);
  const Tensor per_view = torch::randn({7, 5, 3});
  ViewMean at_once, one_by_one;
  at_once.add(per_view);
  for (std::int64_t v = 0; v < 7; ++v) one_by_one.add(per_view.slice(0, v, v + 1));
  EXPECT_TRUE(torch::equal(at_once.mean(), one_by_one.mean()));
  EXPECT_TRUE(torch::allclose(at_once.mean(), per_view.mean(0), 1e-5, 1e-6));

  ViewMean half_seen;
  half_seen.add(torch::full({1, 2, 1}, 6.0F));
  half_seen.add(torch::zeros({2, 2, 1}));
  EXPECT_EQ(half_seen.mean()[1][0].item<float>(), 2.0F);
  EXPECT_EQ(half_seen.views(), 3);
}

TEST(ViewMean, LeavesItsInputAlone) {
  const Tensor first = torch::ones({1, 2, 1});
  ViewMean mean;
  mean.add(first);
  mean.add(first);
  EXPECT_EQ(first[0][0][0].item<float>(), 1.0F);
}

}  // namespace

namespace {

constexpr int kSize = 28, kPatches = 7;  // per side, of the views as the model sees them

Dinov2 tiny_model() {
  Dinov2Options options;
  options.img_size = kSize;
  options.patch_size = kSize / kPatches;
  options.embed_dim = 8;
  options.depth = 2;
  options.num_heads = 2;
  options.num_register_tokens = 3;
  Dinov2 model(options);
  test::golden_fill(*model);
  return model;
}

class DinoFeaturesTest : public testing::Test {
 protected:
  // Solid pictures seen from the published feature-view distance; 20 pixels, so that they are resized.
  void write_views(const std::vector<std::uint32_t>& colors) {
    std::vector<render::ViewCamera> cameras;
    for (std::size_t i = 0; i < colors.size(); ++i) cameras.push_back(camera(i));
    const render::Transforms transforms = render::make_transforms(cameras, {});
    render::write_transforms(folder_ / "transforms.json", transforms);
    for (std::size_t i = 0; i < colors.size(); ++i)
      io::write_png(folder_.path() / transforms.frames[i].file_path, io::Image(20, 20, colors[i]));
  }

  static render::ViewCamera camera(std::size_t i) { return {0.7 * static_cast<double>(i), 0.3, 2.0, 0.7}; }

  io::NdArray extract() const {
    return DinoFeatures("tiny", "test", tiny_model(), kSize).extract({asset_, voxels_, 64, folder_.path()});
  }

  test::TemporaryFolder folder_;
  Asset asset_;
  std::vector<geometry::Voxel> voxels_ = {{20, 30, 40}, {31, 32, 31}, {40, 22, 35}};
};

// At the middle of a picture with an odd number of patches the projection reads one patch alone, so the cube's centre
// reads the mean over views of their middle patches.
TEST_F(DinoFeaturesTest, CentreReadsTheMiddlePatchOfEveryView) {
  const std::vector<std::uint32_t> colors = {0xFF8000FFu, 0x2040C0FFu, 0xFF000080u};
  write_views(colors);
  voxels_ = {{0, 0, 0}};
  Dinov2 model = tiny_model();
  const DinoFeatures extractor("tiny", "test", model, kSize);
  EXPECT_EQ(extractor.channels(), 8);
  EXPECT_TRUE(extractor.needs_views());

  const torch::NoGradGuard no_grad;
  Tensor expected = torch::zeros({8});
  for (const std::uint32_t color : colors) {
    const Tensor picture = view_image(io::Image(kSize, kSize, color), kSize);
    const Tensor tokens = model->forward(imagenet_normalized(picture.unsqueeze(0))).prenorm_patches()[0];
    expected += tokens[kPatches * kPatches / 2] / 3.0;
  }
  // A grid of one cell has its only voxel's centre at the origin.
  const Tensor found = nn::to_tensor(extractor.extract({asset_, voxels_, 1, folder_.path()})).to(torch::kFloat32)[0];
  EXPECT_TRUE(torch::allclose(found, expected, 2e-3, 2e-3)) << found << expected;
}

TEST_F(DinoFeaturesTest, RowsAreInTheOrderOfTheVoxels) {
  write_views({0xFF8000FFu, 0x2040C0FFu});
  const Tensor rows = nn::to_tensor(extract());
  ASSERT_EQ(rows.scalar_type(), torch::kHalf);
  ASSERT_EQ(rows.sizes(), (std::vector<std::int64_t>{3, 8}));
  std::swap(voxels_[0], voxels_[2]);
  const Tensor swapped = nn::to_tensor(extract());
  EXPECT_TRUE(torch::equal(swapped[0], rows[2]));
  EXPECT_TRUE(torch::equal(swapped[1], rows[1]));
  EXPECT_FALSE(torch::equal(rows[0], rows[2]));
  voxels_.clear();
  EXPECT_EQ(extract().shape, (std::vector<std::int64_t>{0, 8}));
}

TEST_F(DinoFeaturesTest, MoreViewsThanFitIntoABatch) {
  write_views({0x2040C0FFu});
  const Tensor one = nn::to_tensor(extract()).to(torch::kFloat32);
  // One view seventy times; batches hold at most 64.
  render::Transforms transforms = render::read_transforms(folder_ / "transforms.json");
  transforms.frames.resize(70, transforms.frames.front());
  render::write_transforms(folder_ / "transforms.json", transforms);
  const Tensor many = nn::to_tensor(extract()).to(torch::kFloat32);
  EXPECT_TRUE(torch::allclose(many, one, 2e-3, 1e-4)) << many << one;
}

TEST_F(DinoFeaturesTest, NamesTheViewThatCannotBeRead) {
  const auto refusal = [&] {
    try {
      extract();
    } catch (const InputError& error) {
      return std::string(error.what());
    }
    return std::string();
  };
  EXPECT_NE(refusal().find("transforms.json"), std::string::npos);
  write_views({0xFF8000FFu, 0x2040C0FFu});
  write_file_atomically(folder_ / "001.png", read_file(folder_ / "001.png").substr(0, 30));
  EXPECT_NE(refusal().find("001.png"), std::string::npos) << refusal();
  std::filesystem::remove(folder_ / "000.png");
  EXPECT_NE(refusal().find("000.png"), std::string::npos) << refusal();
}

}  // namespace

namespace {

std::string refusal(const prepare::FeatureOptions& options) {
  try {
    make_feature_extractor(options);
  } catch (const InputError& error) {
    return error.what();
  }
  return "";
}

TEST(FeatureModels, SurfaceNeedsNothing) {
  EXPECT_EQ(make_feature_extractor({"surface", {}, "cpu"})->name(), "surface");
  EXPECT_NE(refusal({"surface", "weights.pth", "cpu"}).find("takes no weights"), std::string::npos);
}

TEST(FeatureModels, ListsSurfaceAndThePublishedModels) {
  const std::vector<std::string> names = feature_models();
  EXPECT_EQ(names.front(), "surface");
  EXPECT_EQ(std::count(names.begin(), names.end(), "dinov2_vitl14_reg"), 1);
}

TEST(FeatureModels, DinoWithoutWeightsSaysHowToGiveThem) {
  const std::string message = refusal({"dinov2_vitl14_reg", {}, "cpu"});
  for (const char* word : {"--feature-weights", "dinov2_vitl14_reg4_pretrain.pth", "surface"})
    EXPECT_NE(message.find(word), std::string::npos) << message;
  EXPECT_NE(refusal({"dinov2_vits14", {}, "cpu"}).find("dinov2_vits14_pretrain.pth"), std::string::npos);
}

TEST(FeatureModels, UnknownNamesAndFilesAndDevices) {
  EXPECT_NE(refusal({"dinov2_vitl14_re", {}, "cpu"}).find("'dinov2_vitl14_reg'"), std::string::npos);
  EXPECT_NE(refusal({"surfaces", {}, "cpu"}).find("'surface'"), std::string::npos);
  EXPECT_NE(refusal({"", {}, "cpu"}).find("surface"), std::string::npos);
  EXPECT_NE(refusal({"dinov2_vits14", "absent.pth", "cpu"}).find("absent.pth"), std::string::npos);
  EXPECT_NE(refusal({"dinov2_vits14", "absent.pth", "toaster"}).find("toaster"), std::string::npos);
}

// A safetensors file with the tensors of a published model, all zero: a hole, so that it costs no disk.
void write_zeros(const std::filesystem::path& path, const std::string& model) {
  Json header;
  std::uint64_t end = 0;
  const Dinov2 empty(Dinov2Options::named(model));
  for (const nn::StateEntry& entry : nn::state_entries(*empty)) {
    const std::uint64_t begin = end;
    end += static_cast<std::uint64_t>(entry.tensor.nbytes());
    header[entry.key] = {{"dtype", "F32"}, {"shape", entry.tensor.sizes().vec()}, {"data_offsets", {begin, end}}};
  }
  std::string text = header.dump();
  text.resize((text.size() + 7) / 8 * 8, ' ');
  std::ofstream stream(path, std::ios::binary);
  for (int byte = 0; byte < 8; ++byte) stream.put(static_cast<char>(text.size() >> (8 * byte) & 0xFF));
  stream << text;
  stream.close();
  std::filesystem::resize_file(path, 8 + text.size() + end);
}

// The whole way from a file of published size to an extractor and its fingerprint.
TEST(FeatureModels, PublishedSizeFromAFile) {
  const test::TemporaryFolder folder;
  const std::filesystem::path weights = folder / "weights.safetensors";
  write_zeros(weights, "dinov2_vits14_reg");
  const auto extractor = make_feature_extractor({"dinov2_vits14_reg", weights, "cpu"});
  EXPECT_EQ(extractor->name(), "dinov2_vits14_reg");
  EXPECT_EQ(extractor->channels(), 384);
  EXPECT_TRUE(extractor->needs_views());

  const std::string message = refusal({"dinov2_vitb14_reg", weights, "cpu"});
  EXPECT_NE(message.find("[1, 1, 384]"), std::string::npos) << message;
  EXPECT_NE(message.find("[1, 1, 768]"), std::string::npos) << message;

  std::fstream(weights, std::ios::binary | std::ios::in | std::ios::out).seekp(-4, std::ios::end).write("\1", 1);
  const auto changed = make_feature_extractor({"dinov2_vits14_reg", weights, "cpu"});
  EXPECT_NE(changed->fingerprint(), extractor->fingerprint());
}

}  // namespace

namespace {

using geometry::Voxel;

TEST(VoxelNeighbours, AgreeWithASearchThroughAll) {
  constexpr int kCells = 9;
  Rng rng(3, "voxels");
  std::vector<Voxel> voxels;
  for (int x = 0; x < kCells; ++x) {
    for (int y = 0; y < kCells; ++y) {
      for (int z = 0; z < kCells; ++z) {
        if (rng.chance(0.3)) voxels.push_back({x, y, z});
      }
    }
  }
  std::swap(voxels.front(), voxels.back());  // any order will do
  const VoxelNeighbours neighbours(voxels, kCells);
  for (const int radius : {0, 1, 2}) {
    for (const Voxel& voxel : voxels) {
      std::vector<std::size_t> expected;
      for (std::size_t i = 0; i < voxels.size(); ++i) {
        bool near = true;
        for (std::size_t axis = 0; axis < 3; ++axis) near = near && std::abs(voxels[i][axis] - voxel[axis]) <= radius;
        if (near) expected.push_back(i);
      }
      std::vector<std::size_t> found = neighbours.within(voxel, radius);
      std::sort(found.begin(), found.end());
      ASSERT_EQ(found, expected);
    }
  }
}

TEST(VoxelNeighbours, RefusesVoxelsOutsideOrTwice) {
  EXPECT_THROW(VoxelNeighbours({{0, 0, 4}}, 4), InputError);
  EXPECT_THROW(VoxelNeighbours({{0, -1, 0}}, 4), InputError);
  EXPECT_THROW(VoxelNeighbours({{1, 2, 3}, {0, 0, 0}, {1, 2, 3}}, 4), InputError);
  EXPECT_THROW(VoxelNeighbours({}, 0), InputError);
}

}  // namespace

}  // namespace anigen::vision
