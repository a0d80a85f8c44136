#include "anigen/generate/encode_report.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/table.h"
#include "anigen/data/datasets.h"
#include "anigen/generate/asset_generator.h"
#include "anigen/generate/field_rigger.h"
#include "anigen/generate/grouping.h"
#include "anigen/io/arrays/npz.h"
#include "anigen/io/arrays/safetensors.h"
#include "anigen/io/gltf/gltf.h"
#include "anigen/nn/init.h"
#include "anigen/nn/state_dict.h"
#include "anigen/structured_latent/decoder.h"
#include "tests/data/published_dataset.h"
#include "tests/generate/small_runs.h"
#include "tests/support/paths.h"
#include "tests/train/stages/structured_latent_dataset.h"

namespace anigen::generate {
namespace {

Json slat_run() {
  return {{"models", test::post_models()},
          {"dataset",
           {{"name", "AniGenSparseFeat2Skeleton"},
            {"args",
             {{"image_size", 24},
              {"model", "toy"},
              {"skl_dilation_iter", 1},
              {"load_cubvh", true},
              {"test_mode", false}}}}},
          {"trainer", {{"name", "AniGenSLatVaeSkeletonTrainer"}, {"args", Json::object()}}}};
}

class EncodeStructuredLatents : public testing::Test {
 protected:
  void SetUp() override {
    test::PostDataset::write(folder_ / "data", 3);
    write_run(slat_run());
    request_.run = folder_ / "slat_run";
    request_.data = folder_ / "data";
  }
  void write_run(const Json& config) {
    write_file_atomically(folder_ / "slat_run" / "config.json", config.dump());
    torch::manual_seed(3);
    const auto args = [&](const char* model) { return config["models"][model]["args"]; };
    structured_latent::StructuredLatentEncoder encoder(
        structured_latent::StructuredLatentEncoderOptions::from_json(args("encoder")));
    structured_latent::StructuredLatentDecoder decoder(
        structured_latent::StructuredLatentDecoderOptions::from_json(args("decoder")));
    {
      const torch::NoGradGuard no_grad;  // the geometry's head begins at zero, which would encode nothing
      for (torch::Tensor parameter : encoder->parameters()) parameter.add_(0.05 * torch::randn_like(parameter));
    }
    const auto save = [&](const std::string& name, const torch::nn::Module& model) {
      io::write_safetensors(folder_ / "slat_run" / "ckpts" / (name + "_step0000003.safetensors"),
                            nn::state_dict(model));
    };
    save("encoder", *encoder);
    save("decoder", *decoder);
  }
  torch::Tensor array(int i, const std::string& name, const std::string& latents = "slat_run") const {
    const io::NamedArrays arrays =
        io::read_npz(folder_ / "data" / "latents" / latents / (test::PostDataset::id(i) + ".npz"));
    return nn::to_tensor(*io::find(arrays, name));
  }
  test::TemporaryFolder folder_;
  EncodeRequest request_;
};

TEST_F(EncodeStructuredLatents, WritesWhatStageFiveReads) {
  const EncodedLatents result = encode_structured_latents(request_);
  EXPECT_EQ(result.encoded, 3u);
  ASSERT_TRUE(result.failed.empty()) << result.failed.begin()->second;
  const torch::Tensor feats = array(0, "feats"), feats_skl = array(0, "feats_skl");
  EXPECT_EQ(array(0, "coords").sizes(), (std::vector<std::int64_t>{feats.size(0), 3}));
  EXPECT_EQ(feats.size(1), 16);
  EXPECT_EQ(feats_skl.size(1), 4);
  EXPECT_TRUE(torch::allclose(feats.slice(1, 8).norm(2, 1), torch::ones({feats.size(0)}), 1e-5, 1e-5))
      << "skin latents lie on the unit sphere";
  EXPECT_TRUE(torch::allclose(feats_skl.norm(2, 1), torch::ones({feats_skl.size(0)}), 1e-5, 1e-5));

  const Json statistics = read_json(folder_ / "data" / "latents" / "slat_run_statistics.json");
  const Json& normalization = statistics.at("normalization");
  EXPECT_EQ(normalization.at("mean").size(), 16u);
  EXPECT_EQ(normalization.at("mean").at(8), 0.0);
  EXPECT_EQ(normalization.at("std").at(15), 1.0);
  EXPECT_EQ(normalization.at("mean").at(0), statistics.at("feats").at("mean").at(0));
  const Json dataset = {
      {"name", "AniGenSLat"},
      {"args",
       {{"data_dir", (folder_ / "data").string()}, {"latent_model", "slat_run"}, {"normalization", normalization}}}};
  const data::Datasets data = data::make_datasets(ConfigReader(dataset, "config.json", "/dataset"), 1);
  const auto batch = test::load<data::StructuredLatentBatch>(*data.train, {{0, 0}, {1, 1}, {2, 2}});
  EXPECT_EQ(batch->x_0.feats.size(1), 16);
}

TEST_F(EncodeStructuredLatents, AFlowWithoutImagesFindsTheSkeletonsVoxels) {
  constexpr std::int64_t kSide = 16;
  const std::filesystem::path tree = test::parity_file("ckpt_tree");
  if (!std::filesystem::is_directory(tree)) GTEST_SKIP() << tree << " is not there";
  std::filesystem::copy(tree, folder_ / "tree", std::filesystem::copy_options::recursive);
  const std::filesystem::path flow = folder_ / "tree" / "ckpts" / "anigen" / "ss_flow_solo";
  test::make_rig_flow(flow, "AniGenSparseStructureLatent", {{"p_given_shape", 1.0}});
  Json coarse = slat_run();
  coarse["dataset"]["args"]["resolution"] = kSide;
  write_run(coarse);
  encode_structured_latents(request_);
  request_.name = "found";
  request_.ss_flow = flow;
  const EncodedLatents result = encode_structured_latents(request_);
  EXPECT_EQ(result.encoded, 3u);
  ASSERT_TRUE(result.failed.empty()) << result.failed.begin()->second;
  StructureGenerator::Request of_flow;
  of_flow.run = flow;
  of_flow.pictures = false;
  StructureGenerator generator(of_flow);
  for (int i = 0; i < 3; ++i) {
    const torch::Tensor shape = array(i, "coords").to(torch::kInt64);
    EXPECT_TRUE(torch::equal(array(i, "coords", "found").to(torch::kInt64), shape));
    torch::Tensor voxels = torch::zeros({kSide, kSide, kSide}, torch::kBool);
    voxels.index_put_({shape.select(1, 0), shape.select(1, 1), shape.select(1, 2)}, true);
    const torch::Tensor skeleton =
        generator.skeleton_of(voxels, generator.noise(noise_generator(FieldRigger::Request().seed))).voxels;
    EXPECT_TRUE(torch::equal(array(i, "coords_skl", "found").to(torch::kInt64), skeleton.nonzero())) << i;
  }
  const Json dataset = {{"name", "AniGenSLat"},
                        {"args",
                         {{"data_dir", (folder_ / "data").string()},
                          {"latent_model", "slat_run"},
                          {"seen_models", {"found"}},
                          {"seen_share", 1.0}}}};
  const data::Datasets data = data::make_datasets(ConfigReader(dataset, "config.json", "/dataset"), 1);
  const auto batch = test::load<data::StructuredLatentBatch>(*data.train, {{1, 0}});
  EXPECT_EQ(batch->x_0_skl.coords.size(0), array(1, "coords_skl", "found").size(0));
  write_run(slat_run());
  const EncodedLatents of_other_grid = encode_structured_latents(request_);
  ASSERT_EQ(of_other_grid.failed.size(), 3u);
  EXPECT_NE(of_other_grid.failed.begin()->second.find("voxels of 64 on a side"), std::string::npos);
  request_.view = 1;
  EXPECT_THROW(encode_structured_latents(request_), InputError) << "there are no views in it";
}

TEST_F(EncodeStructuredLatents, KeepsWhatIsUpToDate) {
  encode_structured_latents(request_);
  EXPECT_EQ(encode_structured_latents(request_).up_to_date, 3u);
  // Another rig of one asset.
  io::NamedArrays rig = io::read_npz(folder_ / "data/skeleton/post1/skeleton_voxelized.npz");
  for (auto& [name, values] : rig) {
    if (name == "joints") values = io::NdArray::from(std::vector<float>{0, 0, -0.02F, 0, 0, 0, 0, 0, 0.02F}, {3, 3});
  }
  io::write_npz(folder_ / "data/skeleton/post1/skeleton_voxelized.npz", rig);
  std::filesystem::remove(folder_ / "data/features/toy/post2.npz");
  const EncodedLatents again = encode_structured_latents(request_);
  EXPECT_EQ(again.up_to_date, 1u);
  EXPECT_EQ(again.encoded, 1u);
  EXPECT_EQ(again.failed.count("post2"), 1u);
  const CsvTable table = read_csv(folder_ / "data/metadata.csv");
  EXPECT_EQ(table.cell(0, "latent_slat_run") + table.cell(2, "latent_slat_run"), "TrueFalse");
}

TEST_F(EncodeStructuredLatents, LatentsAreThoseOfTheVariant) {
  Json config = slat_run();
  config["trainer"]["args"]["normalization"] = "l1";
  write_run(config);
  encode_structured_latents(request_);
  const torch::Tensor skeleton = array(0, "feats_skl");
  EXPECT_TRUE(torch::allclose(skeleton.abs().sum(1), torch::ones({skeleton.size(0)}), 1e-5, 1e-5));
}

TEST_F(EncodeStructuredLatents, ReconstructsRiggedAssets) {
  ReconstructRequest request;
  request.run = request_.run;
  request.data = request_.data;
  request.ids = {"post0", "post1"};
  request.output = folder_ / "out";
  request.true_skeleton = true;
  const std::vector<ReconstructedAsset> made = reconstruct_assets(request);
  ASSERT_EQ(made.size(), 2u);
  EXPECT_EQ(made[0].joints, 3u);
  EXPECT_EQ(to_json(made).at(1).at("id"), "post1");
  const Asset read = io::read_gltf(made[0].file).asset;
  EXPECT_EQ(read.skeleton.size(), 3u);
  EXPECT_GT(made[0].faces, 0u);
  EXPECT_FALSE(read.mesh.faces.empty());
  // Fresh heads draw the outline of the voxels.
  const Box box = bounding_box(read.mesh.vertices);
  EXPECT_LT(box.longest_side(), 0.2);
  request.true_skeleton = false;
  EXPECT_GE(reconstruct_assets(request).front().joints, 1u);
  request.ids = {"../post0"};
  EXPECT_THROW(reconstruct_assets(request), InputError);
  request.ids.clear();
  EXPECT_THROW(reconstruct_assets(request), InputError);
}

TEST_F(EncodeStructuredLatents, TheGroupingThatIsChosenIsNearTheBestAndHasTheRightNumberOfJoints) {
  GroupingRequest request;
  request.run = request_.run;
  request.data = request_.data;
  write_file_atomically(folder_ / "all.txt", "post0\npost1\npost2\n");
  request.splits = {folder_ / "all.txt"};
  const GroupingFit fit = fit_grouping(request);
  EXPECT_EQ(fit.assets, 3u);
  ASSERT_GT(fit.rows.size(), 10u);
  double best = 0.0;
  for (const GroupingRow& row : fit.rows) best = std::max(best, row.f1);
  const GroupingRow& chosen = fit.rows.front();
  EXPECT_GE(chosen.f1, best - kNearlyBest);
  for (const GroupingRow& row : fit.rows) {
    if (row.f1 >= best - kNearlyBest) {
      EXPECT_LE(chosen.off, row.off) << row.bandwidth << " " << row.least_votes;
    }
    EXPECT_GE(row.off, std::abs(row.surplus));
  }
  for (std::size_t i = 2; i < fit.rows.size(); ++i) EXPECT_GE(fit.rows[i - 1].f1, fit.rows[i].f1) << i;
  const Json written = read_json(folder_ / "slat_run" / "grouping.json");
  EXPECT_EQ(written.at("least_votes"), chosen.least_votes);
  EXPECT_EQ(written.at("bandwidth"), chosen.bandwidth);
  EXPECT_NE(to_markdown(fit).find("joints off"), std::string::npos);
}

// The folder of a dataset's own assets is no place for what an auto-encoder makes of them.
TEST_F(EncodeStructuredLatents, AReconstructionDoesNotReplaceTheDatasetsAsset) {
  const std::filesystem::path asset = request_.data / "assets/post0.glb";
  write_file_atomically(asset, "the asset");
  ReconstructRequest request;
  request.run = request_.run;
  request.data = request_.data;
  request.ids = {"post0", "post1"};
  request.output = request_.data / "assets";
  EXPECT_THROW(reconstruct_assets(request), InputError);
  EXPECT_EQ(read_file(asset), "the asset");
  EXPECT_FALSE(std::filesystem::exists(request_.data / "assets/post1.glb")) << "before any work";
}

TEST_F(EncodeStructuredLatents, ReconstructsASplitNamesFailuresAndShowsVotes) {
  std::ofstream(folder_ / "ids.txt") << "absent\npost1\n";
  ReconstructRequest request;
  request.run = request_.run;
  request.data = request_.data;
  request.splits = {folder_ / "ids.txt"};
  request.output = folder_ / "out";
  request.votes = true;
  const std::vector<ReconstructedAsset> made = reconstruct_assets(request);
  ASSERT_EQ(made.size(), 2u);
  EXPECT_NE(made[0].failure.find("absent"), std::string::npos) << made[0].failure;
  EXPECT_TRUE(made[0].file.empty());
  EXPECT_NE(to_text(made).find("no file"), std::string::npos);
  EXPECT_EQ(made[1].failure, "");
  EXPECT_GT(io::read_gltf(folder_ / "out/post1.votes.glb").asset.mesh.faces.size(), 0u);
  EXPECT_TRUE(std::filesystem::exists(folder_ / "out/post1.votes.ply"));
}

TEST_F(EncodeStructuredLatents, ARunOfTheShapeAloneGivesShapesHeldByOneJoint) {
  Json config = slat_run();
  config["trainer"]["args"]["geometry_only"] = true;
  write_run(config);
  ReconstructRequest request;
  request.run = request_.run;
  request.data = request_.data;
  request.ids = {"post0"};
  request.output = folder_ / "out";
  const std::vector<ReconstructedAsset> made = reconstruct_assets(request);
  ASSERT_EQ(made.front().failure, "");
  EXPECT_EQ(made.front().joints, 1u);
  const Asset read = io::read_gltf(made.front().file).asset;
  EXPECT_EQ(read.skeleton.size(), 1u);
  EXPECT_GT(read.mesh.faces.size(), 0u);
  request.votes = true;
  EXPECT_THROW(reconstruct_assets(request), InputError);
  request.votes = false;
  request.true_skeleton = true;
  EXPECT_THROW(reconstruct_assets(request), InputError);
}

}  // namespace
}  // namespace anigen::generate
