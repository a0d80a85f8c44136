#include <gtest/gtest.h>

#include "anigen/anymate/heads.h"
#include "anigen/core/error.h"
#include "tests/anymate/anymate_small.h"

namespace anigen::anymate {
namespace {

constexpr double kHidden = -1e7;  // what masked logits lie below

std::shared_ptr<torch::nn::Module> head_for_test(const char* decoder) {
  std::shared_ptr<torch::nn::Module> module = make_decoder(small_model("bert", decoder));
  module->eval();
  return module;
}

TEST(AnymateConnectivity, RootsAreTheirOwnParents) {
  const Tensor logits = torch::tensor({{9.0F, 1.0F, 0.0F}, {5.0F, 2.0F, 1.0F}, {0.0F, 4.0F, 1.0F}});
  const Tensor parents = likeliest_parents(logits);
  EXPECT_TRUE(torch::equal(parents, torch::tensor({0, 0, 1}, torch::kInt64)));
  const Tensor joints = torch::arange(9, torch::kFloat32).view({3, 3});
  const Tensor bones = bones_of(joints, parents);
  ASSERT_EQ(bones.size(0), 2);
  EXPECT_TRUE(torch::equal(bones[0], torch::cat({joints[0], joints[1]})));
  EXPECT_TRUE(torch::equal(bones[1], torch::cat({joints[1], joints[2]})));
  EXPECT_EQ(bones_of(joints, torch::arange(3)).size(0), 0);
  EXPECT_THROW(bones_of(joints, torch::tensor({0, 0, 3}, torch::kInt64)), InputError);
  EXPECT_THROW(likeliest_parents(torch::zeros({2, 3})), InputError);
}

TEST(AnymateConnectivity, LossCountsPaddedRows) {
  const Tensor logits = torch::zeros({1, 4, 4}, torch::kFloat64);
  Tensor truth = torch::zeros({1, 6, 4}, torch::kFloat64);
  truth[0][0][0] = 1.0;
  truth[0][1][0] = 1.0;
  EXPECT_NEAR(connectivity_loss(logits, truth).item<double>(), -2.0 * std::log(0.25 + 1e-6) / 4.0, 1e-9);
  EXPECT_THROW(connectivity_loss(logits, truth.narrow(1, 0, 3)), InputError);
}

TEST(AnymateConnectivity, BinaryCrossEntropyCountsRealEntries) {
  // Two real joints of three, logits 0: every softmax is 1/3, joint 0 a root and the parent of joint 1.
  const Tensor logits = torch::zeros({1, 3, 3}, torch::kFloat64), mask = torch::tensor({{1, 1, 0}});
  Tensor truth = torch::zeros({1, 3, 3}, torch::kFloat64);
  truth[0][0][0] = 1.0;
  truth[0][1][0] = 1.0;
  const double by_hand = -(2.0 * std::log(1.0 / 3.0) + 2.0 * std::log(2.0 / 3.0)) / 4.0;
  EXPECT_NEAR(connectivity_bce(logits, truth, mask).item<double>(), by_hand, 1e-12);
  const double of_all = -(2.0 * std::log(1.0 / 3.0) + 7.0 * std::log(2.0 / 3.0)) / 9.0;
  EXPECT_NEAR(connectivity_bce(logits, truth).item<double>(), of_all, 1e-12);
  EXPECT_THROW(connectivity_bce(logits, truth, torch::ones({1, 2})), InputError);

  // Certain and wrong: finite, and so is the gradient.
  const Tensor certain = (200.0 * torch::eye(3, torch::kFloat64)).unsqueeze(0).requires_grad_();
  connectivity_bce(certain, truth).backward();
  EXPECT_TRUE(torch::isfinite(certain.grad()).all().item<bool>());
}

TEST(AnymateConnectivity, ColumnsAsChildrenSwapTheBranches) {
  torch::manual_seed(12);
  const torch::NoGradGuard no_grad;
  const Tensor latents = torch::randn({1, 5, 24}), joints = torch::rand({1, 6, 3});
  HeadOptions options;
  options.width = 24;
  options.heads = 2;
  const auto compare = [&](ConnectivityImpl& head) {
    const Tensor rows = head.forward(latents, joints);
    head.columns_are_children(true);
    EXPECT_TRUE(torch::equal(head.forward(latents, joints), rows.transpose(1, 2)));
    head.columns_are_children(false);
    EXPECT_TRUE(torch::equal(head.forward(latents, joints), rows));
  };
  compare(*TwoBranchConnectivity(options));
  compare(*TokenConnectivity(options, 1, 8));

  // Masked joints are no parents, whichever side the children are on.
  TwoBranchConnectivity masked(options);
  masked->columns_are_children(true);
  const Tensor logits = masked->forward(latents, joints, torch::tensor({{1, 1, 1, 1, 0, 0}}));
  EXPECT_LT(logits.slice(2, 4).max().item<double>(), -1e7);
  EXPECT_GT(logits.slice(2, 0, 4).min().item<double>(), -1e7);
}

TEST(AnymateConnectivity, PaddedJointsChangeNothing) {
  torch::manual_seed(11);
  const torch::NoGradGuard no_grad;
  const Tensor latents = torch::randn({1, 5, 24}), joints = torch::rand({1, 9, 3});
  Tensor mask = torch::ones({1, 9});
  mask.slice(1, 6).zero_();
  for (const char* decoder : {"attendjoints_con_token", "attendjoints_con_combine"}) {
    const auto module = head_for_test(decoder);
    auto& head = dynamic_cast<ConnectivityImpl&>(*module);
    const Tensor padded = head.forward(latents, joints, mask), alone = head.forward(latents, joints.narrow(1, 0, 6));
    EXPECT_LT(apart(padded.narrow(1, 0, 6).narrow(2, 0, 6), alone), 1e-4) << decoder;
    EXPECT_EQ(padded.size(2), 9);
    if (decoder == std::string("attendjoints_con_combine")) {
      EXPECT_LT(padded.slice(2, 6).max().item<double>(), kHidden);
    }
    EXPECT_THROW(head.forward(latents, joints, torch::ones({1, 10})), InputError);
    EXPECT_THROW(head.forward(latents.narrow(2, 0, 20), joints), InputError);
    EXPECT_THROW(head.forward(latents, joints.narrow(2, 0, 2)), InputError);
  }
}

SkinningInput input_for_test(std::int64_t items, std::int64_t points, std::int64_t bones) {
  return {torch::randn({items, 5, 24}), small_cloud(items, points), torch::rand({items, bones, 6}) * 2.0 - 1.0, {}};
}

TEST(AnymateSkinning, ChunksDoNotShow) {
  torch::manual_seed(12);
  const torch::NoGradGuard no_grad;
  SkinningInput input = input_for_test(2, 40, 7);
  input.mask = (torch::arange(7).unsqueeze(0) < torch::tensor({7, 4}).unsqueeze(1));
  for (const char* decoder : {"attendjoints_combine", "attendjoints_multi"}) {
    const auto module = head_for_test(decoder);
    auto& head = dynamic_cast<SkinningImpl&>(*module);
    const Tensor whole = head.forward(input, 40);
    EXPECT_LT(whole[1].slice(1, 4).max().item<double>(), kHidden);
    for (const std::int64_t chunk : {0, 8, 24})
      EXPECT_LT(apart(torch::softmax(whole, -1), torch::softmax(head.forward(input, chunk), -1)), 1e-5) << decoder;
  }
  // Points do not see each other: any chunk does for the one head, runs only for the other.
  EXPECT_NO_THROW(dynamic_cast<SkinningImpl&>(*head_for_test("attendjoints_combine")).forward(input, 7));
  EXPECT_THROW(dynamic_cast<SkinningImpl&>(*head_for_test("attendjoints_multi")).forward(input, 7), InputError);
  input.points = input.points.narrow(1, 0, 39);
  EXPECT_THROW(dynamic_cast<SkinningImpl&>(*head_for_test("attendjoints_multi")).forward(input), InputError);
}

TEST(AnymateSkinning, ItemsOfABatchDoNotSeeEachOther) {
  torch::manual_seed(13);
  const torch::NoGradGuard no_grad;
  SkinningInput input = input_for_test(2, 24, 6);
  input.mask = (torch::arange(6).unsqueeze(0) < torch::tensor({6, 3}).unsqueeze(1)).to(torch::kFloat32);
  for (const char* decoder : {"attendjoints_combine", "attendjoints_multi"}) {
    const auto module = head_for_test(decoder);
    auto& head = dynamic_cast<SkinningImpl&>(*module);
    const Tensor together = head.forward(input);
    for (std::int64_t b = 0; b < 2; ++b) {
      const std::int64_t bones = b == 0 ? 6 : 3;
      const SkinningInput one = {input.latents.narrow(0, b, 1),
                                 input.points.narrow(0, b, 1),
                                 input.bones.narrow(0, b, 1).narrow(1, 0, bones),
                                 {}};
      EXPECT_LT(apart(together.narrow(0, b, 1).narrow(2, 0, bones), head.forward(one)), 1e-4) << decoder;
    }
  }
}

TEST(AnymateSkinning, TiledMasksAreThoseOfOtherItems) {
  torch::manual_seed(14);
  const torch::NoGradGuard no_grad;
  const ModelOptions options = small_model("bert", "attendjoints_multi");
  ConcatSkinningOptions released = options.concat_skinning;
  released.tiled_masks = true;
  ConcatSkinning head(options.head, options.concat_skinning), tiled(options.head, released);
  for (std::size_t i = 0; i < head->parameters().size(); ++i) tiled->parameters()[i].copy_(head->parameters()[i]);
  SkinningInput input = input_for_test(2, 16, 6);
  input.mask = (torch::arange(6).unsqueeze(0) < torch::tensor({6, 3}).unsqueeze(1)).to(torch::kFloat32);
  // Sequences are (item, run) = 00, 01, 10, 11 and get the masks of items 0, 1, 0, 1.
  const Tensor own = head(input), other = tiled(input);
  EXPECT_TRUE(torch::equal(own[0].narrow(0, 0, 8), other[0].narrow(0, 0, 8)));
  EXPECT_TRUE(torch::equal(own[1].narrow(0, 8, 8), other[1].narrow(0, 8, 8)));
  EXPECT_GT(apart(own[0].narrow(0, 8, 8), other[0].narrow(0, 8, 8)), 0.0);
  EXPECT_GT(apart(own[1].narrow(0, 0, 8).slice(1, 0, 3), other[1].narrow(0, 0, 8).slice(1, 0, 3)), 0.0);
}

TEST(AnymateSkinning, BothEmbeddingsOfPoints) {
  torch::manual_seed(15);
  const torch::NoGradGuard no_grad;
  CrossSkinning head(small_model("bert", "attendjoints_combine").head, 2, /*separate=*/true);
  EXPECT_TRUE(head->named_parameters().contains("pc_proj.weight"));
  EXPECT_FALSE(head->named_parameters().contains("co_proj.weight"));
  EXPECT_EQ(head(input_for_test(1, 10, 4)).sizes(), (std::vector<std::int64_t>{1, 10, 4}));
}

TEST(AnymateSkinning, VerticesTakeTheLogitsOfTheNearestPoint) {
  const Tensor points = torch::tensor({{0.0F, 0.0F, 0.0F}, {1.0F, 0.0F, 0.0F}, {1.0F, 0.0F, 0.0F}});
  const Tensor logits = torch::tensor({{1.0F, 2.0F}, {3.0F, 4.0F}, {5.0F, 6.0F}});
  const Tensor vertices = torch::tensor({{0.9F, 0.0F, 0.0F}, {-1.0F, 0.0F, 0.0F}});
  const Tensor found = nearest_point_logits(vertices, points, logits);
  EXPECT_TRUE(torch::equal(found, torch::tensor({{3.0F, 4.0F}, {1.0F, 2.0F}})));
  EXPECT_THROW(nearest_point_logits(vertices, points, logits.narrow(0, 0, 2)), InputError);
}

TEST(AnymateSkinning, LossesByHand) {
  // Two bones, equal logits: weights (½, ½), clamped the same; truth (1, 0), and a row without weights.
  const Tensor logits = torch::zeros({1, 2, 2}, torch::kFloat64);
  const Tensor truth = torch::tensor({1.0, 0.0, 0.0, 0.0}, torch::kFloat64).view({1, 2, 2});
  const SkinningLosses losses = skinning_losses(logits, truth);
  EXPECT_NEAR(losses.cos.item<double>(), 1.0 - std::sqrt(0.5) / 2.0, 1e-9);
  EXPECT_NEAR(losses.cos_clamp.item<double>(), 1.0 - std::sqrt(0.5) / 2.0, 1e-9);
  EXPECT_NEAR(losses.ce.item<double>(), -std::log(0.5 + 1e-6) / 2.0, 1e-9);
  EXPECT_THROW(skinning_losses(logits, truth.narrow(1, 0, 1)), InputError);
  EXPECT_EQ(std::get<0>(at::_unique(training_points(100, 30))).size(0), 30);
  EXPECT_THROW(training_points(10, 11), InputError);
}

}  // namespace
}  // namespace anigen::anymate
