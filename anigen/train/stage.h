#pragma once
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "anigen/core/error.h"
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

/// State-dict keys of the weights that came from files, by the name a model has in the config.
using LoadedKeys = std::map<std::string, std::set<std::string>>;

/// Those of one model; none for a model that no file filled.
inline std::set<std::string> keys_of(const LoadedKeys& loaded, const std::string& model) {
  const auto found = loaded.find(model);
  return found == loaded.end() ? std::set<std::string>() : found->second;
}

/// What is trained: one of the five stages, or a baseline. Its models, its data and its loss. The loop around it is
/// Trainer's.
class Stage {
 public:
  virtual ~Stage() = default;

  /// In config order, which is the order of the optimiser's parameters. Always the same modules.
  virtual std::vector<nn::NamedModel> models() const = 0;
  virtual const loaders::BatchSource& data() const = 0;
  virtual Losses losses(const loaders::Batch& batch, const LossContext& context) = 0;

  /// Loads the pretrained weights that the published models of this stage begin with. Called once by a run that goes on
  /// from no checkpoint, after `finetune_ckpt`, before replicas are made (reference training-and-data.md, 2.2): a
  /// resumed run needs these files no more. @param finetuned what `finetune_ckpt` has filled
  /// @throws InputError for a damaged file, or when a frozen parameter would stay at its random start
  virtual void warm_start(const LoadedKeys& finetuned) { static_cast<void>(finetuned); }

  /// Whether set_compute_dtype() takes this type.
  virtual bool supports(torch::Dtype dtype) const { return dtype == torch::kFloat32; }
  /// The type in which the torsos of the models compute from now on, where the published system has fp16: their linears
  /// and convolutions are converted in place. fp64 converts all of the models, and what goes into them. Called once,
  /// before anyone holds the parameters.
  /// @throws NotSupportedError for a type that supports() does not name
  virtual void set_compute_dtype(torch::Dtype dtype) {
    if (!supports(dtype)) throw NotSupportedError("", "/trainer/args/precision", "this precision in this stage");
  }

  /// Quantities over held-out assets, with whatever weights the models have now; empty: nothing to evaluate.
  virtual Values evaluate() { return {}; }
  /// Writes examples into a folder; called with averaged weights in place. Its PNG files also go to TensorBoard.
  virtual void sample(const std::filesystem::path& folder) { static_cast<void>(folder); }

  /// The same stage with models of its own, over the same data.
  virtual std::unique_ptr<Stage> replica() const = 0;
};

}  // namespace anigen::train
