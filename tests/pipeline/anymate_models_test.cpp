#include "anigen/pipeline/anymate_models.h"

#include <gtest/gtest.h>

#include "anigen/core/atomic_file.h"
#include "anigen/core/error.h"
#include "anigen/core/json.h"
#include "anigen/io/arrays/zip_archive.h"
#include "anigen/io/safetensors.h"
#include "anigen/models/state_dict.h"
#include "anigen/pipeline/run_weights.h"
#include "tests/io/array_file_bytes.h"
#include "tests/support/paths.h"

namespace anigen::pipeline {
namespace {

namespace fs = std::filesystem;
using models::anymate::AnymateModel;
using models::anymate::ModelOptions;

constexpr const char kArgs[] = R"({"encoder": "bert", "decoder": "transformer_latent", "width": 24, "heads": 2,
  "num_joints": 10, "bert": {"trans_dim": 12, "num_heads": 2, "depth": 1, "num_group": 6, "group_size": 5,
  "encoder_dims": 16, "projection_1": 16, "projection_2": 16}})";

/// A plain value, as pickle writes it.
void add_value(test::PickleBuilder& pickle, const Json& value) {
  if (value.is_object()) {
    pickle.op("}").mark();
    for (const auto& [key, item] : value.items()) add_value(pickle.text(key), item);
    pickle.op("u");
  } else if (value.is_string()) {
    pickle.text(value.get<std::string>());
  } else {
    pickle.integer(value.get<std::int32_t>());
  }
}

/// A checkpoint as the released code saves one: epoch, state_dict and, unless null, model_config.
void write_checkpoint(const fs::path& path, const io::NamedArrays& state, const Json& config) {
  test::PickleBuilder pickle;
  std::vector<io::ZipContent> storages;
  const auto add_sizes = [&](const std::vector<std::int64_t>& sizes) {
    pickle.mark();
    for (const std::int64_t size : sizes) pickle.integer(static_cast<std::int32_t>(size));
    pickle.tuple();
  };
  pickle.op("}").mark().text("epoch").integer(7).text("state_dict").op("}").mark();
  for (const auto& [key, array] : state) {
    std::vector<std::int64_t> strides(array.shape.size(), 1);
    for (std::size_t d = strides.size(); d-- > 1;) strides[d - 1] = strides[d] * array.shape[d];
    const std::string storage = std::to_string(storages.size());
    const bool is_float = array.dtype == io::Dtype::kF32;
    ASSERT_TRUE(is_float || array.dtype == io::Dtype::kI64) << key;
    pickle.text(key).global("torch._utils", "_rebuild_tensor_v2").mark().mark().text("storage");
    pickle.global("torch", is_float ? "FloatStorage" : "LongStorage").text(storage).text("cpu");
    pickle.integer(static_cast<std::int32_t>(array.count())).tuple().op("Q").integer(0);
    add_sizes(array.shape);
    add_sizes(strides);
    pickle.boolean(false).global("collections", "OrderedDict").op(")").reduce().tuple().reduce();
    storages.push_back({"x/data/" + storage, std::string(array.bytes.begin(), array.bytes.end())});
  }
  pickle.op("u");
  if (!config.is_null()) add_value(pickle.text("model_config"), config);
  std::vector<io::ZipContent> members = {{"x/data.pkl", pickle.op("u").stop()}};
  members.insert(members.end(), storages.begin(), storages.end());
  io::write_zip(path, members);
}

class AnymateCheckpoints : public testing::Test {
 protected:
  AnymateCheckpoints() {
    args_ = parse_json(kArgs, "test");
    torch::manual_seed(3);
    state_ = models::state_dict(*AnymateModel(ModelOptions::from_json(args_)));
    averages_ = models::state_dict(*AnymateModel(ModelOptions::from_json(args_)));
  }
  void write_run(const std::string& class_name = "AnymateModel") {
    const Json config = {{"models", {{"rigger", {{"name", class_name}, {"args", args_}}}}},
                         {"dataset", {{"name", "Anymate"}, {"args", {{"points", 64}}}}},
                         {"trainer", {{"name", "AnymateTrainer"}, {"args", {{"num_train_step", 20}}}}}};
    write_file_atomically(folder_ / "run/config.json", config.dump());
    io::write_safetensors(folder_ / "run/ckpts/rigger_step0000002.safetensors", state_);
    io::write_safetensors(folder_ / "run/ckpts/rigger_ema0.99_step0000002.safetensors", averages_);
  }
  static TrainedAnymateModel load(const fs::path& path) { return load_anymate_model(path, torch::kCPU); }
  static std::string refusal(const fs::path& path) {
    try {
      load(path);
    } catch (const InputError& error) {
      return error.what();
    }
    return "";
  }
  static void expect_weights(const TrainedAnymateModel& trained, const io::NamedArrays& expected) {
    const io::NamedArrays found = models::state_dict(*trained.model);
    ASSERT_EQ(found.size(), expected.size());
    for (std::size_t i = 0; i < found.size(); ++i) EXPECT_EQ(found[i].second.bytes, expected[i].second.bytes);
  }

  test::TemporaryFolder folder_;
  Json args_;
  io::NamedArrays state_, averages_;
};

TEST_F(AnymateCheckpoints, OfARunWithItsAverages) {
  write_run();
  const TrainedAnymateModel trained = load(folder_ / "run");
  expect_weights(trained, averages_);
  EXPECT_FALSE(trained.model->is_training());
  for (const torch::Tensor& parameter : trained.model->parameters()) EXPECT_FALSE(parameter.requires_grad());
  EXPECT_EQ(trained.points, 64);
  EXPECT_EQ(trained.train_steps, 20);
  EXPECT_EQ(trained.denoised_joints, 128);
  EXPECT_EQ(describe_weights(folder_ / "run")["rigger"]["complete"], true);
}

TEST_F(AnymateCheckpoints, OfOneFileOfARun) {
  write_run();
  const TrainedAnymateModel trained = load(folder_ / "run/ckpts/rigger_step0000002.safetensors");
  expect_weights(trained, state_);
  EXPECT_EQ(trained.points, 64);
}

TEST_F(AnymateCheckpoints, AsReleasedWithTheirConfig) {
  Json config = args_;
  config["num_train_step"] = 50;
  write_checkpoint(folder_ / "any.pth.tar", state_, config);
  const TrainedAnymateModel trained = load(folder_ / "any.pth.tar");
  expect_weights(trained, state_);
  EXPECT_EQ(trained.train_steps, 50);
  EXPECT_EQ(trained.points, 8192);
}

TEST_F(AnymateCheckpoints, WithoutAConfigTheNameSaysWhatTheyAre) {
  write_checkpoint(folder_ / "any.pth.tar", state_, nullptr);
  EXPECT_NE(refusal(folder_ / "any.pth.tar").find("<encoder>-<decoder>"), std::string::npos);
  write_checkpoint(folder_ / "bert-transformer_latent-small.pth.tar", state_, nullptr);
  const std::string sizes = refusal(folder_ / "bert-transformer_latent-small.pth.tar");
  EXPECT_NE(sizes.find("bert-transformer_latent-small.pth.tar"), std::string::npos) << sizes;
  io::write_safetensors(folder_ / "any.safetensors", state_);
  EXPECT_NE(refusal(folder_ / "any.safetensors").find("any.safetensors"), std::string::npos);
}

TEST_F(AnymateCheckpoints, ThatDoNotFitAreNamed) {
  EXPECT_NE(refusal(folder_ / "absent").find("absent"), std::string::npos);
  write_file_atomically(folder_ / "model.txt", "text");
  EXPECT_NE(refusal(folder_ / "model.txt").find("not supported"), std::string::npos);
  write_run("SomethingElse");
  EXPECT_NE(refusal(folder_ / "run").find("AnymateModel"), std::string::npos);
  const std::string lost = averages_.back().first;
  averages_.pop_back();
  write_run();
  EXPECT_NE(refusal(folder_ / "run").find(lost), std::string::npos) << refusal(folder_ / "run");
  EXPECT_NE(refusal(folder_ / "run").find("rigger_ema0.99_step0000002.safetensors"), std::string::npos);
  args_["heads"] = 5;  // do not divide the width
  write_run();
  EXPECT_NE(refusal(folder_ / "run").find("config.json"), std::string::npos) << refusal(folder_ / "run");
}

TEST_F(AnymateCheckpoints, InTheWrongPlaceAreRefused) {
  write_run();
  EXPECT_NO_THROW(load_anymate_models({folder_ / "run", "", ""}, torch::kCPU));
  EXPECT_THROW(load_anymate_models({"", folder_ / "run", ""}, torch::kCPU), InputError);
  EXPECT_THROW(load_anymate_models({"", "", folder_ / "run"}, torch::kCPU), InputError);
  const AnymateModels none = load_anymate_models({}, torch::kCPU);
  EXPECT_FALSE(none.joints || none.connectivity || none.skin);
}

}  // namespace
}  // namespace anigen::pipeline
