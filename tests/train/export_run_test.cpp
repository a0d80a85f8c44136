#include "anigen/train/export_run.h"

#include <gtest/gtest.h>

#include "anigen/core/config.h"
#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/io/arrays/safetensors.h"
#include "anigen/io/arrays/torch_archive.h"
#include "tests/support/paths.h"

namespace anigen::train {
namespace {

class ExportRun : public ::testing::Test {
 protected:
  ExportRun() {
    std::filesystem::create_directories(run() / "ckpts");
    write_file_atomically(run() / "config.json", R"({
      "models": {"denoiser": {"name": "Any", "args": {}}},
      "dataset": {"name": "Any", "args": {"data_dir": "/data/of/mine", "ss_dec_path": "/runs/of/mine/ss_dae/"}},
      "trainer": {"name": "Any", "args": {"image_encoder": {"estimator": "runs/picture_estimator"}}}})");
    write("denoiser_step0000010", 1.0F);
    write("denoiser_ema0.9_step0000010", 2.0F);
    write("image_encoder_step0000010", 3.0F);
  }

  std::filesystem::path run() const { return folder_ / "flow"; }

  void write(const std::string& name, float value) const {
    io::write_safetensors(run() / "ckpts" / (name + ".safetensors"),
                          {{"weight", io::NdArray::from(std::vector<float>{value, 0.1F, -7e-5F}, {3})},
                           {"rows", io::NdArray::from(std::vector<std::int64_t>{70000, 2}, {2})}});
  }

  test::TemporaryFolder folder_;
};

TEST_F(ExportRun, WritesAveragedWeightsInHalfPrecisionAndNoPaths) {
  const ExportedRun exported = export_run(run(), folder_ / "out");
  EXPECT_EQ(exported.models, (std::vector<std::string>{"denoiser", "image_encoder"}));
  EXPECT_EQ(exported.step, 10);
  EXPECT_EQ(exported.parameters, 10u);
  const auto arrays = io::read_state_dict(folder_ / "out/flow/ckpts/denoiser_step0000010.safetensors");
  const io::NdArray& weight = *io::find(arrays, "weight");
  EXPECT_EQ(weight.dtype, io::Dtype::kF16);
  EXPECT_EQ(weight.as<float>()[0], 2.0F) << "the average, not the weights";
  EXPECT_NEAR(weight.as<float>()[2], -7e-5F, 7e-5F / 1000) << "half a unit in the last place of eleven bits";
  EXPECT_EQ(io::find(arrays, "rows")->as<std::int64_t>()[0], 70000);
  const Json config = read_json(folder_ / "out/flow/config.json");
  EXPECT_EQ(config["dataset"]["args"], (Json{{"ss_dec_path", "ss_dae"}}));
  EXPECT_EQ(config["trainer"]["args"]["image_encoder"]["estimator"], "picture_estimator");
}

TEST_F(ExportRun, RefusesItsOwnFolderAndNumbersThatHalfPrecisionLacks) {
  EXPECT_THROW(export_run(run(), folder_.path()), InputError);
  write("denoiser_ema0.9_step0000010", 1e6F);
  EXPECT_THROW(export_run(run(), folder_ / "out"), InputError);
  EXPECT_FALSE(std::filesystem::exists(folder_ / "out")) << "nothing half written";
}

}  // namespace
}  // namespace anigen::train
