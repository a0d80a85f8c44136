#pragma once
#include <memory>

#include "anigen/nn/torch.h"

namespace anigen::nn {

/// A tensor that the host has made, such as a list of rows, and its copy on the device that last asked for it, which is
/// kept. Copies of a HostTensor share both. Thread-safe.
class HostTensor {
 public:
  HostTensor() = default;
  explicit HostTensor(const Tensor& host);

  bool defined() const { return kept_ != nullptr; }
  const Tensor& host() const;
  /// @return the host's own where the device is the CPU; else a copy, for which a GPU is not waited for
  Tensor on(torch::Device device) const;

 private:
  struct Kept;
  std::shared_ptr<Kept> kept_;
};

}  // namespace anigen::nn
