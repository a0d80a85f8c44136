#pragma once
#include <cstddef>
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "anigen/train/train_command.h"

namespace anigen::train {

/// A way to compute a step of given samples: speed and memory depend on it, and the last bits of the result.
struct StepSettings {
  std::size_t replicas = 1, batch_split = 1;
  std::string precision = "fp32";
};

/// Settings and the measurement of them.
struct TimedSettings {
  StepSettings settings;
  double samples_per_second = 0.0;  ///< 0: failed
  std::uint64_t peak_bytes = 0;
  std::string failure;  ///< reason of the failure, such as a precision that the stage lacks
};

/// Looks for the fastest settings: for each precision and each number of replicas (1, 2, 4 … up to the threads) it
/// begins with one micro-batch per replica and doubles their number for as long as that makes a step faster.
/// @param batch_size samples of a step @param time measures, and is called for no settings twice
/// @return all that were timed, fastest first
std::vector<TimedSettings> search_settings(std::size_t batch_size, int threads,
                                           const std::vector<std::string>& precisions,
                                           const std::function<TimedSettings(const StepSettings&)>& time);

/// `anigen-train --tune`: trains 22 steps with each of the settings, in a process of its own below `<output>/tune`, and
/// takes the first two steps as warm-up. Writes the fastest to the output's config.json, where a run of this folder
/// begins, and the table to `<output>/tune.md`. The output may hold a run already: it goes on with the new settings.
/// @return the table, fastest first
/// @throws InputError as train() about the config; Error when no settings work, Interrupted after Ctrl-C
std::vector<TimedSettings> tune(const TrainCommand& command);

/// Table of settings, samples per second and memory, in Markdown.
std::string to_markdown(const std::vector<TimedSettings>& timed);

}  // namespace anigen::train
