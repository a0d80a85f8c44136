#include "anigen/train/train_command.h"

#include <ATen/Context.h>
#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cstring>
#include <ctime>
#include <fstream>
#include <optional>
#include <system_error>
#include <thread>

#include "anigen/core/config.h"
#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/log.h"
#include "anigen/core/process.h"
#include "anigen/core/run_folder.h"
#include "anigen/core/version.h"
#include "anigen/data/latent_files.h"
#include "anigen/nn/kernels/mixed_products.h"
#include "anigen/nn/profile.h"
#include "anigen/train/stages/paper_variants.h"
#include "anigen/train/stages/stages.h"

namespace anigen::train {

namespace {

namespace fs = std::filesystem;

// A resumed run may be continued with changed settings, but not without saying so.
void report_changes(const fs::path& earlier, const Json& config) {
  std::error_code error;
  if (!fs::exists(earlier, error)) return;
  const Json before = read_json(earlier);
  for (const Json& change : Json::diff(before, config)) {
    log::warn("config differs from the one this run began with: {} {}", change.at("op").get<std::string>(),
              change.at("path").get<std::string>());
  }
}

// A run goes on by another build than the one that it was made by so far, but not without saying so.
void report_other_program(const fs::path& record) {
  std::error_code error;
  if (!fs::exists(record, error)) return;
  const Json before = read_json(record);
  if (before != made_by()) log::warn("the run was made so far by {}; this is {}", before.dump(), made_by().dump());
}

void append_command(const fs::path& file, const std::string& line) {
  std::error_code error;
  std::string text = fs::exists(file, error) ? read_file(file) : std::string();
  const std::time_t now = std::time(nullptr);
  char stamp[40];
  std::strftime(stamp, sizeof stamp, "%Y-%m-%dT%H:%M:%SZ", std::gmtime(&now));
  write_file_atomically(file, text + stamp + " " + line + "\n");
}

// Of the lock file, which its holder has written; nothing when nobody says, or a process that is gone.
std::optional<ProcessIdentity> holder_of(const fs::path& file) {
  try {
    const ProcessIdentity holder = process_identity_from_json(read_json(file));
    if (!certainly_gone(holder)) return holder;
  } catch (const InputError&) {  // empty or half written: its holder has only just come
  } catch (const Json::exception&) {
  }
  return std::nullopt;
}

// The run folder is this process's alone for as long as this lives. The kernel ends the lock with the process; the file
// stays and says who held it last.
class RunFolderLock {
 public:
  explicit RunFolderLock(const fs::path& run) {
    const fs::path file = RunFolder{run}.lock();
    try {
      // A server of files may take so long to notice that a machine is gone, which held the lock.
      constexpr auto kLongest = std::chrono::seconds(120);
      const auto begin = std::chrono::steady_clock::now();
      bool told = false;
      while (!(lock_ = FileLock::try_lock(file, FileLock::Kind::kExclusive))) {
        const std::optional<ProcessIdentity> holder = holder_of(file);
        const std::string name =
            holder ? "process " + std::to_string(holder->id) + " on " + holder->host : std::string("another process");
        const bool elsewhere = holder && holder->space != this_process().space;
        if (!elsewhere || std::chrono::steady_clock::now() - begin > kLongest) {
          throw InputError(run.string(), "",
                           "is the run folder of another anigen-train that is running, " + name +
                               "; wait until it has ended, stop it, or give another --output");
        }
        if (!told) log::info("waiting up to 2 minutes for {}: {} holds it", run.string(), name);
        told = true;
        throw_if_interrupted();
        std::this_thread::sleep_for(std::chrono::milliseconds(200));
      }
    } catch (const NotSupportedError& problem) {
      log::warn("{}; no other anigen-train may work on it meanwhile, and nothing checks that", problem.what());
      return;
    }
    // In place: a file that is renamed over this one would not be locked.
    std::ofstream out(file, std::ios::trunc | std::ios::binary);
    out << to_json(this_process()).dump() << "\n" << std::flush;
    if (!out) throw WriteError(file.string() + ": cannot write: " + std::strerror(errno));
  }

 private:
  std::optional<FileLock> lock_;
};

ConfigReader trainer_of(ConfigReader& top) {
  for (const char* part : {"models", "dataset", "trainer"}) top.require(part);
  ConfigReader trainer = top.object("trainer");
  trainer.require("name");
  return trainer;
}

// A config, read as far as all trainers share it.
struct TrainingConfig {
  const Json& config;
  const std::string& file;
  torch::Device device;
  ConfigReader top{config, file}, trainer = trainer_of(top);
  std::string name = trainer.text("name", "");
  ConfigReader args = trainer.object("args");
  TrainerOptions options = TrainerOptions::read(args);

  std::unique_ptr<Stage> stage() { return make_stage(name, {config, file, args, options, device}); }
  // Refuses keys that stand beside models, dataset and trainer, or beside name and args of the trainer.
  void finish() {
    top.raw("models");
    top.raw("dataset");
    top.finish();
    trainer.finish();
  }
};

// Makes a run longer: it goes on from its newest checkpoint of the steps in which both lengths have one learning rate.
// The config in the run folder is of the new length from the first time on, so that the same command goes on.
void extend(Json& config, const std::string& file, const TrainCommand& command, RunOptions& run) {
  const Json shorter = config;
  config["trainer"]["args"]["max_steps"] = command.extend_to;
  const TrainerOptions now = trainer_options(shorter, file), then = trainer_options(config, file);
  if (then.max_steps < now.max_steps) {
    throw InputError(
        "", "--extend-to",
        std::to_string(then.max_steps) + " is less than the " + std::to_string(now.max_steps) + " steps of this run");
  }
  const std::int64_t common =
      common_steps(now.update.schedule, then.update.schedule, now.update.optimizer.lr, now.max_steps);
  const CheckpointFolder checkpoints(RunFolder{run.output}.checkpoints());
  const std::optional<std::int64_t> newest = checkpoints.latest();
  if (!newest || *newest <= common) return;
  const std::vector<std::int64_t> steps = checkpoints.steps();
  const auto after = std::upper_bound(steps.begin(), steps.end(), common);
  if (after == steps.begin()) {
    throw InputError(checkpoints.file("state", common).string(), "--extend-to",
                     "a longer run has another learning rate from step " + std::to_string(common) +
                         " on, and there is no checkpoint from before; a schedule that is flat first keeps one");
  }
  run.ckpt = std::to_string(*std::prev(after));
  run.restart = true;
  log::info("the longer run goes on from step {}, before the learning rate fell", run.ckpt);
}

void prepare_run_folder(const TrainCommand& command, const Json& config) {
  make_folders(command.run.output);
  const RunFolder run{command.run.output};
  log::also_to_file(run.log());
  report_changes(run.config(), config);
  append_command(run.command(), command.command_line);
  report_other_program(run.made_by());
  write_file_atomically(run.made_by(), made_by().dump(2) + "\n");
}

// Numbers of parameters by model, frozen ones included.
Json parameter_counts(const Stage& stage) {
  Json counts = Json::object();
  for (const nn::NamedModel& model : stage.models()) {
    std::int64_t count = 0;
    for (const torch::Tensor& parameter : model.module->parameters()) count += parameter.numel();
    counts[model.name] = count;
  }
  return counts;
}

// Work of all ranks, and files of rank 0.
void train_as_rank(const TrainCommand& command, RunOptions run, const std::shared_ptr<Communicator>& ranks,
                   TrainingConfig& given) {
  TrainerOptions& options = given.options;
  make_deterministic(given.device);
  torch::manual_seed(options.seed);
  const Precision precision = choose_precision(options, given.device, given.file);
  options.update.loss_scaling = precision.loss_scaling;
  options.compute_dtype = precision.compute;
  nn::set_mixed_products(precision.mixed_products);
  at::globalContext().setAllowTF32CuBLAS(precision.tf32_products);
  if (!precision.note.empty()) log::info("{}", precision.note);
  // Everything is read and checked before the run folder is touched.
  const std::unique_ptr<Stage> stage = given.stage();
  given.args.finish();
  if (!stage->supports(precision.compute)) {
    throw NotSupportedError(given.file, "/trainer/args/precision",
                            "precision " + options.precision + " with trainer " + given.name.substr(0, 80));
  }

  run.ranks = ranks;
  run.command = command.command_line;
  std::optional<RunFolderLock> lock;
  if (ranks->rank() == 0) {
    lock.emplace(run.output);
    std::error_code error;
    const fs::path earlier = RunFolder{run.output}.config();
    if (fs::exists(earlier, error)) run.earlier_config = read_file(earlier);
    prepare_run_folder(command, given.config);
  }
  Trainer loop(*stage, options, run);
  // A run that could not begin leaves the config of what the folder holds.
  if (ranks->rank() == 0) {
    write_config(RunFolder{run.output}.config(), given.config);
    write_config(RunFolder{run.output}.parameters(), parameter_counts(*stage));
  }
  log::info("{} trainable parameters, {} threads, {} replicas", loop.parameters().master().numel(), command.run.threads,
            options.replicas);
  loop.run();
  log::info("finished at step {}; results are in {}", loop.step(), command.run.output.string());
}

}  // namespace

Json resolved_config(const TrainCommand& command, std::string& file) {
  const fs::path earlier = RunFolder{command.run.output}.config();
  std::error_code error;
  if (command.config.empty() && !fs::exists(earlier, error))
    throw InputError(earlier.string(), "", "there is no run to resume here; give --config");
  const fs::path source = command.config.empty() ? earlier : command.config;
  file = source.string();
  Json config = load_config(source);
  apply_overrides(config, command.overrides);
  fill_in_paper_variants(config);
  if (!command.data_dir.empty()) config["dataset"]["args"]["data_dir"] = command.data_dir;
  return config;
}

TrainerOptions trainer_options(const Json& config, const std::string& file) {
  return TrainingConfig{config, file, torch::kCPU}.options;
}

void make_deterministic(torch::Device device) {
  if (!device.is_cuda()) return;
  at::globalContext().setDeterministicCuDNN(true);
  at::globalContext().setBenchmarkCuDNN(false);
  // LibTorch 2.11 loads its linear algebra for CUDA at the first use, and fails when two replicas come first at once.
  if (torch::cuda::is_available()) torch::linalg_inv(torch::eye(4, torch::TensorOptions().device(device)));
}

Json describe_config(const TrainCommand& command, ConfigView view) {
  std::string file;
  const Json config = resolved_config(command, file);
  Json read = config;
  // Stages read all their arguments, then stop at a dataset that is not there, before they build their models.
  if (read.is_object()) read["dataset"]["args"]["data_dir"] = "/no/dataset";
  ConfigRecord record;
  TrainingConfig given{read, file, torch::kCPU};
  given.finish();
  try {
    given.stage();
  } catch (const InputError& problem) {
    if (problem.file() == file) throw;
  }
  given.args.finish();
  return view == ConfigView::kSchema ? record.schema() : record.completed(config);
}

void train(const TrainCommand& command) {
  check_start(command.run);
  nn::set_up_computing(command.run.threads);
  std::string file;
  Json config = resolved_config(command, file);
  if (config.is_object() && config.contains("dataset")) data::write_out_statistics(config["dataset"], file);
  RunOptions run = command.run;
  if (command.extend_to > 0) extend(config, file, command, run);
  const bool several = command.environment.size > 1;
  const bool numbered = several && command.device == "cuda";
  const torch::Device device =
      nn::parse_device(numbered ? "cuda:" + std::to_string(command.environment.local_rank) : command.device);
  TrainingConfig given{config, file, device};
  given.finish();

  const std::shared_ptr<Communicator> ranks = join_ranks(command.environment, command.ranks);
  if (several) {
    log::info("rank {} of {}: {}, rendezvous {}", ranks->rank(), ranks->size(), ranks->description(),
              command.environment.rendezvous.text());
    // The others have nothing to say that rank 0 does not, but for what goes wrong.
    if (ranks->rank() > 0 && spdlog::get_level() == spdlog::level::info) spdlog::set_level(spdlog::level::warn);
  }
  try {
    train_as_rank(command, run, ranks, given);
  } catch (const RankLost& lost) {
    throw Error("rank " + std::to_string(ranks->rank()) + " stops: " + lost.what());
  } catch (const Interrupted&) {
    throw;
  } catch (const std::exception& error) {
    ranks->leave("rank " + std::to_string(ranks->rank()) + " stopped: " + error.what());
    throw;
  }
}

}  // namespace anigen::train
