#include "anigen/features/dino_features.h"

#include <gtest/gtest.h>

#include <string>

#include "anigen/core/atomic_file.h"
#include "anigen/core/error.h"
#include "anigen/features/image_condition.h"
#include "anigen/io/image.h"
#include "anigen/models/tensor_arrays.h"
#include "anigen/raytrace/views/transforms_json.h"
#include "tests/models/deterministic_fill.h"
#include "tests/support/paths.h"

namespace anigen::features {
namespace {

constexpr int kSize = 28, kPatches = 7;  // per side, of the views as the model sees them

models::Dinov2 tiny_model() {
  models::Dinov2Options options;
  options.img_size = kSize;
  options.patch_size = kSize / kPatches;
  options.embed_dim = 8;
  options.depth = 2;
  options.num_heads = 2;
  options.num_register_tokens = 3;
  models::Dinov2 model(options);
  test::golden_fill(*model);
  return model;
}

class DinoFeaturesTest : public testing::Test {
 protected:
  // Solid pictures seen from the published feature-view distance; 20 pixels, so that they are resized.
  void write_views(const std::vector<std::uint32_t>& colors) {
    std::vector<raytrace::ViewCamera> cameras;
    for (std::size_t i = 0; i < colors.size(); ++i) cameras.push_back(camera(i));
    const raytrace::Transforms transforms = raytrace::make_transforms(cameras, {});
    raytrace::write_transforms(folder_ / "transforms.json", transforms);
    for (std::size_t i = 0; i < colors.size(); ++i) {
      io::write_png(folder_.path() / transforms.frames[i].file_path, io::Image(20, 20, colors[i]));
    }
  }

  static raytrace::ViewCamera camera(std::size_t i) { return {0.7 * static_cast<double>(i), 0.3, 2.0, 0.7}; }

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
  models::Dinov2 model = tiny_model();
  const DinoFeatures extractor("tiny", "test", model, kSize);
  EXPECT_EQ(extractor.channels(), 8);
  EXPECT_TRUE(extractor.needs_views());

  const torch::NoGradGuard no_grad;
  Tensor expected = torch::zeros({8});
  for (const std::uint32_t color : colors) {
    const Tensor picture = view_image(io::Image(kSize, kSize, color), kSize);
    const Tensor tokens = model->forward(models::imagenet_normalized(picture.unsqueeze(0))).prenorm_patches()[0];
    expected += tokens[kPatches * kPatches / 2] / 3.0;
  }
  // A grid of one cell has its only voxel's centre at the origin.
  const Tensor found =
      models::to_tensor(extractor.extract({asset_, voxels_, 1, folder_.path()})).to(torch::kFloat32)[0];
  EXPECT_TRUE(torch::allclose(found, expected, 2e-3, 2e-3)) << found << expected;
}

TEST_F(DinoFeaturesTest, RowsAreInTheOrderOfTheVoxels) {
  write_views({0xFF8000FFu, 0x2040C0FFu});
  const Tensor rows = models::to_tensor(extract());
  ASSERT_EQ(rows.scalar_type(), torch::kHalf);
  ASSERT_EQ(rows.sizes(), (std::vector<std::int64_t>{3, 8}));
  std::swap(voxels_[0], voxels_[2]);
  const Tensor swapped = models::to_tensor(extract());
  EXPECT_TRUE(torch::equal(swapped[0], rows[2]));
  EXPECT_TRUE(torch::equal(swapped[1], rows[1]));
  EXPECT_FALSE(torch::equal(rows[0], rows[2]));
  voxels_.clear();
  EXPECT_EQ(extract().shape, (std::vector<std::int64_t>{0, 8}));
}

TEST_F(DinoFeaturesTest, MoreViewsThanFitIntoABatch) {
  write_views({0x2040C0FFu});
  const Tensor one = models::to_tensor(extract()).to(torch::kFloat32);
  // The same view seventy times; batches hold at most 64.
  raytrace::Transforms transforms = raytrace::read_transforms(folder_ / "transforms.json");
  transforms.frames.resize(70, transforms.frames.front());
  raytrace::write_transforms(folder_ / "transforms.json", transforms);
  const Tensor many = models::to_tensor(extract()).to(torch::kFloat32);
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
}  // namespace anigen::features
