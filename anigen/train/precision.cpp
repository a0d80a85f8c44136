#include "anigen/train/precision.h"

#include "anigen/core/error.h"

namespace anigen::train {

Precision choose_precision(const TrainerOptions& options, torch::Device device, const std::string& file) {
  const bool fp16_mode = options.fp16_mode != "none";
  Precision precision;
  if (options.precision == "bf16") {
    precision.compute = torch::kBFloat16;
    precision.note =
        "precision bf16: the blocks compute in bf16, parameters are updated in fp32, losses are not scaled";
  } else if (options.precision == "fp16-published") {
    if (!device.is_cuda()) {
      throw NotSupportedError(file, "/trainer/args/precision", "fp16 on a CPU; use bf16, which a CPU computes faster");
    }
    if (!fp16_mode) {
      throw InputError(file, "/trainer/args/precision",
                       "\"fp16-published\" contradicts fp16_mode \"none\"; leave one of them out");
    }
    precision.compute = torch::kHalf;
    precision.loss_scaling = options.loss_scaling;
    precision.note = "precision fp16-published: the blocks compute in fp16, parameters are updated in fp32";
  } else if (options.precision == "fp64") {
    precision.compute = torch::kFloat64;
    precision.note = "precision fp64: everything is computed and kept in fp64, many times as slow";
  } else if (options.precision == "fp32") {
    precision.note = "precision fp32";
  } else {
    precision.loss_scaling = options.loss_scaling && fp16_mode && device.is_cuda();
    if (fp16_mode && device.is_cpu()) {
      precision.note =
          "fp16_mode " + options.fp16_mode + ": on a CPU parameters and arithmetic are fp32, losses are not scaled";
    }
  }
  return precision;
}

}  // namespace anigen::train
