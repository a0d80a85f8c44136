#pragma once
#include <condition_variable>
#include <cstddef>
#include <deque>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "anigen/core/job.h"
#include "anigen/studio/job_store.h"
#include "anigen/studio/time_left.h"

namespace anigen::studio {

/// Runs the jobs of a store: generations one by one, all others one by one beside them, in the order they came.
class JobRunner {
 public:
  /// Does one job: writes files into its folder, and note and result into the record.
  using Work = std::function<void(const std::filesystem::path& folder, Job& job, JobRecord& record)>;

  struct Progress {
    std::string stage;
    double fraction = 0.0;               ///< of the stage
    std::optional<double> seconds_left;  ///< nothing: not known
  };

  /// Starts the queued jobs of the store. @param store outlives the runner @param most_queued further ones are refused
  JobRunner(JobStore& store, Work work, std::size_t most_queued = 64);
  ~JobRunner();  ///< as stop()
  JobRunner(const JobRunner&) = delete;
  JobRunner& operator=(const JobRunner&) = delete;

  /// Accepts a job as JobStore::create() does. @return nothing when the queue is full @throws WriteError
  std::optional<JobRecord> submit(JobRecord record, const std::vector<InputFile>& files);
  /// It takes a job now: it is not stopping, and its queue not full.
  bool accepts() const;
  std::size_t most_queued() const { return most_queued_; }
  /// Cancels a job that waits or runs, which ends at the next safe point. @return false when it has ended, or there is
  /// none @throws WriteError when the disk refuses: a job that waits goes on waiting
  bool cancel(const std::string& id);
  /// Of a running job.
  std::optional<Progress> progress(const std::string& id) const;

  /// Ends the work: running jobs are interrupted and wait on disk for the next start.
  void stop();

 private:
  enum Lane { kImages, kMeshes, kLanes };

  struct Running {
    Job* job = nullptr;      ///< null before and after its work
    bool cancelled = false;  ///< perhaps before its work
    double started = 0.0;    ///< seconds since 1970
    double fraction = 0.0;
    std::vector<std::pair<std::string, double>> stages;  ///< as JobRecord::stages
    std::optional<Timeline> alike;
  };

  static Lane lane_of(const JobRecord& record) { return record.kind == "generation" ? kImages : kMeshes; }
  bool has_place() const;
  void note(const std::string& id, const std::string& stage, double fraction);
  void work_through(Lane lane);
  void run(const std::string& id);
  void finish(const std::string& id, const JobRecord& outcome);
  void give_up(const std::string& id, const std::string& problem);
  void wait_again(const std::string& id, Lane lane, std::size_t place);

  JobStore& store_;
  Work work_;
  std::size_t most_queued_;
  mutable std::mutex mutex_;
  std::condition_variable changed_;
  std::deque<std::string> queues_[kLanes];
  std::size_t arriving_ = 0;  ///< accepted and not yet queued
  std::map<std::string, Running> running_;
  bool stopping_ = false;
  std::vector<std::thread> threads_;
};

}  // namespace anigen::studio
