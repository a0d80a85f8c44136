#include <gtest/gtest.h>

#include <fstream>

#include "anigen/core/error.h"
#include "anigen/loaders/datasets/structure_latent_dataset.h"
#include "tests/loaders/published_dataset.h"

namespace anigen::loaders {
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
      for (const char* name : {"000_normal.png", "001_normal.png"}) {
        io::write_png(sample_.condition(i) / name, test::PublishedSample::picture(127, 127, 255));
      }
    }
  }
  test::TemporaryFolder folder_;
  test::PublishedSample sample_{folder_ / "data"};
};

TEST_F(ConditionPictures, NormalsAreReadFromTheirOwnFilesCroppedAndMaskedAsColours) {
  write_normals();
  const torch::Tensor normals = first("normal")->cond[0], colors = first("color")->cond[0];
  // What is background in one is background in the other; inside, a surface square to the camera.
  const torch::Tensor object = colors[1] > 0;
  EXPECT_TRUE(torch::equal(normals[2] > 0, object));
  EXPECT_TRUE(torch::equal(normals[2], object.to(torch::kFloat32)));
  EXPECT_NEAR(normals[0].max().item<float>(), 127.0f / 255.0f, 1e-6f);
  EXPECT_TRUE(torch::equal(first("")->cond, first("color")->cond)) << "published default";
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
}  // namespace anigen::loaders
