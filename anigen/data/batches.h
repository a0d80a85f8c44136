#pragma once
#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <exception>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

namespace anigen::data {

struct AssetId;
struct SourceOptions;
struct StreamGeneration;
class ShardStream;

/// One micro-batch, ready for a model. What it holds is between a dataset and the stage that trains on it.
struct Batch {
  virtual ~Batch() = default;
  std::vector<std::string> ids;  ///< of its samples, for messages
};

/// One sample to draw: which item, and its place in the endless stream of draws, which names its random numbers.
struct Draw {
  std::size_t item = 0;
  std::uint64_t position = 0;
};

/// A dataset that turns draws into batches. load() is a pure function of its arguments and is called from several
/// threads at once, so batches depend neither on the number of threads nor on what was loaded before.
class BatchSource : public std::enable_shared_from_this<BatchSource> {
 public:
  virtual ~BatchSource() = default;
  virtual std::size_t size() const = 0;  ///< number of items, > 0
  /// @throws InputError naming file and place when an item cannot be read
  virtual std::unique_ptr<Batch> load(const std::vector<Draw>& draws) const = 0;

  /// Sizes of the items, for batches of items of similar size. Empty: order does not look at sizes.
  virtual std::vector<std::uint64_t> bucket_loads() const { return {}; }
  /// Deals the draws of one step into at most `parts` micro-batches, none empty: contiguous runs as equal as possible,
  /// unless a dataset balances them. @param draws not empty
  virtual std::vector<std::vector<Draw>> split(const std::vector<Draw>& draws, std::size_t parts) const;

  std::shared_ptr<const StreamGeneration> generation;  ///< shards it reads, of a stream; null: its assets stay
  std::shared_ptr<ShardStream> stream;                 ///< where its successors come from, of the first source alone
};

/// The endless stream of items: epoch after epoch, each a new permutation, without gaps between epochs (the
/// published loader drops an incomplete last batch instead). Position p is a pure function of (seed, p), so the
/// only state of a run is how many samples it has consumed.
class SampleOrder {
 public:
  /// @pre items > 0
  SampleOrder(std::size_t items, std::uint64_t seed);
  /// Batches of similar load, see bucketed_permutation(). @param loads one per item @param batch items per step, > 0
  SampleOrder(std::vector<std::uint64_t> loads, std::size_t batch, std::uint64_t seed);

  /// Draws at positions [first, first + count).
  std::vector<Draw> draws(std::uint64_t first, std::size_t count);

 private:
  std::vector<std::size_t> permutation_of(std::uint64_t epoch) const;

  std::size_t items_, batch_ = 1;
  std::vector<std::uint64_t> loads_;  // empty: uniform permutations
  std::uint64_t seed_, epoch_ = 0;
  std::vector<std::size_t> permutation_;  // of epoch_
};

/// A permutation of the items for one epoch whose batches hold items of similar load, so that no batch mixes a few
/// large items with many small ones. Loads are stretched by a random factor of up to a quarter before they are sorted,
/// so that batches differ between epochs; batches and the items inside each come in random order. Ours; the published
/// trainer has no buckets. A pure function of its arguments.
///
/// Batches are cut from the endless stream of draws: batch k is positions [k·batch, (k+1)·batch). Where an epoch is no
/// multiple of the batch, its last items and the first of the next epoch share a batch and are taken from the same
/// quantile of their epochs.
/// @param loads one per item, not empty @param batch items per training step, at least 1
std::vector<std::size_t> bucketed_permutation(const std::vector<std::uint64_t>& loads, std::size_t batch,
                                              std::uint64_t seed, std::uint64_t epoch);

/// Deals items into groups of similar total load by the longest-processing-time rule (Graham 1969): items by falling
/// load, each to the group that is lightest so far, the first of several (docs/reference/training.md, 1.3). Equal loads
/// keep their order.
/// @param groups at least 1 @param equal_size a group with loads.size() / groups items takes no more; the number of
/// items must then be a multiple of groups @return item indices per group, by falling load
/// @throws InputError when it is not, or groups is 0
std::vector<std::vector<std::size_t>> balanced_groups(const std::vector<std::uint64_t>& loads, std::size_t groups,
                                                      bool equal_size = false);

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

  /// @param source is kept as long as threads may read it: a training takes newer data while they load
  Prefetcher(std::shared_ptr<const BatchSource> source, std::uint64_t seed, std::uint64_t first_position,
             const Options& options);
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

  const std::shared_ptr<const BatchSource> source_;
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

/// Makes the dataset of some assets. @param earlier one of the same class that may share what it has read, or null
using MakeSource = std::function<std::shared_ptr<BatchSource>(std::vector<AssetId> assets, const BatchSource* earlier)>;

/// The generations of a stream (core/run_folder.h) as datasets of one training. A thread looks for a newer generation
/// and reads it, so that nobody waits for it.
class ShardStream {
 public:
  ShardStream(const SourceOptions& options, MakeSource make);
  ~ShardStream();
  ShardStream(const ShardStream&) = delete;
  ShardStream& operator=(const ShardStream&) = delete;

  /// @return null when one of the shards is gone @throws InputError, also for a creature kept for testing
  std::shared_ptr<const BatchSource> open(std::uint64_t generation, const std::vector<std::uint64_t>& shards) const;
  /// Gets the generation after that of `current` ready.
  void follow(const std::shared_ptr<const BatchSource>& current);
  /// A newer generation that is ready, else null. @throws what reading it threw
  std::shared_ptr<const BatchSource> newer() const;
  /// Tells the preparer that a run can go on from this generation, and needs none before it.
  void mark_used(std::uint64_t generation) const;

 private:
  struct State;
  std::shared_ptr<State> state_;
};

/// Assets of a training: of a fixed dataset, or of a stream's newest generation with what follows it. Refuses creatures
/// that are kept for testing. @throws InputError
struct TrainingData {
  std::shared_ptr<const BatchSource> train;
  std::vector<AssetId> eval;
};
TrainingData open_training(const SourceOptions& options, const MakeSource& make);

}  // namespace anigen::data
