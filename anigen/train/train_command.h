#pragma once
#include <filesystem>
#include <string>
#include <vector>

#include "anigen/train/distributed/launch.h"
#include "anigen/train/trainer.h"

namespace anigen::train {

/// Everything `anigen-train` is told.
struct TrainCommand {
  std::filesystem::path config;        ///< empty: the config.json of the output folder
  std::vector<std::string> overrides;  ///< path.to.key=value
  std::string data_dir;                ///< empty: the config's dataset.args.data_dir
  RunOptions run;
  std::int64_t extend_to = 0;     ///< new max_steps of the run in the output folder; 0: what the config says
  std::string device = "cpu";     ///< of several ranks on a machine "cuda" is the one with the number of the rank
  LaunchEnvironment environment;  ///< which of how many processes this one is
  RankOptions ranks;
  std::string command_line;  ///< for command.txt
};

/// One training run: reads the config, makes the run folder (config.json, command.txt, log.txt), the stage and the
/// trainer, and trains. Nobody else can train into the folder meanwhile (`run.lock`). As one of several ranks it joins
/// the others first, and tells them when it fails; the run folder is rank 0's, and all must see it. @throws as these
void train(const TrainCommand& command);

/// The config of a command with its overrides and its dataset: of --config, else of the output folder.
/// @param file set to the file it comes from, for messages
Json resolved_config(const TrainCommand& command, std::string& file);

/// Arguments of a config that all trainers share. @throws InputError
TrainerOptions trainer_options(const Json& config, const std::string& file);

enum class ConfigView {
  kSchema,  ///< JSON Schema of configs with the same models, dataset and trainer
  kFull     ///< the config itself with overrides and every default
};

/// Describes a run's config by reading it as train() does, up to where the dataset would be opened: nothing is built or
/// written. @throws InputError as train() about the config
Json describe_config(const TrainCommand& command, ConfigView view);

/// Settings under which a step on this device gives the same bits every time: on a GPU cuDNN's deterministic
/// algorithms, chosen by rule and not by the clock.
void make_deterministic(torch::Device device);

}  // namespace anigen::train
