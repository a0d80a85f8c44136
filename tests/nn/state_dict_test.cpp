#include <gtest/gtest.h>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/io/arrays/safetensors.h"
#include "anigen/nn/init.h"
#include "anigen/nn/linear.h"
#include "anigen/nn/state_dict.h"
#include "tests/support/paths.h"

namespace anigen::nn {

namespace {

struct SmallImpl : torch::nn::Module {
  SmallImpl() {
    // Children are registered before the own parameter; a state dict lists own parameters first all the same.
    layer = register_module("layer", Linear(2, 3));
    scale = register_parameter("scale", torch::ones({3}));
    steps = register_buffer("steps", torch::zeros({1}, torch::kInt64));
    torch::nn::init::zeros_(layer->weight);
    torch::nn::init::zeros_(layer->bias);
  }
  Linear layer = nullptr;
  torch::Tensor scale, steps;
};
TORCH_MODULE(Small);

std::vector<std::string> keys_of(const Small& model) {
  std::vector<std::string> keys;
  for (const StateEntry& entry : state_entries(*model)) keys.push_back(entry.key);
  return keys;
}

TEST(StateDict, ListsOwnEntriesThenChildren) {
  const Small model;
  EXPECT_EQ(keys_of(model), (std::vector<std::string>{"scale", "steps", "layer.weight", "layer.bias"}));
  EXPECT_TRUE(state_entries(*model)[1].is_buffer);
}

TEST(StateDict, RoundTrip) {
  Small from, to;
  {
    const torch::NoGradGuard no_grad;
    from->layer->weight.normal_();
    from->scale.normal_();
    from->steps.fill_(12);
  }
  const LoadReport report = load_state_dict(*to, state_dict(*from), LoadMode::kStrict);
  EXPECT_TRUE(report.missing.empty() && report.unexpected.empty());
  EXPECT_TRUE(torch::equal(to->layer->weight, from->layer->weight));
  EXPECT_EQ(to->steps.item<std::int64_t>(), 12);
  EXPECT_TRUE(to->layer->weight.requires_grad());
}

TEST(StateDict, GivesBackTheBytesOfArraysThatMayBeUsedUp) {
  const Small from;
  Small to;
  io::NamedArrays arrays = state_dict(*from);
  load_state_dict(*to, arrays, LoadMode::kStrict);
  EXPECT_FALSE(arrays[0].second.bytes.empty());
  load_state_dict(*to, std::move(arrays), LoadMode::kStrict);
  for (const auto& [key, array] : arrays) EXPECT_EQ(array.bytes.capacity(), 0U) << key;  // NOLINT: looked at on purpose
  EXPECT_TRUE(torch::equal(to->scale, from->scale));
}

TEST(StateDict, NonStrictReportsAndLeavesTheRestAlone) {
  Small model;
  const LoadReport report =
      load_state_dict(*model, {{"scale", to_array(torch::full({3}, 2.0F))}, {"other", to_array(torch::ones({1}))}},
                      LoadMode::kNonStrict);
  EXPECT_EQ(report.missing, (std::vector<std::string>{"steps", "layer.weight", "layer.bias"}));
  EXPECT_EQ(report.unexpected, (std::vector<std::string>{"other"}));
  EXPECT_EQ(model->scale[1].item<float>(), 2.0F);
}

TEST(StateDict, StrictNamesMissingAndUnexpectedKeysAndWritesNothing) {
  Small model;
  try {
    load_state_dict(*model, {{"scale", to_array(torch::zeros({3}))}, {"other", to_array(torch::ones({1}))}},
                    LoadMode::kStrict, "file.pt");
    FAIL() << "no error";
  } catch (const InputError& error) {
    const std::string message = error.what();
    EXPECT_NE(message.find("file.pt"), std::string::npos);
    EXPECT_NE(message.find("layer.weight"), std::string::npos);
    EXPECT_NE(message.find("unexpected other"), std::string::npos);
  }
  EXPECT_EQ(model->scale[0].item<float>(), 1.0F);
}

TEST(StateDict, ShapeMismatchNamesKeyAndBothShapes) {
  Small model;
  try {
    load_state_dict(*model, {{"layer.weight", to_array(torch::zeros({2, 3}))}}, LoadMode::kNonStrict, "file.pt");
    FAIL() << "no error";
  } catch (const InputError& error) {
    EXPECT_STREQ(error.what(), "file.pt: layer.weight: the file has shape [2, 3], the model [3, 2]");
  }
}

TEST(StateDict, ConvertsToTheRunTimeDtype) {
  Small model;
  const LoadReport report =
      load_state_dict(*model, {{"scale", to_array(torch::full({3}, 0.5).to(torch::kHalf))}}, LoadMode::kNonStrict);
  EXPECT_EQ(model->scale.scalar_type(), torch::kFloat32);
  EXPECT_EQ(model->scale[2].item<float>(), 0.5F);
}

TEST(StateFile, ComesTensorByTensorAndNamesWhatIsWrong) {
  const Small from;
  {
    const torch::NoGradGuard no_grad;
    torch::nn::init::normal_(from->layer->weight);
    from->steps.fill_(12);
  }
  const test::TemporaryFolder folder;
  const auto file = folder / "model.safetensors";
  io::NamedArrays arrays = state_dict(*from);
  io::write_safetensors(file, arrays);
  Small to;
  std::vector<std::string> keys;
  load_state_file(*to, file, [&](const std::string& key) {
    keys.push_back(key);
    if (key != "layer.weight") return;
    EXPECT_TRUE(torch::equal(to->layer->weight, from->layer->weight)) << "its numbers are there by then";
    to->layer->weight.set_data(to->layer->weight.data().to(torch::kBFloat16));
  });
  EXPECT_EQ(keys, keys_of(from));
  EXPECT_EQ(to->layer->weight.scalar_type(), torch::kBFloat16);
  EXPECT_EQ(to->steps.item<std::int64_t>(), 12);

  const auto problem = [&](const LoadedKey& loaded = {}) {
    try {
      Small other;
      load_state_file(*other, file, loaded);
    } catch (const InputError& error) {
      return std::string(error.what());
    }
    return std::string("none");
  };
  const std::string name = file.string() + ": ";
  EXPECT_EQ(problem([](const std::string& key) { throw InputError("", key, "a number is not finite"); }),
            name + "scale: a number is not finite");
  std::swap(arrays[0], arrays.back());
  arrays[0].second = io::NdArray::from(std::vector<std::int64_t>(3, 1), {3});
  arrays[0].second.dtype = io::Dtype::kU64;
  io::write_safetensors(file, arrays);
  EXPECT_EQ(problem(), name + "layer.bias: an array of uint64 cannot become a tensor");
  arrays = state_dict(*from);
  arrays[0].first = "other";
  io::write_safetensors(file, arrays);
  EXPECT_EQ(problem(), name + "these are not the weights of this model: missing scale; unexpected other");
  arrays[0] = {"scale", to_array(torch::zeros({4}))};
  io::write_safetensors(file, arrays);
  EXPECT_EQ(problem(), name + "scale: the file has shape [4], the model [3]");
}

TEST(PublishedDtypes, HalfConcernsLinearsBelowTheNamedModules) {
  const Small model;
  const auto none = published_dtypes(*model, {"lay"});
  EXPECT_EQ(none[2], torch::kFloat32);
  const auto dtypes = published_dtypes(*model, {"layer"});
  EXPECT_EQ(dtypes, (std::vector<torch::Dtype>{torch::kFloat32, torch::kInt64, torch::kHalf, torch::kHalf}));
}

TEST(TensorArrays, RoundTripOfEveryDtype) {
  for (const torch::Dtype dtype : {torch::kBool, torch::kUInt8, torch::kInt8, torch::kInt16, torch::kInt32,
                                   torch::kInt64, torch::kHalf, torch::kBFloat16, torch::kFloat32, torch::kFloat64}) {
    const torch::Tensor tensor = torch::tensor({0.0, 1.0, 1.0, 0.0, 1.0, 0.0}).view({2, 3}).t().to(dtype);
    const torch::Tensor back = to_tensor(to_array(tensor));
    EXPECT_EQ(back.scalar_type(), dtype);
    EXPECT_TRUE(torch::equal(back, tensor));
  }
}

TEST(TensorArrays, WidensUnsignedAndRefusesWhatTorchLacks) {
  io::NdArray array;
  array.dtype = io::Dtype::kU16;
  array.shape = {2};
  array.bytes = {255, 255, 1, 0};
  EXPECT_EQ(to_tensor(array)[0].item<int>(), 65535);
  array.dtype = io::Dtype::kU64;
  array.bytes.resize(16);
  EXPECT_THROW(to_tensor(array), InputError);
  array.dtype = io::Dtype::kF32;
  EXPECT_THROW(to_tensor(array), InputError);  // 16 bytes are not two floats
}

}  // namespace

namespace {

class RunModelTest : public testing::Test {
 protected:
  RunModelTest() {
    write_file_atomically(folder_ / "config.json",
                          R"({"models": {"encoder": {"name": "E", "args": {"a": 1}}, "decoder": {"name": "D"}}})");
  }
  void weights(const std::string& name) { write_file_atomically(folder_ / "ckpts" / name, "weights"); }
  std::string chosen(const std::string& class_name, const std::string& ckpt = "") {
    return find_run_model(folder_.path(), class_name, ckpt).checkpoint.filename().string();
  }
  test::TemporaryFolder folder_;
};

TEST_F(RunModelTest, TakesTheNewestOfItsOwnFilesAveragedFirst) {
  for (const char* name :
       {"encoder_step0000010.safetensors", "encoder_ema0.99_step0000010.safetensors", "encoder_step0000009.safetensors",
        "decoder_step0000020.safetensors", "state_step0000030.safetensors", "encoder_step0000040.txt"}) {
    weights(name);
  }
  EXPECT_EQ(chosen("E"), "encoder_ema0.99_step0000010.safetensors");
  EXPECT_EQ(chosen("D"), "decoder_step0000020.safetensors");
  weights("encoder_step0000011.safetensors");
  EXPECT_EQ(chosen("E"), "encoder_step0000011.safetensors") << "a later step beats an average";
  EXPECT_EQ(chosen("E", "final"), "encoder_step0000011.safetensors") << "there is no file of that name";
  EXPECT_EQ(chosen("E", "step0000009"), "encoder_step0000009.safetensors");
  EXPECT_THROW(chosen("E", "step0000008"), InputError);
  weights("encoder_final.pt");
  EXPECT_EQ(chosen("E", "final"), "encoder_final.pt");
}

// The file names sort otherwise: "8" comes before "_".
TEST_F(RunModelTest, OfSeveralAveragesTakesTheOneThatTheTrainingEvaluates) {
  for (const char* rate : {"0.999", "0.9998"}) weights(std::string("encoder_ema") + rate + "_step0000010.safetensors");
  EXPECT_EQ(chosen("E"), "encoder_ema0.9998_step0000010.safetensors") << "the config does not say";
  for (const char* rates : {"[0.999, 0.9998]", "0.999", "[0.9998, 0.999]"}) {
    write_file_atomically(
        folder_ / "config.json",
        std::string(R"({"models": {"encoder": {"name": "E"}}, "trainer": {"args": {"ema_rate": )") + rates + "}}}");
    const bool smaller = std::string(rates) != "[0.9998, 0.999]";
    EXPECT_EQ(chosen("E"),
              smaller ? "encoder_ema0.999_step0000010.safetensors" : "encoder_ema0.9998_step0000010.safetensors")
        << rates;
    EXPECT_EQ(newest_checkpoint(folder_ / "ckpts", "encoder").filename().string(), chosen("E"));
  }
}

TEST_F(RunModelTest, TakesWholeSetsBeforeWhatAKilledRunLeft) {
  weights("encoder_step0000010.safetensors");
  weights("encoder_step0000030.tmp-12-3.safetensors");
  EXPECT_EQ(chosen("E"), "encoder_step0000010.safetensors");
  weights("encoder_step0000020.safetensors");
  EXPECT_EQ(chosen("E"), "encoder_step0000020.safetensors") << "no state, as in released folders";
  weights("state_step0000010.safetensors");
  EXPECT_EQ(chosen("E"), "encoder_step0000010.safetensors") << "the decoder of step 20 may never have been written";
  weights("state_step0000020.tmp-12-4.safetensors");
  EXPECT_EQ(chosen("E"), "encoder_step0000010.safetensors");
  weights("state_step0000020.safetensors");
  EXPECT_EQ(chosen("E"), "encoder_step0000020.safetensors");
}

TEST_F(RunModelTest, TellsArgumentsAndWhatIsMissing) {
  EXPECT_THROW(find_run_model(folder_.path(), "E"), InputError) << "no weights";
  weights("encoder_step0000001.safetensors");
  const RunModel found = find_run_model(folder_.path(), "E");
  EXPECT_EQ(found.name, "encoder");
  EXPECT_EQ(found.args.at("a"), 1);
  EXPECT_EQ(found.pointer, "/models/encoder/args");
  EXPECT_THROW(find_run_model(folder_.path(), "Other"), InputError);
  EXPECT_THROW(find_run_model(folder_ / "absent", "E"), InputError);
}

}  // namespace

}  // namespace anigen::nn
