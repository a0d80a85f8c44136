// Training steps and samples on a device, counted: none may make a GPU wait for its host.
#include <gtest/gtest.h>

#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "anigen/core/config.h"
#include "anigen/data/datasets.h"
#include "anigen/flow/sampler.h"
#include "anigen/structured_latent/sampling.h"
#include "anigen/train/trainer.h"
#include "tests/data/synthetic_dataset.h"
#include "tests/device/counting_device.h"
#include "tests/train/distributed/skin_stage_config.h"
#include "tests/train/stages/flow_configs.h"
#include "tests/train/stages/published_sample.h"
#include "tests/train/stages/sparse_structure_dataset.h"
#include "tests/train/stages/stage_of_config.h"

namespace anigen::test {
namespace {

using torch::Tensor;

// A stage's config, its dataset and its twins on the CPU and on the device, with equal weights.
class OnDevice : public ::testing::Test {
 protected:
  std::unique_ptr<train::Stage> stage_on(const std::string& config, torch::Device device,
                                         const std::vector<std::string>& overrides = {}) const {
    auto made = stage_of_config(config, folder_ / "data", overrides, device);
    draw_weights(*made);
    return made;
  }

  // Loss and gradients of a step are those of the CPU; a step that is asked for a second time is never waited for.
  void expect_no_wait(const std::string& config, const std::vector<std::string>& overrides = {}) const {
    const auto here = stage_on(config, torch::kCPU, overrides), there = stage_on(config, device_, overrides);
    const auto batch = here->data().load({data::Draw{0, 0}, data::Draw{1, 1}});
    const double expected = loss_and_backward(*here, *batch).item<double>();
    forget_requests();
    const Tensor found = loss_and_backward(*there, *batch);
    const DeviceRequests requests = device_requests();
    EXPECT_EQ(requests.all_waits(), 0) << waits_text(requests);
    EXPECT_GT(requests.operators, 100);
    EXPECT_NEAR(found.item<double>(), expected, 1e-5 * expected);
    const auto models = here->models(), far = there->models();
    for (std::size_t m = 0; m < models.size(); ++m) {
      for (const auto& parameter : models[m].module->named_parameters()) {
        const Tensor wanted = parameter.value().grad();
        const Tensor given = far[m].module->named_parameters()[parameter.key()].grad();
        ASSERT_EQ(wanted.defined(), given.defined()) << parameter.key();
        if (!wanted.defined()) continue;
        const double off = (given.to(torch::kCPU) - wanted).norm().item<double>();
        EXPECT_LE(off, 1e-3 * wanted.norm().item<double>() + 1e-6) << models[m].name << "." << parameter.key();
      }
    }
  }

  // Waits of a run of so many steps, with a checkpoint at its end.
  std::int64_t waits_of_run(const std::string& config, std::int64_t steps) const {
    const std::vector<std::string> overrides = {"trainer.args.max_steps=" + std::to_string(steps),
                                                "trainer.args.i_save=1000", "trainer.args.i_eval=0"};
    const auto stage = stage_on(config, device_, overrides);
    Json all = parse_json(config, "test");
    apply_overrides(all, overrides);
    ConfigReader args(all.at("trainer").at("args"), "test", "/trainer/args");
    const train::TrainerOptions options = train::TrainerOptions::read(args);
    train::RunOptions run;
    run.output = folder_ / ("run" + std::to_string(steps));
    forget_requests();
    train::Trainer(*stage, options, run).run();
    return device_requests().all_waits();
  }

  // The host reads the losses, the norm of the gradient and whether all weights are finite, once a step each.
  void expect_three_reads_a_step(const std::string& config) const {
    const std::int64_t few = waits_of_run(config, 4), more = waits_of_run(config, 9);
    EXPECT_EQ((more - few) / 5.0, 3.0);
  }

  TemporaryFolder folder_;
  const torch::Device device_ = counting_device();

 private:
  static Tensor loss_and_backward(train::Stage& stage, const data::Batch& batch) {
    const train::Losses losses = stage.losses(batch, {5, 7, 1});
    losses.total.backward();
    return losses.total.detach();
  }
};

TEST_F(OnDevice, TheSkinAutoEncoderIsNotWaitedFor) {
  write_synthetic_dataset(folder_ / "data", 4);
  expect_no_wait(kSkinStageConfig);
}

TEST_F(OnDevice, TheStructureAutoEncoderIsNotWaitedFor) {
  write_ball_dataset(folder_ / "data", 4);
  expect_no_wait(kBallConfig);
  expect_three_reads_a_step(kBallConfig);
}

TEST_F(OnDevice, TheStructureFlowIsNotWaitedFor) {
  const PublishedSample sample(folder_ / "data");
  expect_no_wait(kStructureFlowConfig, {"dataset.args.eval_split="});
}

class LatentFlowOnDevice : public OnDevice {
 protected:
  LatentFlowOnDevice() : sample_(folder_ / "data") {
    for (int i = 0; i < PublishedSample::kAssets; ++i) io::write_npz(sample_.latent(i), box_latents(i));
  }
  PublishedSample sample_;
};

TEST_F(LatentFlowOnDevice, AStepIsNotWaitedFor) { expect_no_wait(kLatentFlowConfig, {"dataset.args.eval_split="}); }

TEST_F(LatentFlowOnDevice, ATrainingReadsThreeTimesAStep) {
  Json config = Json::parse(kLatentFlowConfig);
  config["dataset"]["args"].erase("eval_split");
  expect_three_reads_a_step(config.dump());
}

// Lists of rows, windows and neighbours go to the device once, whatever the number of calls and steps.
TEST_F(LatentFlowOnDevice, WindowsOfAGridSendTheirListsOnce) {
  nn::AttentionOptions options;
  options.channels = 8;
  options.num_heads = 2;
  nn::DenseAttention attention(options);
  const torch::NoGradGuard no_grad;
  for (const Tensor& parameter : attention->parameters()) parameter.copy_(0.1 * torch::randn(parameter.sizes()));
  const Tensor x = torch::randn({1, 64, 8}), wanted = attention->forward_in_windows(x, {4, 2, 1});
  attention->to(device_);
  const Tensor there = nn::to_device(x, device_);
  Tensor found;
  for (int call = 0; call < 2; ++call) {
    forget_requests();
    found = attention->forward_in_windows(there, {4, 2, 1});
    const DeviceRequests requests = device_requests();
    EXPECT_EQ(requests.all_waits(), 0) << waits_text(requests);
    if (call > 0) {
      EXPECT_EQ(requests.uploads, 0);
    }
  }
  EXPECT_TRUE(torch::allclose(found.to(torch::kCPU), wanted, 1e-4, 1e-5));
}

TEST_F(LatentFlowOnDevice, ASampleIsNotWaitedForAndKeepsItsLists) {
  const Json args = Json::parse(kLatentFlowConfig)["models"]["denoiser"]["args"];
  const auto options = structured_latent::StructuredLatentFlowOptions::from_json(args);
  const auto batch = stage_on(kLatentFlowConfig, torch::kCPU, {"dataset.args.eval_split="})->data().load({{0, 0}});
  const auto& latents = dynamic_cast<const data::StructuredLatentBatch&>(*batch);
  const auto support = sparse::Support::create(latents.x_0.coords),
             bones = sparse::Support::create(latents.x_0_skl.coords);
  flow::SamplerOptions sampler;
  sampler.windowed_steps = 1;
  sampler.window = 2;
  std::vector<Tensor> samples;
  for (const torch::Device device : {torch::Device(torch::kCPU), device_}) {
    torch::manual_seed(5);
    structured_latent::StructuredLatentFlow model(options);
    const torch::NoGradGuard no_grad;
    for (const Tensor& parameter : model->parameters()) parameter.copy_(0.1 * torch::randn(parameter.sizes()));
    model->to(device);
    const structured_latent::StructuredLatentTarget target{support, bones,
                                                           nn::to_device(torch::randn({1, 4, 12}), device), Tensor()};
    flow::Streams noise = {torch::randn(latents.x_0.feats.sizes()), torch::randn(latents.x_0_skl.feats.sizes())};
    for (Tensor& stream : noise) stream = nn::to_device(stream, device);
    flow::Streams drawn;
    for (const std::int64_t steps : {2, 3}) {
      sampler.steps = steps;
      forget_requests();
      drawn = flow::sample_flow(noise, structured_latent::structured_latent_velocities(model, target, true), sampler)
                  .samples;
      const DeviceRequests requests = device_requests();
      EXPECT_EQ(requests.all_waits(), 0) << waits_text(requests);
      if (steps > 2) {
        EXPECT_EQ(requests.uploads, 0);
      }
    }
    samples.push_back(drawn[0].to(torch::kCPU));
  }
  EXPECT_TRUE(torch::allclose(samples[0], samples[1], 1e-4, 1e-5));
}

}  // namespace
}  // namespace anigen::test
