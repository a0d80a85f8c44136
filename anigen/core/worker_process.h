#pragma once
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "anigen/core/config.h"
#include "anigen/core/process.h"

namespace anigen {

/// Writes all bytes to a file descriptor. @return false when nobody reads any more
bool write_all(int descriptor, std::string_view bytes);

/// A child process that is spoken to in lines: one goes to its standard input, lines come back from its standard
/// output; its standard error is ours. It dies with its parent (core/process.h).
class WorkerProcess {
 public:
  /// @param command program and arguments @param own_group as in ChildProgram @throws Error when the system refuses a
  /// pipe or a process; a program that cannot be run shows as a worker that ended with status 127
  explicit WorkerProcess(const std::vector<std::string>& command, bool own_group = false);

  pid_t id() const { return child_.id(); }        ///< -1 after its end was seen
  int output() const { return child_.output(); }  ///< to poll

  /// @return false when the worker is gone
  bool send(const std::string& line) { return write_all(child_.input(), line + "\n"); }
  /// Takes what is there without waiting for more. @return complete lines; `ended` is set at end of file
  std::vector<std::string> receive(bool& ended);
  /// Memory that the worker and the processes it started (run_guarded) have in RAM, bytes; 0 when it cannot be told.
  std::uint64_t resident_bytes() const;
  /// Ends it at once. A worker writes files by rename only, so this leaves nothing half-done under a final name.
  void kill() { child_.send(SIGKILL); }
  /// Waits for the end. @return how it ended, in words: "ended with status 3", "was ended by signal 11 (Segmentation
  /// fault)"
  std::string wait();

 private:
  ChildProcess child_;  ///< killed when it still runs
  std::string unread_;
};

/// The worker's side: writes messages to what was standard output, which now is standard error for everybody else.
class WorkerMessages {
 public:
  WorkerMessages();
  ~WorkerMessages();
  WorkerMessages(const WorkerMessages&) = delete;
  WorkerMessages& operator=(const WorkerMessages&) = delete;

  /// One line. The process ends with status 1 when nobody listens any more.
  void send(const Json& message) const;

 private:
  int descriptor_;
};

}  // namespace anigen
