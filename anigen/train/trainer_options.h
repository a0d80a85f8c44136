#pragma once
#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "anigen/core/config_reader.h"
#include "anigen/train/parameter_update.h"

namespace anigen::train {

/// The arguments every trainer takes (`trainer.args`); names and defaults of reference training-and-data.md, section
/// 2.1, then ours. Those of a stage are read from the same object by the stage.
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
  double max_minutes = 0.0;                 ///< stop after that much training time, over all resumed runs; 0: no limit
  std::int64_t i_eval = 0;                  ///< steps between evaluations on held-out assets; 0: never
  std::size_t replicas = 1;                 ///< copies of the models that work on micro-batches at the same time
  std::string compatibility = "published";  ///< or "paper": which side of a documented difference to take
  std::string precision;  ///< "fp32", "fp64", "bf16", "fp16-published"; empty: fp16_mode decides (precision.h)
  torch::Dtype compute_dtype = torch::kFloat32;  ///< what that came to; not an argument

  /// Marks the keys as known; the caller reads the stage's own and then calls reader.finish().
  /// @throws InputError
  static TrainerOptions read(ConfigReader& reader);
};

/// `lr_scheduler`: {name, args}, or SequentialLR with `schedulers`. Where a number of steps is expected, "5%" means
/// that share of max_steps.
LrSchedulePtr read_schedule(const Json& json, std::int64_t max_steps, const std::string& file,
                            const std::string& pointer);

}  // namespace anigen::train
