#include "anigen/train/options.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <utility>

#include "anigen/core/error.h"

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

void read_optimizer(ConfigReader reader, UpdateOptions& update) {
  reader.require("name");
  const std::string name = reader.choice("name", "AdamW", {"AdamW", "Adam", "Muon"});
  const bool muon = name == "Muon";
  ConfigReader args = reader.object("args");
  if (muon) {
    update.muon.emplace();
    update.muon->momentum = args.number("momentum", update.muon->momentum, 0.0, 0.9999);
    update.muon->min_side = args.integer("min_side", update.muon->min_side, 1);
  }
  AdamW::Options options;
  if (name == "Adam") {
    options.decoupled = false;
    options.weight_decay = 0.0;
  }
  options.lr = args.number("lr", options.lr, 0.0, 1e3);
  const std::vector<double> betas = args.numbers("betas", {options.betas[0], options.betas[1]});
  if (betas.size() != 2 || betas[0] < 0.0 || betas[0] >= 1.0 || betas[1] < 0.0 || betas[1] >= 1.0)
    throw args.error("betas", "must be two numbers in [0, 1)");
  options.betas = {betas[0], betas[1]};
  options.eps = args.number("eps", options.eps, 1e-30, 1.0);
  options.weight_decay = args.number("weight_decay", options.weight_decay, 0.0, 1e3);
  args.finish();
  reader.finish();
  update.optimizer = options;
}

void read_grad_clip(ConfigReader& reader, UpdateOptions& update) {
  const Json* value = reader.raw("grad_clip");
  if (value == nullptr || value->is_null()) return;
  if (value->is_number()) {
    update.grad_clip = reader.number("grad_clip", 1.0, 1e-12, 1e12);
    return;
  }
  ConfigReader clip = reader.object("grad_clip");
  clip.require("name");
  clip.choice("name", "AdaptiveGradClipper", {"AdaptiveGradClipper"});
  ConfigReader args = clip.object("args");
  AdaptiveGradClipper::Options options;
  const Json* max_norm = args.raw("max_norm");
  if (max_norm != nullptr && !max_norm->is_null()) options.max_norm = args.number("max_norm", 1.0, 1e-12, 1e12);
  options.clip_percentile = args.number("clip_percentile", options.clip_percentile, 0.0, 100.0);
  options.buffer_size = static_cast<std::size_t>(args.integer("buffer_size", 1000, 1, 10'000'000));
  args.finish();
  clip.finish();
  update.grad_clip = options;
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

std::size_t read_batch_size(ConfigReader& reader) {
  const bool both = reader.has("batch_size_per_gpu");
  if (!both) reader.require("batch_size");
  const std::int64_t whole = reader.integer("batch_size", 1, 1, 1 << 20);
  return static_cast<std::size_t>(reader.integer("batch_size_per_gpu", whole, 1, 1 << 20));
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
  reader.require("max_steps");
  options.max_steps = reader.integer("max_steps", 0, 0, kManySteps);
  options.batch_size = read_batch_size(reader);
  options.batch_split =
      static_cast<std::size_t>(reader.integer("batch_split", 1, 1, static_cast<std::int64_t>(options.batch_size)));
  reader.require("optimizer");
  read_optimizer(reader.object("optimizer"), options.update);
  const Json* schedule = reader.raw("lr_scheduler");
  if (schedule != nullptr && !schedule->is_null()) {
    options.update.schedule =
        read_schedule(*schedule, options.max_steps, reader.file(), reader.pointer_to("lr_scheduler"));
  }
  read_grad_clip(reader, options.update);
  options.update.ema_rates = read_ema_rates(reader);
  options.fp16_mode = reader.choice("fp16_mode", "inflat_all", {"inflat_all", "none"});
  options.update.fp16_scale_growth = reader.number("fp16_scale_growth", 1e-3, 0.0, 1.0);
  options.loss_scaling = reader.boolean("loss_scaling", true);
  options.prefetch_data = reader.boolean("prefetch_data", true);
  options.num_workers_dl = static_cast<std::size_t>(reader.integer("num_workers_dl", 1, 0, 256));
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
  options.seed = static_cast<std::uint64_t>(reader.integer("seed", 0, 0));
  options.max_minutes = reader.number("max_minutes", 0.0, 0.0);
  options.i_eval = interval(reader, "i_eval", 0, options.max_steps);
  options.replicas = static_cast<std::size_t>(reader.integer("replicas", 1, 1, 256));
  if (reader.has("precision"))
    options.precision = reader.choice("precision", "", {"fp32", "fp64", "bf16", "fp16-published"});
  options.compatibility = reader.choice("compatibility", "published", {"published", "paper"});
  return options;
}

Precision choose_precision(const TrainerOptions& options, torch::Device device, const std::string& file) {
  const bool fp16_mode = options.fp16_mode != "none";
  Precision precision;
  if (options.precision == "bf16") {
    precision.compute = torch::kBFloat16;
    precision.note =
        "precision bf16: the blocks compute in bf16, parameters are updated in fp32, losses are not scaled";
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
