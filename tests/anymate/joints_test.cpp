#include <gtest/gtest.h>

#include "anigen/anymate/denoisers.h"
#include "anigen/anymate/joints.h"
#include "anigen/anymate/volumes.h"
#include "anigen/core/error.h"
#include "tests/anymate/anymate_small.h"

namespace anigen::anymate {
namespace {

using Labels = std::vector<std::int64_t>;

Tensor points_on_x(const std::vector<double>& x) {
  Tensor points = torch::zeros({static_cast<std::int64_t>(x.size()), 3}, torch::kFloat64);
  points.select(1, 0).copy_(torch::tensor(x, torch::kFloat64));
  return points;
}

TEST(AnymateDbscan, WithOneSampleClustersAreConnectedComponents) {
  // The reach is inclusive, and labels follow the first member.
  const Tensor points = points_on_x({5.0, 0.0, 0.5, 1.0, 5.5, 9.0});
  EXPECT_EQ(dbscan_labels(points, {0.5, 1}), (Labels{0, 1, 1, 1, 0, 2}));
  EXPECT_EQ(dbscan_labels(points, {0.499, 1}), (Labels{0, 1, 2, 3, 4, 5}));
  EXPECT_EQ(dbscan_labels(torch::empty({0, 3}), {0.5, 1}), Labels{});
}

TEST(AnymateDbscan, BorderPointsAndNoise) {
  // Cores at 1, 2 and 6, 7; 4 reaches neither of them but 3 and 5, which are border points.
  const Tensor points = points_on_x({0.0, 1.0, 2.0, 3.0, 10.0, 5.0, 6.0, 7.0, 8.0});
  EXPECT_EQ(dbscan_labels(points, {1.0, 3}), (Labels{0, 0, 0, 0, -1, 1, 1, 1, 1}));
}

TEST(AnymateDbscan, MeansAreInLabelOrderWithoutNoise) {
  const Tensor points = points_on_x({4.0, 0.0, 1.0, 6.0, 20.0});
  const Tensor means = cluster_means(points, {1, 0, 0, 1, -1});
  EXPECT_LT(apart(means, points_on_x({0.5, 5.0})), 1e-12);
  EXPECT_EQ(merged_joints(points.to(torch::kFloat32), {1.5, 1}).size(0), 4);
  EXPECT_THROW(cluster_means(points, {0, 1}), InputError);
}

TEST(AnymateDbscan, RefusesWhatHasNoClusters) {
  const Tensor points = points_on_x({0.0, 1.0});
  EXPECT_THROW(dbscan_labels(points, {0.0, 1}), InputError);
  EXPECT_THROW(dbscan_labels(points, {0.1, 0}), InputError);
  EXPECT_THROW(dbscan_labels(points / 0.0, {0.1, 1}), InputError);
  EXPECT_THROW(dbscan_labels(points.narrow(1, 0, 2), {0.1, 1}), InputError);
}

TEST(AnymateRegression, LossIsTheChamferDistanceToRealJoints) {
  const Tensor predicted = points_on_x({0.0, 1.0}).unsqueeze(0);
  const Tensor joints = points_on_x({0.5, 3.0, -3.0}).unsqueeze(0);  // the last is padding
  // 0.5 and 0.5 from predictions, 0.5 and 2 from joints.
  EXPECT_NEAR(joint_chamfer_loss(predicted, joints, {2}).item<double>(), 0.5 * (0.5 + 1.25), 1e-12);
  EXPECT_THROW(joint_chamfer_loss(predicted, joints, {4}), InputError);
  EXPECT_THROW(joint_chamfer_loss(predicted, joints, {0}), InputError);
  EXPECT_THROW(joint_chamfer_loss(predicted, joints, {2, 2}), InputError);
}

// docs/reference/anymate.md, 3.2.
TEST(AnymateDdim, NoiseLevelsAreTheReleasedOnes) {
  const DdimSchedule schedule;
  const auto alpha = [&](std::int64_t t) { return schedule.alphas_cumprod()[t].item<double>(); };
  EXPECT_NEAR(alpha(0), 0.9999, 1e-6);
  EXPECT_NEAR(alpha(49), 0.77718, 1e-5);
  EXPECT_NEAR(alpha(99), 0.363563, 1e-6);
  EXPECT_EQ(schedule.timesteps(4), (Labels{75, 50, 25, 0}));
  EXPECT_THROW(schedule.timesteps(101), InputError);
  EXPECT_THROW(DdimSchedule(0), InputError);
  const Tensor x = torch::zeros({2, 3});
  EXPECT_THROW(schedule.noisy(x, x, torch::tensor({1, 100}, torch::kInt64)), InputError);
  EXPECT_THROW(schedule.noisy(x, x.narrow(0, 0, 1), torch::tensor({1, 2}, torch::kInt64)), InputError);
}

// Knows the data, and says what noise would lead to where it is.
class AllKnowing : public JointDenoiserImpl {
 public:
  AllKnowing(Tensor joints, DdimSchedule schedule) : joints_(std::move(joints)), schedule_(std::move(schedule)) {}
  Tensor forward(const Tensor& x, const Tensor& t, const Tensor&) override {
    const Tensor alpha = schedule_.alphas_cumprod()[t.item<std::int64_t>()];
    ++calls;
    return (x - alpha.sqrt() * joints_.transpose(1, 2)) / (1.0 - alpha).sqrt();
  }
  int calls = 0;

 private:
  Tensor joints_;
  DdimSchedule schedule_;
};

TEST(AnymateDdim, AKnownAnswerIsReachedInAnyNumberOfSteps) {
  torch::manual_seed(7);
  const Tensor joints = torch::rand({2, 9, 3}) * 2.0 - 1.0;
  AllKnowing model(joints, DdimSchedule());
  for (const std::int64_t steps : {0, 25, 1}) {
    DdimSampling sampling;
    sampling.steps = steps;
    std::int64_t last = 0;
    sampling.progress = [&](std::int64_t step, std::int64_t) { last = step; };
    model.calls = 0;
    const Tensor found =
        sample_joints(model, DdimSchedule(), torch::zeros({2, 1, 1}), torch::randn({2, 9, 3}), sampling);
    EXPECT_LT(apart(found, joints), 1e-4) << steps;
    EXPECT_EQ(model.calls, steps == 0 ? 100 : steps);
    EXPECT_EQ(last, model.calls);
  }
}

TEST(AnymateDiffusion, AnyNumberOfJointsInAnyOrder) {
  torch::manual_seed(8);
  const torch::NoGradGuard no_grad;
  for (const char* decoder : {"Pointe_Diffusion", "Cross_Attention_Diffusion"}) {
    const std::shared_ptr<torch::nn::Module> module = make_decoder(small_model("bert", decoder));
    for (Tensor parameter : module->parameters()) parameter.normal_(0.0, 0.2);
    module->eval();
    auto& model = dynamic_cast<JointDenoiserImpl&>(*module);
    const Tensor latents = torch::randn({2, 6, 24}), noise = torch::randn({2, 17, 3});
    DdimSampling sampling;
    sampling.steps = 5;
    const Tensor joints = sample_joints(model, DdimSchedule(), latents, noise, sampling);
    EXPECT_EQ(joints.sizes(), noise.sizes());
    EXPECT_LE(joints.abs().max().item<double>(), 1.0);  // the last step is the clamped data
    const Tensor order = torch::randperm(17, torch::kInt64);
    const Tensor shuffled = sample_joints(model, DdimSchedule(), latents, noise.index_select(1, order), sampling);
    EXPECT_LT(apart(joints.index_select(1, order), shuffled), 1e-4) << decoder;
    EXPECT_EQ(sample_joints(model, DdimSchedule(), latents, torch::randn({2, 1, 3}), sampling).size(1), 1);
    // Another condition gives other joints: what is kept of the latents is kept for one call.
    EXPECT_GT(apart(joints, sample_joints(model, DdimSchedule(), torch::randn({2, 6, 24}), noise, sampling)), 1e-4)
        << decoder;
    EXPECT_THROW(model.forward(noise.transpose(1, 2), torch::zeros({3}, torch::kInt64), latents), InputError);
    EXPECT_THROW(model.forward(noise, torch::zeros({2}, torch::kInt64), latents), InputError);
  }
}

TEST(AnymateDiffusion, ConditionsAreDroppedWhileTraining) {
  torch::manual_seed(9);
  const torch::NoGradGuard no_grad;
  ModelOptions options = small_model("bert", "Pointe_Diffusion");
  options.concat_denoiser.cond_drop_prob = 1.0;
  ConcatDenoiser model(options.concat_denoiser);
  for (Tensor parameter : model->parameters()) parameter.normal_(0.0, 0.2);
  const Tensor latents = torch::randn({1, 6, 24}), x = torch::randn({1, 3, 4}), t = torch::tensor({50}, torch::kInt64);
  const Tensor dropped = model(x, t, latents);
  model->eval();
  EXPECT_TRUE(torch::equal(dropped, model(x, t, torch::zeros_like(latents))));
  EXPECT_GT(apart(dropped, model(x, t, latents)), 1e-4);
}

// All cells of a cube of the grid, [side³, 3].
Tensor cube_of_cells(std::int64_t first, std::int64_t side) {
  const Tensor axis = torch::arange(first, first + side);
  return torch::stack(torch::meshgrid({axis, axis, axis}, "ij"), -1).view({-1, 3});
}

TEST(AnymateVolume, HeatIsOneAtAJointAndFallsWithin) {
  const Tensor corners = voxel_corners(torch::tensor({{32, 32, 32}, {33, 32, 32}, {0, 0, 0}}, torch::kInt64));
  EXPECT_LT(apart(corners[2], torch::full({3}, -1.0)), 1e-7);
  const Tensor heat = joint_heat(corners, torch::zeros({1, 3}));
  EXPECT_NEAR(heat[0].item<double>(), 1.0, 1e-6);
  EXPECT_NEAR(heat[1].item<double>(), std::exp(-0.5), 1e-6);  // one cell is one standard deviation
  EXPECT_THROW(joint_heat(corners, torch::zeros({0, 3})), InputError);
  EXPECT_THROW(voxel_corners(torch::full({1, 3}, 64, torch::kInt64)), InputError);
  EXPECT_THROW(voxel_corners(torch::zeros({1, 3})), InputError);
  EXPECT_EQ(training_voxels(cube_of_cells(0, 4), 10).size(0), 10);
  EXPECT_TRUE(torch::equal(training_voxels(cube_of_cells(0, 4), 64), cube_of_cells(0, 4)));
}

TEST(AnymateVolume, KeyPointsAreWhereTheFieldIsHigh) {
  const Tensor cells = cube_of_cells(20, 20);
  const Tensor joints =
      torch::tensor({{24.0F, 25.0F, 26.0F}, {35.0F, 34.0F, 33.0F}, {35.0F, 24.0F, 30.0F}}) / 32.0 - 1.0;
  const Tensor logits = 12.0 * joint_heat(voxel_corners(cells), joints) - 6.0;
  const Tensor found = joint_key_points(logits, cells);
  ASSERT_EQ(found.size(0), 3);
  const Tensor distance = (found.to(torch::kFloat32).unsqueeze(1) - joints.unsqueeze(0)).norm(2, -1);
  EXPECT_LT(std::get<0>(distance.min(0)).max().item<double>(), 1e-5);
  // In any order of the voxels.
  const Tensor order = torch::randperm(cells.size(0), torch::kInt64);
  EXPECT_LT(apart(found, joint_key_points(logits.index_select(0, order), cells.index_select(0, order))), 1e-12);
}

TEST(AnymateVolume, AFlatFieldEnds) {
  const Tensor cells = cube_of_cells(10, 4);
  const Tensor found = joint_key_points(torch::full({64}, 2.0), cells);
  ASSERT_EQ(found.size(0), 1);
  EXPECT_LT(apart(found[0], torch::full({3}, 11.5 / 32.0 - 1.0, torch::kFloat64)), 1e-12);
  EXPECT_EQ(joint_key_points(torch::empty({0}), torch::empty({0, 3}, torch::kInt64)).size(0), 0);
  EXPECT_THROW(joint_key_points(torch::zeros({3}), cells), InputError);
  EXPECT_THROW(joint_key_points(torch::zeros({64}) / 0.0, cells), InputError);
}

TEST(AnymateVolume, ChunksDoNotShow) {
  torch::manual_seed(10);
  const Tensor cells = torch::randint(64, {500, 3}, torch::kInt64);
  for (const char* decoder : {"implicit_transformer", "triplane"}) {
    const std::shared_ptr<torch::nn::Module> module = make_decoder(small_model("bert", decoder));
    module->eval();
    auto& model = dynamic_cast<JointVolumeImpl&>(*module);
    const Tensor latents = decoder == std::string("triplane") ? torch::randn({1, 24}) : torch::randn({1, 6, 24});
    const Tensor whole = joint_volume(model, latents, cells, 500);
    EXPECT_LT(apart(whole, joint_volume(model, latents, cells, 37)), 1e-5) << decoder;
    EXPECT_THROW(joint_volume(model, latents, cells, 0), InputError);
  }
}

}  // namespace
}  // namespace anigen::anymate
