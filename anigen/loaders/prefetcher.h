#pragma once
#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <exception>
#include <map>
#include <memory>
#include <mutex>
#include <thread>
#include <vector>

#include "anigen/loaders/batch_source.h"
#include "anigen/loaders/sample_order.h"

namespace anigen::loaders {

/// The micro-batches of one training step, by their number among all of them; null: another process works on it.
using StepBatches = std::vector<std::unique_ptr<Batch>>;

/// Loads the batches of coming steps in the background and hands them out in order. The sequence is the same for
/// any number of workers, including none, and continues exactly from `first_position`.
class Prefetcher {
 public:
  struct Options {
    std::size_t batch_size = 1;       ///< samples per step
    std::size_t batch_split = 1;      ///< micro-batches they are dealt into, by BatchSource::split
    std::size_t workers = 1;          ///< 0: load in next()
    std::size_t ahead = 4;            ///< steps kept ready at most
    std::size_t rank = 0, ranks = 1;  ///< loads micro-batches rank, rank + ranks, … of every step
  };

  /// @param source must outlive the prefetcher
  Prefetcher(const BatchSource& source, std::uint64_t seed, std::uint64_t first_position, const Options& options);
  ~Prefetcher();
  Prefetcher(const Prefetcher&) = delete;
  Prefetcher& operator=(const Prefetcher&) = delete;

  /// Waits for the next step's batches. @throws what loading them threw
  StepBatches next();

 private:
  struct Slot {
    StepBatches batches;
    std::exception_ptr error;
  };
  StepBatches load(const std::vector<Draw>& draws) const;
  void work();

  const BatchSource& source_;
  const Options options_;
  std::mutex mutex_;
  std::condition_variable space_, ready_;
  SampleOrder order_;                      // guarded by mutex_
  std::uint64_t position_;                 // of the next step to start loading
  std::uint64_t started_ = 0, taken_ = 0;  // steps begun by workers, handed out
  std::map<std::uint64_t, Slot> slots_;    // finished steps
  bool stop_ = false;
  std::vector<std::thread> threads_;
};

}  // namespace anigen::loaders
