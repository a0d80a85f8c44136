#pragma once
#include <memory>
#include <string>
#include <vector>

#include "anigen/core/config_reader.h"
#include "anigen/train/stage.h"
#include "anigen/train/trainer_options.h"

namespace anigen::train {

/// The stage that a config's trainer names.
/// @param trainer_name `trainer.name` @param trainer_args of which the stage reads its own; the caller calls finish()
/// @param trainer the options already read from them
/// @throws NotSupportedError naming the trainers there are; InputError as the stage's own make function
std::unique_ptr<Stage> make_stage(const std::string& trainer_name, const Json& config, const std::string& file,
                                  ConfigReader& trainer_args, const TrainerOptions& trainer, torch::Device device);

/// Names that make_stage() knows.
std::vector<std::string> trainer_names();

}  // namespace anigen::train
