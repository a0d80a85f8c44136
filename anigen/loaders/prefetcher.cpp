#include "anigen/loaders/prefetcher.h"

#include <utility>

namespace anigen::loaders {
namespace {

SampleOrder order_of(const BatchSource& source, std::uint64_t seed, std::size_t batch) {
  std::vector<std::uint64_t> loads = source.bucket_loads();
  return loads.empty() ? SampleOrder(source.size(), seed) : SampleOrder(std::move(loads), batch, seed);
}

}  // namespace

Prefetcher::Prefetcher(const BatchSource& source, std::uint64_t seed, std::uint64_t first_position,
                       const Options& options)
    : source_(source),
      options_(options),
      order_(order_of(source, seed, options.batch_size)),
      position_(first_position) {
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
  for (const std::vector<Draw>& part : source_.split(draws, options_.batch_split)) {
    const bool ours = batches.size() % options_.ranks == options_.rank;
    batches.push_back(ours ? source_.load(part) : nullptr);
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
