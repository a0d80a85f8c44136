#pragma once
#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

namespace anigen::loaders {

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
class BatchSource {
 public:
  virtual ~BatchSource() = default;
  virtual std::size_t size() const = 0;  ///< number of items, > 0
  /// @throws InputError naming file and place when an item cannot be read
  virtual std::unique_ptr<Batch> load(const std::vector<Draw>& draws) const = 0;

  /// Where batches are to hold items of similar size: the size of every item. Empty: order does not look at sizes.
  virtual std::vector<std::uint64_t> bucket_loads() const { return {}; }
  /// Deals the draws of one step into at most `parts` micro-batches, none empty: contiguous runs as equal as possible,
  /// unless a dataset balances them. @param draws not empty
  virtual std::vector<std::vector<Draw>> split(const std::vector<Draw>& draws, std::size_t parts) const;
};

}  // namespace anigen::loaders
