#include "anigen/train/tune.h"

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <filesystem>
#include <system_error>
#include <thread>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/log.h"
#include "anigen/core/process.h"
#include "anigen/core/run_folder.h"
#include "anigen/core/table.h"

namespace anigen::train {

namespace {

namespace fs = std::filesystem;

constexpr std::int64_t kWarmUp = 2, kTimed = 20;

std::string text_of(const StepSettings& settings) {
  return settings.precision + ", " + std::to_string(settings.replicas) +
         (settings.replicas == 1 ? " replica, " : " replicas, ") + std::to_string(settings.batch_split) +
         (settings.batch_split == 1 ? " micro-batch" : " micro-batches");
}

void set(Json& config, const StepSettings& settings) {
  Json& args = config["trainer"]["args"];
  args["replicas"] = settings.replicas;
  args["batch_split"] = settings.batch_split;
  args["precision"] = settings.precision;
}

// Last line of a trial's log that tells of an error.
std::string failure_in(const fs::path& log) {
  std::string text = read_file(log), last;
  for (std::size_t begin = 0; begin < text.size();) {
    const std::size_t end = std::min(text.find('\n', begin), text.size());
    const std::string line = text.substr(begin, end - begin);
    if (line.find("error") != std::string::npos) last = line;
    begin = end + 1;
  }
  return last.empty() ? "see " + log.string() : last;
}

// Trains a few steps in a process of its own, whose memory is its own, and which may run out of it.
TimedSettings time_in_process(const Json& config, const StepSettings& settings, const fs::path& folder,
                              const TrainCommand& command) {
  std::error_code ignored;
  fs::remove_all(folder, ignored);
  fs::create_directories(folder);
  Json trial = config;
  set(trial, settings);
  Json& args = trial["trainer"]["args"];
  args["max_steps"] = kWarmUp + kTimed;
  args["i_log"] = kWarmUp;
  for (const char* never : {"i_eval", "i_sample", "i_print", "i_ddpcheck"}) args[never] = 0;
  args["i_save"] = kWarmUp + kTimed;
  write_config(folder / "trial.json", trial);
  ChildProgram program;
  program.file = fs::read_symlink("/proc/self/exe").string();
  program.words = {"anigen-train",
                   "--config",
                   (folder / "trial.json").string(),
                   "--output",
                   folder.string(),
                   "--threads",
                   std::to_string(command.run.threads),
                   "--device",
                   command.device,
                   "--log-level",
                   "warn"};
  if (!command.run.load.empty()) program.words.insert(program.words.end(), {"--load", command.run.load.string()});
  program.log = folder / "trial.txt";
  TimedSettings timed;
  timed.settings = settings;
  ChildProcess process(program);
  std::optional<ChildProcess::End> end;
  while (!(end = process.poll())) {
    throw_if_interrupted();
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
  }
  timed.peak_bytes = end->peak_bytes;
  if (end->status != 0) {
    timed.failure = failure_in(program.log);
    return timed;
  }
  const CsvTable metrics = read_csv(RunFolder{folder}.metrics());
  std::vector<double> rates;
  for (std::size_t row = 1; row < metrics.rows.size(); ++row) {
    const std::string& cell = metrics.cell(row, "time.samples_per_s");
    if (!cell.empty()) rates.push_back(std::stod(cell));
  }
  if (rates.empty()) throw Error(RunFolder{folder}.metrics().string() + ": no times");
  // Other programs only make a step slower: the upper quartile is nearer to the truth than the mean.
  std::sort(rates.begin(), rates.end());
  timed.samples_per_second = rates[rates.size() * 3 / 4];
  fs::remove_all(folder, ignored);
  return timed;
}

}  // namespace

std::vector<TimedSettings> search_settings(std::size_t batch_size, int threads,
                                           const std::vector<std::string>& precisions,
                                           const std::function<TimedSettings(const StepSettings&)>& time) {
  std::vector<TimedSettings> all;
  for (const std::string& precision : precisions) {
    for (std::size_t replicas = 1; replicas <= std::min(batch_size, static_cast<std::size_t>(threads)); replicas *= 2) {
      double best = 0.0;
      bool hopeless = false;
      for (std::size_t split = replicas; split <= batch_size; split *= 2) {
        const TimedSettings& timed = all.emplace_back(time({replicas, split, precision}));
        // Settings that ran out of memory may work in smaller pieces; a stage without this precision, or without
        // replicas, has none of them in any.
        hopeless =
            timed.failure.find("recision") != std::string::npos || timed.failure.find("eplicas") != std::string::npos;
        if (hopeless || (best > 0.0 && timed.samples_per_second < best)) break;
        best = timed.samples_per_second;
      }
      if (hopeless) break;
    }
  }
  std::stable_sort(all.begin(), all.end(), [](const TimedSettings& a, const TimedSettings& b) {
    return a.samples_per_second > b.samples_per_second;
  });
  return all;
}

std::vector<TimedSettings> tune(const TrainCommand& command) {
  std::string file;
  Json config = resolved_config(command, file);
  const TrainerOptions options = trainer_options(config, file);
  const fs::path trials = command.run.output / "tune";
  std::size_t number = 0;
  const auto time = [&](const StepSettings& settings) {
    TimedSettings timed = time_in_process(config, settings, trials / ("trial-" + std::to_string(++number)), command);
    if (timed.failure.empty()) {
      log::info("{}: {:.2f} samples per second, {:.0f} MB", text_of(settings), timed.samples_per_second,
                static_cast<double>(timed.peak_bytes) / 1e6);
    } else {
      log::info("{}: {}", text_of(settings), timed.failure);
    }
    return timed;
  };
  const std::vector<TimedSettings> all =
      search_settings(options.batch_size, command.run.threads, {"fp32", "mixed", "bf16"}, time);
  if (all.empty() || all.front().samples_per_second <= 0.0)
    throw Error("no settings work; the first: " + (all.empty() ? std::string("none") : all.front().failure));
  set(config, all.front().settings);
  write_config(RunFolder{command.run.output}.config(), config);
  write_file_atomically(command.run.output / "tune.md", to_markdown(all));
  std::error_code ignored;
  fs::remove_all(trials, ignored);
  return all;
}

std::string to_markdown(const std::vector<TimedSettings>& timed) {
  std::string text = "| precision | replicas | micro-batches | samples/s | peak MB |\n|---|--:|--:|--:|--:|\n";
  for (const TimedSettings& row : timed) {
    char numbers[64];
    std::snprintf(numbers, sizeof numbers, "%.2f | %.0f", row.samples_per_second,
                  static_cast<double>(row.peak_bytes) / 1e6);
    text += "| " + row.settings.precision + " | " + std::to_string(row.settings.replicas) + " | " +
            std::to_string(row.settings.batch_split) + " | " +
            (row.failure.empty() ? numbers : "| failed: " + row.failure) + " |\n";
  }
  return text;
}

}  // namespace anigen::train
