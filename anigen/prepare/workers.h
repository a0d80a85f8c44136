#pragma once
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
#include "anigen/prepare/run.h"

namespace anigen::prepare {

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
  explicit WorkerPool(PoolOptions options);
  ~WorkerPool();

  /// Works until there are no tasks left; workers stay for another call. @throws Interrupted after Ctrl-C, InputError
  /// or Error for a fatal message, Error when workers keep dying before their first task
  void run(const PoolClient& client);

 private:
  struct Worker;
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
ANIGEN_JSON_RECORD(WorkerSettings, out, plan, threads, log_level)

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
