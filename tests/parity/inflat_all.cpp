// The published training step, mode inflat_all: fp16 and fp32 parameters, gradients scaled by 2^log_scale of which some
// overflow, a flat fp32 master, adaptive clipping, AdamW, a schedule, averages.
#include <cmath>
#include <limits>

#include "anigen/nn/init.h"
#include "anigen/train/optimizer.h"
#include "anigen/train/options.h"
#include "tests/parity/registry.h"

namespace anigen::test {
namespace {

using torch::Tensor;

/// The fixture's parameters in its order: those of `lin` in fp16, the others in fp32, `frozen` without gradient.
struct MixedPrecisionModel : torch::nn::Module {
  explicit MixedPrecisionModel(const io::NamedArrays& arrays) {
    const torch::NoGradGuard no_grad;
    for (const char* name : {"frozen", "lin.weight", "lin.bias", "norm.weight", "norm.bias"}) {
      const io::NdArray* array = io::find(arrays, name);
      if (array == nullptr) throw std::runtime_error(std::string("the fixture lacks param.") + name);
      Tensor value = nn::to_tensor(*array);
      if (std::string(name).rfind("lin", 0) == 0) value = value.to(torch::kHalf);
      std::string key = name;
      for (char& c : key) c = c == '.' ? '_' : c;  // a parameter of this module itself
      register_parameter(key, value, std::string(name) != "frozen");
    }
  }
  /// All trainable values, fp32 [P], and with `halves` 1 where a value is stored in fp16.
  Tensor flat(bool halves = false) {
    std::vector<Tensor> parts;
    for (const Tensor& parameter : parameters()) {
      if (!parameter.requires_grad()) continue;
      const Tensor values = parameter.to(torch::kFloat32).reshape({-1});
      const double half = parameter.scalar_type() == torch::kHalf ? 1.0 : 0.0;
      parts.push_back(halves ? torch::full_like(values, half) : values);
    }
    return torch::cat(parts);
  }
};

train::TrainerOptions options_of_fixture(const Json& config, Json& args) {
  args = config;
  for (const char* key : {"steps", "grad_scale"}) args.erase(key);
  args["max_steps"] = config.at("steps");
  args["batch_size"] = config.at("batch_split");
  ConfigReader reader(args, "fixture", "/config");
  train::TrainerOptions options = train::TrainerOptions::read(reader);
  reader.finish();
  options.update.loss_scaling = true;
  return options;
}

/// A master within the tolerance of the middle between two fp16 numbers may round to either.
Tensor with_forgiven_roundings(const Tensor& actual, const Tensor& wanted, const Tensor& master, const Tensor& halves,
                               double atol, double rtol) {
  const Tensor middle = (actual + wanted) / 2.0;
  const Tensor between = ((master - middle).abs() <= atol + rtol * master.abs()).logical_and(halves > 0.5);
  const Tensor neighbours = (actual - wanted).abs() <= 1.1e-3 * wanted.abs() + 6.1e-8;  // one unit in the last place
  return torch::where(between.logical_and(neighbours), wanted, actual);
}

void run_inflat_all(Fixture& fixture) {
  Json args;
  const train::TrainerOptions options = options_of_fixture(fixture.config(), args);
  const double atol = fixture.json().at("tolerance").at("atol"), rtol = fixture.json().at("tolerance").at("rtol");
  auto model = std::make_shared<MixedPrecisionModel>(fixture.parameters());
  train::ParameterBuffer buffer({{"m", model}});
  train::ParameterUpdate update(buffer, options.update);
  const Tensor targets = fixture.input("target_grad"), wanted = fixture.expected("model");
  const Tensor halves = model->flat(true).detach();

  std::vector<Tensor> masters, values, norms;
  std::vector<double> scales, rates, thresholds;
  std::vector<std::int64_t> skipped;
  std::vector<std::vector<Tensor>> averages(update.ema.rates().size());
  for (std::int64_t step = 0; step < targets.size(0); ++step) {
    buffer.zero_gradients();
    for (std::int64_t part = 0; part < targets.size(1); ++part) {
      const Tensor loss = (model->flat() * targets[step][part]).sum() / static_cast<double>(targets.size(1));
      (loss * update.loss_scale()).backward();
    }
    buffer.collect_gradients();
    const train::ParameterUpdate::Result result = update.apply(step);
    skipped.push_back(result.skipped ? 1 : 0);
    scales.push_back(update.log_scale);
    rates.push_back(result.lr);
    thresholds.push_back(update.clipper->threshold());
    const double norm = std::isfinite(result.grad_norm) ? result.grad_norm : std::numeric_limits<double>::quiet_NaN();
    norms.push_back(torch::full({}, norm, torch::kFloat64));
    masters.push_back(buffer.master().clone());
    values.push_back(with_forgiven_roundings(model->flat().detach(), wanted[step], masters.back(), halves, atol, rtol));
    for (std::size_t i = 0; i < averages.size(); ++i) averages[i].push_back(update.ema.averages()[i].clone());
  }
  std::vector<Tensor> per_rate;
  for (const std::vector<Tensor>& history : averages) per_rate.push_back(torch::stack(history));
  fixture.check("log_scale", torch::tensor(scales, torch::kFloat64));
  fixture.check("skipped", torch::tensor(skipped, torch::kInt64));
  fixture.check("master", torch::stack(masters));
  fixture.check("model", torch::stack(values));
  fixture.check("ema", torch::stack(per_rate));
  fixture.check("lr", torch::tensor(rates, torch::kFloat64));
  fixture.check("grad_norm", torch::stack(norms));
  fixture.check("max_norm", torch::tensor(thresholds, torch::kFloat64));
  fixture.check("exp_avg", update.optimizer.exp_avg);
  fixture.check("exp_avg_sq", update.optimizer.exp_avg_sq);
  fixture.check("adam_step", torch::tensor(update.optimizer.steps));
}

}  // namespace
}  // namespace anigen::test

ANIGEN_PARITY(ops_train_inflat_all_steps, anigen::test::run_inflat_all)
