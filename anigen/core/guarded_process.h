#pragma once
#include <cstdint>
#include <functional>
#include <string>

namespace anigen {

/// Limits of a guarded process; past one of them it is ended.
struct ProcessLimits {
  double cpu_seconds = 60.0;
  std::uint64_t more_memory =
      0;  ///< bytes of address space beyond what this process has; 0: as much as the machine has
};

/// Outcome of guarded work.
struct GuardedWork {
  bool finished = false;
  std::string result;   ///< what the work returned, when it finished
  std::string failure;  ///< else in words that follow "it ": "crashed (Segmentation fault)", "took more than 60 s …"
};

/// Runs work that may crash, hang or fill the memory, such as a library that parses a foreign file, in a copy of this
/// process (fork), so that this one goes on whatever happens. The copy has the calling thread alone: the work must not
/// wait for others, and so use neither parallel_for nor the log. What it changes in memory stays in the copy. An
/// exception that leaves it counts as a crash. The copy ends with its parent.
/// @throws Error when the system refuses a process
GuardedWork run_guarded(const std::function<std::string()>& work, const ProcessLimits& limits);

}  // namespace anigen
