#include <ATen/Context.h>
#include <gtest/gtest.h>

#include "anigen/core/config.h"
#include "anigen/core/error.h"
#include "anigen/train/options.h"
#include "anigen/train/train_command.h"

namespace anigen::train {

namespace {

TrainerOptions precision_options(const std::string& precision, const std::string& fp16_mode) {
  TrainerOptions options;
  options.precision = precision;
  options.fp16_mode = fp16_mode;
  return options;
}

TEST(ChoosePrecision, FollowsTheTable) {
  const torch::Device cpu(torch::kCPU), gpu(torch::kCUDA, 0);
  const Precision published = choose_precision(precision_options("fp16-published", "inflat_all"), gpu, "c.json");
  EXPECT_EQ(published.compute, torch::kHalf);
  EXPECT_TRUE(published.loss_scaling);
  const Precision bf16 = choose_precision(precision_options("bf16", "inflat_all"), gpu, "c.json");
  EXPECT_EQ(bf16.compute, torch::kBFloat16);
  EXPECT_FALSE(bf16.loss_scaling);
  EXPECT_EQ(choose_precision(precision_options("", "inflat_all"), cpu, "c.json").compute, torch::kFloat32);
  EXPECT_FALSE(choose_precision(precision_options("", "inflat_all"), cpu, "c.json").loss_scaling);
  EXPECT_TRUE(choose_precision(precision_options("", "inflat_all"), gpu, "c.json").loss_scaling);
  EXPECT_THROW(choose_precision(precision_options("fp16-published", "inflat_all"), cpu, "c.json"), NotSupportedError);
  const Precision emulated = choose_precision(precision_options("mixed-emulated", "none"), cpu, "c.json");
  EXPECT_EQ(emulated.mixed_products, nn::MixedForm::kEmulated);
  EXPECT_EQ(emulated.compute, torch::kFloat32);
  EXPECT_THROW(choose_precision(precision_options("mixed-emulated", "none"), gpu, "c.json"), NotSupportedError);
}

TEST(ChoosePrecision, ContradictionsAreNamed) {
  try {
    choose_precision(precision_options("fp16-published", "none"), torch::Device(torch::kCUDA, 0), "c.json");
    FAIL() << "expected an error";
  } catch (const InputError& error) {
    const std::string message = error.what();
    for (const char* part : {"c.json", "/trainer/args/precision", "fp16-published", "fp16_mode"})
      EXPECT_NE(message.find(part), std::string::npos) << message;
  }
}

// The settings exist without a GPU too.
TEST(MakeDeterministic, ChoosesDeterministicAlgorithmsOnAGpuOnly) {
  at::Context& context = at::globalContext();
  const bool deterministic = context.deterministicCuDNN(), benchmark = context.benchmarkCuDNN();
  context.setDeterministicCuDNN(false);
  context.setBenchmarkCuDNN(true);
  make_deterministic(torch::Device(torch::kCPU));
  EXPECT_FALSE(context.deterministicCuDNN());
  make_deterministic(torch::Device(torch::kCUDA, 0));
  EXPECT_TRUE(context.deterministicCuDNN());
  EXPECT_FALSE(context.benchmarkCuDNN());
  context.setDeterministicCuDNN(deterministic);
  context.setBenchmarkCuDNN(benchmark);
}

}  // namespace

namespace {

TrainerOptions options_with(const std::string& changes) {
  Json json = Json::parse(R"({"max_steps": 200, "batch_size": 4, "optimizer": {"name": "AdamW", "args": {"lr": 1}}})");
  json.update(Json::parse(changes));
  ConfigReader reader(json, "config.json");
  return TrainerOptions::read(reader);
}

TEST(TrainerOptions, AveragesWarmUpWhereTheyAreAskedTo) {
  EXPECT_FALSE(options_with("{}").update.ema_warm_up) << "published";
  EXPECT_TRUE(options_with(R"({"ema_warm_up": true})").update.ema_warm_up);
}

TEST(TrainerOptions, IntervalsMayBeSharesOfAllSteps) {
  const TrainerOptions options = options_with(R"({"i_eval": "25%", "i_save": "100%", "i_print": 7, "i_sample": -1})");
  EXPECT_EQ(options.i_eval, 50);
  EXPECT_EQ(options.i_save, 200);
  EXPECT_EQ(options.i_print, 7);
  EXPECT_EQ(options.i_sample, -1);
  EXPECT_EQ(options_with(R"({"i_eval": "0.1%"})").i_eval, 1) << "a share is never none";
  EXPECT_EQ(options_with(R"({"i_eval": 0})").i_eval, 0) << "never";
  EXPECT_THROW(options_with(R"({"i_eval": "often"})"), InputError);
  EXPECT_THROW(options_with(R"({"i_save": -1})"), InputError);
}

}  // namespace

}  // namespace anigen::train
