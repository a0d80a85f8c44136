#include "anigen/models/anymate/collate.h"

#include <gtest/gtest.h>

#include "anigen/core/error.h"

namespace anigen::models::anymate {
namespace {

// A chain of joints with one bone between each pair, and as many points as bones, each held by one of them.
AnymateSample chain_sample(std::int64_t joints, std::int64_t points = 4) {
  AnymateSample sample;
  sample.name = "chain" + std::to_string(joints);
  sample.joints = torch::rand({joints, 3});
  sample.conns = torch::arange(-1, joints - 1).clamp_min(0).to(torch::kInt8);
  sample.bones = torch::cat({sample.joints.slice(0, 0, joints - 1), sample.joints.slice(0, 1)}, 1);
  sample.points_cloud = torch::rand({points, 6});
  sample.skins_index =
      torch::stack({torch::arange(points).remainder(joints - 1), torch::full({points}, -1)}, 1).to(torch::kInt8);
  sample.skins_weight = torch::tensor({0.75F, 0.0F}).expand({points, 2}).to(torch::kHalf);
  sample.vox = torch::randint(64, {joints, 3}, torch::kInt8);
  return sample;
}

TEST(AnymateCollate, PadsMasksAndMakesDense) {
  const std::vector<AnymateSample> samples = {chain_sample(3), chain_sample(5)};
  const AnymateBatch batch = collate(samples);
  EXPECT_EQ(batch.joints_num, (std::vector<std::int64_t>{3, 5}));
  EXPECT_EQ(batch.joints.sizes(), (std::vector<std::int64_t>{2, 96, 3}));
  EXPECT_TRUE(torch::equal(batch.joints[0].narrow(0, 0, 3), samples[0].joints));
  EXPECT_TRUE((batch.joints[0].slice(0, 3) == -3).all().item<bool>());
  EXPECT_TRUE((batch.bones[1].slice(0, 4) == -3).all().item<bool>());
  EXPECT_EQ(batch.joints_mask.sizes(), (std::vector<std::int64_t>{2, 5}));
  EXPECT_EQ(batch.joints_mask.sum(1).select(0, 0).item<std::int64_t>(), 3);
  EXPECT_EQ(batch.bones_mask.sum().item<std::int64_t>(), 2 + 4);
  // Rows are children: the root is its own parent, the others have the joint before.
  EXPECT_EQ(batch.conns.sizes(), (std::vector<std::int64_t>{2, 96, 5}));
  EXPECT_EQ(batch.conns.sum().item<double>(), 8.0);
  EXPECT_EQ(batch.conns[1][0][0].item<double>(), 1.0);
  EXPECT_EQ(batch.conns[1][4][3].item<double>(), 1.0);
  // Point 1 of the chain of three belongs to bone 1.
  EXPECT_EQ(batch.skins.sizes(), (std::vector<std::int64_t>{2, 4, 4}));
  EXPECT_EQ(batch.skins.scalar_type(), torch::kFloat64);
  EXPECT_EQ(batch.skins[0][1][1].item<double>(), 0.75);
  EXPECT_EQ(batch.skins.sum().item<double>(), 0.75 * 8);
  EXPECT_EQ(batch.vox.size(), 2U);
}

TEST(AnymateCollate, DiffusionRepeatsJointsInTurn) {
  const std::vector<AnymateSample> samples = {chain_sample(3), chain_sample(9)};
  const AnymateBatch batch = collate_diffusion(samples, 7);
  EXPECT_EQ(batch.joints_repeat.sizes(), (std::vector<std::int64_t>{2, 7, 3}));
  EXPECT_TRUE(torch::equal(batch.joints_repeat[0][6], samples[0].joints[0]));
  EXPECT_TRUE(torch::equal(batch.joints_repeat[1], samples[1].joints.narrow(0, 0, 7)));
  EXPECT_FALSE(batch.conns.defined());
  EXPECT_THROW(collate_diffusion(samples, 0), InputError);
}

TEST(AnymateCollate, LeavesOutWhatNoSampleHas) {
  AnymateSample sample = chain_sample(3);
  sample.skins_index = sample.conns = sample.vox = Tensor();
  const AnymateBatch batch = collate({sample});
  EXPECT_FALSE(batch.skins.defined() || batch.conns.defined());
  EXPECT_TRUE(batch.vox.empty());
  EXPECT_THROW(collate({sample, chain_sample(3)}), InputError);
}

TEST(AnymateCollate, NamesTheSampleThatIsWrong) {
  const auto with = [](auto change) {
    AnymateSample sample = chain_sample(4);
    change(sample);
    return std::vector<AnymateSample>{chain_sample(3), sample};
  };
  EXPECT_THROW(collate({}), InputError);
  EXPECT_THROW(collate(with([](AnymateSample& s) { s.conns[2] = 4; })), InputError);
  EXPECT_THROW(collate(with([](AnymateSample& s) { s.conns = s.conns.slice(0, 1); })), InputError);
  EXPECT_THROW(collate(with([](AnymateSample& s) { s.skins_index[0][1] = 3; })), InputError);
  EXPECT_THROW(collate(with([](AnymateSample& s) { s.skins_index[0][1] = -2; })), InputError);
  EXPECT_THROW(collate(with([](AnymateSample& s) { s.skins_weight = Tensor(); })), InputError);
  EXPECT_THROW(collate(with([](AnymateSample& s) { s.points_cloud = s.points_cloud.slice(0, 1); })), InputError);
  EXPECT_THROW(collate({chain_sample(97)}), InputError);
  try {
    collate(with([](AnymateSample& s) { s.bones = Tensor(); }));
    FAIL() << "no error";
  } catch (const InputError& error) {
    EXPECT_EQ(error.place(), "chain4/bones");
  }
}

}  // namespace
}  // namespace anigen::models::anymate
