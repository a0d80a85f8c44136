#include "anigen/prepare/run/shard.h"

#include <charconv>
#include <cstdlib>

#include "anigen/core/error.h"

namespace anigen::prepare {
namespace {

/// @return nothing unless the whole text is a number
std::optional<std::size_t> number(const std::string& text) {
  std::size_t value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size() || text.empty()) return std::nullopt;
  return value;
}

std::optional<std::size_t> variable(const char* name) {
  const char* text = std::getenv(name);
  if (text == nullptr || *text == '\0') return std::nullopt;
  const std::optional<std::size_t> value = number(text);
  if (!value) throw InputError("", name, std::string("must be a number, got \"") + text + "\"");
  return value;
}

}  // namespace

Shard parse_shard(const std::string& text) {
  const std::size_t slash = text.find('/');
  if (slash != std::string::npos) {
    const auto index = number(text.substr(0, slash)), count = number(text.substr(slash + 1));
    if (index && count && *index < *count) return {*index, *count};
  }
  throw InputError("", "--shard", "must be i/n with 0 <= i < n, got \"" + text + "\"");
}

std::optional<Shard> slurm_shard() {
  const auto id = variable("SLURM_ARRAY_TASK_ID"), count = variable("SLURM_ARRAY_TASK_COUNT");
  if (!id || !count) return std::nullopt;
  if (*count == 1) {
    // One task of a larger array, sent again: which shard it was is not to be seen.
    throw InputError("", "SLURM_ARRAY_TASK_COUNT", "an array of one task: say --shard i/n (0/1 for everything)");
  }
  const std::size_t first = variable("SLURM_ARRAY_TASK_MIN").value_or(0);
  const std::size_t step = variable("SLURM_ARRAY_TASK_STEP").value_or(1);
  if (step == 0 || *id < first || (*id - first) % step != 0 || (*id - first) / step >= *count) {
    throw InputError("", "SLURM_ARRAY_TASK_ID",
                     std::to_string(*id) + " is not one of " + std::to_string(*count) + " tasks from " +
                         std::to_string(first) + " in steps of " + std::to_string(step) +
                         ": arrays with gaps need --shard");
  }
  return Shard{(*id - first) / step, *count};
}

}  // namespace anigen::prepare
