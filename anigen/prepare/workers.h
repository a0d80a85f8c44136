#pragma once
#include <sys/types.h>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "anigen/core/config.h"
#include "anigen/core/process.h"
#include "anigen/prepare/metadata.h"
#include "anigen/prepare/prepare_source.h"
#include "anigen/prepare/run.h"
#include "anigen/prepare/steps.h"

namespace anigen::prepare {

/// A child process that is spoken to in lines: one goes to its standard input, lines come back from its standard
/// output; its standard error is ours. It dies with its parent (core/process.h).
class WorkerProcess {
 public:
  /// @param command program and arguments @throws Error when the system refuses a pipe or a process; a program that
  /// cannot be run shows as a worker that ended with status 127
  explicit WorkerProcess(const std::vector<std::string>& command);

  pid_t id() const { return child_.id(); }
  int output() const { return child_.output(); }  ///< to poll

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
  ChildProcess child_;  ///< killed when it still runs
  std::string unread_;
};

struct PoolOptions {
  std::vector<std::string> command;  ///< of one worker
  Json settings;                     ///< its first line
  std::size_t workers = 1;
  double timeout = 0;              ///< seconds for one asset; 0: none
  std::uint64_t memory_bytes = 0;  ///< resident, per worker; 0: no limit
};

/// Activity of a worker when it died.
struct WorkerDeath {
  enum class Cause { kTimeout, kMemory, kCrash };
  Cause cause = Cause::kCrash;
  std::string reason;  ///< a sentence for the failure log
  Json at;             ///< the last "step" message of the task; null when there was none
};

/// Callbacks of the pool to its owner. All calls come from the thread that called run().
struct PoolClient {
  /// The next task, or null when there is none left.
  std::function<std::optional<Json>()> next;
  /// A finished task with the worker's answer.
  std::function<void(const Json& task, const Json& result)> done;
  /// A task whose worker died. @return a task to do in its place, or null to give it up
  std::function<std::optional<Json>(const Json& task, const WorkerDeath& death)> died;
};

/// Several worker processes that are each given one task at a time. A worker that takes too long over one asset, grows
/// too large, or crashes is replaced by a new one, and the rest goes on.
///
/// Lines, all JSON: to a worker its settings and then tasks; from it {"event": "ready"}, {"event": "step", "asset": …}
/// before each step (another asset restarts the clock), {"event": "done", "result": …}, or {"event": "fatal",
/// "message": …, "bad_input": …} for what ends the whole run.
class WorkerPool {
 public:
  explicit WorkerPool(PoolOptions options)
      : options_(std::move(options)), workers_(options_.workers > 0 ? options_.workers : 1) {}

  /// Works until there are no tasks left; workers stay for another call. @throws Interrupted after Ctrl-C, InputError
  /// or Error for a fatal message, Error when workers keep dying before their first task
  void run(const PoolClient& client);

 private:
  using Clock = std::chrono::steady_clock;
  struct Worker {
    std::unique_ptr<WorkerProcess> process;
    std::optional<Json> task;
    Json at;
    Clock::time_point since;  ///< when the current asset began
    bool ready = false;
    std::optional<WorkerDeath::Cause> killed;
  };

  void start(Worker& worker);
  void give(Worker& worker, const PoolClient& client);
  void check_limits(Worker& worker);
  void handle(Worker& worker, const Json& message, const PoolClient& client);
  void bury(Worker& worker, const PoolClient& client);

  PoolOptions options_;
  std::vector<Worker> workers_;
  std::deque<Json> again_;
  bool exhausted_ = false;
  std::size_t stillborn_ = 0;  ///< workers in a row that died before they were ready
};

/// The first line a worker gets.
struct WorkerSettings {
  std::filesystem::path out;
  StepPlan plan;
  int threads = 1;
  std::string log_level = "warn";
};
Json to_json(const WorkerSettings& settings);
WorkerSettings worker_settings_from_json(const Json& json);

/// The whole life of a worker process: settings, then tasks from standard input, messages to standard output, until
/// the input ends (see WorkerPool). Anything that libraries print goes to standard error.
/// @param factory makes the feature extractor; only called when the plan wants features. May be empty
/// @return exit status
int run_worker(const FeatureExtractorFactory& factory);

/// Sends tasks somewhere and hands their outcomes in, in any order.
class Executor {
 public:
  /// Asked when there is room for one more. Nothing: it is not for us.
  using Task = std::function<std::optional<SourceTask>(std::size_t)>;
  using Take = std::function<void(std::size_t, SourceOutcome)>;

  virtual ~Executor() = default;
  /// task(i), and take(i, its outcome) where there is a task, for every i in [0, n). Both may be called from several
  /// threads.
  virtual void each(std::size_t n, const Task& task, const Take& take) = 0;
};

/// Worker processes when the options have a command for them, else the threads of this process.
/// @param most how many tasks there will be at most
std::unique_ptr<Executor> make_executor(const std::filesystem::path& out, const StepPlan& plan,
                                        const RunOptions& options, std::size_t most);

}  // namespace anigen::prepare
