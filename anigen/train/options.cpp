#include "anigen/train/options.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <utility>

#include "anigen/core/config_fields.h"
#include "anigen/core/error.h"
#include "anigen/nn/kernels/tiles.h"

namespace anigen::train {

namespace {

constexpr std::int64_t kManySteps = std::int64_t{1} << 40;

// A number of steps, or a share of all steps written as "5%".
std::int64_t steps_of(const Json& value, std::int64_t max_steps, const ConfigReader& reader, const std::string& key) {
  if (value.is_number_integer() && value.get<std::int64_t>() >= 0 && value.get<std::int64_t>() <= kManySteps)
    return value.get<std::int64_t>();
  if (value.is_string()) {
    const std::string text = value.get<std::string>();
    char* end = nullptr;
    const double share = std::strtod(text.c_str(), &end);
    if (end != text.c_str() && std::string(end) == "%" && share >= 0.0 && share <= 1000.0)
      return std::llround(share / 100.0 * static_cast<double>(max_steps));
  }
  throw reader.error(key, "expected a number of steps, or a share of max_steps such as \"5%\"");
}

std::int64_t steps(ConfigReader& reader, const std::string& key, std::int64_t fallback, std::int64_t max_steps) {
  const Json* value = reader.raw(key);
  return value == nullptr ? fallback : std::max<std::int64_t>(1, steps_of(*value, max_steps, reader, key));
}

// Steps between two of a kind: a number, 0 for never, or a share of all steps, which is never none.
std::int64_t interval(ConfigReader& reader, const std::string& key, std::int64_t fallback, std::int64_t max_steps,
                      std::int64_t lowest = 0) {
  const Json* value = reader.raw(key);
  return value != nullptr && value->is_string() ? steps(reader, key, fallback, max_steps)
                                                : reader.integer(key, fallback, lowest);
}

LrSchedule simple_schedule(const std::string& name, ConfigReader& args, std::int64_t max_steps) {
  if (name == "LinearLR") {
    const double start = args.number("start_factor", 1.0 / 3.0, 0.0), end = args.number("end_factor", 1.0, 0.0);
    return linear_lr(start, end, steps(args, "total_iters", 5, max_steps));
  }
  if (name == "CosineAnnealingLR") {
    args.require("T_max");
    const std::int64_t t_max = steps(args, "T_max", 1, max_steps);
    return cosine_annealing_lr(t_max, args.number("eta_min", 0.0, 0.0));
  }
  if (name == "ConstantLR") {
    const double factor = args.number("factor", 1.0 / 3.0, 0.0);
    return constant_lr(factor, steps(args, "total_iters", 5, max_steps));
  }
  if (name == "MultiStepLR") {
    args.require("milestones");
    const Json& listed = *args.raw("milestones");
    if (!listed.is_array() || listed.size() > 64) throw args.error("milestones", "must be a list");
    std::vector<std::int64_t> milestones;
    for (const Json& milestone : listed) milestones.push_back(steps_of(milestone, max_steps, args, "milestones"));
    return multi_step_lr(std::move(milestones), args.number("gamma", 0.1, 0.0, 1e3));
  }
  args.require("warmup_steps");
  return linear_warmup_lr(steps(args, "warmup_steps", 1, max_steps));
}

LrSchedule sequence(ConfigReader& reader, ConfigReader& args, std::int64_t max_steps) {
  reader.require("schedulers");
  args.require("milestones");
  const Json& schedulers = *reader.raw("schedulers");
  const Json& milestones = *args.raw("milestones");
  if (!schedulers.is_array() || schedulers.size() > 64) throw reader.error("schedulers", "must be a list");
  if (!milestones.is_array() || milestones.size() > 64) throw args.error("milestones", "must be a list");
  std::vector<LrSchedule> parts;
  for (std::size_t i = 0; i < schedulers.size(); ++i) {
    parts.push_back(read_schedule(schedulers[i], max_steps, reader.file(),
                                  reader.pointer_to("schedulers") + "/" + std::to_string(i)));
  }
  std::vector<std::int64_t> begins;
  for (const Json& milestone : milestones) begins.push_back(steps_of(milestone, max_steps, args, "milestones"));
  try {
    return sequential_lr(std::move(parts), std::move(begins));
  } catch (const InputError& error) {
    throw args.error("milestones", error.problem());
  }
}

void read_optimizer(ConfigFields& f, UpdateOptions& update) {
  std::string name;
  f("name", name, {"AdamW", "Adam", "Muon"}, kRequired);
  AdamW::Options& options = update.optimizer;
  options.decoupled = name != "Adam";
  if (name == "Adam") options.weight_decay = 0.0;
  f.object("args", [&](ConfigFields& args) {
    if (name == "Muon") {
      Muon::Options& muon = update.muon.emplace();
      args("momentum", muon.momentum, {0.0, 0.9999});
      args("min_side", muon.min_side, {1});
    }
    args("lr", options.lr, {0.0, 1e3});
    std::vector<double> betas(options.betas.begin(), options.betas.end());
    args("betas", betas);
    if (betas.size() != 2 || betas[0] < 0.0 || betas[0] >= 1.0 || betas[1] < 0.0 || betas[1] >= 1.0)
      throw args.error("betas", "must be two numbers in [0, 1)");
    options.betas = {betas[0], betas[1]};
    args("eps", options.eps, {1e-30, 1.0});
    args("weight_decay", options.weight_decay, {0.0, 1e3});
  });
}

void read_grad_clip(ConfigFields& f, UpdateOptions& update) {
  const Json* value = f.reader().raw("grad_clip");
  if (value == nullptr || value->is_null()) return;
  if (value->is_number()) return f("grad_clip", update.grad_clip.emplace<double>(1.0), {1e-12, 1e12});
  auto& options = update.grad_clip.emplace<AdaptiveGradClipper::Options>();
  f.object("grad_clip", [&](ConfigFields& clip) {
    std::string name;
    clip("name", name, {"AdaptiveGradClipper"}, kRequired);
    clip.object("args", [&](ConfigFields& args) {
      const Json* max_norm = args.reader().raw("max_norm");
      if (max_norm != nullptr && !max_norm->is_null()) args("max_norm", options.max_norm.emplace(1.0), {1e-12, 1e12});
      args("clip_percentile", options.clip_percentile, {0.0, 100.0});
      args("buffer_size", options.buffer_size, {1, 10'000'000});
    });
  });
}

std::vector<double> read_ema_rates(ConfigReader& reader) {
  const Json* value = reader.raw("ema_rate");
  if (value == nullptr) return {0.9999};
  const std::vector<double> rates =
      value->is_number() ? std::vector<double>{value->get<double>()} : reader.numbers("ema_rate", {});
  for (const double rate : rates) {
    if (!(rate >= 0.0 && rate < 1.0)) throw reader.error("ema_rate", "every rate must lie in [0, 1)");
  }
  return rates;
}

}  // namespace

LrSchedule read_schedule(const Json& json, std::int64_t max_steps, const std::string& file,
                         const std::string& pointer) {
  ConfigReader reader(json, file, pointer);
  reader.require("name");
  const std::string name = reader.choice(
      "name", "",
      {"LinearLR", "CosineAnnealingLR", "ConstantLR", "MultiStepLR", "LinearWarmupLRScheduler", "SequentialLR"});
  ConfigReader args = reader.object("args");
  const LrSchedule schedule =
      name == "SequentialLR" ? sequence(reader, args, max_steps) : simple_schedule(name, args, max_steps);
  args.finish();
  reader.finish();
  return schedule;
}

TrainerOptions TrainerOptions::read(ConfigReader& reader) {
  TrainerOptions options;
  ConfigFields f(reader);
  f("max_steps", options.max_steps, {0, kManySteps}, kRequired);
  f("batch_size", options.batch_size, {1, 1 << 20},
    reader.has("batch_size_per_gpu") ? FieldNeed::kOptional : kRequired);
  f("batch_size_per_gpu", options.batch_size, {1, 1 << 20});
  f("batch_split", options.batch_split, {1, static_cast<std::int64_t>(options.batch_size)});
  reader.require("optimizer");
  f.object("optimizer", [&options](ConfigFields& optimizer) { read_optimizer(optimizer, options.update); });
  const Json* schedule = reader.raw("lr_scheduler");
  if (schedule != nullptr && !schedule->is_null()) {
    options.update.schedule =
        read_schedule(*schedule, options.max_steps, reader.file(), reader.pointer_to("lr_scheduler"));
  }
  options.before_decay = steps_before_decay(options.update.schedule, options.update.optimizer.lr, options.max_steps);
  if (options.before_decay < options.max_steps / 2 || options.before_decay == options.max_steps)
    options.before_decay = 0;  // falls from early on, or never
  read_grad_clip(f, options.update);
  options.update.ema_rates = read_ema_rates(reader);
  f("ema_warm_up", options.update.ema_warm_up);
  f("fp16_mode", options.fp16_mode, {"inflat_all", "none"});
  f("fp16_scale_growth", options.update.fp16_scale_growth, {0.0, 1.0});
  f("loss_scaling", options.loss_scaling);
  f("prefetch_data", options.prefetch_data);
  f("num_workers_dl", options.num_workers_dl, {0, 256});
  const Json* finetune = reader.raw("finetune_ckpt");
  if (finetune != nullptr && !finetune->is_null()) {
    ConfigReader files = reader.object("finetune_ckpt");
    for (const auto& [model, unused] : finetune->items()) options.finetune_ckpt[model] = files.text(model, "");
    files.finish();
  }
  options.i_print = interval(reader, "i_print", 500, options.max_steps);
  options.i_log = interval(reader, "i_log", 500, options.max_steps);
  options.i_sample = interval(reader, "i_sample", 10000, options.max_steps, -1);
  options.i_save = interval(reader, "i_save", 10000, options.max_steps);
  options.i_ddpcheck = interval(reader, "i_ddpcheck", 100, options.max_steps);
  // The published trainer has these for machinery that this one does not need.
  for (const char* key : {"elastic", "log_param_stats", "skip_init_snapshot"}) reader.ignore(key);
  f("seed", options.seed, {0});
  f("max_minutes", options.max_minutes, {0.0});
  options.i_eval = interval(reader, "i_eval", 0, options.max_steps);
  f("stop_metric", options.stop_metric);
  f("stop_patience", options.stop_patience, {1, 1'000'000});
  f("stop_gain", options.stop_gain, {0.0, 1.0});
  f("replicas", options.replicas, {1, 256});
  if (reader.has("precision"))
    f("precision", options.precision, {"fp32", "fp64", "bf16", "mixed", "mixed-emulated", "fp16-published"});
  f("compatibility", options.compatibility, {"published", "paper"});
  return options;
}

Precision choose_precision(const TrainerOptions& options, torch::Device device, const std::string& file) {
  const bool fp16_mode = options.fp16_mode != "none";
  Precision precision;
  if (options.precision == "bf16") {
    precision.compute = torch::kBFloat16;
    precision.note =
        "precision bf16: the blocks compute in bf16, parameters are updated in fp32, losses are not scaled";
  } else if (options.precision == "mixed") {
    const bool has_kernels = device.is_cpu() && nn::kernels::has_bf16_products();
    if (has_kernels) precision.mixed_products = nn::MixedForm::kKernels;
    precision.tf32_products = device.is_cuda();
    precision.note = has_kernels ? "precision mixed: fp32, but for the factors of products, which are rounded to bf16"
                     : precision.tf32_products
                         ? "precision mixed: fp32, but for the factors of products, which are rounded to tf32"
                         : "precision mixed: no kernels for products of bf16 numbers here, everything is fp32";
  } else if (options.precision == "mixed-emulated") {
    if (!device.is_cpu())
      throw NotSupportedError(file, "/trainer/args/precision", "\"mixed-emulated\" on a GPU; \"mixed\" rounds there");
    precision.mixed_products = nn::MixedForm::kEmulated;
    precision.note = "precision mixed, emulated: fp32, but factors of products are rounded to bf16 beforehand";
  } else if (options.precision == "fp16-published") {
    if (!device.is_cuda())
      throw NotSupportedError(file, "/trainer/args/precision", "fp16 on a CPU; use bf16, which a CPU computes faster");
    if (!fp16_mode) {
      throw InputError(file, "/trainer/args/precision",
                       "\"fp16-published\" contradicts fp16_mode \"none\"; leave one of them out");
    }
    precision.compute = torch::kHalf;
    precision.loss_scaling = options.loss_scaling;
    precision.note = "precision fp16-published: the blocks compute in fp16, parameters are updated in fp32";
  } else if (options.precision == "fp64") {
    precision.compute = torch::kFloat64;
    precision.note = "precision fp64: everything is computed and kept in fp64, many times as slow";
  } else if (options.precision == "fp32") {
    precision.note = "precision fp32";
  } else {
    precision.loss_scaling = options.loss_scaling && fp16_mode && device.is_cuda();
    if (fp16_mode && device.is_cpu()) {
      precision.note =
          "fp16_mode " + options.fp16_mode + ": on a CPU parameters and arithmetic are fp32, losses are not scaled";
    }
  }
  return precision;
}

}  // namespace anigen::train
