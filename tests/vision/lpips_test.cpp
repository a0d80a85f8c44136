#include "anigen/vision/lpips.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/io/arrays/safetensors.h"
#include "tests/support/paths.h"
#include "tests/vision/lpips_formula.h"

namespace anigen::vision {
namespace {

/// Made once: 14.7 million weights.
const io::NamedArrays& trunk() {
  static const io::NamedArrays kTrunk = test::formula_trunk();
  return kTrunk;
}

Lpips formula_lpips() {
  Lpips lpips;
  set_lpips_weights(*lpips, {{"trunk", trunk()}, {"heads", test::formula_heads()}});
  return lpips;
}

/// Colours in [0, 1].
Tensor picture(std::uint64_t seed, std::int64_t height = 20, std::int64_t width = 24, std::int64_t count = 1) {
  torch::manual_seed(seed);
  return torch::rand({count, 3, height, width});
}

TEST(Lpips, IsZeroForEqualPicturesAndSymmetric) {
  const torch::NoGradGuard no_grad;
  Lpips lpips = formula_lpips();
  const Tensor a = picture(1, 20, 24, 2), b = picture(2, 20, 24, 2);
  EXPECT_EQ(lpips(a, a).abs().max().item<float>(), 0.0f);
  const Tensor there = lpips(a, b), back = lpips(b, a);
  EXPECT_EQ(there.sizes(), torch::IntArrayRef({2}));
  EXPECT_GT(there.min().item<float>(), 0.01f);
  EXPECT_TRUE(torch::allclose(there, back, 1e-6, 0.0));
  // Each picture of a batch is compared for itself.
  EXPECT_TRUE(torch::allclose(lpips(a.slice(0, 1, 2), b.slice(0, 1, 2))[0], there[1], 1e-5, 1e-6));
  // A smaller change is a smaller distance.
  EXPECT_LT(lpips(a, a + 0.1 * (b - a))[0].item<float>(), there[0].item<float>());
}

TEST(Lpips, GradientsAreThoseOfFiniteDifferences) {
  Lpips lpips = formula_lpips();
  lpips->to(torch::kFloat64);
  const Tensor b = picture(4, 16, 16).to(torch::kFloat64);
  const Tensor a = picture(3, 16, 16).to(torch::kFloat64).requires_grad_();
  lpips(a, b).sum().backward();
  ASSERT_TRUE(a.grad().defined());
  EXPECT_FALSE(lpips->parameters().front().grad().defined()) << "the network is frozen";
  const torch::NoGradGuard no_grad;
  for (int i = 0; i < 4; ++i) {
    const Tensor direction = torch::randn_like(a);
    // Small enough to stay between the kinks of the rectifiers, large enough for 1e-16 · value / step to be small.
    constexpr double kStep = 1e-7;
    const double slope =
        ((lpips(a + kStep * direction, b) - lpips(a - kStep * direction, b)) / (2.0 * kStep)).item<double>();
    const double expected = (a.grad() * direction).sum().item<double>();
    EXPECT_NEAR(slope, expected, 1e-5 * a.grad().norm().item<double>()) << i;
  }
}

TEST(Lpips, GradientsStayFiniteWhereNoChannelIsActive) {
  io::NamedArrays silent = trunk();
  for (auto& [key, array] : silent) {  // biases that switch every channel of the first layer off
    if (key == "features.0.bias") array = io::NdArray::from(std::vector<float>(64, -100.0f), {64});
    if (key == "features.2.bias") array = io::NdArray::from(std::vector<float>(64, 0.0f), {64});
  }
  Lpips lpips;
  set_lpips_weights(*lpips, {{"trunk", silent}, {"heads", test::formula_heads()}});
  const Tensor a = picture(5, 16, 16).requires_grad_();
  const Tensor distance = lpips(a, picture(6, 16, 16));
  EXPECT_EQ(distance.item<float>(), 0.0f);
  distance.sum().backward();
  EXPECT_TRUE(torch::isfinite(a.grad()).all().item<bool>());
}

TEST(Lpips, RefusesWhatIsNoPairOfPictures) {
  Lpips lpips = formula_lpips();
  EXPECT_THROW(lpips(picture(1, 16, 16), picture(1, 16, 17)), InputError);
  EXPECT_THROW(lpips(picture(1, 15, 16), picture(1, 15, 16)), InputError);
  EXPECT_THROW(lpips(picture(1, 16, 16)[0], picture(1, 16, 16)[0]), InputError);
  EXPECT_THROW(lpips(torch::zeros({1, 1, 16, 16}), torch::zeros({1, 1, 16, 16})), InputError);
}

TEST(Lpips, WithoutWeightsGivesNoNumber) {
  Lpips lpips;
  EXPECT_TRUE(torch::isnan(lpips(picture(1), picture(1))).all().item<bool>());
}

class LpipsWeights : public ::testing::Test {
 protected:
  /// The message for a change of the weights; the network must stay as it was.
  std::string problem(const std::function<void(io::NamedArrays&, io::NamedArrays&)>& change) {
    io::NamedArrays features = trunk(), heads = test::formula_heads();
    change(features, heads);
    Lpips lpips;
    try {
      set_lpips_weights(*lpips, {{"vgg16.pth", features}, {"heads.pth", heads}});
    } catch (const InputError& error) {
      EXPECT_TRUE(torch::isnan(lpips->parameters().front()).all().item<bool>());
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
};

void expect_contains(const std::string& text, const std::vector<std::string>& parts) {
  for (const std::string& part : parts) EXPECT_NE(text.find(part), std::string::npos) << part << " in: " << text;
}

TEST_F(LpipsWeights, BadOnesAreNamedByFileAndKey) {
  using Arrays = io::NamedArrays;
  EXPECT_EQ(problem([](Arrays&, Arrays&) {}), "accepted");
  expect_contains(problem([](Arrays& features, Arrays&) { features.erase(features.begin() + 24); }),
                  {"vgg16.pth, heads.pth", "features.28.weight", "is missing"});
  expect_contains(problem([](Arrays&, Arrays& heads) { heads.pop_back(); }), {"lin4.model.1.weight", "is missing"});
  expect_contains(problem([](Arrays&, Arrays& heads) { get(heads, "lin1.model.1.weight").shape = {128}; }),
                  {"heads.pth", "lin1.model.1.weight", "[128]", "[1, 128, 1, 1]"});
  expect_contains(problem([](Arrays& features, Arrays&) {
                    get(features, "features.2.bias") = io::NdArray::from(std::vector<float>(64, NAN), {64});
                  }),
                  {"vgg16.pth", "features.2.bias", "not finite"});
  expect_contains(problem([](Arrays& features, Arrays&) {
                    get(features, "features.2.bias") = io::NdArray::from(std::vector<std::int64_t>(64, 1), {64});
                  }),
                  {"vgg16.pth", "features.2.bias", "int64"});
  expect_contains(problem([](Arrays& features, Arrays& heads) { features.push_back(heads[0]); }),
                  {"heads.pth", "lin0.model.1.weight", "vgg16.pth"});
}

TEST_F(LpipsWeights, OneFileWithTheNamesOfTheLpipsPackageWillDo) {
  test::TemporaryFolder folder;
  io::NamedArrays together;
  const auto stage = [](int layer) {
    return layer < 4 ? "1" : layer < 9 ? "2" : layer < 16 ? "3" : layer < 23 ? "4" : "5";
  };
  for (const auto& [key, array] : trunk()) {
    const std::string rest = key.substr(std::string("features.").size());
    together.emplace_back(std::string("net.slice") + stage(std::stoi(rest)) + "." + rest, array);
  }
  for (const auto& entry : test::formula_heads()) together.push_back(entry);
  together.emplace_back("scaling_layer.shift", io::NdArray::from(std::vector<float>(3, 0.0f), {1, 3, 1, 1}));
  io::write_safetensors(folder / "lpips.safetensors", together);
  Lpips one = load_lpips({folder / "lpips.safetensors"}), two = formula_lpips();
  EXPECT_EQ(one(picture(1), picture(2)).item<float>(), two(picture(1), picture(2)).item<float>());

  EXPECT_THROW(load_lpips({folder / "absent.safetensors"}), InputError);
  write_file_atomically(folder / "short.pth", "PK");
  EXPECT_THROW(load_lpips({folder / "short.pth", folder / "lpips.safetensors"}), InputError);
  EXPECT_THROW(load_lpips({}), InputError);
}

}  // namespace
}  // namespace anigen::vision
