#pragma once
#include <string>
#include <utility>
#include <vector>

#include "anigen/train/train_command.h"
#include "tests/support/paths.h"

namespace anigen::test {

/// A run of the config and the dataset in a folder ("config.json", "data") into another folder below it.
inline train::TrainCommand train_command(const TemporaryFolder& folder, const std::string& output,
                                         std::vector<std::string> overrides = {}) {
  train::TrainCommand command;
  command.config = folder / "config.json";
  command.data_dir = (folder / "data").string();
  command.run.output = folder / output;
  command.overrides = std::move(overrides);
  command.command_line = "anigen-train";
  return command;
}

}  // namespace anigen::test
