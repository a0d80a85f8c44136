#include "anigen/prepare/workers.h"

#include <poll.h>
#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <iostream>
#include <map>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/log.h"
#include "anigen/core/parallel.h"
#include "anigen/core/process.h"
#include "anigen/core/table.h"
#include "anigen/core/worker_process.h"
#include "anigen/prepare/prepare_source.h"

namespace anigen::prepare {

namespace {

void stop_if_interrupted() {
  if (!interrupt_requested()) return;
  throw Interrupted("interrupted: what was finished is kept, the same command goes on from there");
}

/// Interval between checks of memory and time. A worker that allocates 4 GB/s overshoots its budget by 100 MB.
constexpr int kWatchMilliseconds = 25;
constexpr std::size_t kMostStillborn = 3;

void work(const FeatureExtractorFactory& factory, const WorkerMessages& messages) {
  std::string line;
  if (!std::getline(std::cin, line)) return;
  const auto settings = parse_json(line, "settings of a worker").get<WorkerSettings>();
  log::setup(settings.log_level);
  Progress::set_quiet(true);
  set_thread_count(settings.threads);
  const SourcePreparer preparer(settings.out, settings.plan, make_extractor(settings.plan, factory));
  messages.send({{"event", "ready"}});
  const auto observe = [&](const StepBegin& at) {
    messages.send({{"event", "step"},
                   {"asset", at.id},
                   {"variant", at.variant},
                   {"step", at.step},
                   {"fingerprint", at.fingerprint}});
  };
  while (std::getline(std::cin, line)) {
    const auto task = parse_json(line, "task of a worker").get<SourceTask>();
    messages.send({{"event", "done"}, {"result", preparer.prepare(task, observe)}});
  }
}

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
    stop_if_interrupted();
  }

 private:
  std::shared_ptr<const FeatureExtractor> extractor_;
  SourcePreparer preparer_;
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
        return Json(*one);
      }
      return std::nullopt;
    };
    client.done = [&](const Json& json, const Json& result) {
      settle(json.at("number").get<std::size_t>(), result.get<SourceOutcome>());
    };
    client.died = [&](const Json& json, const WorkerDeath& death) {
      std::optional<Json> again = task_after(json, death);
      if (again) return again;
      const auto lost = json.get<SourceTask>();
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
  /// Task in place of one over which a worker died: a crash that no limit explains may have come from outside
  /// (somebody's kill, the kernel short of memory), so the step gets a second chance; after that, and for a limit at
  /// once, it counts as failed and the rest of the task goes on without it.
  std::optional<Json> task_after(const Json& old_task, const WorkerDeath& death) {
    auto task = old_task.get<SourceTask>();
    StepFailure failure;
    if (!death.at.is_null()) {
      death.at.at("asset").get_to(failure.id);
      death.at.at("variant").get_to(failure.variant);
      death.at.at("step").get_to(failure.step);
      death.at.at("fingerprint").get_to(failure.fingerprint);
    }
    failure.reason = task.source.file_identifier + ": " + death.reason;
    if (death.cause == WorkerDeath::Cause::kCrash && ++crashes_[{task.number, failure.id + failure.step}] < 2)
      return old_task;
    if (failure.step.empty()) return std::nullopt;  // not even identified
    task.known.push_back(std::move(failure));
    return Json(task);
  }

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
    pool.settings = settings;
    // Read by OpenMP when a worker loads it, before its first line of ours.
    ::setenv("OMP_NUM_THREADS", std::to_string(settings.threads).c_str(), 1);
    return pool;
  }

  WorkerPool pool_;
  std::map<std::pair<std::size_t, std::string>, int> crashes_;  ///< by number of the task, asset and step
};

}  // namespace

using Clock = std::chrono::steady_clock;

struct WorkerPool::Worker {
  std::unique_ptr<WorkerProcess> process;
  std::optional<Json> task;
  Json at;
  Clock::time_point since;  ///< when the current asset began
  bool ready = false;
  std::optional<WorkerDeath::Cause> killed;
};

WorkerPool::WorkerPool(PoolOptions options)
    : options_(std::move(options)), workers_(options_.workers > 0 ? options_.workers : 1) {}

WorkerPool::~WorkerPool() = default;

void WorkerPool::start(Worker& worker) {
  worker = Worker{};
  worker.process = std::make_unique<WorkerProcess>(options_.command);
  worker.process->send(options_.settings.dump());
}

void WorkerPool::give(Worker& worker, const PoolClient& client) {
  std::optional<Json> task;
  if (!again_.empty()) {
    task = std::move(again_.front());
    again_.pop_front();
  } else if (!exhausted_) {
    task = client.next();
    exhausted_ = !task;
  }
  if (!task) return;
  if (!worker.process) start(worker);
  worker.task = std::move(task);
  worker.at = nullptr;
  worker.since = Clock::now();
  worker.process->send(worker.task->dump());  // when it is gone, its end of file tells
}

void WorkerPool::check_limits(Worker& worker) {
  if (!worker.process || !worker.task || worker.killed) return;
  const double elapsed = std::chrono::duration<double>(Clock::now() - worker.since).count();
  if (options_.timeout > 0 && !worker.ready && elapsed > options_.timeout) {
    worker.process->kill();  // stuck while starting, which bury() counts
  } else if (options_.timeout > 0 && worker.ready && elapsed > options_.timeout) {
    worker.killed = WorkerDeath::Cause::kTimeout;
  } else if (options_.memory_bytes > 0 && worker.process->resident_bytes() > options_.memory_bytes) {
    worker.killed = WorkerDeath::Cause::kMemory;
  }
  if (worker.killed) worker.process->kill();
}

void WorkerPool::handle(Worker& worker, const Json& message, const PoolClient& client) {
  const std::string event = message.at("event").get<std::string>();
  if (event == "ready") {
    worker.ready = true;
    worker.since = Clock::now();
    stillborn_ = 0;
  } else if (event == "step") {
    if (worker.at.is_null() || worker.at.at("asset") != message.at("asset")) worker.since = Clock::now();
    worker.at = message;
  } else if (event == "done") {
    if (!worker.task) throw Error("a worker answered without a task");
    const Json task = std::move(*worker.task);
    worker.task.reset();
    client.done(task, message.at("result"));
  } else if (event == "fatal") {
    const std::string text = message.at("message").get<std::string>();
    if (message.at("bad_input").get<bool>()) throw InputError("", "", text);
    throw Error(text);
  } else {
    throw Error("a worker sent an unknown event \"" + event + "\"");
  }
}

void WorkerPool::bury(Worker& worker, const PoolClient& client) {
  const std::string end = worker.process->wait();
  const bool ready = worker.ready;
  WorkerDeath death;
  death.at = worker.at;
  if (worker.killed == WorkerDeath::Cause::kTimeout) {
    death = {*worker.killed, "took longer than " + significant(options_.timeout, 6) + " s (--asset-timeout)",
             worker.at};
  } else if (worker.killed == WorkerDeath::Cause::kMemory) {
    death = {*worker.killed, "needed more than " + std::to_string(options_.memory_bytes >> 20) + " MB (--memory-mb)",
             worker.at};
  } else {
    death.reason = "the worker " + end;
  }
  std::optional<Json> task = std::move(worker.task);
  worker = Worker{};
  if (!ready && !(task && death.cause != WorkerDeath::Cause::kCrash)) {
    // It never got to the task: that says nothing about the asset, and trying for ever would hang.
    if (++stillborn_ >= kMostStillborn) throw Error("workers cannot start: the last one " + end);
    if (task) again_.push_front(std::move(*task));
    return;
  }
  if (!task) return;
  if (std::optional<Json> other = client.died(*task, death)) again_.push_front(std::move(*other));
}

void WorkerPool::run(const PoolClient& client) {
  exhausted_ = false;
  for (;;) {
    stop_if_interrupted();
    std::vector<pollfd> watched;
    std::vector<Worker*> owners;
    for (Worker& worker : workers_) {
      if (!worker.task) give(worker, client);
      if (!worker.task) continue;
      watched.push_back({worker.process->output(), POLLIN, 0});
      owners.push_back(&worker);
    }
    if (owners.empty()) return;
    ::poll(watched.data(), watched.size(), kWatchMilliseconds);
    for (std::size_t i = 0; i < owners.size(); ++i) {
      Worker& worker = *owners[i];
      check_limits(worker);
      if (watched[i].revents == 0) continue;
      bool ended = false;
      const std::vector<std::string> lines = worker.process->receive(ended);
      for (const std::string& line : lines) {
        if (worker.killed) break;  // judged already; a "done" that came late must not count twice
        handle(worker, parse_json(line, "message of a worker"), client);
      }
      if (ended) bury(worker, client);
    }
  }
}

int run_worker(const FeatureExtractorFactory& factory) {
  const WorkerMessages messages;
  try {
    work(factory, messages);
    return 0;
  } catch (const std::exception& error) {
    const bool bad_input = dynamic_cast<const InputError*>(&error) != nullptr;
    messages.send({{"event", "fatal"}, {"message", error.what()}, {"bad_input", bad_input}});
    return bad_input ? 2 : 1;
  }
}

std::unique_ptr<Executor> make_executor(const std::filesystem::path& out, const StepPlan& plan,
                                        const RunOptions& options, std::size_t most) {
  if (options.worker_command.empty()) return std::make_unique<HereExecutor>(out, plan, options.features);
  return std::make_unique<WorkerExecutor>(out, plan, options, most);
}

}  // namespace anigen::prepare
