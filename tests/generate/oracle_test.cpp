// Every asset in four ways, with the small models of the parity fixtures on procedural creatures; the auto-encoder's
// encoder is untrained, for the features that need no network.
#include "anigen/generate/oracle.h"

#include <gtest/gtest.h>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/table.h"
#include "anigen/data/latent_files.h"
#include "anigen/data/voxel_files.h"
#include "anigen/generate/encode_report.h"
#include "anigen/prepare/dataset.h"
#include "anigen/structured_latent/encoder.h"
#include "anigen/vision/voxel_features.h"
#include "tests/generate/small_runs.h"
#include "tests/support/paths.h"

namespace anigen::generate {
namespace {

namespace fs = std::filesystem;

class OracleTest : public testing::Test {
 protected:
  void SetUp() override {
    const fs::path tree = test::parity_file("ckpt_tree");
    if (!fs::is_directory(tree)) GTEST_SKIP() << tree << " is not there";
    fs::copy(tree, folder_.path(), fs::copy_options::recursive);
    const fs::path runs = folder_ / "ckpts" / "anigen";
    AssetGenerator::Request& models = request_.generation.models;
    models.structure_flow = runs / "ss_flow_solo";
    models.latent_flow = runs / "slat_flow_control";
    test::give_image_encoder(models.structure_flow);
    test::give_image_encoder(models.latent_flow);
    models.structure_condition = StructureCondition::kColor;
    give_encoder(runs / "slat_dae");
    prepare();
    request_.generation.output = folder_ / "out";
    request_.generation.finishing.reduction = 0.8;
    request_.generation.finishing.views = 8;
    request_.generation.finishing.view_size = 64;
    request_.generation.finishing.texture_size = 0;
    request_.pairs.truth = data_;
    request_.pairs.splits = {folder_ / "all.txt"};
    request_.pairs.report = false;
    request_.pairs.settings.groups = {"skeleton", "skin", "surface"};
    request_.pairs.settings.surface_samples = 500;
    request_.pairs.settings.poses = 1;
    request_.pairs.settings.alignment.registration.rotations = 0;
  }

  void give_encoder(const fs::path& run) {
    Json config = read_json(run / "config.json");
    config["dataset"]["args"]["model"] = "surface";
    Json& args = config["models"]["encoder"]["args"];
    args["in_channels"] = 16;
    write_file_atomically(run / "config.json", config.dump(2));
    torch::manual_seed(1);
    const structured_latent::StructuredLatentEncoder encoder(
        structured_latent::StructuredLatentEncoderOptions::from_json(args));
    fs::remove(run / "ckpts" / "encoder_final.pt");
    io::write_safetensors(run / "ckpts" / "encoder_final.safetensors", nn::state_dict(*encoder));
  }

  void prepare() {
    data_ = folder_ / "data";
    prepare::PrepareOptions options;
    options.out = data_;
    options.sources = prepare::procedural_sources(3, 2);
    options.plan.condition_views.count = 1;
    options.plan.condition_views.size = 64;
    options.plan.features.model = "surface";
    options.run.features = vision::make_feature_extractor;
    prepare::prepare_dataset(options);
    const CsvTable table = read_csv(data_ / "metadata.csv");
    std::string ids;
    for (std::size_t row = 0; row < table.rows.size(); ++row) {
      ids_.push_back(table.cell(row, "sha256"));
      ids += ids_.back() + "\n";
    }
    write_file_atomically(folder_ / "all.txt", ids);
  }

  data::AssetId asset(std::size_t i) const {
    data::AssetId asset;
    asset.root = data_;
    asset.id = ids_[i];
    return asset;
  }
  fs::path mesh(const char* row, std::size_t i) const {
    return request_.generation.output / row / ids_[i] / "mesh.glb";
  }
  std::string refusal() const {
    try {
      evaluate_oracle(request_);
    } catch (const NotSupportedError& error) {
      return error.what();
    }
    return "none";
  }

  test::TemporaryFolder folder_;
  fs::path data_;
  std::vector<std::string> ids_;
  OracleRequest request_;
};

TEST_F(OracleTest, EveryRowHasEveryAssetAndIsKept) {
  const Oracle oracle = evaluate_oracle(request_);
  ASSERT_EQ(oracle.assets.size(), ids_.size());
  std::vector<fs::file_time_type> times;
  for (std::size_t i = 0; i < ids_.size(); ++i) {
    for (const auto& [row, failure] : oracle.assets[i].failures) ADD_FAILURE() << row << ": " << failure;
    for (const char* row : kOracleRows) {
      ASSERT_TRUE(fs::is_regular_file(mesh(row, i))) << row;
      times.push_back(fs::last_write_time(mesh(row, i)));
    }
    EXPECT_EQ(oracle.assets[i].structure.size(), 2u);
  }
  const Json json = read_json(request_.generation.output / "oracle.json");
  for (const char* row : kOracleRows) {
    for (const char* part : {"aligned", "unaligned"})
      EXPECT_EQ(json["rows"][row][part]["j2j"]["n"], ids_.size()) << row;
    EXPECT_TRUE(json["rows"][row]["aligned"].contains("skin_l1")) << row;
  }
  EXPECT_EQ(json["voxels"]["stage 4"]["n"], ids_.size());
  const std::string text = read_file(request_.generation.output / "oracle.md");
  for (const char* row : kOracleRows) EXPECT_NE(text.find(std::string("| ") + row), std::string::npos) << text;

  fs::remove(mesh(kOracleRows[1], 1));
  EXPECT_EQ(to_json(evaluate_oracle(request_))["rows"], to_json(oracle)["rows"]);
  EXPECT_TRUE(fs::exists(mesh(kOracleRows[1], 1))) << "made again";
  for (std::size_t k = 0; k < kOracleRows.size(); ++k)
    EXPECT_EQ(fs::last_write_time(mesh(kOracleRows[k], 0)), times[k]) << "kept";
}

// At an asset's own voxels, features are those of the dataset; anywhere else they exist.
TEST_F(OracleTest, FeaturesAtOtherVoxelsAreThoseOfTheMesh) {
  const torch::NoGradGuard no_grad;
  const AssetGenerator generator(request_.generation.models);
  const StructuredLatentCoder coder = generator.latent_coder();
  const StructuredLatentCoder::Inputs own = coder.inputs(asset(0));
  const std::int64_t r = generator.grid();
  const auto grid_of = [&](const sparse::Support& support) {
    const torch::Tensor at = support.coords().to(torch::kInt64);
    torch::Tensor grid = torch::zeros({r, r, r}, torch::kBool);
    grid.index_put_({at.select(1, 1), at.select(1, 2), at.select(1, 3)}, torch::ones({}, torch::kBool));
    return grid;
  };
  sparse_structure::VoxelPair voxels{grid_of(*own.x.support), grid_of(*own.x_skl.support)};
  const StructuredLatentCoder::Inputs again = coder.inputs_at(asset(0), voxels);
  ASSERT_TRUE(torch::equal(again.x.support->coords(), own.x.support->coords()));
  EXPECT_TRUE(torch::allclose(again.x.feats, own.x.feats, 0.0, 2e-3)) << (again.x.feats - own.x.feats).abs().max();
  EXPECT_EQ(again.x_skl.support->size(), own.x_skl.support->size());

  voxels.shape.fill_(true);
  const StructuredLatentCoder::Inputs everywhere = coder.inputs_at(asset(0), voxels);
  EXPECT_EQ(everywhere.x.support->size(), r * r * r);
  EXPECT_TRUE(torch::isfinite(everywhere.x.feats).all().item<bool>());
}

// Latents for stage 5 at the voxels that stage 4 sees, as inference meets them.
TEST_F(OracleTest, LatentsAreEncodedAtSeenVoxels) {
  const torch::NoGradGuard no_grad;
  EncodeRequest encoded;
  encoded.run = folder_ / "ckpts" / "anigen" / "slat_dae";
  encoded.data = data_;
  encoded.name = "seen";
  encoded.ss_flow = request_.generation.models.structure_flow;
  encoded.view = 5;  // of one: counted round
  const EncodedLatents result = encode_structured_latents(encoded);
  EXPECT_EQ(result.encoded, ids_.size()) << to_text(result, "latents");
  const fs::path file = data_ / "latents" / "seen" / (ids_[0] + ".npz");
  const io::NamedArrays arrays = data::read_arrays(file, {{"view", {1}}, {"coords", {-1, 3}}});
  EXPECT_EQ(data::whole_numbers(arrays, "view", file.string()).front(), 0);

  encoded.name = "own";
  encoded.ss_flow.clear();
  encode_structured_latents(encoded);
  EXPECT_NE(read_file(data_ / "latents" / "own" / (ids_[0] + ".npz")), read_file(file));
  encoded.name = "seen";
  encoded.ss_flow = request_.generation.models.structure_flow;
  EXPECT_EQ(encode_structured_latents(encoded).up_to_date, ids_.size());

  fs::remove(data_ / "assets" / (ids_[1] + ".glb"));
  encoded.again = true;
  const EncodedLatents without = encode_structured_latents(encoded);
  ASSERT_EQ(without.failed.size(), 1u);
  EXPECT_NE(without.failed.begin()->second.find("--no-assets"), std::string::npos) << without.failed.begin()->second;
}

TEST_F(OracleTest, WhatHasNoFeaturesElsewhereIsNamed) {
  const fs::path file = data_ / "assets" / (ids_[1] + ".glb");
  fs::rename(file, data_ / "away.glb");
  EXPECT_NE(refusal().find(file.string()), std::string::npos) << refusal();
  fs::rename(data_ / "away.glb", file);
  const fs::path config_file = folder_ / "ckpts" / "anigen" / "slat_dae" / "config.json";
  Json config = read_json(config_file);
  config["dataset"]["args"]["model"] = "dinov2_vitl14_reg";
  write_file_atomically(config_file, config.dump(2));
  EXPECT_NE(refusal().find("dinov2_vitl14_reg"), std::string::npos) << refusal();
  EXPECT_FALSE(fs::exists(request_.generation.output / "oracle.md"));
}

}  // namespace
}  // namespace anigen::generate
