#pragma once
#include <condition_variable>
#include <cstddef>
#include <exception>
#include <functional>
#include <mutex>
#include <thread>
#include <vector>

namespace anigen::train {

/// A few threads that repeat the same job over and over, each with its own number of LibTorch threads: small models
/// gain far more from working on two micro-batches at once than from two threads inside every small operation.
class Workers {
 public:
  /// @param count jobs that run at the same time; the calling thread is the first
  /// @param threads LibTorch threads of each; also set for the calling thread
  Workers(std::size_t count, int threads);
  ~Workers();
  Workers(const Workers&) = delete;
  Workers& operator=(const Workers&) = delete;

  /// job(0) … job(count − 1) at once, job i always on the same thread; waits for all. @throws the first job's exception
  void run(const std::function<void(std::size_t)>& job);
  std::size_t count() const { return threads_.size() + 1; }

 private:
  void work(std::size_t index, int threads);

  std::mutex mutex_;
  std::condition_variable begin_, done_;
  const std::function<void(std::size_t)>* job_ = nullptr;
  std::size_t round_ = 0, running_ = 0;
  bool stop_ = false;
  std::vector<std::exception_ptr> errors_;
  std::vector<std::thread> threads_;
};

}  // namespace anigen::train
