#pragma once
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "anigen/core/json.h"
#include "anigen/prepare/run/worker_process.h"

namespace anigen::prepare {

struct PoolOptions {
  std::vector<std::string> command;  ///< of one worker
  Json settings;                     ///< its first line
  std::size_t workers = 1;
  double timeout = 0;              ///< seconds for one asset; 0: none
  std::uint64_t memory_bytes = 0;  ///< resident, per worker; 0: no limit
};

/// What a worker was doing when it died.
struct WorkerDeath {
  enum class Cause { kTimeout, kMemory, kCrash };
  Cause cause = Cause::kCrash;
  std::string reason;  ///< a sentence for the failure log
  Json at;             ///< the last "step" message of the task; null when there was none
};

/// What the pool asks of its owner. All calls come from the thread that called run().
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

}  // namespace anigen::prepare
