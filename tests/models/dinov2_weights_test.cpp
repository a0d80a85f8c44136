#include "anigen/models/dinov2_weights.h"

#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "anigen/core/atomic_file.h"
#include "anigen/core/error.h"
#include "anigen/io/safetensors.h"
#include "anigen/models/state_dict.h"
#include "anigen/models/tensor_arrays.h"
#include "tests/io/array_file_bytes.h"
#include "tests/models/deterministic_fill.h"
#include "tests/support/paths.h"

namespace anigen::models {
namespace {

Dinov2Options tiny_weights(std::int64_t channels = 8, std::int64_t registers = 2) {
  Dinov2Options options;
  options.img_size = 12;
  options.patch_size = 4;
  options.embed_dim = channels;
  options.depth = 1;
  options.num_heads = 2;
  options.num_register_tokens = registers;
  return options;
}

class Dinov2Weights : public testing::Test {
 protected:
  Dinov2Weights() : model_(tiny_weights()) {
    test::golden_fill(*model_);
    weights_ = state_dict(*model_);
  }

  std::filesystem::path written(const io::NamedArrays& arrays) {
    io::write_safetensors(folder_ / "weights.safetensors", arrays);
    return folder_ / "weights.safetensors";
  }

  // What loading into a fresh model says.
  std::string refusal(const std::filesystem::path& file, const Dinov2Options& options = tiny_weights()) {
    Dinov2 model(options);
    try {
      load_dinov2_weights(model, file);
    } catch (const InputError& error) {
      return error.what();
    }
    return "";
  }

  io::NdArray& weight(const std::string& key) {
    for (auto& [name, array] : weights_) {
      if (name == key) return array;
    }
    throw std::runtime_error("no weight " + key);
  }

  void expect_same(const Dinov2& loaded) {
    const std::vector<StateEntry> wanted = state_entries(*model_), found = state_entries(*loaded);
    ASSERT_EQ(found.size(), wanted.size());
    for (std::size_t i = 0; i < wanted.size(); ++i) {
      EXPECT_TRUE(torch::equal(found[i].tensor, wanted[i].tensor)) << wanted[i].key;
      EXPECT_FALSE(found[i].tensor.requires_grad());
    }
  }

  test::TemporaryFolder folder_;
  Dinov2 model_;
  io::NamedArrays weights_;
};

void expect_mentions(const std::string& message, const std::vector<std::string>& words) {
  for (const std::string& word : words) EXPECT_NE(message.find(word), std::string::npos) << word << " in: " << message;
}

TEST_F(Dinov2Weights, LoadsSafetensors) {
  Dinov2 loaded(tiny_weights());
  load_dinov2_weights(loaded, written(weights_));
  expect_same(loaded);
  EXPECT_FALSE(loaded->is_training());
}

// The bytes of torch.save of an OrderedDict of fp32 tensors, one storage each.
std::string saved_by_torch(const io::NamedArrays& weights) {
  test::PickleBuilder pickle;
  pickle.global("collections", "OrderedDict").op(")").reduce().mark();
  std::vector<std::pair<std::string, std::string>> members = {{"weights/data.pkl", ""}};
  for (const auto& [key, array] : weights) {
    const std::string storage = std::to_string(members.size() - 1);
    pickle.text(key).global("torch._utils", "_rebuild_tensor_v2").mark().mark();
    pickle.text("storage").global("torch", "FloatStorage").text(storage).text("cpu");
    pickle.integer(static_cast<int>(array.count())).tuple().op("Q").integer(0).mark();
    for (const std::int64_t size : array.shape) pickle.integer(static_cast<int>(size));
    pickle.tuple().mark();
    auto stride = static_cast<int>(array.count());
    for (const std::int64_t size : array.shape) pickle.integer(stride /= static_cast<int>(size));
    pickle.tuple().boolean(false).global("collections", "OrderedDict").op(")").reduce().tuple().reduce();
    members.emplace_back("weights/data/" + storage, std::string(array.bytes.begin(), array.bytes.end()));
  }
  members.front().second = pickle.op("u").stop();
  members.emplace_back("weights/version", "3\n");
  return test::stored_zip(members);
}

TEST_F(Dinov2Weights, LoadsWhatTorchSaves) {
  const std::string bytes = saved_by_torch(weights_);
  write_file_atomically(folder_ / "weights.pth", bytes);
  Dinov2 loaded(tiny_weights());
  load_dinov2_weights(loaded, folder_ / "weights.pth");
  expect_same(loaded);

  for (const std::size_t length : {bytes.size() / 2, bytes.size() - 1}) {
    write_file_atomically(folder_ / "cut.pth", bytes.substr(0, length));
    expect_mentions(refusal(folder_ / "cut.pth"), {"cut.pth"});
  }
}

// The other published form: Hugging Face's names, queries, keys and values apart.
io::NamedArrays in_transformers_form(const io::NamedArrays& weights) {
  const std::vector<std::pair<std::string, std::string>> names = {
      {"cls_token", "embeddings.cls_token"},
      {"pos_embed", "embeddings.position_embeddings"},
      {"register_tokens", "embeddings.register_tokens"},
      {"mask_token", "embeddings.mask_token"},
      {"patch_embed.proj", "embeddings.patch_embeddings.projection"},
      {"blocks.0.attn.proj", "encoder.layer.0.attention.output.dense"},
      {"blocks.0.ls1.gamma", "encoder.layer.0.layer_scale1.lambda1"},
      {"blocks.0.ls2.gamma", "encoder.layer.0.layer_scale2.lambda1"},
      {"blocks.0.mlp.w12", "encoder.layer.0.mlp.weights_in"},
      {"blocks.0.mlp.w3", "encoder.layer.0.mlp.weights_out"},
      {"blocks.0", "encoder.layer.0"},
      {"norm", "layernorm"}};
  io::NamedArrays other;
  for (const auto& [key, array] : weights) {
    const std::string qkv = "blocks.0.attn.qkv.";
    if (key.compare(0, qkv.size(), qkv) == 0) {
      const std::vector<Tensor> parts = to_tensor(array).chunk(3, 0);
      const std::vector<std::string> kinds = {"query", "key", "value"};
      for (std::size_t i = 0; i < 3; ++i) {
        other.emplace_back("encoder.layer.0.attention.attention." + kinds[i] + "." + key.substr(qkv.size()),
                           to_array(parts[i]));
      }
      continue;
    }
    for (const auto& [hub, transformers] : names) {
      if (key.compare(0, hub.size(), hub) != 0) continue;
      other.emplace_back(transformers + key.substr(hub.size()), array);
      break;
    }
  }
  return other;
}

TEST_F(Dinov2Weights, LoadsTheKeysOfTransformers) {
  Dinov2 loaded(tiny_weights());
  load_dinov2_weights(loaded, written(in_transformers_form(weights_)));
  expect_same(loaded);

  io::NamedArrays lacking = in_transformers_form(weights_);
  for (auto& [key, array] : lacking) {
    if (key == "encoder.layer.0.attention.attention.key.bias") key = "elsewhere";
  }
  expect_mentions(refusal(written(lacking)), {"missing", "blocks.0.attn.qkv.bias"});
}

TEST_F(Dinov2Weights, LoadsTheKeysOfTransformersWithSwiGlu) {
  Dinov2Options options = tiny_weights();
  options.ffn_layer = "swiglufused";
  model_ = Dinov2(options);
  test::golden_fill(*model_);
  Dinov2 loaded(options);
  load_dinov2_weights(loaded, written(in_transformers_form(state_dict(*model_))));
  expect_same(loaded);
}

TEST_F(Dinov2Weights, RefusesTruncatedMissingAndForeignFiles) {
  const std::string bytes = read_file(written(weights_));
  for (const std::size_t length : {std::size_t{0}, std::size_t{5}, bytes.size() / 3, bytes.size() - 1}) {
    write_file_atomically(folder_ / "cut.safetensors", bytes.substr(0, length));
    expect_mentions(refusal(folder_ / "cut.safetensors"), {"cut.safetensors"});
  }
  expect_mentions(refusal(folder_ / "absent.pth"), {"absent.pth"});
  write_file_atomically(folder_ / "weights.bin", bytes);
  expect_mentions(refusal(folder_ / "weights.bin"), {"weights.bin"});
}

TEST_F(Dinov2Weights, AnotherSizeNamesTheKeyAndBothShapes) {
  expect_mentions(refusal(written(weights_), tiny_weights(16)), {"cls_token", "[1, 1, 8]", "[1, 1, 16]"});
}

TEST_F(Dinov2Weights, RegistersMustMatch) {
  expect_mentions(refusal(written(weights_), tiny_weights(8, 0)), {"unexpected", "register_tokens"});
  weights_.erase(weights_.begin() + 2);
  expect_mentions(refusal(written(weights_)), {"missing", "register_tokens"});
}

TEST_F(Dinov2Weights, RefusesNumbersThatAreNotFinite) {
  Tensor norm = to_tensor(weight("norm.weight"));
  norm[3] = std::nan("");
  weight("norm.weight") = to_array(norm);
  expect_mentions(refusal(written(weights_)), {"weights.safetensors", "norm.weight", "not finite"});
}

TEST_F(Dinov2Weights, RefusesWholeNumbers) {
  weight("norm.bias") = to_array(torch::zeros({8}, torch::kInt64));
  expect_mentions(refusal(written(weights_)), {"norm.bias", "int64"});
}

}  // namespace
}  // namespace anigen::models
