#pragma once
#include <chrono>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "anigen/core/config.h"
#include "anigen/data/batches.h"
#include "anigen/nn/profile.h"
#include "anigen/train/distributed/gradient_buckets.h"
#include "anigen/train/metrics_log.h"
#include "anigen/train/optimizer.h"
#include "anigen/train/options.h"
#include "anigen/train/stage.h"
#include "anigen/train/trainer_state.h"

namespace anigen::train {

/// Folder of a run and its starting point.
struct RunOptions {
  std::filesystem::path output;    ///< run folder: metrics.csv, tb_logs/, ckpts/, samples/, profile.md
  std::filesystem::path load;      ///< run folder to start from; empty: output. One that export_run() wrote has weights
                                   ///< alone: steps and optimiser begin anew
  std::string ckpt = "latest";     ///< "latest" complete checkpoint if there is one, "none", or a step that must exist
  bool restart = false;            ///< begin at `load` and `ckpt` although the output has complete checkpoints
  std::string command;             ///< tells a restart that goes on from one that begins: the same text goes on
  std::string earlier_config;      ///< config.json of the output before this run; kept beside what a restart leaves
  int threads = 1;                 ///< LibTorch threads, shared among replicas
  std::int64_t profile_steps = 0;  ///< measure where the time of so many steps goes, after two that warm up, then stop
  std::shared_ptr<Communicator> ranks;  ///< the processes that train together; null: this one alone
};

/// Checks `load`, `ckpt` and `restart` without looking at any folder. @throws InputError for an unknown word, and for
/// options of which one would be ignored
void check_start(const RunOptions& run);

/// The loop all stages share (docs/reference/training.md, 2). Given a seed, a number of threads per replica, a number
/// of replicas and a number of ranks it is deterministic, and a run that was killed and resumed ends with the same bits
/// as one that was not.
///
/// With several ranks every process runs this loop on its share of the step's micro-batches, number i on rank i mod
/// ranks. Batches, their split and their random draws are those of one process, so that another number of ranks goes on
/// with the same data; sums of gradients differ in their last bits. After a step all ranks hold the same weights, bit
/// for bit. Rank 0 alone writes files, evaluates and draws samples, while the others go on to the next exchange.
class Trainer {
 public:
  /// Restores the newest complete checkpoint of the output, so that a command that is run again goes on; where there
  /// is none, or `restart` is set, the one that `load` and `ckpt` ask for. Without any the models start from
  /// `finetune_ckpt`, then from the stage's own pretrained weights, which win (docs/reference/training.md, 2.1).
  /// @param stage models with their initial weights; must outlive the trainer
  /// @throws InputError for a file that does not fit, a frozen parameter that is in none, or fewer micro-batches than
  /// there are ranks and replicas
  Trainer(Stage& stage, const TrainerOptions& options, const RunOptions& run);

  /// Trains until max_steps or max_minutes, then evaluates, saves and, if i_sample is above 0, samples. A restart first
  /// moves later steps of the output aside (set_later_steps_aside()); until it has ended, `restart` of the same
  /// `command` goes on.
  /// Weights that an update left not finite are replaced by those of the last tenth step.
  /// @throws Interrupted after saving when a signal asked to stop; Error naming step, tensor and samples when a loss
  /// or a gradient is not finite; with loss scaling such a step leaves the weights alone instead and lowers the scale;
  /// RankLost when another rank is lost, after rank 0 has saved the last step that was completed
  void run();

  std::int64_t step() const { return step_; }
  const ParameterUpdate& update() const { return *update_; }
  const ParameterBuffer& parameters() const { return buffers_.front(); }

 private:
  struct StepTimes {
    double data = 0.0, forward = 0.0, backward = 0.0, communication = 0.0, update = 0.0;  ///< seconds
  };

  void check_finetuned_models() const;
  void start_from_files();
  struct StartPoint {
    std::optional<std::int64_t> step;  ///< of the checkpoint; nothing: from the beginning
    bool own = true;                   ///< a checkpoint of the output; else of `load`
    bool begins_again = false;         ///< what the output holds of later steps belongs to another history
  };
  StartPoint choose_start() const;
  StartPoint agreed_on(const StartPoint& start_of_rank_0);
  bool restart_is_under_way() const;
  /// Of the history in the output that this run continues; -1 when it begins one.
  std::int64_t last_kept_step() const { return start_.own && start_.step ? *start_.step : -1; }
  void begin_again();
  void end_restart() const;
  void require_saved() const;
  void restore(const CheckpointFolder& source, std::int64_t step);
  /// The losses of one micro-batch, by name, and why they cannot be trained on; "" when they can.
  struct MicroBatch {
    Values logged;
    bool finite = true;
    std::string problem;
  };
  bool first() const { return ranks_->rank() == 0; }
  bool alone() const { return ranks_->size() == 1; }
  void train();
  StepVerdict train_step(const data::StepBatches& batches);
  void train_micro_batches(const data::StepBatches& batches, const std::vector<std::size_t>& ours,
                           std::vector<MicroBatch>& done);
  /// Says what is not finite among its losses. @throws Error with that when there are no other ranks
  void judge_losses(const std::vector<std::string>& ids, MicroBatch& done) const;
  StepVerdict sum_gradients(const StepReport& report);
  [[noreturn]] void stop_at_losses(const std::vector<MicroBatch>& done);
  [[noreturn]] void stop_at_gradient(const data::StepBatches& batches);
  /// Of a stream: the shards that the checkpoint names, else the newest.
  void open_shards();
  /// Takes the next generation of a stream if all ranks have it ready. @return false: the data stay
  bool take_newer_shards();
  Json named_shards() const;  ///< of the data now, as a checkpoint names them
  void use_shards(const std::shared_ptr<const data::BatchSource>& source);
  void save_what_is_complete() noexcept;
  void write_checkpoint(const std::vector<std::string>& generators);
  void count_wait(std::chrono::steady_clock::time_point begin);
  void print();
  void log_means();
  void profile(std::int64_t steps_done, bool last);
  void evaluate();
  void sample();
  void save();
  SavedState state(const std::vector<std::string>& generators) const;
  void restore_state(const SavedState& state);
  void restore_generator(const SavedState& state);
  void bring_means_together();
  void check_stop_rule();
  void write_page() const;
  bool out_of_time() const {
    return stalled_ || (options_.max_minutes > 0.0 && elapsed() >= 60.0 * options_.max_minutes);
  }
  double elapsed() const;  ///< seconds of training, over all resumed runs

  const TrainerOptions options_;
  const RunOptions run_;
  std::vector<std::unique_ptr<Stage>> owned_;
  std::vector<Stage*> stages_;  // [replicas]
  const std::shared_ptr<Communicator> ranks_;
  std::vector<ParameterBuffer> buffers_;      // [replicas], sharing one master
  std::unique_ptr<GradientBuckets> buckets_;  // null for one process
  std::unique_ptr<ParameterUpdate> update_;
  CheckpointFolder checkpoints_;
  StartPoint start_;
  std::unique_ptr<Workers> workers_;
  std::unique_ptr<MetricsLog> metrics_;
  std::unique_ptr<TensorBoardWriter> board_;
  std::unique_ptr<nn::OperatorProfile> profile_;
  RunningMeans means_;
  StepTimes times_;
  std::shared_ptr<data::ShardStream> stream_;  // null: the data stay
  Json saved_shards_;                          // of the checkpoint that this run goes on from
  double waited_ = 0.0;                        // seconds for data since the last line of print()
  std::int64_t step_ = 0, timed_steps_ = 0, saved_step_ = -1;
  std::uint64_t samples_ = 0;  // drawn so far
  double elapsed_before_ = 0.0, last_loss_ = 0.0;
  bool stalled_ = false;         // by the stop rule, on rank 0
  std::string generator_then_;   // state of LibTorch's generator when this step began; several ranks only
  std::string generator_saved_;  // and at the last checkpoint
  std::chrono::steady_clock::time_point started_, printed_at_;
  std::int64_t printed_step_ = 0;
};

}  // namespace anigen::train
