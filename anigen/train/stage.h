#pragma once
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "anigen/loaders/batch_source.h"
#include "anigen/nn/torch.h"
#include "anigen/train/metrics_log.h"
#include "anigen/train/parameter_buffer.h"

namespace anigen::train {

/// The loss of one micro-batch: what is minimised, and the named terms that are logged. Scalars.
struct Losses {
  torch::Tensor total;
  std::vector<std::pair<std::string, torch::Tensor>> terms;
};

/// Where in the run a loss is computed; every random draw of a loss derives from it (seed, step, micro_batch), never
/// from LibTorch's global generator, which concurrent replicas would share.
struct LossContext {
  std::uint64_t seed = 0;
  std::int64_t step = 0;
  std::size_t micro_batch = 0;
};

/// One of the five training stages: its models, its data and its loss. The loop around it is Trainer's.
class Stage {
 public:
  virtual ~Stage() = default;

  /// In config order, which is the order of the optimiser's parameters. Always the same modules.
  virtual std::vector<NamedModel> models() const = 0;
  virtual const loaders::BatchSource& data() const = 0;
  virtual Losses losses(const loaders::Batch& batch, const LossContext& context) = 0;

  /// Quantities over held-out assets, with whatever weights the models have now; empty: nothing to evaluate.
  virtual Values evaluate() { return {}; }
  /// Writes examples into a folder; called with averaged weights in place.
  virtual void sample(const std::filesystem::path& folder) { static_cast<void>(folder); }

  /// The same stage with models of its own, over the same data.
  virtual std::unique_ptr<Stage> replica() const = 0;
};

}  // namespace anigen::train
