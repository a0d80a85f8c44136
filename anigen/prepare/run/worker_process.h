#pragma once
#include <sys/types.h>

#include <cstdint>
#include <string>
#include <vector>

namespace anigen::prepare {

/// A child process that is spoken to in lines: one goes to its standard input, lines come back from its standard
/// output; its standard error is ours. It dies with its parent (Linux PR_SET_PDEATHSIG) and inherits no other open
/// file. Start it from the main thread: the kernel ties it to the thread that did.
class WorkerProcess {
 public:
  /// @param command program and arguments @throws Error when the system refuses a pipe or a process; a program that
  /// cannot be run shows as a worker that ended with status 127
  explicit WorkerProcess(const std::vector<std::string>& command);
  ~WorkerProcess();  ///< kills it when it still runs
  WorkerProcess(const WorkerProcess&) = delete;
  WorkerProcess& operator=(const WorkerProcess&) = delete;

  pid_t id() const { return id_; }
  int output() const { return output_; }  ///< to poll

  /// @return false when the worker is gone
  bool send(const std::string& line);
  /// Takes what is there without waiting for more. @return complete lines; `ended` is set at end of file
  std::vector<std::string> receive(bool& ended);
  /// Memory that the worker and the processes it started (run_guarded) have in RAM, bytes; 0 when it cannot be told.
  std::uint64_t resident_bytes() const;
  /// Ends it at once. A worker writes files by rename only, so this leaves nothing half-done under a final name.
  void kill();
  /// Waits for the end. @return how it ended, in words: "ended with status 3", "was ended by signal 11 (Segmentation
  /// fault)"
  std::string wait();

 private:
  pid_t id_ = -1;
  int input_ = -1, output_ = -1;
  std::string unread_;
};

}  // namespace anigen::prepare
