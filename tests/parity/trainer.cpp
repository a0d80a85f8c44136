// Pieces of the training loop: adaptive gradient clipping, learning-rate schedules, moving averages.
#include "anigen/train/optimizer.h"
#include "anigen/train/parameters.h"
#include "tests/parity/registry.h"

namespace anigen::test {
namespace {

using torch::Tensor;

void run_grad_clip(Fixture& fixture) {
  const Json& config = fixture.config();
  train::AdaptiveGradClipper::Options options;
  options.max_norm = config.at("max_norm").get<double>();
  options.clip_percentile = config.at("clip_percentile");
  options.buffer_size = config.at("buffer_size");
  train::AdaptiveGradClipper clipper(options);

  const Tensor a = fixture.input("grad_a"), b = fixture.input("grad_b");
  std::vector<Tensor> norms, clipped_a, clipped_b, thresholds;
  for (std::int64_t step = 0; step < a.size(0); ++step) {
    const Tensor norm = torch::cat({a[step].flatten(), b[step].flatten()}).norm();
    const double factor = clipper.update(norm.item<double>());
    norms.push_back(norm);
    clipped_a.push_back(a[step] * factor);
    clipped_b.push_back(b[step] * factor);
    thresholds.push_back(torch::full({}, clipper.threshold(), torch::kFloat64));
  }
  fixture.check("grad_norm", torch::stack(norms));
  fixture.check("clipped_a", torch::stack(clipped_a));
  fixture.check("clipped_b", torch::stack(clipped_b));
  fixture.check("max_norm", torch::stack(thresholds));
  fixture.check("buffer", torch::tensor(clipper.state().buffer));
  fixture.check("buffer_ptr", torch::tensor(static_cast<std::int64_t>(clipper.state().pointer)));
  fixture.check("buffer_length", torch::tensor(static_cast<std::int64_t>(clipper.state().length)));
}

train::LrSchedule schedule_of(const Json& json) {
  const Json& args = json.at("args");
  if (json.at("name") == "LinearLR")
    return train::linear_lr(args.at("start_factor"), args.at("end_factor"), args.at("total_iters"));
  if (json.at("name") == "CosineAnnealingLR") return train::cosine_annealing_lr(args.at("T_max"), args.at("eta_min"));
  throw std::runtime_error("unexpected schedule " + json.at("name").get<std::string>());
}

train::LrSchedule sequence_of(const Json& config) {
  std::vector<train::LrSchedule> schedules;
  for (const Json& part : config.at("schedulers")) schedules.push_back(schedule_of(part));
  return train::sequential_lr(schedules, config.at("args").at("milestones").get<std::vector<std::int64_t>>());
}

Tensor rates(const train::LrSchedule& schedule, double base, const Tensor& steps) {
  Tensor rates = torch::empty({steps.size(0)}, torch::kFloat64);
  for (std::int64_t i = 0; i < steps.size(0); ++i) rates[i] = schedule(base, steps[i].item<std::int64_t>());
  return rates;
}

void run_lr_schedule(Fixture& fixture) {
  const Json& config = fixture.config();
  const Tensor shipped = rates(sequence_of(config), config.at("lr"), fixture.input("steps"));
  fixture.check("lr", shipped);
  fixture.check("lr_closed_form", shipped);
  const Json& small = config.at("small");
  fixture.check("lr_small", rates(sequence_of(small), small.at("lr"), fixture.input("steps_small")));
  const Json& warm = config.at("warm");
  const train::LrSchedule warmup = train::linear_warmup_lr(warm.at("warmup_steps"));
  fixture.check("lr_warm", rates(warmup, warm.at("lr"), fixture.input("steps_warm")));
}

void run_ema(Fixture& fixture) {
  train::Ema ema(fixture.config().at("ema_rate").get<std::vector<double>>(), fixture.input("p0"));
  const Tensor parameters = fixture.input("p");
  std::vector<std::vector<Tensor>> history(ema.rates().size());
  for (std::int64_t step = 0; step < parameters.size(0); ++step) {
    ema.update(parameters[step]);
    for (std::size_t i = 0; i < history.size(); ++i) history[i].push_back(ema.averages()[i].clone());
  }
  std::vector<Tensor> per_rate;
  for (const auto& steps : history) per_rate.push_back(torch::stack(steps));
  fixture.check("ema", torch::stack(per_rate));
}

}  // namespace
}  // namespace anigen::test

ANIGEN_PARITY(ops_train_adaptive_grad_clip, anigen::test::run_grad_clip)
ANIGEN_PARITY(ops_train_lr_schedule, anigen::test::run_lr_schedule)
ANIGEN_PARITY(ops_train_ema, anigen::test::run_ema)
