#include "anigen/pipeline/device.h"

#include "anigen/core/error.h"

namespace anigen::pipeline {

torch::Device parse_device(const std::string& name) {
  try {
    const torch::Device device(name);
    if (device.is_cpu() || (device.is_cuda() && torch::cuda::is_available())) return device;
  } catch (const c10::Error&) {
  }
  throw InputError("", "--device",
                   "\"" + name + "\" is not available; this build has cpu" +
                       (torch::cuda::is_available() ? ", cuda and cuda:N" : " only"));
}

}  // namespace anigen::pipeline
