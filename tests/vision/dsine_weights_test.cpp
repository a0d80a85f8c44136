#include "anigen/vision/dsine.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/io/arrays/safetensors.h"
#include "anigen/nn/state_dict.h"
#include "tests/io/arrays/array_file_bytes.h"
#include "tests/support/paths.h"
#include "tests/vision/dsine_formula.h"

namespace anigen::vision {
namespace {

constexpr const char* kCounterEnd = ".num_batches_tracked";

/// A file of torch.save that holds every tensor of a list under `model`, and an epoch beside it. All of them are views
/// of one storage with strides of 0, so that the file is small; as small as the reader lets a file of such views be.
std::string saved_constant(const std::vector<nn::StateEntry>& entries, const std::string& prefix, float value) {
  constexpr int kStored = 1 << 22;
  test::PickleBuilder pickle;
  pickle.op("}").mark().text("epoch").integer(3).text("model").global("collections", "OrderedDict").op(")").reduce();
  pickle.mark();
  for (const nn::StateEntry& entry : entries) {
    const bool counter = test::dsine_key_ends(entry.key, kCounterEnd);
    pickle.text(prefix + entry.key).global("torch._utils", "_rebuild_tensor_v2").mark().mark();
    pickle.text("storage").global("torch", counter ? "LongStorage" : "FloatStorage").text(counter ? "1" : "0");
    pickle.text("cpu").integer(counter ? 1 : kStored).tuple().op("Q").integer(0).mark();
    for (const std::int64_t size : entry.tensor.sizes()) pickle.integer(static_cast<int>(size));
    pickle.tuple().mark();
    for (std::int64_t i = 0; i < entry.tensor.dim(); ++i) pickle.integer(0);
    pickle.tuple().boolean(false).global("collections", "OrderedDict").op(")").reduce().tuple().reduce();
  }
  const std::vector<float> values(kStored, value);
  std::string numbers(values.size() * sizeof(float), '\0');
  std::memcpy(numbers.data(), values.data(), numbers.size());
  return test::stored_zip({{"dsine/data.pkl", pickle.op("u").op("u").stop()},
                           {"dsine/data/0", numbers},
                           {"dsine/data/1", test::little(11, 8)},
                           {"dsine/version", "3\n"}});
}

void expect_all(const Dsine& network, double value) {
  for (const nn::StateEntry& entry : nn::state_entries(*network)) {
    if (test::dsine_key_ends(entry.key, kCounterEnd)) continue;  // not read
    EXPECT_TRUE((entry.tensor == value).all().item<bool>()) << entry.key;
  }
}

TEST(DsineWeights, LoadsTheReleasedForm) {
  const test::TemporaryFolder folder;
  test::write_quickly(folder / "dsine.pt", saved_constant(nn::state_entries(*Dsine()), "module.", 0.125f));
  const Dsine network = load_dsine(folder / "dsine.pt");
  expect_all(network, 0.125);
  EXPECT_FALSE(network->is_training());
}

/// The state dict of a network with a constant everywhere, changed, and what loading says to it.
class DsineWeightErrors : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    Dsine network;
    for (const nn::StateEntry& entry : nn::state_entries(*network)) entry.tensor.fill_(0.5);
    state_ = nn::state_dict(*network);
    target_ = Dsine();
  }
  static void TearDownTestSuite() {
    state_.clear();
    target_ = nullptr;
  }

  static std::string refusal(const std::function<void(io::NamedArrays&)>& change) {
    io::NamedArrays arrays = state_;
    change(arrays);
    try {
      set_dsine_weights(target_, std::move(arrays), "dsine.pt");
    } catch (const InputError& error) {
      return error.what();
    }
    return "accepted";
  }
  static io::NdArray& get(io::NamedArrays& arrays, const std::string& key) {
    for (auto& [name, array] : arrays) {
      if (name == key) return array;
    }
    throw std::runtime_error("no " + key);
  }
  static void expect_mentions(const std::string& message, const std::vector<std::string>& words) {
    for (const std::string& word : words)
      EXPECT_NE(message.find(word), std::string::npos) << word << " in: " << message;
  }

  static inline io::NamedArrays state_;
  static inline Dsine target_ = nullptr;
};

TEST_F(DsineWeightErrors, NoneWithoutCounters) {
  EXPECT_EQ(refusal([](io::NamedArrays& arrays) {
              const auto is_counter = [](const auto& entry) { return test::dsine_key_ends(entry.first, kCounterEnd); };
              arrays.erase(std::remove_if(arrays.begin(), arrays.end(), is_counter), arrays.end());
              ASSERT_EQ(arrays.size(), 802u);
            }),
            "accepted");
}

TEST_F(DsineWeightErrors, NameTheKey) {
  using Arrays = io::NamedArrays;
  expect_mentions(refusal([](Arrays& arrays) {
                    arrays.back() = {"kappa_head.0.weight", io::NdArray::from(std::vector<float>(1, 0.0f), {1})};
                  }),
                  {"dsine.pt", "missing up_prob_head.4.bias", "unexpected kappa_head.0.weight"});
  expect_mentions(refusal([](Arrays& arrays) {
                    get(arrays, "gru.convz.bias").shape = {8, 8};
                  }),
                  {"gru.convz.bias", "[8, 8]", "[64]"});
  expect_mentions(refusal([](Arrays& arrays) {
                    get(arrays, "gru.convz.bias") = io::NdArray::from(std::vector<float>(64, NAN), {64});
                  }),
                  {"dsine.pt", "gru.convz.bias", "not finite"});
  expect_mentions(refusal([](Arrays& arrays) {
                    get(arrays, "gru.convz.bias") = io::NdArray::from(std::vector<std::int64_t>(64, 1), {64});
                  }),
                  {"gru.convz.bias", "int64"});
  expect_mentions(refusal([](Arrays& arrays) { arrays.clear(); }),
                  {"missing", "encoder.original_model.conv_stem.weight"});
}

TEST(DsineWeights, RefusesOtherFiles) {
  const test::TemporaryFolder folder;
  const auto refusal = [&](const std::string& name) -> std::string {
    try {
      load_dsine(folder / name);
    } catch (const InputError& error) {
      return error.what();
    }
    return "accepted";
  };
  const auto expect_names = [&](const std::string& name, const std::string& word) {
    const std::string message = refusal(name);
    EXPECT_NE(message.find(name), std::string::npos) << message;
    EXPECT_NE(message.find(word), std::string::npos) << message;
  };
  expect_names("absent.pt", "");
  write_file_atomically(folder / "text.pt", "no weights at all");
  expect_names("text.pt", "");
  write_file_atomically(folder / "weights.onnx", "ONNX");
  expect_names("weights.onnx", "not supported");
  write_file_atomically(folder / "old.pt", test::raw("\x80\x02}q\x00."));
  expect_names("old.pt", "before version 1.6");

  // Another network's weights.
  io::write_safetensors(folder / "other.safetensors",
                        {{"blocks.0.norm.weight", io::NdArray::from(std::vector<float>(4, 1.0f), {4})}});
  expect_names("other.safetensors", "encoder.original_model.conv_stem.weight");
  expect_names("other.safetensors", "blocks.0.norm.weight");

  const std::string whole = saved_constant(nn::state_entries(*Dsine()), "", 0.5f);
  test::write_quickly(folder / "cut.pt", whole.substr(0, whole.size() / 2));
  expect_names("cut.pt", "");
}  // namespace anigen::vision

}  // namespace
}  // namespace anigen::vision
