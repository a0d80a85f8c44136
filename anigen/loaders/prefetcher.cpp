#include "anigen/loaders/prefetcher.h"

#include <algorithm>
#include <utility>

namespace anigen::loaders {

Prefetcher::Prefetcher(const BatchSource& source, std::uint64_t seed, std::uint64_t first_position,
                       const Options& options)
    : source_(source), options_(options), order_(source.size(), seed), position_(first_position) {
  for (std::size_t i = 0; i < options_.workers; ++i) threads_.emplace_back([this] { work(); });
}

Prefetcher::~Prefetcher() {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    stop_ = true;
  }
  space_.notify_all();
  for (std::thread& thread : threads_) thread.join();
}

StepBatches Prefetcher::load(const std::vector<Draw>& draws) const {
  StepBatches batches;
  const std::size_t parts = std::max<std::size_t>(1, std::min(options_.batch_split, draws.size()));
  for (std::size_t part = 0; part < parts; ++part) {
    const auto begin = draws.begin() + static_cast<std::ptrdiff_t>(draws.size() * part / parts);
    const auto end = draws.begin() + static_cast<std::ptrdiff_t>(draws.size() * (part + 1) / parts);
    batches.push_back(source_.load(std::vector<Draw>(begin, end)));
  }
  return batches;
}

void Prefetcher::work() {
  std::unique_lock<std::mutex> lock(mutex_);
  for (;;) {
    space_.wait(lock, [this] { return stop_ || started_ < taken_ + options_.ahead; });
    if (stop_) return;
    const std::uint64_t step = started_++;
    const std::vector<Draw> draws = order_.draws(position_, options_.batch_size);
    position_ += options_.batch_size;
    lock.unlock();
    Slot slot;
    try {
      slot.batches = load(draws);
    } catch (...) {
      slot.error = std::current_exception();
    }
    lock.lock();
    slots_.emplace(step, std::move(slot));
    ready_.notify_all();
  }
}

StepBatches Prefetcher::next() {
  std::unique_lock<std::mutex> lock(mutex_);
  if (threads_.empty()) {
    const std::vector<Draw> draws = order_.draws(position_, options_.batch_size);
    position_ += options_.batch_size;
    return load(draws);
  }
  ready_.wait(lock, [this] { return slots_.count(taken_) > 0; });
  Slot slot = std::move(slots_[taken_]);
  slots_.erase(taken_++);
  lock.unlock();
  space_.notify_one();
  if (slot.error) std::rethrow_exception(slot.error);
  return std::move(slot.batches);
}

}  // namespace anigen::loaders
