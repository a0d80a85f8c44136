// From pictures to rigged files with the small models of the parity fixtures, whose voxels, votes and surface exist
// whatever the noise; the published image encoder, whose weights are not there, is replaced by a small one.
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <fstream>
#include <thread>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/version.h"
#include "anigen/data/voxel_files.h"
#include "anigen/generate/generate_assets.h"
#include "anigen/generate/picture_input.h"
#include "anigen/io/arrays/npz.h"
#include "anigen/io/gltf/gltf.h"
#include "anigen/sparse_structure/flow.h"
#include "anigen/structured_latent/flow.h"
#include "tests/generate/generate_assets_case.h"
#include "tests/generate/red_matting.h"
#include "tests/generate/small_runs.h"
#include "tests/support/hinged_boxes.h"
#include "tests/support/onnx_files.h"
#include "tests/support/paths.h"

namespace anigen::generate {
namespace {

namespace fs = std::filesystem;

constexpr int kSide = test::kConditionSide;

TEST_F(GenerateAssets, APictureBecomesARiggedFile) {
  const GenerationReport report = one("a");
  ASSERT_EQ(report.failure, "");
  for (const char* file :
       {"mesh.glb", "skeleton.glb", "processed_image.png", "processed_normal.png", "preview.png", "generation.json"}) {
    EXPECT_TRUE(fs::is_regular_file(made("a", file))) << file;
  }
  const Asset asset = io::read_gltf(made("a", "mesh.glb")).asset;
  EXPECT_GT(asset.mesh.faces.size(), 100u);
  EXPECT_GT(asset.skeleton.size(), 0u);
  EXPECT_EQ(asset.skin.rows(), asset.mesh.vertices.size());
  EXPECT_EQ(asset.images.size(), 1u) << "a texture";
  EXPECT_EQ(asset.mesh.uvs.size(), asset.mesh.vertices.size());
  EXPECT_EQ(report.details["joints"], asset.skeleton.size());
  EXPECT_EQ(io::read_gltf(made("a", "skeleton.glb")).asset.skeleton.size(), asset.skeleton.size());
}

TEST_F(GenerateAssets, FlowsOfTheShapeAloneMakeAMeshThatOneJointHolds) {
  const auto keep_the_shape = [](const fs::path& run) {
    Json config = read_json(run / "config.json");
    Json& args = config["models"]["denoiser"]["args"];
    args["geometry_only"] = true;
    if (args.contains("use_joint_num_cond")) args["use_joint_num_cond"] = false;
    write_file_atomically(run / "config.json", config.dump());
    for (const auto& file : fs::directory_iterator(run / "ckpts")) {
      if (file.path().filename().string().rfind("denoiser", 0) == 0) fs::remove(file.path());
    }
    torch::manual_seed(1);
    return args;
  };
  const fs::path first = request_.models.structure_flow, second = request_.models.latent_flow;
  const auto structure = sparse_structure::SparseStructureFlowOptions::from_json(keep_the_shape(first));
  io::write_safetensors(first / "ckpts/denoiser_final.safetensors",
                        nn::state_dict(*sparse_structure::SparseStructureFlow(structure)));
  EXPECT_NE(one_failure("mixed").find("finds no voxels of a skeleton"), std::string::npos);
  const auto latents = structured_latent::StructuredLatentFlowOptions::from_json(keep_the_shape(second));
  io::write_safetensors(second / "ckpts/denoiser_final.safetensors",
                        nn::state_dict(*structured_latent::StructuredLatentFlow(latents)));
  request_.intermediate = true;
  const GenerationReport report = one("a");
  ASSERT_EQ(report.failure, "");
  const Asset asset = io::read_gltf(made("a", "mesh.glb")).asset;
  EXPECT_GT(asset.mesh.faces.size(), 100u);
  EXPECT_EQ(asset.skeleton.size(), 1u);
  EXPECT_EQ(report.details["joints"], 1);
  EXPECT_EQ(report.details["voxels"]["skeleton"], 0);
  EXPECT_FALSE(fs::exists(made("a", "votes.glb")));
}

TEST_F(GenerateAssets, AnAssetIdlesUnlessItIsToStandStill) {
  ASSERT_EQ(one("moving").failure, "");
  const Asset moving = io::read_gltf(made("moving", "mesh.glb")).asset;
  ASSERT_EQ(moving.animations.size(), 1u);
  EXPECT_EQ(moving.animations.front().name, "idle");
  EXPECT_FALSE(moving.animations.front().channels.empty());
  request_.idle = false;
  ASSERT_EQ(one("still").failure, "");
  EXPECT_TRUE(io::read_gltf(made("still", "mesh.glb")).asset.animations.empty());
}

// Results of the stages, in files as those of a dataset: every voxel that the report counts has a row.
TEST_F(GenerateAssets, IntermediateResultsAreKeptWhenAskedFor) {
  ASSERT_EQ(one("without").failure, "");
  EXPECT_FALSE(fs::exists(made("without", "latents.npz")));
  request_.intermediate = true;
  const GenerationReport report = one("a");
  ASSERT_EQ(report.failure, "");
  const data::VoxelRows shape = data::read_voxel_arrays(made("a", "latents.npz"), "coords", "feats");
  const data::VoxelRows skeleton = data::read_voxel_arrays(made("a", "latents.npz"), "coords_skl", "feats_skl");
  EXPECT_EQ(report.details["voxels"]["shape"], shape.coords.size());
  EXPECT_EQ(report.details["voxels"]["skeleton"], skeleton.coords.size());
  const io::NamedArrays structure = io::read_npz(made("a", "ss_latents.npz"));
  for (const char* name : {"mean", "mean_skl"}) {
    ASSERT_NE(io::find(structure, name), nullptr) << name;
    EXPECT_EQ(io::find(structure, name)->shape.size(), 4u) << name;
  }
  for (const char* file : {"voxels.png", "votes.glb", "dense.glb"}) EXPECT_TRUE(fs::exists(made("a", file))) << file;
  // Kept only while they are there, and never those of another mesh.
  fs::remove(made("a", "latents.npz"));
  EXPECT_FALSE(one("a").kept);
  EXPECT_TRUE(fs::exists(made("a", "latents.npz")));
  EXPECT_TRUE(one("a").kept);
  request_.intermediate = false;
  request_.sampling.seed = 43;
  ASSERT_EQ(one("a").failure, "");
  EXPECT_FALSE(fs::exists(made("a", "latents.npz")));
}

// Whatever normalises the first flow's latents in training is undone in the file.
TEST_F(GenerateAssets, StructureLatentsAreThoseThatTheAutoEncoderDecodes) {
  Json config = read_json(request_.models.structure_flow / "config.json");
  Json& data = config["dataset"]["args"];
  const auto channels = [&](const char* key) { return config["models"]["denoiser"]["args"][key].get<std::size_t>(); };
  const auto statistics = [](std::size_t count) {
    return Json{{"mean", std::vector<double>(count, 0.5)}, {"std", std::vector<double>(count, 2.0)}};
  };
  data["normalization"] = statistics(channels("in_channels"));
  data["normalization_skl"] = statistics(channels("in_channels_skl"));
  write_file_atomically(request_.models.structure_flow / "config.json", config.dump(2));
  AssetGenerator generator(request_.models);
  const torch::Tensor picture = torch::rand({1, 3, kSide, kSide});
  const GeneratedAsset asset = generator.generate(picture, picture, "a", request_.sampling);
  StructureGenerator::Request request;
  request.run = request_.models.structure_flow;
  StructureGenerator structure(request);
  const flow::Streams noise = structure.noise(noise_generator(request_.sampling.seed));
  const flow::SamplerOptions sampler = structure.sampler();
  const flow::Streams sampled =
      structure.sample(noise, structure.condition(picture), sampler, sampler.cfg_strength > 0);
  EXPECT_TRUE(torch::allclose(asset.structure[0], sampled[0] * 2.0 + 0.5));
  EXPECT_TRUE(torch::allclose(asset.structure[1], sampled[1] * 2.0 + 0.5));
}

// Models this small run on one thread whatever is asked for, and leave the number of threads as it was.
TEST_F(GenerateAssets, VoxelsOfSmallModelsDoNotDependOnThreads) {
  StructureGenerator::Request request;
  request.run = request_.models.structure_flow;
  StructureGenerator structure(request);
  const flow::Streams noise = structure.noise(noise_generator(request_.sampling.seed));
  const torch::Tensor condition = structure.condition(torch::rand({1, 3, kSide, kSide}));
  const int before = torch::get_num_threads();
  std::vector<flow::Streams> sampled;
  for (const int threads : {1, 3}) {
    torch::set_num_threads(threads);
    sampled.push_back(structure.sample(noise, condition, structure.sampler(), /*guided=*/true));
    EXPECT_EQ(torch::get_num_threads(), threads);
  }
  torch::set_num_threads(before);
  for (std::size_t stream = 0; stream < 2; ++stream) EXPECT_TRUE(sampled[0][stream].equal(sampled[1][stream]));
}

// Results of a picture lie under fixed names, which a picture of an earlier result may have.
TEST_F(GenerateAssets, AResultThatWouldReplaceAnInputIsRefused) {
  fs::create_directories(request_.output / "a");
  for (const char* file : {"processed_image.png", "preview.png", "voxels.png"}) {
    const fs::path input = made("a", file);
    fs::copy_file(picture_, input);
    request_.name = "a";
    EXPECT_THROW(generate_assets(request_, {input}), InputError) << file;
    NamedPicture with_normals(picture_);
    with_normals.normal_map = input;
    EXPECT_THROW(generate_assets(request_, {with_normals}), InputError) << file;
    EXPECT_EQ(read_file(input), read_file(picture_));
    fs::remove(input);
  }
  EXPECT_FALSE(fs::exists(made("a", "generation.json")));
}

TEST_F(GenerateAssets, WhateverOnePictureThrowsIsItsFailure) {
  std::vector<NamedPicture> pictures;
  for (const char* name : {"memory", "torch", "good"}) pictures.emplace_back(picture_, name);
  request_.started = [](const NamedPicture& picture) {
    if (picture.name == "memory") throw std::bad_alloc();
    if (picture.name == "torch") torch::zeros({2, 3}).matmul(torch::zeros({2, 3}));
  };
  const std::vector<GenerationReport> reports = generate_assets(request_, pictures);
  ASSERT_EQ(reports.size(), 3u);
  EXPECT_EQ(reports[0].failure, "out of memory");
  EXPECT_NE(reports[1].failure.find("mat1 and mat2"), std::string::npos) << reports[1].failure;
  EXPECT_EQ(reports[1].failure.find('\n'), std::string::npos) << "one line";
  EXPECT_EQ(reports[2].failure, "");
  EXPECT_TRUE(fs::exists(made("good", "mesh.glb")));
  request_.started = [](const NamedPicture&) { throw Interrupted("stopped"); };
  request_.output = folder_ / "other";
  EXPECT_THROW(generate_assets(request_, pictures), Interrupted);
}

// Of a folder of pictures each is made once, whoever makes it.
TEST_F(GenerateAssets, CallsAtTheSameTimeShareThePictures) {
  std::vector<NamedPicture> pictures;
  for (const char* name : {"a", "b", "c"}) pictures.emplace_back(picture_, name);
  std::vector<std::vector<GenerationReport>> reports(2);
  std::vector<std::thread> threads;
  for (auto& made : reports) threads.emplace_back([&] { made = generate_assets(request_, pictures); });
  for (std::thread& thread : threads) thread.join();
  for (std::size_t i = 0; i < pictures.size(); ++i) {
    EXPECT_NE(reports[0].at(i).kept, reports[1].at(i).kept) << "made by one, found by the other";
    EXPECT_EQ(reports[0][i].failure + reports[1][i].failure, "");
  }
  EXPECT_FALSE(fs::exists(request_.output / ".leases"));
}

std::vector<float> dense_rows(const Asset& asset) { return to_dense(asset.skin, asset.skeleton.size()); }

TEST_F(GenerateAssets, TheSeedAloneDecides) {
  const torch::Tensor picture = torch::rand({1, 3, kSide, kSide});
  AssetGenerator generator(request_.models);
  const auto dense = [&](AssetGenerator& from, std::uint64_t seed) {
    GenerationOptions options = request_.sampling;
    options.seed = seed;
    return from.generate(picture, picture, "a", options);
  };
  const GeneratedAsset first = dense(generator, 42), again = dense(generator, 42), other = dense(generator, 43);
  EXPECT_TRUE(torch::equal(first.voxels.shape, again.voxels.shape));
  EXPECT_TRUE(torch::equal(first.decoded.votes.joints, again.decoded.votes.joints));
  EXPECT_EQ(first.decoded.asset.mesh.vertices, again.decoded.asset.mesh.vertices);
  EXPECT_EQ(dense_rows(first.decoded.asset), dense_rows(again.decoded.asset));
  EXPECT_NE(first.decoded.asset.mesh.vertices, other.decoded.asset.mesh.vertices);

  AssetGenerator::Request lean = request_.models;
  lean.low_memory = true;
  AssetGenerator one_by_one(lean);
  const GeneratedAsset third = dense(one_by_one, 42);
  EXPECT_TRUE(torch::equal(first.decoded.votes.joints, third.decoded.votes.joints));
  EXPECT_EQ(first.decoded.asset.mesh.vertices, third.decoded.asset.mesh.vertices);
  EXPECT_EQ(dense_rows(first.decoded.asset), dense_rows(third.decoded.asset));

  const Asset finished = finish_asset(first.decoded.asset, request_.finishing).asset;
  const Asset finished_again = finish_asset(first.decoded.asset, request_.finishing).asset;
  EXPECT_EQ(finished.mesh.vertices, finished_again.mesh.vertices);
  EXPECT_EQ(dense_rows(finished), dense_rows(finished_again));
}

// Whatever the latents are sampled on, the noise is that of the whole way.
TEST_F(GenerateAssets, GivenVoxelsAndLatentsStandForWhatTheFlowsGive) {
  const torch::Tensor picture = torch::rand({1, 3, kSide, kSide});
  AssetGenerator generator(request_.models);
  GenerationOptions options = request_.sampling;
  const GeneratedAsset whole = generator.generate(picture, picture, "a", options);
  const sparse_structure::VoxelPair sampled = generator.sample_voxels(picture, "a", options);
  EXPECT_TRUE(torch::equal(sampled.shape, whole.voxels.shape));
  options.given_voxels = sampled;
  const GeneratedAsset same = generator.generate(picture, picture, "a", options);
  EXPECT_EQ(same.decoded.asset.mesh.vertices, whole.decoded.asset.mesh.vertices);
  EXPECT_EQ(dense_rows(same.decoded.asset), dense_rows(whole.decoded.asset));

  const std::int64_t r = generator.grid();
  sparse_structure::VoxelPair other{torch::zeros({r, r, r}, torch::kBool), torch::zeros({r, r, r}, torch::kBool)};
  other.shape.slice(0, 4, 10).slice(1, 5, 9).slice(2, 3, 12).fill_(true);
  other.skeleton.slice(0, 6, 8).slice(1, 7, 8).slice(2, 4, 11).fill_(true);
  options.given_voxels = other;
  const GeneratedAsset moved = generator.generate(picture, picture, "a", options);
  const auto places = [](const torch::Tensor& occupied) { return torch::nonzero(occupied).to(torch::kInt32); };
  EXPECT_TRUE(torch::equal(moved.latents.geometry.support->coords().slice(1, 1), places(other.shape)));
  EXPECT_TRUE(torch::equal(moved.latents.skeleton.support->coords().slice(1, 1), places(other.skeleton)));

  options.given_latents = moved.latents;
  options.seed = 7;
  const GeneratedAsset decoded = generator.generate({}, {}, "a", options);
  EXPECT_EQ(decoded.decoded.asset.mesh.vertices, moved.decoded.asset.mesh.vertices);
  EXPECT_EQ(decoded.shape_voxels, moved.shape_voxels);
}

TEST_F(GenerateAssets, GoesOnFromVoxelsOfAnEarlierCall) {
  ASSERT_EQ(one("whole").failure, "");
  const auto request = request_;
  request_.sampling.voxels_alone = true;
  ASSERT_EQ(one("whole").failure, "");  // in the place of the whole asset
  for (const char* file : {"mesh.glb", "skeleton.glb", "preview.png"}) EXPECT_FALSE(fs::exists(made("whole", file)));
  EXPECT_TRUE(fs::is_regular_file(made("whole", "voxels.png")));
  EXPECT_TRUE(one("whole").kept);

  request_ = request;
  EXPECT_FALSE(one("whole").kept);
  request_.sampling.voxels_alone = true;
  ASSERT_EQ(one("first").failure, "");
  request_ = request;
  request_.voxels = made("first", "voxels.npz");
  request_.intermediate = true;
  ASSERT_EQ(one("second").failure, "");
  EXPECT_EQ(io::read_gltf(made("second", "mesh.glb")).asset.mesh.vertices,
            io::read_gltf(made("whole", "mesh.glb")).asset.mesh.vertices);
  EXPECT_EQ(read_file(made("second", "voxels.npz")), read_file(made("first", "voxels.npz")));
  EXPECT_FALSE(fs::exists(made("second", "ss_latents.npz")));
  EXPECT_TRUE(one("second").kept);
  EXPECT_NE(one_failure("first").find("voxels.npz"), std::string::npos) << "would replace what it reads";
}

TEST(FinishAsset, RigidPartsComeLast) {
  const Asset boxes = test::hinged_boxes(0.01F, 0.3F);
  FinishingOptions options;
  options.reduction = 0.0;
  options.remove_hidden = false;
  options.texture_size = 0;
  options.smoothing_iterations = 1;
  const FinishedAsset soft = finish_asset(boxes, options);
  EXPECT_GT(soft.asset.skin.largest_row(), 1u);
  EXPECT_TRUE(soft.rigid_parts.is_null());
  options.rigid_parts = true;
  const FinishedAsset rigid = finish_asset(boxes, options);
  EXPECT_EQ(rigid.asset.skin.largest_row(), 1u);
  EXPECT_EQ(rigid.notices.back(), "2 of 2 shells rigid, 100 % of the surface");
  EXPECT_EQ(rigid.rigid_parts.at(1)["joint"], "lid");
  options.rigid_share = 0.5;
  EXPECT_THROW(finish_asset(boxes, options), InputError);
}

// Several images of one object make one asset: that of one image where all are equal, but for the last bits.
TEST_F(GenerateAssets, EqualViewsGiveTheAssetOfOne) {
  AssetGenerator generator(request_.models);
  const torch::Tensor picture = torch::rand({1, 3, kSide, kSide}), other = torch::rand({1, 3, kSide, kSide});
  GenerationOptions options = request_.sampling;
  options.structure.steps = options.latents.steps = 3;
  const GeneratedAsset single = generator.generate(picture, picture, "a", options);
  const auto made_of = [&](const std::vector<torch::Tensor>& views) {
    return generator.generate(torch::cat(views), torch::cat(views), "a", options);
  };
  for (const flow::ViewRule rule : {flow::ViewRule::kAverage, flow::ViewRule::kStochastic}) {
    options.views = rule;
    const GeneratedAsset three = made_of({picture, picture, picture}), mixed = made_of({picture, other});
    for (std::size_t stream = 0; stream < 2; ++stream) {
      const torch::Tensor& expected = single.structure[stream];
      EXPECT_TRUE(torch::allclose(three.structure[stream], expected, 1e-3, 1e-4));
      EXPECT_FALSE(torch::allclose(mixed.structure[stream], expected, 1e-3, 1e-4));
    }
    ASSERT_TRUE(torch::equal(three.voxels.shape, single.voxels.shape));
    EXPECT_TRUE(torch::allclose(three.latents.geometry.feats, single.latents.geometry.feats, 1e-3, 1e-3));
  }
  options.latents.steps = 2;
  EXPECT_THROW(made_of({picture, picture, other}), InputError) << "stochastic, and one view never has its turn";
}

TEST_F(GenerateAssets, ViewsThatCannotBeUsedTogetherAreErrors) {
  AssetGenerator generator(request_.models);
  const torch::Tensor picture = torch::rand({1, 3, kSide, kSide}), two = torch::cat({picture, picture});
  const torch::Tensor none = torch::zeros({0, 3, kSide, kSide});
  EXPECT_THROW(generator.generate(none, none, "a", request_.sampling), InputError);
  EXPECT_THROW(generator.generate({}, {}, "a", request_.sampling), InputError);
  EXPECT_THROW(generator.generate(two, picture, "a", request_.sampling), InputError);

  // The first flow sees normals: a view with a map of them and one without would show it different things.
  NamedPicture views(picture_, "a");
  views.others.emplace_back(picture_);
  views.others.front().normal_map = picture_;
  const GenerationReport mixed = generate_assets(request_, {views}).front();
  EXPECT_NE(mixed.failure.find("views must be of one kind"), std::string::npos) << mixed.failure;
  views.normal_map = picture_;
  const GenerationReport alike = generate_assets(request_, {views}).front();
  EXPECT_EQ(alike.failure, "");
}

TEST_F(GenerateAssets, ViewsOfOneAreOneAsset) {
  const fs::path second = folder_ / "second.png";
  io::write_png(second, blue_disc(64));
  NamedPicture views = views_of_one({picture_, second});
  EXPECT_EQ(views.name, "disc");
  const auto reports = [&] { return generate_assets(request_, {views}); };
  const std::vector<GenerationReport> first = reports();
  ASSERT_EQ(first.size(), 1u);
  ASSERT_EQ(first[0].failure, "");
  EXPECT_EQ(first[0].details["settings"]["view_rule"], "average");
  EXPECT_EQ(first[0].details["settings"]["other_views"].size(), 1u);
  const io::Image seen = io::read_image(made("disc", "processed_image.png"));
  EXPECT_EQ(seen.width, 2 * seen.height) << "both views";
  EXPECT_TRUE(reports()[0].kept);
  io::write_png(second, blue_disc(80));
  EXPECT_FALSE(reports()[0].kept) << "another image";
  // One image asks for the asset of one.
  views.others.clear();
  const GenerationReport single = reports()[0];
  EXPECT_FALSE(single.kept);
  EXPECT_FALSE(single.details["settings"].contains("view_rule"));
  EXPECT_THROW(views_of_one({}), InputError);
  EXPECT_THROW(views_of_one(std::vector<NamedPicture>(kMostViews + 1, NamedPicture(picture_))), InputError);
}

TEST_F(GenerateAssets, TheSameRequestGivesTheSameFiles) {
  one("a");
  one("b");
  const Asset a = io::read_gltf(made("a", "mesh.glb")).asset, b = io::read_gltf(made("b", "mesh.glb")).asset;
  EXPECT_EQ(a.mesh.vertices, b.mesh.vertices);
  EXPECT_EQ(a.mesh.uvs, b.mesh.uvs);
  EXPECT_EQ(dense_rows(a), dense_rows(b));
  EXPECT_EQ(a.images.front().bytes, b.images.front().bytes);
}

TEST_F(GenerateAssets, WhatIsThereIsKeptUntilSomethingChanges) {
  EXPECT_FALSE(one("a").kept);
  EXPECT_TRUE(one("a").kept);
  request_.sampling.joints = 10;
  EXPECT_FALSE(one("a").kept);
  request_.pictures.background = Background::kKeep;
  EXPECT_FALSE(one("a").kept) << "another background";
  request_.models.structure_condition = StructureCondition::kColor;
  EXPECT_FALSE(one("a").kept) << "another condition";
  EXPECT_TRUE(one("a").kept);
  io::write_png(picture_, blue_disc(80));
  EXPECT_FALSE(one("a").kept) << "another picture of the same name";
  const fs::path weights = request_.models.latent_flow / "ckpts" / "image_encoder_final.safetensors";
  fs::last_write_time(weights, fs::file_time_type::clock::now() + std::chrono::hours(1));
  EXPECT_FALSE(one("a").kept) << "weights written again";
  request_.again = true;
  EXPECT_FALSE(one("a").kept);
}

// An asset of another build does not pass for one of this build: the run stops before anything is made, and says how to
// go on.
TEST_F(GenerateAssets, WhatAnotherCommitMadeIsRefusedUntilTheRequestSaysWhatToDo) {
  ASSERT_EQ(one("a").failure, "");
  Json record = read_json(made("a", "generation.json"));
  EXPECT_EQ(record["made_by"], made_by());
  EXPECT_TRUE(one("a").kept);
  for (const Json& other : {Json("0123456789"), Json()}) {
    record["made_by"]["commit"] = other;
    if (other.is_null()) record.erase("made_by");  // as programs wrote it that recorded no commit
    write_file_atomically(made("a", "generation.json"), record.dump(2));
    try {
      one("a");
      ADD_FAILURE() << "kept, or made again";
    } catch (const InputError& error) {
      for (const std::string& word :
           {std::string(other.is_null() ? "recorded no commit" : "commit 0123456789"), named_commit(commit()),
            std::string("--force"), std::string("--accept-other-code")})
        EXPECT_NE(std::string(error.what()).find(word), std::string::npos) << error.what();
    }
    EXPECT_EQ(read_json(made("a", "generation.json")), record) << "untouched";
    request_.accept_other_code = true;
    EXPECT_TRUE(one("a").kept);
    request_.accept_other_code = false;
    request_.sampling.seed = 43;
    EXPECT_FALSE(one("a").kept) << "other options: there is nothing to keep";
    EXPECT_EQ(read_json(made("a", "generation.json"))["made_by"]["commit"], commit());
    request_.sampling.seed = GenerateRequest().sampling.seed;
    write_file_atomically(made("a", "generation.json"), record.dump(2));
    request_.again = true;
    EXPECT_FALSE(one("a").kept);
    EXPECT_EQ(read_json(made("a", "generation.json"))["made_by"]["commit"], commit());
    request_.again = false;
  }
}

TEST_F(GenerateAssets, TheRecordNamesTheMattingNetworkAndItsNormalisation) {
  ASSERT_EQ(one("without").failure, "");
  EXPECT_FALSE(read_json(made("without", "generation.json"))["settings"].contains("matting"));
  request_.pictures.matting.network = folder_ / "network.onnx";
  write_file_atomically(request_.pictures.matting.network, test::onnx_bytes(test::channel_sum_network(8, {1, 0, 0})));
  ASSERT_EQ(one("a").failure, "");
  const Json matting = read_json(made("a", "generation.json"))["settings"]["matting"];
  EXPECT_EQ(matting["network"], request_.pictures.matting.network.string());
  EXPECT_EQ(matting["mean"], (Json{0.485, 0.456, 0.406}));
  EXPECT_EQ(matting["deviation"], (Json{0.229, 0.224, 0.225}));
  EXPECT_TRUE(one("a").kept);
  request_.pictures.matting.mean = {0.5, 0.5, 0.5};
  EXPECT_FALSE(one("a").kept) << "another mean";
  EXPECT_EQ(read_json(made("a", "generation.json"))["settings"]["matting"]["mean"], (Json{0.5, 0.5, 0.5}));
}

TEST_F(GenerateAssets, TheRecordNamesATrainedMattingNetwork) {
  const fs::path run = folder_ / "matting";
  test::write_red_matting(run);
  request_.pictures.matting.network = run;
  ASSERT_EQ(one("a").failure, "");
  EXPECT_EQ(read_json(made("a", "generation.json"))["settings"]["matting"], (Json{{"run", run.string()}}));
  EXPECT_TRUE(one("a").kept);
  fs::rename(run / "ckpts/matting_step0000001.safetensors", run / "ckpts/matting_step0000002.safetensors");
  EXPECT_FALSE(one("a").kept) << "other weights";
}

TEST_F(GenerateAssets, ABadPictureDoesNotStopTheOthers) {
  const fs::path folder = folder_ / "pictures";
  fs::create_directories(folder);
  io::write_png(folder / "clear.png", io::Image(64, 64, 0));
  io::write_png(folder / "disc.png", blue_disc(96));
  std::ofstream(folder / "text.png") << "not a picture";
  std::ofstream(folder / "notes.txt") << "ignored";
  const auto reports = generate_assets(request_, pictures_at(folder));
  ASSERT_EQ(reports.size(), 3u);
  EXPECT_NE(reports[0].failure.find("clear.png"), std::string::npos) << reports[0].failure;
  EXPECT_EQ(reports[1].failure, "");
  EXPECT_NE(reports[2].failure.find("text.png"), std::string::npos) << reports[2].failure;
  EXPECT_FALSE(fs::exists(made("text", "generation.json")));
}

TEST_F(GenerateAssets, UnusableModelsAreNamedBeforeAnythingIsMade) {
  const auto error_of = [&](const GenerateRequest& request) {
    try {
      generate_assets(request, {picture_});
    } catch (const InputError& error) {
      return std::string(error.what());
    }
    return std::string("no error");
  };
  GenerateRequest swapped = request_;
  std::swap(swapped.models.structure_flow, swapped.models.latent_flow);
  EXPECT_NE(error_of(swapped).find("describes no model named"), std::string::npos) << error_of(swapped);

  const fs::path runs = folder_ / "ckpts" / "anigen", weights = runs / "slat_flow_control" / "ckpts" / "denoiser.pt";
  const std::string whole = read_file(weights);
  std::ofstream(weights, std::ios::binary) << whole.substr(0, whole.size() / 2);
  EXPECT_NE(error_of(request_).find("denoiser.pt"), std::string::npos) << error_of(request_);
  fs::remove(weights);
  fs::remove(runs / "slat_flow_control" / "ckpts" / "denoiser_ema0.9999.pt");
  EXPECT_NE(error_of(request_).find("slat_flow_control"), std::string::npos) << error_of(request_);
  fs::remove_all(runs / "ss_dae");
  EXPECT_NE(error_of(request_).find("ss_dec_path"), std::string::npos) << error_of(request_);
  EXPECT_FALSE(fs::exists(request_.output));
}

TEST_F(GenerateAssets, NormalsThatNoFlowSeesAreRefused) {
  request_.models.structure_condition = StructureCondition::kColor;
  request_.pictures.normals = NormalSource::kFlat;
  EXPECT_THROW(one("a"), InputError);
  request_.pictures.normals = NormalSource::kColors;
  EXPECT_EQ(one("a").failure, "");
}

TEST_F(GenerateAssets, OnePictureOneName) {
  const fs::path other = folder_ / "more" / "disc.png";
  fs::create_directories(other.parent_path());
  io::write_png(other, blue_disc(64));
  EXPECT_THROW(generate_assets(request_, {picture_, other}), InputError);
  request_.name = "x";
  EXPECT_THROW(generate_assets(request_, {picture_, other}), InputError);
}

}  // namespace
}  // namespace anigen::generate
