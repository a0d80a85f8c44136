#pragma once
#include <cstdint>
#include <map>
#include <string>

#include "anigen/core/config.h"
#include "anigen/nn/kernels/mixed_products.h"
#include "anigen/nn/torch.h"
#include "anigen/train/optimizer.h"

namespace anigen::train {

/// The arguments every trainer takes (`trainer.args`); names and defaults of docs/reference/training.md, 2.1, then
/// ours. Those of a stage are read from the same object by the stage.
struct TrainerOptions {
  std::int64_t max_steps = 0;   ///< required
  std::size_t batch_size = 1;   ///< `batch_size`, or `batch_size_per_gpu`, which wins
  std::size_t batch_split = 1;  ///< micro-batches a batch is dealt into; their gradients are averaged
  UpdateOptions update;
  std::string fp16_mode = "inflat_all";
  bool loss_scaling = true;
  bool prefetch_data = true;
  std::size_t num_workers_dl = 1;                    ///< threads that load batches; the batches do not depend on it
  std::map<std::string, std::string> finetune_ckpt;  ///< model → weights to start from
  std::int64_t i_ddpcheck = 100;  ///< steps between comparisons of the ranks' parameters (published: 10000); 0: never
  std::int64_t i_print = 500, i_log = 500, i_sample = 10000, i_save = 10000;  ///< steps between; 0: never

  // Ours.
  std::uint64_t seed = 0;
  double max_minutes = 0.0;        ///< stop after that much training time, over all resumed runs; 0: no limit
  std::int64_t i_eval = 0;         ///< steps between evaluations on held-out assets; 0: never
  std::string stop_metric;         ///< a held-out metric ("eval.…", is_larger_better()) that ends the run …
  std::int64_t stop_patience = 3;  ///< … when so many evaluations in a row …
  double stop_gain = 0.02;         ///< … gain less than this share of the best before; empty: never
  std::size_t replicas = 1;        ///< copies of the models that work on micro-batches at the same time
  std::string compatibility = "published";  ///< or "paper": which side of a documented difference to take
  std::string precision;  ///< "fp32", "fp64", "bf16", "mixed", "mixed-emulated", "fp16-published"; empty: fp16_mode
                          ///< decides (precision.h)
  torch::Dtype compute_dtype = torch::kFloat32;  ///< what that came to; not an argument
  std::int64_t before_decay = 0;  ///< step whose checkpoint is kept: the learning rate, flat for half of the run or
                                  ///< more, falls from there on; 0: none

  /// Marks the keys as known; the caller reads the stage's own and then calls reader.finish().
  /// @throws InputError
  static TrainerOptions read(ConfigReader& reader);
};

/// `lr_scheduler`: {name, args}, or SequentialLR with `schedulers`. Numbers of steps may be shares of max_steps, "5%".
LrSchedule read_schedule(const Json& json, std::int64_t max_steps, const std::string& file, const std::string& pointer);

/// In which numbers a run computes. Masters, optimiser state and averages are fp32, but for fp64.
struct Precision {
  torch::Dtype compute = torch::kFloat32;               ///< of the torsos (see Stage::set_compute_dtype)
  nn::MixedForm mixed_products = nn::MixedForm::kNone;  ///< whether factors of products are rounded to bf16
  bool tf32_products = false;  ///< on CUDA: rounded to tf32, which has 10 bits behind the point
  bool loss_scaling = false;   ///< multiply losses by 2^log_scale: fp16 gradients underflow without
  std::string note;            ///< one line for the log
};

/// Precision that the trainer arguments `precision`, `fp16_mode` and `loss_scaling` give on a device:
///
/// | precision | CPU | GPU |
/// |---|---|---|
/// | absent | fp32 | fp32 parameters; losses scaled if fp16_mode and loss_scaling say so |
/// | "fp32" | fp32 | fp32 |
/// | "fp64" | everything in fp64: for comparing ways to sum, stages 1, 4 and 5 | the same |
/// | "bf16" | torsos in bf16 | torsos in bf16 |
/// | "mixed" | fp32, factors of products rounded to bf16 where the CPU has such products | the same, to tf32 |
/// | "mixed-emulated" | the same on any CPU, at the speed of fp32: to compare how "mixed" learns | not supported |
/// | "fp16-published" | not supported | torsos in fp16, losses scaled (docs/reference/training.md, 2.2) |
///
/// bf16 has the range of fp32, so its losses are not scaled.
/// @param file of the config, for messages @throws NotSupportedError for fp16 on a CPU, "mixed-emulated" on a GPU;
/// InputError for "fp16-published" beside fp16_mode "none"
Precision choose_precision(const TrainerOptions& options, torch::Device device, const std::string& file);

}  // namespace anigen::train
