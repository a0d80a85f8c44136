#include "anigen/studio/job_runner.h"

#include <algorithm>
#include <cstddef>
#include <exception>
#include <new>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/log.h"
#include "anigen/studio/job_work.h"

namespace anigen::studio {

namespace {

constexpr std::size_t kMostStages = 100;

}  // namespace

JobRunner::JobRunner(JobStore& store, Work work, std::size_t most_queued)
    : store_(store), work_(std::move(work)), most_queued_(most_queued) {
  for (const JobRecord& record : store_.list())
    if (record.state == JobState::kQueued) queues_[lane_of(record)].push_back(record.id);
  for (const Lane lane : {kImages, kMeshes}) threads_.emplace_back([this, lane] { work_through(lane); });
}

JobRunner::~JobRunner() { stop(); }

void JobRunner::stop() {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    stopping_ = true;
    for (auto& [id, running] : running_)
      if (running.job != nullptr) running.job->cancel();
  }
  changed_.notify_all();
  for (std::thread& thread : threads_) thread.join();
  threads_.clear();
}

bool JobRunner::has_place() const {
  std::size_t waiting = arriving_;
  for (const auto& queue : queues_) waiting += queue.size();
  return !stopping_ && waiting < most_queued_;
}

bool JobRunner::accepts() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  return has_place();
}

std::optional<JobRecord> JobRunner::submit(JobRecord record, const std::vector<InputFile>& files) {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (!has_place()) return std::nullopt;
    ++arriving_;
  }
  std::exception_ptr failure;
  JobRecord created;
  try {
    created = store_.create(std::move(record), files);
  } catch (...) {
    failure = std::current_exception();
  }
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    --arriving_;
    if (!failure) queues_[lane_of(created)].push_back(created.id);
  }
  if (failure) std::rethrow_exception(failure);
  changed_.notify_all();
  return created;
}

bool JobRunner::cancel(const std::string& id) {
  bool runs = false;
  std::optional<std::pair<Lane, std::size_t>> place;  // in a queue
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    const auto running = running_.find(id);
    if (running != running_.end()) {
      runs = running->second.cancelled = true;
      if (running->second.job != nullptr) running->second.job->cancel();
    }
    // Out of its queue first: a job that is being cancelled must not begin.
    for (const Lane lane : {kImages, kMeshes}) {
      auto& queue = queues_[lane];
      const auto found = std::find(queue.begin(), queue.end(), id);
      if (found == queue.end()) continue;
      place.emplace(lane, static_cast<std::size_t>(found - queue.begin()));
      queue.erase(found);
    }
  }
  if (!runs && !place) return false;
  bool ended = false;  // on disk, while its thread has not yet taken it from those that run
  try {
    // On disk, too, so that a studio that crashes meanwhile does not begin it again.
    store_.update(id, [&](JobRecord& record) {
      ended = has_ended(record.state);
      if (ended) return;
      record.cancelling = runs;
      if (runs) return;
      record.state = JobState::kCancelled;
      record.ended = seconds_now();
    });
  } catch (...) {
    if (place) wait_again(id, place->first, place->second);
    throw;
  }
  return !ended;
}

/// Puts a job back that was taken out of its queue.
void JobRunner::wait_again(const std::string& id, Lane lane, std::size_t place) {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    auto& queue = queues_[lane];
    queue.insert(queue.begin() + static_cast<std::ptrdiff_t>(std::min(place, queue.size())), id);
  }
  changed_.notify_all();
}

std::optional<JobRunner::Progress> JobRunner::progress(const std::string& id) const {
  const std::lock_guard<std::mutex> lock(mutex_);
  const auto found = running_.find(id);
  if (found == running_.end()) return std::nullopt;
  const Running& running = found->second;
  Progress progress;
  if (!running.stages.empty()) progress.stage = running.stages.back().first;
  progress.fraction = running.fraction;
  if (running.alike)
    progress.seconds_left =
        seconds_left(*running.alike, running.stages, running.fraction, seconds_now() - running.started);
  return progress;
}

void JobRunner::note(const std::string& id, const std::string& stage, double fraction) {
  const std::lock_guard<std::mutex> lock(mutex_);
  Running& running = running_[id];
  running.fraction = fraction;
  const bool goes_on = !running.stages.empty() && running.stages.back().first == stage;
  if (!goes_on && running.stages.size() < kMostStages)
    running.stages.emplace_back(stage, seconds_now() - running.started);
}

void JobRunner::work_through(Lane lane) {
  for (;;) {
    std::string id;
    {
      std::unique_lock<std::mutex> lock(mutex_);
      changed_.wait(lock, [&] { return stopping_ || !queues_[lane].empty(); });
      if (stopping_) return;
      id = queues_[lane].front();
      queues_[lane].pop_front();
      running_[id];  // from here on cancel() finds it among those that run
    }
    try {
      run(id);
    } catch (const std::exception& error) {
      log::error("job {}: {}", id, error.what());
      give_up(id, error.what());
    }
  }
}

/// Ends a job whose record the disk refused. While the studio stops it stays on disk as it is, for the next start.
void JobRunner::give_up(const std::string& id, const std::string& problem) {
  bool leaves = false;
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    leaves = stopping_;
  }
  if (!leaves) {
    store_.update_anyway(id, [&](JobRecord& record) {
      record.state = JobState::kFailed;
      record.error = as_utf8(problem);
      record.cancelling = false;
      record.ended = seconds_now();
    });
  }
  const std::lock_guard<std::mutex> lock(mutex_);
  running_.erase(id);
}

void JobRunner::run(const std::string& id) {
  Job job([this, &id](const std::string& stage, double fraction) { note(id, as_utf8(stage), fraction); });
  const std::optional<JobRecord> begun = store_.update(id, [](JobRecord& record) {
    record.state = JobState::kRunning;
    record.started = seconds_now();
    ++record.starts;
  });
  JobRecord outcome = begun.value();
  std::optional<Timeline> alike = timeline_alike(store_.list(), outcome);
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    Running& running = running_[id];
    running.job = &job;
    running.started = outcome.started;
    running.alike = std::move(alike);
    if (stopping_ || running.cancelled) job.cancel();
  }
  try {
    work_(store_.folder(id), job, outcome);
    outcome.state = JobState::kDone;
  } catch (const Interrupted&) {
    const std::lock_guard<std::mutex> lock(mutex_);
    // An interrupt of the process that stop() has not told of yet counts as one, too; one that was asked for comes
    // first.
    const bool ends = !running_[id].cancelled;
    outcome.state = ends ? JobState::kQueued : JobState::kCancelled;
    if (ends) --outcome.starts;
  } catch (const std::bad_alloc&) {
    outcome.state = JobState::kFailed;
    outcome.error = "out of memory";
  } catch (const std::exception& error) {
    outcome.state = JobState::kFailed;
    outcome.error = as_utf8(error.what());
  }
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    running_[id].job = nullptr;  // it does not outlive this function, even when finish() throws
  }
  finish(id, outcome);
}

void JobRunner::finish(const std::string& id, const JobRecord& outcome) {
  store_.update(id, [&](JobRecord& record) {
    record = outcome;
    record.cancelling = false;
    if (has_ended(record.state)) record.ended = seconds_now();
    const std::lock_guard<std::mutex> lock(mutex_);
    record.stages = running_[id].stages;
  });
  const std::lock_guard<std::mutex> lock(mutex_);
  running_.erase(id);
}

}  // namespace anigen::studio
