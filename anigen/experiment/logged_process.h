#pragma once
#include <sys/types.h>

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace anigen::experiment {

/// A program whose output goes to a log. It dies with its parent (Linux PR_SET_PDEATHSIG with SIGTERM, at which our
/// programs save and stop).
class LoggedProcess {
 public:
  struct End {
    int status = 0;                ///< exit status; -N: ended by signal N
    std::uint64_t peak_bytes = 0;  ///< most memory of it, or of a process it waited for
  };

  /// @param log output is appended
  /// @throws Error when the system refuses; a program that cannot be run ends with status 127
  LoggedProcess(const std::vector<std::string>& command, const std::filesystem::path& log);
  LoggedProcess(LoggedProcess&& other) noexcept;
  LoggedProcess& operator=(LoggedProcess&&) = delete;
  ~LoggedProcess();  ///< asks it to stop, and waits

  /// @return nothing while it still runs
  std::optional<End> poll();
  /// Asks it to save and stop, once; not when Ctrl-C reached it already, since a second signal would end it at once.
  void ask_to_stop();

 private:
  pid_t id_ = -1;
  bool asked_ = false;
};

/// The last line of a log that says something, at most so many characters; progress bars count as lines.
std::string last_line(const std::filesystem::path& log, std::size_t most = 100);

}  // namespace anigen::experiment
