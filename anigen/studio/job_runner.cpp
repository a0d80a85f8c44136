#include "anigen/studio/job_runner.h"

#include <algorithm>
#include <exception>
#include <new>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/log.h"
#include "anigen/studio/job_work.h"

namespace anigen::studio {

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

std::optional<JobRecord> JobRunner::submit(JobRecord record, const std::string& extension, std::string_view input) {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    std::size_t waiting = arriving_;
    for (const auto& queue : queues_) waiting += queue.size();
    if (stopping_ || waiting >= most_queued_) return std::nullopt;
    ++arriving_;
  }
  std::exception_ptr failure;
  JobRecord created;
  try {
    created = store_.create(std::move(record), extension, input);
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
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    const auto running = running_.find(id);
    if (running != running_.end()) {
      running->second.cancelled = true;
      if (running->second.job != nullptr) running->second.job->cancel();
      return true;
    }
    bool waited = false;
    for (auto& queue : queues_) {
      const auto place = std::find(queue.begin(), queue.end(), id);
      if (place == queue.end()) continue;
      queue.erase(place);
      waited = true;
    }
    if (!waited) return false;
  }
  store_.update(id, [](JobRecord& record) {
    record.state = JobState::kCancelled;
    record.ended = seconds_now();
  });
  return true;
}

std::optional<JobRunner::Progress> JobRunner::progress(const std::string& id) const {
  const std::lock_guard<std::mutex> lock(mutex_);
  const auto found = running_.find(id);
  if (found == running_.end()) return std::nullopt;
  return found->second.progress;
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
      // The disk refused its record; the job stays as it is there, and the next start takes it up.
      log::error("job {}: {}", id, error.what());
      const std::lock_guard<std::mutex> lock(mutex_);
      running_.erase(id);
    }
  }
}

void JobRunner::run(const std::string& id) {
  Job job([this, &id](const std::string& stage, double fraction) {
    const std::lock_guard<std::mutex> lock(mutex_);
    running_[id].progress = {stage, fraction};
  });
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    running_[id].job = &job;
    if (stopping_ || running_[id].cancelled) job.cancel();
  }
  const std::optional<JobRecord> begun = store_.update(id, [](JobRecord& record) {
    record.state = JobState::kRunning;
    record.started = seconds_now();
    ++record.starts;
  });
  JobRecord outcome = begun.value();
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
  finish(id, outcome);
}

void JobRunner::finish(const std::string& id, const JobRecord& outcome) {
  store_.update(id, [&](JobRecord& record) {
    record = outcome;
    if (has_ended(record.state)) record.ended = seconds_now();
  });
  const std::lock_guard<std::mutex> lock(mutex_);
  running_.erase(id);
}

}  // namespace anigen::studio
