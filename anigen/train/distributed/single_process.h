#pragma once
#include <memory>
#include <string>
#include <vector>

#include "anigen/train/distributed/communicator.h"

namespace anigen::train {

/// One process that trains alone: every sum is what it was, nothing is sent, no thread runs.
class SingleProcess : public Communicator {
 public:
  int rank() const override { return 0; }
  int size() const override { return 1; }
  std::string description() const override { return "one process"; }
  std::unique_ptr<PendingSum> start_sum(torch::Tensor flat) override;
  void broadcast(torch::Tensor flat) override { static_cast<void>(flat); }
  std::vector<std::string> gather(const std::string& bytes) override { return {bytes}; }
  void barrier() override {}
  void report(std::int64_t, Activity) override {}
  void leave(const std::string&) noexcept override {}
};

}  // namespace anigen::train
