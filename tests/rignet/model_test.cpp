#include <gtest/gtest.h>

#include <cmath>

#include "anigen/core/error.h"
#include "anigen/rignet/skeleton.h"
#include "tests/rignet/rignet_small.h"

namespace anigen::rignet {
namespace {

RignetModel small_of(Task task) {
  torch::manual_seed(7);
  RignetModel model(small_rignet(task));
  model->eval();
  return model;
}

BoneSlots random_slots(std::int64_t vertices, std::int64_t slots, std::int64_t bones) {
  return {torch::randint(0, bones, {vertices, slots}), torch::rand({vertices, slots * kBoneNumbers})};
}

TEST(RignetJoints, TheNetworkDoesNotCareHowVerticesAreNumbered) {
  RignetModel model = small_of(Task::kJoints);
  for (Tensor& parameter : model->parameters()) {
    if (parameter.dim() == 2) torch::nn::init::uniform_(parameter, -0.4, 0.4);  // the last map begins at zero
  }
  const MeshGraph graph = random_graph(20);
  const Tensor order = torch::randperm(20);
  auto& network = model->network<JointNetworkImpl>();
  const DisplacedVertices plain = network.forward(graph), other = network.forward(renumbered(graph, order));
  EXPECT_GT(difference(plain.points, graph.vertices), 1e-3);
  EXPECT_LT(difference(plain.points.index_select(0, order), other.points), 1e-5);
  EXPECT_LT(difference(plain.attention_logits.index_select(0, order), other.attention_logits), 1e-5);
}

TEST(RignetJoints, TrainingBeginsWithoutDisplacementsAndReachesEveryParameter) {
  RignetModel model = small_of(Task::kJoints);
  auto& network = model->network<JointNetworkImpl>();
  const MeshGraph graph = joined({random_graph(20), random_graph(11)});
  EXPECT_EQ(difference(network.forward(graph).points, graph.vertices), 0.0);
  EXPECT_NEAR(network.bandwidth().item<double>(), 0.04, 1e-7);
  for (Tensor& parameter : model->parameters()) {
    if (parameter.dim() == 2) torch::nn::init::uniform_(parameter, -0.4, 0.4);
  }
  model->train();
  const JointLosses losses = joint_losses(network.forward(graph), graph, {torch::rand({4, 3}), torch::rand({2, 3})},
                                          (torch::rand({31}) < 0.3).to(torch::kFloat32), network.bandwidth() * 10.0, 3);
  (losses.chamfer + losses.attention + losses.clusters).backward();
  for (const auto& parameter : model->named_parameters()) {
    EXPECT_TRUE(parameter.value().grad().defined() && parameter.value().grad().isfinite().all().item<bool>())
        << parameter.key();
  }
  EXPECT_NE(network.bandwidth().grad().item<double>(), 0.0);
}

TEST(RignetMeanShift, MovesPointsToThoseThatAttend) {
  const Tensor points = torch::tensor({{0.0F, 0.0F, 0.0F}, {0.1F, 0.0F, 0.0F}, {5.0F, 0.0F, 0.0F}});
  const Tensor h = torch::tensor(0.2F);
  // k_01 = 0.04 − 0.01; each point weighs itself by 0.04.
  const Tensor even = mean_shifted(points, torch::ones({3}), h, 1.0);
  EXPECT_NEAR(even[0][0].item<double>(), 0.03 * 0.1 / 0.07, 1e-6);
  EXPECT_NEAR(even[2][0].item<double>(), 5.0, 1e-6) << "nobody near";
  const Tensor only_second = mean_shifted(points, torch::tensor({0.0F, 1.0F, 0.0F}), h, 0.3);
  EXPECT_NEAR(only_second[0][0].item<double>(), 0.03, 1e-6) << "a third of the way to the one that counts";
  EXPECT_NEAR(only_second[2][0].item<double>(), 5.0, 1e-5) << "nothing attends here, not even itself";
}

// `count` points within `spread` of a place.
Tensor cloud_at(float x, float y, std::int64_t count, double spread = 0.01) {
  return torch::tensor({{x, y, 0.0F}}) + spread * (torch::rand({count, 3}) - 0.5);
}

TEST(RignetClusters, JointsAreWherePointsGather) {
  torch::manual_seed(8);
  const Tensor points = torch::cat({cloud_at(0.3F, 0.5F, 30), cloud_at(-0.2F, 0.1F, 20), cloud_at(0.0F, 0.9F, 10)});
  JointClusters options;
  options.mirrored = false;
  Tensor inside = torch::ones({60}, torch::kBool), attention = torch::ones({60});
  Tensor joints = clustered_joints(points, attention, inside, options);
  ASSERT_EQ(joints.size(0), 3);
  EXPECT_NEAR(joints[0][0].item<double>(), 0.3, 0.005) << "the densest first";
  inside.slice(0, 50).fill_(false);
  attention.slice(0, 30, 40).fill_(0.0);
  EXPECT_EQ(clustered_joints(points, attention, inside, options).size(0), 2) << "one place is outside";
  inside.fill_(false);
  EXPECT_EQ(clustered_joints(points, attention, inside, options).size(0), 3) << "all outside: all count";

  options.mirrored = true;
  joints = clustered_joints(points, torch::ones({60}), torch::ones({60}, torch::kBool), options);
  EXPECT_EQ(joints.size(0), 5) << "two twins and the one in the middle";
  EXPECT_LT(std::abs(joints.select(1, 0).sum().item<double>()), 1e-6);
  EXPECT_EQ((joints.select(1, 0) == 0.0).sum().item<std::int64_t>(), 1);
}

TEST(RignetClusters, OneClusterIsOneJointAndNoPointsAreRefused) {
  JointClusters options;
  options.mirrored = false;
  const Tensor points = torch::zeros({5, 3});
  EXPECT_EQ(clustered_joints(points, torch::ones({5}), torch::ones({5}, torch::kBool), options).size(0), 1);
  const Tensor none = torch::zeros({0, 3});
  EXPECT_THROW(clustered_joints(none, torch::ones({0}), torch::ones({0}, torch::kBool), options), InputError);
}

TEST(RignetConnectivity, AnswersDependOnNeitherOrderOfJointsNorOfMeshes) {
  RignetModel model = small_of(Task::kConnectivity);
  auto& network = model->network<ConnectivityNetworkImpl>();
  const MeshGraph graph = random_graph(15), other = random_graph(9);
  const Tensor joints = torch::rand({7, 3}), inside = torch::rand({7, 7}), even = inside + inside.t();
  const auto input = connectivity_input({graph}, {joints}, {even});
  const ConnectivityChances plain = connectivity_chances(network.forward(input), input);
  EXPECT_EQ(input.first.size(0), 21);
  EXPECT_EQ(difference(plain.bone, plain.bone.t()), 0.0);

  const Tensor order = torch::randperm(7);
  const auto moved = connectivity_input({graph}, {joints.index_select(0, order)},
                                        {even.index_select(0, order).index_select(1, order)});
  const ConnectivityChances again = connectivity_chances(network.forward(moved), moved);
  EXPECT_LT(difference(plain.bone.index_select(0, order).index_select(1, order), again.bone), 1e-5);
  EXPECT_LT(difference(plain.root.index_select(0, order), again.root), 1e-5);

  const auto both = connectivity_input({other, graph}, {torch::rand({3, 3}), joints}, {torch::ones({3, 3}), even});
  const ConnectivityLogits together = network.forward(both), alone = network.forward(input);
  EXPECT_LT(difference(together.bone.slice(0, 3), alone.bone), 1e-4);
  EXPECT_LT(difference(together.root.slice(0, 3), alone.root), 1e-4);
}

TEST(RignetConnectivity, GradientsReachEverythingAndTruthIsSymmetric) {
  RignetModel model = small_of(Task::kConnectivity);
  model->train();
  const ConnectivityInput input = small_input(15, 6);
  const ConnectivityLogits logits = model->network<ConnectivityNetworkImpl>().forward(input);
  const ConnectivityTruth truth = connectivity_truth({torch::tensor({0, 0, 1, 1, 0, 4}, torch::kInt64)});
  EXPECT_EQ(truth.bone.sum().item<double>(), 5.0);
  EXPECT_EQ(truth.root[0].item<double>(), 1.0);
  EXPECT_EQ(truth.root.sum().item<double>(), 1.0);
  (hard_binary_loss(logits.bone, truth.bone) + hard_binary_loss(logits.root, truth.root)).backward();
  for (const auto& parameter : model->named_parameters()) {
    EXPECT_TRUE(parameter.value().grad().defined() && parameter.value().grad().isfinite().all().item<bool>())
        << parameter.key();
  }
}

TEST(RignetConnectivity, TheLossAddsTheHardest) {
  const Tensor logits = torch::zeros({10}), truth = torch::ones({10});
  EXPECT_NEAR(hard_binary_loss(logits, truth).item<double>(), 2.0 * std::log(2.0), 1e-6);
  Tensor one_wrong = torch::full({10}, 20.0);
  one_wrong[3] = -6.0;
  // 6.0025 in the mean of ten and in that of the hardest three.
  EXPECT_NEAR(hard_binary_loss(one_wrong, truth).item<double>(), 6.0025 / 10.0 + 6.0025 / 3.0, 1e-3);
}

TEST(RignetTree, GrowsFromTheRootAlongTheLikeliestBones) {
  JointGraph graph;
  graph.joints = {{0.5, 0, 0}, {0.5, 1, 0}, {0.5, 2, 0}, {0.5, 3, 0}};
  graph.bone = Eigen::MatrixXd::Constant(4, 4, 0.01);
  const auto link = [&](int a, int b, double p) { graph.bone(a, b) = graph.bone(b, a) = p; };
  link(0, 1, 0.9);
  link(1, 2, 0.8);
  link(1, 3, 0.7);
  link(2, 3, 0.6);
  graph.root = Eigen::Vector4d(0.1, 0.2, 0.7, 0.3);
  graph.outside = Eigen::MatrixXd::Zero(4, 4);
  EXPECT_EQ(skeleton_tree(graph), (std::vector<int>{1, 2, -1, 1}));
  graph.outside(1, 3) = graph.outside(3, 1) = 1;
  EXPECT_EQ(skeleton_tree(graph), (std::vector<int>{1, 2, -1, 1})) << "one sample outside is forgiven";
  graph.outside(1, 3) = graph.outside(3, 1) = 2;
  EXPECT_EQ(skeleton_tree(graph), (std::vector<int>{1, 2, -1, 2}));
  graph.root[0] = std::nan("");
  EXPECT_THROW(skeleton_tree(graph), InputError);
}

// Hips in the middle, a spine, two legs of two joints each; the likeliest root is a knee.
TEST(RignetTree, MirroredJointsGrowInPairs) {
  JointGraph graph;
  graph.joints = {{0, 1, 0}, {0, 2, 0}, {0.2, 0.6, 0}, {-0.2, 0.6, 0}, {0.2, 0.1, 0}, {-0.2, 0.1, 0}};
  graph.bone = Eigen::MatrixXd::Constant(6, 6, 0.01);
  const auto link = [&](int a, int b, double p) { graph.bone(a, b) = graph.bone(b, a) = p; };
  link(0, 1, 0.9);
  link(0, 2, 0.8);
  link(2, 4, 0.8);
  link(3, 2, 0.95);  // alone, the other leg would hang on this one
  link(5, 4, 0.95);
  graph.root = Eigen::VectorXd::Zero(6);
  graph.root[2] = 1.0;
  graph.outside = Eigen::MatrixXd::Zero(6, 6);
  EXPECT_EQ(skeleton_tree(graph), (std::vector<int>{-1, 0, 0, 0, 2, 3}));
  graph.joints[5].z() = 0.01;  // no longer a mirror image: one at a time, from the likeliest root
  EXPECT_EQ(skeleton_tree(graph), (std::vector<int>{2, 0, -1, 2, 2, 4}));
}

TEST(RignetSkin, TheNetworkDoesNotCareHowVerticesAreNumbered) {
  RignetModel model = small_of(Task::kSkinning);
  const MeshGraph graph = random_graph(18);
  BoneSlots slots = random_slots(18, 5, 9);
  slots.bones[4][3] = slots.bones[4][4] = -1;
  const Tensor order = torch::randperm(18);
  const BoneSlots moved = {slots.bones.index_select(0, order), slots.features.index_select(0, order)};
  auto& network = model->network<SkinNetworkImpl>();
  const Tensor plain = torch::softmax(network.forward(graph, slots), 1);
  EXPECT_EQ(plain[4].slice(0, 3).sum().item<double>(), 0.0) << "slots without a bone";
  const Tensor other = torch::softmax(network.forward(renumbered(graph, order), moved), 1);
  EXPECT_LT(difference(plain.index_select(0, order), other), 1e-5);
  const Tensor weights = predicted_weights(*model, graph, slots, 9);
  EXPECT_LT(difference(weights.sum(1), torch::ones({18})), 1e-5);
  EXPECT_THROW(network.forward(graph, random_slots(18, 4, 9)), InputError);
  EXPECT_THROW(model->network<JointNetworkImpl>(), InputError);
}

TEST(RignetSkin, TheLossLooksAtVerticesWhoseSlotsHoldWeight) {
  const Tensor logits = torch::tensor({{0.0F, 0.0F}, {5.0F, 1.0F}});
  const Tensor weights = torch::tensor({{0.1F, 0.3F}, {0.0F, 0.0F}});
  EXPECT_NEAR(skin_slot_loss(logits, weights).item<double>(), std::log(2.0), 1e-6);
  EXPECT_EQ(skin_slot_loss(logits, torch::zeros({2, 2})).item<double>(), 0.0);
}

TEST(RignetSkin, CleaningAveragesNeighboursAndDropsTheSmall) {
  // A path 0 – 1 – 2 and a vertex by itself.
  const EdgeSet ring = {starts_of({2, 3, 2, 1}), torch::tensor({0, 1, 1, 0, 2, 2, 1, 3}, torch::kInt64)};
  const Tensor weights = torch::tensor({{1.0F, 0.0F}, {0.0F, 1.0F}, {0.4F, 0.6F}, {0.9F, 0.1F}});
  const Tensor cleaned = cleaned_weights(weights, ring, 0.5);
  const Tensor expected = torch::tensor({{0.0F, 1.0F}, {1.0F, 0.0F}, {0.0F, 1.0F}, {1.0F, 0.0F}});
  EXPECT_LT(difference(cleaned, expected), 1e-6);
  const Tensor all = cleaned_weights(weights, ring, 0.0);
  EXPECT_NEAR(all[1][1].item<double>(), 0.3, 1e-6);
}

TEST(RignetModels, OptionsAreReadAndPublishedSizesAreTheDefault) {
  const RignetOptions options = RignetOptions::from_json(parse_json(R"({"task": "skin", "width": 0.1})", "test"));
  EXPECT_EQ(options.task, Task::kSkinning);
  EXPECT_EQ(options.wide(512), 52);
  EXPECT_EQ(options.wide(8), 8);
  EXPECT_EQ(RignetOptions().wide(1024), 1024);
  EXPECT_THROW(RignetOptions::from_json(parse_json(R"({"task": "skim"})", "test")), InputError);
  EXPECT_THROW(RignetOptions::from_json(parse_json(R"({"bandwith": 0.1})", "test")), InputError);
  // JointNet of the description: messages, mixes, codes and heads with biases, two numbers per norm.
  RignetModel model(RignetOptions{}, nn::Init::kNone);
  std::int64_t parameters = 0;
  for (const auto& parameter : model->named_parameters()) {
    if (parameter.key().rfind("joints.displace.", 0) == 0) parameters += parameter.value().numel();
  }
  const auto layer = [](std::int64_t in, std::int64_t out) { return in * out + 3 * out; };
  const auto unit = [&](std::int64_t in, std::int64_t out) {
    return 2 * (layer(2 * in, out / 2) + layer(out / 2, out / 2)) + layer(out, out);
  };
  EXPECT_EQ(parameters, unit(3, 64) + unit(64, 256) + unit(256, 512) + layer(832, 1024) + layer(1859, 1024) +
                            layer(1024, 256) + 256 * 3 + 3);
}

}  // namespace
}  // namespace anigen::rignet
