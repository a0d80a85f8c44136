#include <gtest/gtest.h>

#include <cmath>

#include "anigen/core/json.h"
#include "anigen/io/safetensors.h"
#include "anigen/models/tensor_arrays.h"
#include "anigen/train/parameter_update.h"
#include "anigen/train/trainer_options.h"
#include "tests/support/paths.h"

namespace anigen::train {
namespace {

/// The published step, mode inflat_all: fp16 and fp32 parameters, overflows, infinities and NaNs among the gradients.
struct MixedModel : torch::nn::Module {
  explicit MixedModel(const io::NamedArrays& arrays) {
    torch::NoGradGuard no_grad;
    for (const char* name : {"frozen", "lin.weight", "lin.bias", "norm.weight", "norm.bias"}) {
      torch::Tensor value = models::to_tensor(*io::find(arrays, std::string("param.") + name));
      if (std::string(name).rfind("lin", 0) == 0) value = value.to(torch::kHalf);
      std::string key = name;
      for (char& c : key) c = c == '.' ? '_' : c;  // a parameter of this module itself
      register_parameter(key, value, std::string(name) != "frozen");
    }
  }
  torch::Tensor flat() {
    std::vector<torch::Tensor> parts;
    for (const torch::Tensor& parameter : parameters()) {
      if (parameter.requires_grad()) parts.push_back(parameter.to(torch::kFloat32).reshape({-1}));
    }
    return torch::cat(parts);
  }
};

TEST(InflatAll, FollowsThePublishedSteps) {
  const std::filesystem::path json_file = test::parity_dir() / "ops_train_inflat_all_steps.json";
  if (!std::filesystem::exists(json_file)) GTEST_SKIP() << json_file << " is missing";
  const Json fixture = read_json(json_file);
  const Json& config = fixture.at("config");
  const io::NamedArrays arrays =
      io::read_safetensors(test::parity_dir() / "ops_train_inflat_all_steps.safetensors").tensors;
  const auto expected = [&](const char* name) {
    return models::to_tensor(*io::find(arrays, std::string("out.") + name));
  };
  const double atol = fixture.at("tolerance").at("atol"), rtol = fixture.at("tolerance").at("rtol");
  const auto close = [&](const torch::Tensor& actual, const torch::Tensor& wanted) {
    return torch::allclose(actual.to(torch::kFloat64), wanted.to(torch::kFloat64), rtol, atol, true);
  };

  Json args = config;
  for (const char* key : {"steps", "grad_scale"}) args.erase(key);
  args["max_steps"] = config.at("steps");
  args["batch_size"] = config.at("batch_split");
  ConfigReader reader(args, json_file.string(), "/config");
  TrainerOptions options = TrainerOptions::read(reader);
  reader.finish();
  options.update.loss_scaling = true;
  auto model = std::make_shared<MixedModel>(arrays);
  ParameterBuffer buffer({{"m", model}});
  ParameterUpdate update(buffer, options.update);

  const torch::Tensor targets = models::to_tensor(*io::find(arrays, "in.target_grad"));
  const torch::Tensor norms = expected("grad_norm");
  int skipped = 0;
  for (std::int64_t step = 0; step < targets.size(0); ++step) {
    buffer.zero_gradients();
    for (std::int64_t part = 0; part < targets.size(1); ++part) {
      ((model->flat() * targets[step][part]).sum() / static_cast<double>(targets.size(1)) * update.loss_scale())
          .backward();
    }
    buffer.collect_gradients();
    const ParameterUpdate::Result result = update.apply(step);
    skipped += result.skipped;
    ASSERT_EQ(result.skipped, expected("skipped")[step].item<std::int64_t>() == 1) << step;
    ASSERT_NEAR(update.log_scale, expected("log_scale")[step].item<double>(), 1e-9) << step;
    ASSERT_NEAR(result.lr, expected("lr")[step].item<double>(), atol) << step;
    if (std::isfinite(norms[step].item<double>())) {
      ASSERT_NEAR(result.grad_norm, norms[step].item<double>(), 1e-4 * result.grad_norm) << step;
    }
    ASSERT_NEAR(update.clipper->threshold(), expected("max_norm")[step].item<double>(), 1e-5) << step;
    ASSERT_TRUE(close(buffer.master(), expected("master")[step])) << step;
    for (std::size_t i = 0; i < update.ema.rates().size(); ++i) {
      ASSERT_TRUE(close(update.ema.averages()[i], expected("ema")[static_cast<std::int64_t>(i)][step])) << step;
    }
    // One unit in the last place of fp16, where a master lies on a rounding boundary.
    const torch::Tensor difference = (model->flat() - expected("model")[step]).abs();
    ASSERT_TRUE((difference <= 1e-3 * expected("model")[step].abs() + 1e-7).all().item<bool>()) << step;
  }
  EXPECT_GT(skipped, 0) << "the fixture must exercise the skip";
  EXPECT_TRUE(close(update.optimizer.exp_avg, expected("exp_avg")));
  EXPECT_TRUE(close(update.optimizer.exp_avg_sq, expected("exp_avg_sq")));
  EXPECT_EQ(update.optimizer.steps, expected("adam_step").item<std::int64_t>());
}

}  // namespace
}  // namespace anigen::train
