#pragma once
#include <condition_variable>
#include <deque>
#include <functional>
#include <future>
#include <mutex>
#include <thread>

namespace anigen::train {

/// A thread that does jobs one after another, in the order in which they were given.
class SerialThread {
 public:
  SerialThread();
  /// Waits for the jobs that were given.
  ~SerialThread();
  SerialThread(const SerialThread&) = delete;
  SerialThread& operator=(const SerialThread&) = delete;

  /// @return ready when the job is done; holds what it threw
  std::future<void> give(std::function<void()> job);

 private:
  void work();

  std::mutex mutex_;
  std::condition_variable given_;
  std::deque<std::packaged_task<void()>> jobs_;
  bool stop_ = false;
  std::thread thread_;
};

}  // namespace anigen::train
