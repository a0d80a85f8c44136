#include "anigen/train/stage.h"

namespace anigen::train {

at::Generator loss_generator(const LossContext& context, std::string_view purpose) {
  constexpr std::uint64_t kMostMicroBatches = 1 << 20;
  const std::uint64_t index = static_cast<std::uint64_t>(context.step) * kMostMicroBatches + context.micro_batch;
  return nn::numbered_generator(context.seed, purpose, index);
}

// NOLINTNEXTLINE(bugprone-throw-keyword-missing): a list of what workers threw
Workers::Workers(std::size_t count, int threads) : errors_(count) {
  at::set_num_threads(threads);
  for (std::size_t i = 1; i < count; ++i) threads_.emplace_back([this, i, threads] { work(i, threads); });
}

Workers::~Workers() {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    stop_ = true;
  }
  begin_.notify_all();
  for (std::thread& thread : threads_) thread.join();
}

void Workers::work(std::size_t index, int threads) {
  at::set_num_threads(threads);  // a setting of the thread, since OpenMP keeps it per thread
  std::size_t seen = 0;
  std::unique_lock<std::mutex> lock(mutex_);
  for (;;) {
    begin_.wait(lock, [&] { return stop_ || round_ != seen; });
    if (stop_) return;
    seen = round_;
    const auto* job = job_;
    lock.unlock();
    std::exception_ptr error;
    try {
      (*job)(index);
    } catch (...) {
      error = std::current_exception();
    }
    lock.lock();
    errors_[index] = error;
    if (--running_ == 0) done_.notify_one();
  }
}

void Workers::run(const std::function<void(std::size_t)>& job) {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    job_ = &job;
    running_ = threads_.size();
    ++round_;
  }
  begin_.notify_all();
  errors_[0] = nullptr;
  try {
    job(0);
  } catch (...) {
    errors_[0] = std::current_exception();
  }
  std::unique_lock<std::mutex> lock(mutex_);
  done_.wait(lock, [this] { return running_ == 0; });
  for (const std::exception_ptr& error : errors_) {
    if (error) std::rethrow_exception(error);
  }
}

}  // namespace anigen::train
