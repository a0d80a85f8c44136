#include "anigen/prepare/run/executor.h"

#include <algorithm>
#include <cstdlib>
#include <map>
#include <optional>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/interrupt.h"
#include "anigen/core/parallel.h"
#include "anigen/prepare/run/worker_main.h"
#include "anigen/prepare/run/worker_pool.h"
#include "anigen/prepare/steps/prepare_source.h"

namespace anigen::prepare {
namespace {

class HereExecutor : public Executor {
 public:
  HereExecutor(const std::filesystem::path& out, const StepPlan& plan, const FeatureExtractorFactory& factory)
      : extractor_(make_extractor(plan, factory)), preparer_(out, plan, extractor_) {}

  void each(std::size_t n, const Task& task, const Take& take) override {
    const auto one = [&](std::size_t i) {
      if (interrupt_requested()) return;
      const std::optional<SourceTask> wanted = task(i);
      if (wanted) take(i, preparer_.prepare(*wanted, [](const StepBegin&) {}));
    };
    if (extractor_ == nullptr) {
      parallel_for(n, one);
    } else {
      for (std::size_t i = 0; i < n; ++i) one(i);  // an extractor takes one request at a time
    }
    if (interrupt_requested()) {
      throw Interrupted("interrupted: what was finished is kept, the same command goes on from there");
    }
  }

 private:
  std::shared_ptr<const FeatureExtractor> extractor_;
  SourcePreparer preparer_;
};

/// What to do when a worker died over a task: a crash that no limit explains may have come from outside (somebody's
/// kill, the kernel short of memory), so the step gets a second chance; after that, and for a limit at once, it counts
/// as failed and the rest of the task goes on without it.
class Undertaker {
 public:
  std::optional<Json> replace(const Json& old_task, const WorkerDeath& death) {
    SourceTask task = source_task_from_json(old_task);
    StepFailure failure;
    if (!death.at.is_null()) {
      death.at.at("asset").get_to(failure.id);
      death.at.at("variant").get_to(failure.variant);
      death.at.at("step").get_to(failure.step);
      death.at.at("fingerprint").get_to(failure.fingerprint);
    }
    failure.reason = task.source.file_identifier + ": " + death.reason;
    if (death.cause == WorkerDeath::Cause::kCrash && ++crashes_[{task.number, failure.id + failure.step}] < 2) {
      return old_task;
    }
    if (failure.step.empty()) return std::nullopt;  // not even identified
    task.known.push_back(std::move(failure));
    return to_json(task);
  }

 private:
  std::map<std::pair<std::size_t, std::string>, int> crashes_;
};

class WorkerExecutor : public Executor {
 public:
  WorkerExecutor(const std::filesystem::path& out, const StepPlan& plan, const RunOptions& options, std::size_t most)
      : pool_(pool_options(out, plan, options, most)) {}

  void each(std::size_t n, const Task& task, const Take& take) override {
    std::size_t next = 0;
    std::map<std::size_t, std::size_t> positions;  // of tasks that are out, by their number
    const auto settle = [&](std::size_t number, SourceOutcome outcome) {
      const auto found = positions.find(number);
      if (found == positions.end()) throw Error("a worker answered for a task it was not given");
      const std::size_t position = found->second;
      positions.erase(found);
      take(position, std::move(outcome));
    };
    PoolClient client;
    client.next = [&]() -> std::optional<Json> {
      while (next < n) {
        const std::size_t position = next++;
        const std::optional<SourceTask> one = task(position);
        if (!one) continue;
        positions[one->number] = position;
        return to_json(*one);
      }
      return std::nullopt;
    };
    client.done = [&](const Json& json, const Json& result) {
      settle(json.at("number").get<std::size_t>(), source_outcome_from_json(result));
    };
    client.died = [&](const Json& json, const WorkerDeath& death) {
      std::optional<Json> again = undertaker_.replace(json, death);
      if (again) return again;
      const SourceTask lost = source_task_from_json(json);
      const std::string reason = lost.source.file_identifier + ": " + death.reason;
      SourceOutcome outcome;
      outcome.number = lost.number;
      outcome.assets.emplace_back();
      outcome.assets[0].failures.push_back({lost.id, 0, kImport, "", reason, ""});
      settle(lost.number, std::move(outcome));
      return again;
    };
    pool_.run(client);
  }

 private:
  static PoolOptions pool_options(const std::filesystem::path& out, const StepPlan& plan, const RunOptions& options,
                                  std::size_t most) {
    const auto threads = static_cast<std::size_t>(std::max(1, thread_count()));
    PoolOptions pool;
    pool.command = options.worker_command;
    pool.workers = std::max<std::size_t>(1, std::min(options.workers > 0 ? options.workers : threads, most));
    pool.timeout = options.timeout;
    pool.memory_bytes = options.memory_bytes;
    WorkerSettings settings{out, plan, 1, options.log_level};
    settings.threads = static_cast<int>(std::max<std::size_t>(1, threads / pool.workers));
    pool.settings = to_json(settings);
    // Read by OpenMP when a worker loads it, before its first line of ours.
    ::setenv("OMP_NUM_THREADS", std::to_string(settings.threads).c_str(), 1);
    return pool;
  }

  WorkerPool pool_;
  Undertaker undertaker_;
};

}  // namespace

std::unique_ptr<Executor> make_executor(const std::filesystem::path& out, const StepPlan& plan,
                                        const RunOptions& options, std::size_t most) {
  if (options.worker_command.empty()) return std::make_unique<HereExecutor>(out, plan, options.features);
  return std::make_unique<WorkerExecutor>(out, plan, options, most);
}

}  // namespace anigen::prepare
