#include "anigen/experiment/resources.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "anigen/core/error.h"

namespace anigen::experiment {
namespace {

constexpr int kMost = 1 << 16;

/// Whether several processes of a program, called alike, divide the work.
bool shares_its_work(const std::string& program, const std::string& word, const Json& arguments) {
  if (program == "anigen-encode") return word != "reconstruct";
  if (program == "anigen-eval") return arguments.contains("--pred");
  return program == "anigen-prepare" || program == "anigen-generate";
}

/// As sbatch takes it, to the next minute.
std::string time_text(double hours) {
  const long minutes = std::max(1L, static_cast<long>(std::ceil(hours * 60)));
  char text[32];
  std::snprintf(text, sizeof text, "%ld:%02ld:00", minutes / 60, minutes % 60);
  return text;
}

}  // namespace

Resources read_resources(ConfigReader& step, const std::string& program, const std::string& word,
                         const Json& arguments) {
  Resources resources;
  if (!step.has("resources")) return resources;
  ConfigReader reader = step.object("resources");
  const auto count = [&](const char* key, int least) {
    return static_cast<int>(reader.integer(key, least, least, kMost));
  };
  resources.workers = count("workers", 1);
  resources.cpus = count("cpus", 0);
  resources.gpus = count("gpus", 0);
  resources.memory_gb = reader.number("memory_gb", 0, 0);
  resources.hours = reader.number("hours", 0, 0);
  resources.partition = reader.text("partition", "");
  if (resources.partition.find_first_not_of("abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_-.,") !=
      std::string::npos)
    throw reader.error("partition", "names of partitions are made of letters, digits, '_', '-' and '.'");
  if (resources.workers > 1 && !shares_its_work(program, word, arguments))
    throw reader.error("workers", program + (word.empty() ? "" : " " + word) + " does not share this work");
  reader.finish();
  return resources;
}

std::string sbatch_lines(const Resources& resources) {
  std::string lines;
  const auto add = [&](const std::string& option, const std::string& value) {
    lines += "#SBATCH --" + option + "=" + value + "\n";
  };
  if (!resources.partition.empty()) add("partition", resources.partition);
  if (resources.cpus > 0) add("cpus-per-task", std::to_string(resources.cpus));
  if (resources.gpus > 0) add("gpus-per-node", std::to_string(resources.gpus));
  if (resources.memory_gb > 0)
    add("mem", std::to_string(static_cast<long>(std::ceil(resources.memory_gb * 1024))) + "M");
  if (resources.hours > 0) add("time", time_text(resources.hours));
  return lines;
}

}  // namespace anigen::experiment
