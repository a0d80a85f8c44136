#include "anigen/data/batches.h"

#include <algorithm>
#include <chrono>
#include <numeric>
#include <optional>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/random.h"
#include "anigen/data/metadata.h"

namespace anigen::data {

std::vector<std::vector<Draw>> BatchSource::split(const std::vector<Draw>& draws, std::size_t parts) const {
  parts = std::max<std::size_t>(1, std::min(parts, draws.size()));
  std::vector<std::vector<Draw>> result;
  for (std::size_t part = 0; part < parts; ++part) {
    const auto begin = draws.begin() + static_cast<std::ptrdiff_t>(draws.size() * part / parts);
    const auto end = draws.begin() + static_cast<std::ptrdiff_t>(draws.size() * (part + 1) / parts);
    result.emplace_back(begin, end);
  }
  return result;
}

SampleOrder::SampleOrder(std::size_t items, std::uint64_t seed)
    : items_(items), seed_(seed), permutation_(permutation_of(0)) {}

SampleOrder::SampleOrder(std::vector<std::uint64_t> loads, std::size_t batch, std::uint64_t seed)
    : items_(loads.size()), batch_(batch), loads_(std::move(loads)), seed_(seed), permutation_(permutation_of(0)) {}

std::vector<std::size_t> SampleOrder::permutation_of(std::uint64_t epoch) const {
  if (!loads_.empty()) return bucketed_permutation(loads_, batch_, seed_, epoch);
  return Rng(seed_, "sample order", epoch).permutation(items_);
}

std::vector<Draw> SampleOrder::draws(std::uint64_t first, std::size_t count) {
  std::vector<Draw> result;
  result.reserve(count);
  for (std::uint64_t position = first; position < first + count; ++position) {
    const std::uint64_t epoch = position / items_;
    if (epoch != epoch_) {
      epoch_ = epoch;
      permutation_ = permutation_of(epoch);
    }
    result.push_back({permutation_[position % items_], position});
  }
  return result;
}

namespace {

constexpr double kStretch = 0.25;

std::vector<std::size_t> by_stretched_load(const std::vector<std::uint64_t>& loads, Rng& rng) {
  std::vector<double> key(loads.size());
  for (std::size_t i = 0; i < loads.size(); ++i)
    key[i] = static_cast<double>(loads[i]) * (1.0 + kStretch * rng.uniform());
  std::vector<std::size_t> order = rng.permutation(loads.size());  // equal keys: in random order
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) { return key[a] < key[b]; });
  return order;
}

// Position among `blocks` full batches, sorted by load, the batch shared by the epochs e − 1 and e lies.
std::size_t boundary(std::uint64_t seed, std::uint64_t epoch, std::size_t blocks) {
  const double quantile = Rng(seed, "bucket boundary", epoch).uniform();
  return static_cast<std::size_t>(quantile * static_cast<double>(blocks + 1));
}

SampleOrder order_of(const BatchSource& source, std::uint64_t seed, std::size_t batch) {
  std::vector<std::uint64_t> loads = source.bucket_loads();
  return loads.empty() ? SampleOrder(source.size(), seed) : SampleOrder(std::move(loads), batch, seed);
}

}  // namespace

std::vector<std::size_t> bucketed_permutation(const std::vector<std::uint64_t>& loads, std::size_t batch,
                                              std::uint64_t seed, std::uint64_t epoch) {
  const std::size_t items = loads.size();
  Rng rng(seed, "bucketed order", epoch);
  const std::vector<std::size_t> sorted = by_stretched_load(loads, rng);
  const std::size_t begun = static_cast<std::size_t>(epoch % batch) * (items % batch) % batch;
  const std::size_t head = begun == 0 ? 0 : std::min(items, batch - begun);
  const std::size_t full = (items - head) / batch, tail = (items - head) % batch;
  const std::size_t head_at = boundary(seed, epoch, full), tail_at = boundary(seed, epoch + 1, full);

  std::vector<std::size_t> first, last;
  std::vector<std::vector<std::size_t>> batches;
  auto next = sorted.begin();
  const auto cut = [&](std::size_t count) {
    std::vector<std::size_t> run(next, next + static_cast<std::ptrdiff_t>(count));
    next += static_cast<std::ptrdiff_t>(count);
    std::vector<std::size_t> shuffled;
    for (const std::size_t i : rng.permutation(count)) shuffled.push_back(run[i]);
    return shuffled;
  };
  for (std::size_t k = 0; k <= full; ++k) {
    if (k == head_at) first = cut(head);
    if (k == tail_at) last = cut(tail);
    if (k < full) batches.push_back(cut(batch));
  }
  std::vector<std::size_t> result = std::move(first);
  for (const std::size_t k : rng.permutation(full)) result.insert(result.end(), batches[k].begin(), batches[k].end());
  result.insert(result.end(), last.begin(), last.end());
  return result;
}

std::vector<std::vector<std::size_t>> balanced_groups(const std::vector<std::uint64_t>& loads, std::size_t groups,
                                                      bool equal_size) {
  if (groups == 0) throw InputError("", "balanced groups", "there must be at least one group");
  if (equal_size && loads.size() % groups != 0) {
    throw InputError("", "balanced groups",
                     std::to_string(loads.size()) + " items cannot be dealt into " + std::to_string(groups) +
                         " groups of equal size");
  }
  const std::size_t room = equal_size ? loads.size() / groups : loads.size();
  std::vector<std::size_t> order(loads.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) { return loads[a] > loads[b]; });

  std::vector<std::vector<std::size_t>> result(groups);
  std::vector<std::uint64_t> total(groups, 0);
  for (const std::size_t item : order) {
    std::size_t lightest = groups;
    for (std::size_t g = 0; g < groups; ++g) {
      if (result[g].size() < room && (lightest == groups || total[g] < total[lightest])) lightest = g;
    }
    result[lightest].push_back(item);
    total[lightest] += loads[item];
  }
  return result;
}

Prefetcher::Prefetcher(std::shared_ptr<const BatchSource> source, std::uint64_t seed, std::uint64_t first_position,
                       const Options& options)
    : source_(std::move(source)),
      options_(options),
      order_(order_of(*source_, seed, options.batch_size)),
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
  for (const std::vector<Draw>& part : source_->split(draws, options_.batch_split)) {
    const bool ours = batches.size() % options_.ranks == options_.rank;
    batches.push_back(ours ? source_->load(part) : nullptr);
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

struct ShardStream::State {
  SourceOptions options;
  MakeSource make;
  StreamFolder folder;
  mutable std::mutex mutex;
  std::condition_variable wake;
  bool stop = false;
  std::uint64_t current = 0;
  std::weak_ptr<const BatchSource> earlier;  // not kept alive: its shards may go
  std::shared_ptr<const BatchSource> next;
  std::exception_ptr error;
  std::thread thread;

  std::shared_ptr<BatchSource> source_of(std::shared_ptr<const StreamGeneration> held,
                                         const std::shared_ptr<const BatchSource>& before) const {
    TrainAndEval assets = select(options, held.get());
    refuse_test_creatures(assets, options);
    std::shared_ptr<BatchSource> source = make(std::move(assets.train), before.get());
    source->generation = std::move(held);
    return source;
  }

  /// Waits for a generation after the current one, and reads it.
  void look() {
    constexpr auto kInterval = std::chrono::milliseconds(500);
    std::unique_lock<std::mutex> lock(mutex);
    for (; !stop; wake.wait_for(lock, kInterval)) {
      if (next || error) continue;
      const std::uint64_t known = current;
      const std::shared_ptr<const BatchSource> before = earlier.lock();
      lock.unlock();
      std::shared_ptr<const BatchSource> found;
      std::exception_ptr problem;
      try {
        if (folder.read_index().generation > known) found = source_of(newest_generation(folder), before);
      } catch (...) {
        problem = std::current_exception();
      }
      lock.lock();
      if (known != current) continue;  // another one was taken meanwhile
      next = std::move(found);
      error = problem;
    }
  }
};

ShardStream::ShardStream(const SourceOptions& options, MakeSource make) : state_(std::make_shared<State>()) {
  state_->options = options;
  state_->make = std::move(make);
  state_->folder = *stream_of(options.data_dir);
}

ShardStream::~ShardStream() {
  {
    const std::lock_guard<std::mutex> lock(state_->mutex);
    state_->stop = true;
  }
  state_->wake.notify_all();
  if (!state_->thread.joinable()) return;
  // The thread itself may hold the last source, and with it this.
  if (state_->thread.get_id() == std::this_thread::get_id()) {
    state_->thread.detach();
  } else {
    state_->thread.join();
  }
}

std::shared_ptr<const BatchSource> ShardStream::open(std::uint64_t generation,
                                                     const std::vector<std::uint64_t>& shards) const {
  std::shared_ptr<const StreamGeneration> held = hold_generation(state_->folder, generation, shards);
  return held ? state_->source_of(std::move(held), nullptr) : nullptr;
}

void ShardStream::follow(const std::shared_ptr<const BatchSource>& current) {
  {
    const std::lock_guard<std::mutex> lock(state_->mutex);
    state_->current = current->generation->number;
    state_->earlier = current;
    state_->next = nullptr;
    state_->error = nullptr;
  }
  if (!state_->thread.joinable()) state_->thread = std::thread([state = state_] { state->look(); });
  state_->wake.notify_all();
}

std::shared_ptr<const BatchSource> ShardStream::newer() const {
  const std::lock_guard<std::mutex> lock(state_->mutex);
  if (state_->error) std::rethrow_exception(state_->error);
  return state_->next;
}

void ShardStream::mark_used(std::uint64_t generation) const { state_->folder.mark_used(generation); }

TrainingData open_training(const SourceOptions& options, const MakeSource& make) {
  const std::optional<StreamFolder> folder = stream_of(options.data_dir);
  const std::shared_ptr<const StreamGeneration> held = folder ? newest_generation(*folder) : nullptr;
  TrainAndEval assets = select(options, held.get());
  refuse_test_creatures(assets, options);
  const std::shared_ptr<BatchSource> train = make(std::move(assets.train), nullptr);
  train->generation = held;
  if (folder) train->stream = std::make_shared<ShardStream>(options, make);
  return {train, std::move(assets.eval)};
}

}  // namespace anigen::data
