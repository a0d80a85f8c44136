#include "anigen/prepare/run/worker_pool.h"

#include <poll.h>

#include <algorithm>
#include <cstdio>

#include "anigen/core/error.h"
#include "anigen/core/interrupt.h"

namespace anigen::prepare {
namespace {

/// How often memory and time are looked at. A worker that allocates 4 GB/s overshoots its budget by 100 MB.
constexpr int kWatchMilliseconds = 25;
constexpr std::size_t kMostStillborn = 3;

std::string seconds_text(double seconds) {
  char text[32];
  std::snprintf(text, sizeof text, "%g", seconds);
  return text;
}

}  // namespace

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
    death = {*worker.killed, "took longer than " + seconds_text(options_.timeout) + " s (--timeout)", worker.at};
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
    if (interrupt_requested()) {
      throw Interrupted("interrupted: what was finished is kept, the same command goes on from there");
    }
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

}  // namespace anigen::prepare
