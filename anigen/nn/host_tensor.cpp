#include "anigen/nn/host_tensor.h"

#include <mutex>

namespace anigen::nn {

struct HostTensor::Kept {
  Tensor host;
  std::mutex mutex;
  Tensor elsewhere;
};

HostTensor::HostTensor(const Tensor& host) : kept_(std::make_shared<Kept>()) { kept_->host = host; }

const Tensor& HostTensor::host() const { return kept_->host; }

Tensor HostTensor::on(torch::Device device) const {
  if (device.is_cpu()) return kept_->host;
  const std::lock_guard<std::mutex> lock(kept_->mutex);
  if (!kept_->elsewhere.defined() || kept_->elsewhere.device() != device)
    kept_->elsewhere = to_device(kept_->host, device);
  return kept_->elsewhere;
}

}  // namespace anigen::nn
