#include "anigen/skin_correction/network.h"

#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "anigen/core/error.h"
#include "tests/support/paths.h"

namespace anigen::skin_correction {
namespace {

constexpr double kHeatShare = 0.8807970779778823;  // 1 / (1 + e^-2)
constexpr std::int64_t kRows = 5, kCandidates = 4, kPairs = rigging::kSkinPairFeatures;

SkinCorrectionOptions tiny_correction() {
  SkinCorrectionOptions options;
  options.candidates = kCandidates;
  options.members = 3;
  options.width = 16;
  options.num_heads = 2;
  return options;
}

/// Random features of five vertices with weights that are weights; the last vertex lacks its last two candidates.
struct Vertices {
  Tensor pairs = torch::randn({kRows, kCandidates, kPairs}), heat = torch::rand({kRows, kCandidates}).square(),
         geodesic = torch::rand({kRows, kCandidates}), assets = torch::rand({kRows, rigging::kSkinAssetFeatures}),
         present = torch::ones({kRows, kCandidates}, torch::kBool);

  Vertices() {
    for (const std::int64_t candidate : {2, 3}) present[kRows - 1][candidate] = false;
    for (Tensor* weights : {&heat, &geodesic}) {
      weights->masked_fill_(present.logical_not(), 0.0);
      *weights /= weights->sum(1, true);
    }
    put(rigging::kHeatLog, heat);
    put(rigging::kGeodesicLog, geodesic);
  }
  void put(std::int64_t feature, const Tensor& weights) {
    pairs.select(2, feature).copy_((weights + rigging::kClassicalFloor).log());
  }
};

void randomize(SkinCorrection& model) {
  const torch::NoGradGuard no_grad;
  for (Tensor parameter : model->parameters()) parameter.copy_(0.3 * torch::randn_like(parameter));
}

TEST(SkinCorrections, GiveAMixtureOfClassicalWeightsBeforeTheyLearn) {
  torch::manual_seed(1);
  const Vertices v;
  SkinCorrection model(tiny_correction());
  const Tensor weights = model->forward(v.pairs, v.assets, v.present).exp();
  ASSERT_EQ(weights.sizes(), (std::vector<std::int64_t>{kRows, kCandidates}));
  // The floor inside the logarithm moves a weight by at most itself times the candidates.
  EXPECT_LT((weights - (kHeatShare * v.heat + (1.0 - kHeatShare) * v.geodesic)).abs().max().item<double>(), 5e-4);
  EXPECT_LT((weights.sum(1) - 1.0).abs().max().item<double>(), 1e-5);
}

TEST(SkinCorrections, DoNotDependOnTheOrderOfCandidatesAndLeaveMissingOnesOut) {
  torch::manual_seed(2);
  const Vertices v;
  SkinCorrection model(tiny_correction());
  randomize(model);
  const Tensor weights = model->forward(v.pairs, v.assets, v.present).exp();
  EXPECT_LT((weights.sum(1) - 1.0).abs().max().item<double>(), 1e-5);
  EXPECT_EQ(weights[kRows - 1].narrow(0, 2, 2).max().item<float>(), 0.0F);
  const Tensor order = torch::tensor({2, 0, 3, 1}, torch::kInt64);
  const Tensor permuted = model->forward(v.pairs.index_select(1, order), v.assets, v.present.index_select(1, order));
  EXPECT_LT((permuted.exp() - weights.index_select(1, order)).abs().max().item<double>(), 1e-5);
  // Features of a candidate that is missing have no effect.
  Tensor other = v.pairs.clone();
  other[kRows - 1].narrow(0, 2, 2).narrow(1, rigging::kBoneDistance, 4).fill_(7.0);
  EXPECT_LT((model->forward(other, v.assets, v.present).exp() - weights).abs().max().item<double>(), 1e-6);
}

TEST(SkinCorrections, AllTheirParametersLearn) {
  torch::manual_seed(3);
  const Vertices v;
  SkinCorrection model(tiny_correction());
  randomize(model);
  (model->forward(v.pairs, v.assets, v.present).exp() * torch::rand({kRows, kCandidates})).sum().backward();
  for (const auto& parameter : model->named_parameters()) {
    ASSERT_TRUE(parameter.value().grad().defined()) << parameter.key();
    EXPECT_GT(parameter.value().grad().abs().max().item<double>(), 0.0) << parameter.key();
  }
}

TEST(SkinCorrections, AreTheMeanOfTheirMembers) {
  torch::manual_seed(4);
  const Vertices v;
  SkinCorrection model(tiny_correction());
  randomize(model);
  const Tensor members = model->of_members(v.pairs, v.assets, v.present).exp();
  ASSERT_EQ(members.sizes(), (std::vector<std::int64_t>{3, kRows, kCandidates}));
  EXPECT_GT((members[0] - members[1]).abs().max().item<double>(), 0.01) << "they differ";
  EXPECT_LT((model->forward(v.pairs, v.assets, v.present).exp() - members.mean(0)).abs().max().item<double>(), 1e-6);
}

TEST(SkinCorrections, SeeNoiseInFeaturesButNotInTheWeightsThatTheyCorrect) {
  torch::manual_seed(5);
  const Vertices v;
  SkinCorrection model(tiny_correction());
  const Tensor noise = torch::randn_like(v.pairs);
  const Tensor untrained = model->of_members(v.pairs, v.assets, v.present);
  EXPECT_TRUE(torch::equal(model->of_members(v.pairs, v.assets, v.present, noise), untrained));
  randomize(model);
  const Tensor clean = model->of_members(v.pairs, v.assets, v.present);
  EXPECT_GT((model->of_members(v.pairs, v.assets, v.present, noise) - clean).abs().max().item<double>(), 0.01);
}

TEST(SkinCorrections, RefuseOtherShapes) {
  const Vertices v;
  SkinCorrection model(tiny_correction());
  EXPECT_THROW(model->forward(v.pairs.narrow(1, 0, 3), v.assets, v.present), InputError);
  EXPECT_THROW(model->forward(v.pairs.narrow(2, 0, 3), v.assets, v.present), InputError);
  EXPECT_THROW(model->forward(v.pairs, v.assets.narrow(0, 0, 2), v.present), InputError);
  EXPECT_THROW(model->forward(v.pairs, v.assets, v.present.narrow(1, 0, 2)), InputError);
}

TEST(SkinCorrections, TheOneThatShipsIsSmall) {
  const Json config = read_json(test::source_dir() / "configs/small/skin_correction.json");
  const SkinCorrection model(SkinCorrectionOptions::from_json(config["models"]["skin_correction"]["args"]));
  std::int64_t parameters = 0;
  for (const Tensor& parameter : model->parameters()) parameters += parameter.numel();
  EXPECT_LT(parameters, 400'000);
  EXPECT_GT(parameters, 100'000);
}

TEST(SkinCorrectionOptions, AreChecked) {
  const SkinCorrectionOptions options = tiny_correction();
  EXPECT_EQ(SkinCorrectionOptions::from_json(options.to_json()).to_json(), options.to_json());
  for (const auto& [key, value] : std::vector<std::pair<std::string, int>>{
           {"feature_version", 999}, {"candidates", 0}, {"num_heads", 3}, {"smoothing", 2}, {"depth", 2}}) {
    Json json = options.to_json();
    json[key] = value;
    try {
      SkinCorrectionOptions::from_json(json, "config.json", "/args");
      ADD_FAILURE() << key;
    } catch (const InputError& error) {
      EXPECT_NE(std::string(error.what()).find(key), std::string::npos) << error.what();
    }
  }
}

TEST(StrongestWeights, AreTheLargestOfARow) {
  const Tensor weights = torch::tensor({{0.4, 0.1, 0.2, 0.3}, {0.0, 1.0, 0.0, 0.0}});
  const Tensor kept = strongest_weights(weights, 2);
  const Tensor expected = torch::tensor({{4.0 / 7.0, 0.0, 0.0, 3.0 / 7.0}, {0.0, 1.0, 0.0, 0.0}});
  EXPECT_LT((kept - expected).abs().max().item<double>(), 1e-6);
  const Vertices v;
  EXPECT_LT((classical_weights(v.pairs, rigging::kHeatLog) - v.heat).abs().max().item<double>(), 1e-5);
}

}  // namespace
}  // namespace anigen::skin_correction
