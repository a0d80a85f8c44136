#include <gtest/gtest.h>
#include <functional>
#include <new>
#include <thread>
#include <utility>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/log.h"
#include "anigen/core/process.h"
#include "anigen/core/table.h"
#include "anigen/core/version.h"
#include "anigen/data/datasets.h"
#include "anigen/generate/encode.h"
#include "anigen/generate/encode_report.h"
#include "anigen/io/arrays/npz.h"
#include "anigen/io/arrays/safetensors.h"
#include "anigen/nn/init.h"
#include "anigen/nn/state_dict.h"
#include "anigen/sparse_structure/autoencoder.h"
#include "anigen/sparse_structure/voxel_metrics.h"
#include "tests/data/published_dataset.h"
#include "tests/support/paths.h"

namespace anigen::generate {

namespace {

constexpr const char kRun[] = R"({
  "models": {
    "encoder": {"name": "AniGenSparseStructureEncoder", "args": {
      "latent_channels": 8, "latent_channels_skl": 4, "num_res_blocks": 1, "num_res_blocks_middle": 1,
      "channels": [4, 4, 8], "encode_global": false, "encode_global_skl": false, "use_pretrain_branch": false,
      "latent_denoising": false, "latent_denoising_skl": true, "normalize_z_skl": true}},
    "decoder": {"name": "AniGenSparseStructureDecoder", "args": {
      "latent_channels": 8, "latent_channels_skl": 4, "num_res_blocks": 1, "num_res_blocks_middle": 1,
      "channels": [8, 4, 4], "encode_global": false, "encode_global_skl": false, "use_pretrain_branch": false,
      "normalize_z_skl": false}}},
  "dataset": {"name": "AniGenSparseStructure", "args": {"resolution": 16, "skl_dilation_iter": 1}}})";

class EncodeSparseStructure : public testing::Test {
 protected:
  EncodeSparseStructure() {
    write_file_atomically(folder_ / "ss_run" / "config.json", kRun);
    write_weights(1);
    request_.run = folder_ / "ss_run";
    request_.data = sample_.root();
  }

  void write_weights(std::uint64_t seed) {
    torch::manual_seed(seed);
    const Json config = parse_json(kRun, "test").at("models");
    sparse_structure::SparseStructureEncoder encoder(
        sparse_structure::SparseStructureEncoderOptions::from_json(config.at("encoder").at("args")));
    sparse_structure::SparseStructureDecoder decoder(
        sparse_structure::SparseStructureDecoderOptions::from_json(config.at("decoder").at("args")));
    {
      const torch::NoGradGuard no_grad;  // output layers may begin at zero, which would encode nothing
      for (torch::Tensor parameter : encoder->parameters()) parameter.add_(0.1 * torch::randn_like(parameter));
      for (torch::Tensor parameter : decoder->parameters()) parameter.add_(0.1 * torch::randn_like(parameter));
    }
    const auto save = [&](const std::string& name, const torch::nn::Module& model) {
      io::write_safetensors(folder_ / "ss_run" / "ckpts" / (name + "_step0000003.safetensors"), nn::state_dict(model));
    };
    save("encoder", *encoder);
    save("decoder", *decoder);
  }

  std::filesystem::path latent(int i, const std::string& name = "ss_run") const {
    return sample_.root() / "ss_latents" / name / (test::PublishedSample::id(i) + ".npz");
  }
  std::filesystem::path statistics() const { return sample_.root() / "ss_latents" / "ss_run_statistics.npz"; }

  /// Column of flags in metadata.csv, one letter an asset.
  std::string flags() const {
    const CsvTable table = read_csv(sample_.root() / "metadata.csv");
    std::string letters;
    for (std::size_t row = 0; row < table.rows.size(); ++row)
      letters += table.cell(row, "ss_latent_ss_run").substr(0, 1);
    return letters;
  }
  /// A run that ends after some assets.
  void encode_interrupted(std::size_t after) {
    EncodeRequest request = request_;
    request.progress = [after](std::size_t done, std::size_t) {
      if (done == after) throw Interrupted("test");
    };
    EXPECT_THROW(encode_sparse_structure(request), Interrupted);
  }

  /// The voxels of an asset as the run's config says, and its latent as it was written.
  struct Encoded {
    std::unique_ptr<data::SparseStructureBatch> voxels;
    torch::Tensor mean, mean_skl;  // [C, r, r, r]
  };
  Encoded encoded(int i, const std::string& name) const {
    data::SparseStructureOptions options;
    options.resolution = 16;
    options.skl_dilation_iter = 1;
    const data::SparseStructureDataset voxels({{sample_.root(), test::PublishedSample::id(i)}}, options, 0);
    const io::NamedArrays arrays = io::read_npz(latent(i, name));
    return {test::load<data::SparseStructureBatch>(voxels, {{0, 0}}), nn::to_tensor(*io::find(arrays, "mean")),
            nn::to_tensor(*io::find(arrays, "mean_skl"))};
  }

  test::TemporaryFolder folder_;
  test::PublishedSample sample_{folder_ / "data"};
  EncodeRequest request_;
};

TEST_F(EncodeSparseStructure, WritesWhatTheEncoderGivesWithoutNoise) {
  const EncodeResult result = encode_sparse_structure(request_);
  EXPECT_EQ(result.name, "ss_run");
  EXPECT_EQ(result.encoded, 3u);
  EXPECT_TRUE(result.failed.empty());

  const torch::NoGradGuard no_grad;
  const auto found = nn::find_run_model(request_.run, sparse_structure::kSparseStructureEncoderClass);
  sparse_structure::SparseStructureEncoder encoder =
      nn::load_trained<sparse_structure::SparseStructureEncoder>(found, torch::kCPU);
  for (int i = 0; i < 3; ++i) {
    const Encoded asset = encoded(i, "ss_run");
    const auto expected =
        encoder->forward(asset.voxels->ss.to(torch::kFloat32), asset.voxels->ss_skl.to(torch::kFloat32));
    EXPECT_EQ(asset.mean.sizes(), (std::vector<std::int64_t>{8, 4, 4, 4}));
    EXPECT_TRUE(torch::equal(asset.mean, expected.mean[0]));
    EXPECT_TRUE(torch::equal(asset.mean_skl, expected.mean_skl[0]));
    EXPECT_TRUE(torch::allclose(asset.mean_skl.norm(2, 0), torch::ones({4, 4, 4}), 1e-5, 1e-5)) << "unit length";
  }
}

TEST_F(EncodeSparseStructure, KeepsWhatIsUpToDateAndOnlyThat) {
  encode_sparse_structure(request_);
  const std::string before = read_file(latent(0));
  EncodeResult again = encode_sparse_structure(request_);
  EXPECT_EQ(again.encoded, 0u);
  EXPECT_EQ(again.up_to_date, 3u);
  // Other voxels of one asset; a damaged latent of another.
  test::PublishedSample::write_centres(sample_.surface(1), {{1, 2, 3}, {40, 50, 60}});
  write_file_atomically(latent(2), "damaged");
  again = encode_sparse_structure(request_);
  EXPECT_EQ(again.encoded, 2u);
  EXPECT_EQ(again.up_to_date, 1u);
  EXPECT_EQ(read_file(latent(0)), before);
  write_weights(2);
  again = encode_sparse_structure(request_);
  EXPECT_EQ(again.encoded, 3u);
  EXPECT_NE(read_file(latent(0)), before);
  request_.again = true;
  EXPECT_EQ(encode_sparse_structure(request_).encoded, 3u);
}

// Latents of another build do not pass for those of this one, neither after a whole run nor after an interrupted one.
TEST_F(EncodeSparseStructure, WhatAnotherCommitEncodedIsEncodedAgainUnlessAccepted) {
  const auto list = sample_.root() / "ss_latents" / "ss_run" / "encoded.json";
  const auto outcomes = sample_.root() / "run" / "encode-ss_latent_ss_run" / "assets";
  const auto relabel = [](const std::filesystem::path& file, const char* place) {
    Json json = read_json(file);
    Json& commit = json[Json::json_pointer(place)];
    EXPECT_EQ(commit, Json(anigen::commit())) << file;
    commit = "0123456789";
    write_file_atomically(file, json.dump());
  };
  encode_sparse_structure(request_);
  std::filesystem::remove_all(outcomes.parent_path());
  const std::string id = test::PublishedSample::id(0);
  relabel(list, ("/assets/" + id + "/commit").c_str());
  request_.accept_other_code = true;
  EXPECT_EQ(encode_sparse_structure(request_).up_to_date, 3u);
  EXPECT_EQ(read_json(list)["assets"][id]["commit"], "0123456789") << "kept, under its name";
  request_.accept_other_code = false;
  std::filesystem::remove_all(outcomes.parent_path());
  testing::internal::CaptureStderr();
  log::setup("warn");
  const EncodeResult again = encode_sparse_structure(request_);
  const std::string said = testing::internal::GetCapturedStderr();
  EXPECT_EQ(again.encoded, 1u);
  EXPECT_EQ(again.up_to_date, 2u);
  for (const std::string& word :
       {std::string("1 latents of "), std::string("commit 0123456789"), named_commit(commit())})
    EXPECT_NE(said.find(word), std::string::npos) << said;
  EXPECT_EQ(read_json(list)["assets"][id]["commit"], commit());
  EXPECT_EQ(encode_sparse_structure(request_).up_to_date, 3u);

  write_weights(2);
  encode_interrupted(2);
  std::size_t relabelled = 0;
  for (const auto& entry : std::filesystem::directory_iterator(outcomes)) {
    relabel(entry.path(), "/commit");
    ++relabelled;
  }
  EXPECT_EQ(relabelled, 2u);
  request_.accept_other_code = true;
  encode_interrupted(3);
  EXPECT_EQ(read_json(list)["assets"].size(), 2u) << "kept so far";
  request_.accept_other_code = false;
  EXPECT_EQ(encode_sparse_structure(request_).up_to_date, 1u) << "what the second of both encoded";
}

TEST_F(EncodeSparseStructure, TheNextStageCanReadIt) {
  const EncodeResult result = encode_sparse_structure(request_);
  const std::string statistics = (sample_.root() / "ss_latents" / "ss_run_statistics.npz").string();
  const Json args = {{"latent_model", "ss_run"}, {"normalization", statistics}, {"normalization_skl", statistics}};
  const data::Datasets data = test::make_published(sample_, "AniGenSparseStructureLatent", args);
  ASSERT_EQ(data.train->size(), 3u);
  const auto batch = test::load<data::StructureLatentBatch>(*data.train, {{0, 0}, {1, 1}, {2, 2}});
  // All assets have as many voxels, so normalised with their own statistics they have mean 0 and variance 1.
  const torch::Tensor per_channel = batch->x_0.transpose(0, 1).reshape({8, -1});
  EXPECT_LT(per_channel.mean(1).abs().max().item<float>(), 1e-3f);
  EXPECT_NEAR(per_channel.square().mean().item<float>(), 1.0f, 1e-2f);
  EXPECT_EQ(result.shape.assets(), 3u);
  const Json json = read_json(sample_.root() / "ss_latents" / "ss_run_statistics.json");
  EXPECT_EQ(json.at("assets"), 3);
  EXPECT_EQ(json.at("feats_skl").at("mean").size(), 4u);
}

TEST_F(EncodeSparseStructure, BrokenAssetsAreNamedAndNotFlagged) {
  std::filesystem::remove(sample_.skeleton_voxels(1));
  const EncodeResult result = encode_sparse_structure(request_);
  EXPECT_EQ(result.encoded, 2u);
  ASSERT_EQ(result.failed.size(), 1u);
  EXPECT_EQ(result.failed.begin()->first, "asset1");
  const CsvTable table = read_csv(sample_.root() / "metadata.csv");
  EXPECT_EQ(table.cell(0, "ss_latent_ss_run"), "True");
  EXPECT_EQ(table.cell(1, "ss_latent_ss_run"), "False");
  EXPECT_EQ(table.cell(1, "aesthetic_score"), "6.5") << "the rest of the table stays";
  EXPECT_EQ(to_json(result).at("failed").size(), 1u);
}

TEST_F(EncodeSparseStructure, CheckMeasuresTheReconstruction) {
  request_.check = true;
  request_.name = "checked";
  const EncodeResult result = encode_sparse_structure(request_);
  ASSERT_TRUE(result.reconstruction);
  const torch::NoGradGuard no_grad;
  sparse_structure::SparseStructureDecoder decoder = nn::load_trained<sparse_structure::SparseStructureDecoder>(
      nn::find_run_model(request_.run, sparse_structure::kSparseStructureDecoderClass), torch::kCPU);
  sparse_structure::VoxelAgreement shape, skeleton;
  const auto add_third = [](sparse_structure::VoxelAgreement& sum, const torch::Tensor& logits,
                            const torch::Tensor& truth) {
    const sparse_structure::VoxelAgreement one = sparse_structure::voxel_agreement(logits[0][0] > 0, truth[0][0] > 0);
    sum.iou += one.iou / 3.0;
    sum.precision += one.precision / 3.0;
    sum.recall += one.recall / 3.0;
    sum.f1 += one.f1 / 3.0;
  };
  for (int i = 0; i < 3; ++i) {
    const Encoded asset = encoded(i, "checked");
    const auto logits = decoder->forward(asset.mean.unsqueeze(0), asset.mean_skl.unsqueeze(0));
    add_third(shape, logits.shape, asset.voxels->ss);
    add_third(skeleton, logits.skeleton, asset.voxels->ss_skl);
  }
  const auto expect_same = [](const sparse_structure::VoxelAgreement& found,
                              const sparse_structure::VoxelAgreement& expected) {
    EXPECT_NEAR(found.iou, expected.iou, 1e-12);
    EXPECT_NEAR(found.precision, expected.precision, 1e-12);
    EXPECT_NEAR(found.recall, expected.recall, 1e-12);
    EXPECT_NEAR(found.f1, expected.f1, 1e-12);
  };
  expect_same(result.reconstruction->shape, shape);
  expect_same(result.reconstruction->skeleton, skeleton);
  EXPECT_GT(shape.precision, 0.0) << "a decoder that gives nothing would prove nothing";
  EXPECT_NE(to_text(result).find("IoU"), std::string::npos);
  EXPECT_TRUE(to_json(result).contains("reconstruction"));
}

// The latents that an interrupted run replaced must not pass for those of the encoder before it.
TEST_F(EncodeSparseStructure, ReplacedLatentsAreMadeAgainForTheFirstEncoder) {
  encode_sparse_structure(request_);
  const std::string before = read_file(latent(0));
  write_weights(2);
  encode_interrupted(1);
  ASSERT_NE(read_file(latent(0)), before);
  write_weights(1);
  EXPECT_EQ(encode_sparse_structure(request_).encoded, 3u);
  EXPECT_EQ(read_file(latent(0)), before);
}

TEST_F(EncodeSparseStructure, AnInterruptedRunFlagsOnlyWhatItKept) {
  encode_sparse_structure(request_);
  EXPECT_EQ(flags(), "TTT");
  EXPECT_TRUE(std::filesystem::exists(statistics()));
  test::PublishedSample::write_centres(sample_.surface(1), {{1, 2, 3}, {40, 50, 60}});
  encode_interrupted(2);
  EXPECT_EQ(flags(), "TFT");
  EXPECT_FALSE(std::filesystem::exists(statistics()));
  const EncodeResult rest = encode_sparse_structure(request_);
  EXPECT_EQ(rest.encoded, 0u) << "what was written is kept";
  EXPECT_EQ(rest.up_to_date, 3u);
  EXPECT_EQ(flags(), "TTT");
  EXPECT_TRUE(std::filesystem::exists(statistics()));
  write_weights(2);
  encode_interrupted(1);
  EXPECT_EQ(flags(), "FFF") << "of several encoders, no latent may be trained on";
}

TEST_F(EncodeSparseStructure, StatisticsGoWithTheLastLatent) {
  encode_sparse_structure(request_);
  for (int i = 0; i < 3; ++i) std::filesystem::remove(sample_.skeleton_voxels(i));
  const EncodeResult result = encode_sparse_structure(request_);
  EXPECT_EQ(result.failed.size(), 3u);
  EXPECT_EQ(flags(), "FFF");
  EXPECT_FALSE(std::filesystem::exists(statistics()));
}

// Latents that cannot be put together, here of another grid: one asset's failure, and not half in the statistics.
TEST_F(EncodeSparseStructure, AnAssetThatDoesNotFitFailsAlone) {
  encode_sparse_structure(request_);
  io::write_npz(latent(1), {{"mean", io::NdArray::from(std::vector<float>(64, 1.0f), {8, 2, 2, 2})},
                            {"mean_skl", io::NdArray::from(std::vector<float>(40, 1.0f), {5, 2, 2, 2})}});
  const EncodeResult result = encode_sparse_structure(request_);
  ASSERT_EQ(result.failed.count("asset1"), 1u);
  EXPECT_EQ(result.shape.assets(), 2u);
  EXPECT_EQ(result.skeleton.assets(), 2u);
  EXPECT_EQ(flags(), "TFT");
}

/// An encoder of three assets that throws what a test wants.
class ThrowingSource : public LatentSource {
 public:
  explicit ThrowingSource(std::function<void(const std::string&)> problem) : problem_(std::move(problem)) {}
  std::filesystem::path checkpoint() const override { return "encoder_of_a_test"; }
  std::string fingerprint() const override { return "of a test"; }
  std::string required_flag() const override { return "voxelized"; }
  std::vector<std::filesystem::path> inputs(const data::AssetId&) const override { return {}; }
  void encode(const data::AssetId& asset, const std::filesystem::path& file) override {
    problem_(asset.id);
    write_file_atomically(file, "latent");
  }
  LatentValues read(const std::filesystem::path&) const override { return {{1, 2}, {3, 4}, 1, 1}; }

 private:
  std::function<void(const std::string&)> problem_;
};

TEST_F(EncodeSparseStructure, WhateverOneAssetThrowsIsItsFailure) {
  const LatentFolder folder(request_.data, "latents_of_a_test", request_.run, LatentKind::kStructure);
  ThrowingSource source([](const std::string& id) {
    if (id == test::PublishedSample::id(0)) throw std::bad_alloc();
    if (id == test::PublishedSample::id(1)) torch::zeros({2, 3}).matmul(torch::zeros({2, 3}));
  });
  const EncodedLatents result = encode_latents(request_, folder, source);
  EXPECT_EQ(result.assets, 3u);
  EXPECT_EQ(result.encoded, 1u);
  ASSERT_EQ(result.failed.size(), 2u);
  EXPECT_EQ(result.failed.at(test::PublishedSample::id(0)), "out of memory");
  EXPECT_NE(result.failed.at(test::PublishedSample::id(1)).find("mat1 and mat2"), std::string::npos);
  ThrowingSource stopped([](const std::string&) { throw Interrupted("stopped"); });
  request_.again = true;
  EXPECT_THROW(encode_latents(request_, folder, stopped), Interrupted);
  ThrowingSource full([](const std::string&) { throw WriteError("disk full"); });
  EXPECT_THROW(encode_latents(request_, folder, full), WriteError) << "no fault of the asset";
}

TEST_F(EncodeSparseStructure, OneDatasetAtATimeAndNoneThatIsBeingPrepared) {
  EncodeRequest two = request_;
  two.data = sample_.root().string() + "," + sample_.root().string();
  try {
    encode_sparse_structure(two);
    FAIL() << "expected an error";
  } catch (const InputError& error) {
    EXPECT_NE(std::string(error.what()).find("--dataset"), std::string::npos) << error.what();
  }
  const auto prepare = FileLock::try_lock(dataset_lock_file(sample_.root()), FileLock::Kind::kExclusive);
  EXPECT_THROW(encode_sparse_structure(request_), InputError);
}

TEST_F(EncodeSparseStructure, CallsAtTheSameTimeShareTheAssets) {
  encode_sparse_structure(request_);
  const std::string flags_alone = flags(), statistics_alone = read_file(statistics()),
                    latent_alone = read_file(latent(1));
  write_weights(2);
  encode_interrupted(1);  // so that there is something to do
  write_weights(1);
  std::vector<EncodeResult> results(2);
  std::vector<std::thread> threads;
  for (EncodeResult& result : results) threads.emplace_back([&] { result = encode_sparse_structure(request_); });
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(flags(), flags_alone);
  EXPECT_EQ(read_file(statistics()), statistics_alone);
  EXPECT_EQ(read_file(latent(1)), latent_alone);
  for (const EncodeResult& result : results) {
    EXPECT_EQ(result.encoded + result.up_to_date, 3u);
    EXPECT_EQ(result.shape.assets(), 3u);
  }
}

TEST_F(EncodeSparseStructure, RefusesBadNamesAndRuns) {
  for (const char* name : {"../out", "a/b", ".hidden", "a b", "a,b"}) {
    request_.name = name;
    EXPECT_THROW(encode_sparse_structure(request_), InputError) << name;
  }
  request_.name = "fine";
  request_.run = folder_ / "absent";
  EXPECT_THROW(encode_sparse_structure(request_), InputError);
}

}  // namespace

namespace {

class MetadataFlag : public testing::Test {
 protected:
  MetadataFlag() { write_file_atomically(table(), "sha256,note\na,\"x, y\"\nb,\n"); }
  std::filesystem::path table() const { return folder_ / "metadata.csv"; }
  test::TemporaryFolder folder_;
};

TEST_F(MetadataFlag, ChangesItsColumnAlone) {
  set_metadata_flag(folder_.path(), "done", {"b", "not there"});
  EXPECT_EQ(read_file(table()), "sha256,note,done\na,\"x, y\",False\nb,,True\n");
  set_metadata_flag(folder_.path(), "done", {"a"});
  EXPECT_EQ(read_file(table()), "sha256,note,done\na,\"x, y\",True\nb,,False\n");
}

TEST_F(MetadataFlag, WritersAtTheSameTimeLoseNothing) {
  constexpr int kWriters = 8;
  std::vector<std::thread> writers;
  for (int i = 0; i < kWriters; ++i) {
    writers.emplace_back([this, i] { set_metadata_flag(folder_.path(), "flag" + std::to_string(i), {"a"}); });
  }
  for (std::thread& writer : writers) writer.join();
  const CsvTable result = read_csv(table());
  ASSERT_EQ(result.columns.size(), 2u + kWriters);
  for (int i = 0; i < kWriters; ++i) EXPECT_EQ(result.cell(0, "flag" + std::to_string(i)), "True");
}

TEST_F(MetadataFlag, KeepsOffWhilePrepareWritesTheTables) {
  {
    const auto prepare = FileLock::try_lock(dataset_lock_file(folder_.path()), FileLock::Kind::kExclusive);
    EXPECT_THROW(set_metadata_flag(folder_.path(), "done", {"a"}), InputError);
  }
  EXPECT_NO_THROW(set_metadata_flag(folder_.path(), "done", {"a"}));
}

TEST_F(MetadataFlag, LeavesNothingWhereThereIsNoDataset) {
  EXPECT_THROW(set_metadata_flag(folder_ / "absent", "done", {}), InputError);
  EXPECT_FALSE(std::filesystem::exists(folder_ / "absent"));
}

}  // namespace

}  // namespace anigen::generate
