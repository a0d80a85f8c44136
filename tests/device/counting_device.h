#pragma once
#include <cstdint>
#include <map>
#include <string>

#include "anigen/nn/torch.h"

namespace anigen::test {

/// A device in host memory that stands for a GPU where there is none. Operators of LibTorch's CPU backend compute on
/// it; its addresses are none of the host, so that code that reads its memory directly crashes, as with a GPU.
/// Registered at the first call, which must come before the first backward pass of the process.
torch::Device counting_device();

/// Requests that the device has had since forget_requests(), from all threads.
struct DeviceRequests {
  std::int64_t operators = 0;
  std::int64_t uploads = 0;  ///< copies from the host, those that are waited for too
  /// Those after which a GPU's host waits until the GPU has caught up, by operator: values that are read back
  /// ("aten::item", "aten::nonzero", "copy to the host", …), and copies of pageable memory ("copy of pageable memory"):
  /// those that do not go through nn::to_device().
  std::map<std::string, std::int64_t> waits;

  std::int64_t all_waits() const;
};

DeviceRequests device_requests();
void forget_requests();

/// For failure messages: each operator that waits, with its number.
std::string waits_text(const DeviceRequests& requests);

}  // namespace anigen::test
