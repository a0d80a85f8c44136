#pragma once
#include <atomic>
#include <functional>
#include <mutex>
#include <string>
#include <utility>

namespace anigen {

/// One piece of work that its caller watches and may cancel, such as a request to a server. Work runs for a job between
/// the two ends of a JobScope; until then progress goes to standard error and only a signal interrupts.
class Job {
 public:
  /// @param stage such as "binding" @param fraction done of this stage, 0 … 1
  using Watch = std::function<void(const std::string& stage, double fraction)>;

  /// @param watch called from any thread, one call at a time, at most twenty times a second and at the end of a stage;
  /// what it throws cancels the job
  explicit Job(Watch watch = nullptr) : watch_(std::move(watch)) {}
  Job(const Job&) = delete;
  Job& operator=(const Job&) = delete;

  /// Ends the work at the next safe point, where it throws Interrupted. From any thread, at any time.
  void cancel() noexcept { cancelled_ = true; }
  bool cancelled() const noexcept { return cancelled_; }

  /// For those who do the work.
  void report(const std::string& stage, double fraction) noexcept;

 private:
  Watch watch_;
  std::mutex mutex_;
  std::atomic<bool> cancelled_{false};
};

/// Makes a job the one that this thread works for, and with it the threads of parallel_for().
class JobScope {
 public:
  /// @param job null: none. It outlives the scope
  explicit JobScope(Job* job);
  ~JobScope();
  JobScope(const JobScope&) = delete;
  JobScope& operator=(const JobScope&) = delete;

 private:
  Job* before_;
};

/// Null without one.
Job* current_job();

}  // namespace anigen
