#include "anigen/train/precision.h"

#include <ATen/Context.h>
#include <gtest/gtest.h>

#include "anigen/core/error.h"
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
}

TEST(ChoosePrecision, ContradictionsAreNamed) {
  try {
    choose_precision(precision_options("fp16-published", "none"), torch::Device(torch::kCUDA, 0), "c.json");
    FAIL() << "expected an error";
  } catch (const InputError& error) {
    const std::string message = error.what();
    for (const char* part : {"c.json", "/trainer/args/precision", "fp16-published", "fp16_mode"}) {
      EXPECT_NE(message.find(part), std::string::npos) << message;
    }
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
}  // namespace anigen::train
