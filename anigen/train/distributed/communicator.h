#pragma once
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/nn/torch.h"

namespace anigen::train {

/// Another rank died, hangs or has stopped; what() names it. Every rank that notices gets one.
class RankLost : public Error {
 public:
  using Error::Error;
};

/// Activity of a rank, as others see it who wait for it.
enum class Activity {
  kTraining,  ///< on its way to the next exchange
  kBusy,      ///< writes a checkpoint, evaluates, draws samples: may take as long as it likes while it is alive
};

/// A sum under way; as it is, one that is there already.
class PendingSum {
 public:
  virtual ~PendingSum() = default;
  /// Returns when the tensor holds the sum. Once. @throws RankLost
  virtual void wait() {}
};

/// The processes that train together. They are symmetric but for rank 0, which writes files.
///
/// All ranks call the same functions in the same order; only report() and leave() are free of that. A call that waits
/// for others ends in RankLost when one of them is lost (watchdog.h); afterwards only leave() may be called.
class Communicator {
 public:
  virtual ~Communicator() = default;

  virtual int rank() const = 0;
  virtual int size() const = 0;
  /// For the log: "Gloo over 127.0.0.1, gradients in fp32".
  virtual std::string description() const = 0;

  /// Begins to replace a tensor by its sum over all ranks, the same bits on each of them. Of several sums those that
  /// began first end first, whoever waits for which. The tensor must be left alone until wait().
  /// @param flat [n] fp32 or fp64, contiguous, n > 0; fp32 may travel in bf16, fp64 never does
  virtual std::unique_ptr<PendingSum> start_sum(torch::Tensor flat) = 0;
  /// Bytes of a sum that keep the network busy; several of them are under way at a time.
  virtual std::int64_t sum_bytes() const { return std::int64_t{25} << 20; }
  /// Overwrites a tensor by rank 0's. @param flat [n], contiguous, fp32 or fp64
  virtual void broadcast(torch::Tensor flat) = 0;
  /// Bytes of every rank, in order of ranks, on every rank.
  virtual std::vector<std::string> gather(const std::string& bytes) = 0;
  /// Returns when all ranks have called it.
  virtual void barrier() = 0;

  /// Tells the others how far this rank is, at no cost to the caller.
  virtual void report(std::int64_t step, Activity activity) = 0;
  /// Tells the others why this rank stops before its time; the first reason told is the one they give. Returns within
  /// seconds whatever the state of the connections.
  virtual void leave(const std::string& reason) noexcept = 0;
};

/// Says that this rank is busy for as long as it lives.
class BusyRank {
 public:
  BusyRank(Communicator& ranks, std::int64_t step) : ranks_(ranks), step_(step) {
    ranks_.report(step_, Activity::kBusy);
  }
  ~BusyRank() { ranks_.report(step_, Activity::kTraining); }
  BusyRank(const BusyRank&) = delete;
  BusyRank& operator=(const BusyRank&) = delete;

 private:
  Communicator& ranks_;
  std::int64_t step_;
};

/// One process that trains alone: every sum is what it was, nothing is sent, no thread runs.
class SingleProcess : public Communicator {
 public:
  int rank() const override { return 0; }
  int size() const override { return 1; }
  std::string description() const override { return "one process"; }
  std::unique_ptr<PendingSum> start_sum(torch::Tensor) override { return std::make_unique<PendingSum>(); }
  void broadcast(torch::Tensor flat) override { static_cast<void>(flat); }
  std::vector<std::string> gather(const std::string& bytes) override { return {bytes}; }
  void barrier() override {}
  void report(std::int64_t, Activity) override {}
  void leave(const std::string&) noexcept override {}
};

/// Small values that all ranks see, beside the connections between them. Functions may be called from several threads
/// and throw when whoever keeps the values is gone.
class SharedKeys {
 public:
  virtual ~SharedKeys() = default;
  virtual void set(const std::string& key, const std::string& value) = 0;
  virtual std::optional<std::string> find(const std::string& key) = 0;
  /// Adds to a number that begins at 0. @return the sum
  virtual std::int64_t add(const std::string& key, std::int64_t amount) = 0;
};

}  // namespace anigen::train
