#pragma once
#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <exception>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <set>
#include <string>
#include <string_view>
#include <thread>
#include <utility>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/data/batches.h"
#include "anigen/nn/torch.h"
#include "anigen/train/metrics_log.h"
#include "anigen/train/parameters.h"

namespace anigen::train {

/// The loss of one micro-batch: what is minimised, and the named terms that are logged. Scalars.
struct Losses {
  torch::Tensor total;
  std::vector<std::pair<std::string, torch::Tensor>> terms;
};

/// Position in the run at which a loss is computed; every random draw of a loss derives from it (seed, step,
/// micro_batch), never from LibTorch's global generator, which concurrent replicas would share.
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

/// A trainable task: one of the five stages, or a baseline. Its models, data and loss; the loop is Trainer's.
class Stage {
 public:
  virtual ~Stage() = default;

  /// In config order, which is the order of the optimiser's parameters. Always the same modules.
  virtual std::vector<nn::NamedModel> models() const = 0;
  virtual const data::BatchSource& data() const = 0;
  /// Takes other training data of the class of data(): the next generation of a stream. @throws NotSupportedError by a
  /// stage that reads no streams
  // NOLINTNEXTLINE(performance-unnecessary-value-param): stages keep it
  virtual void set_data(std::shared_ptr<const data::BatchSource>) {
    throw NotSupportedError("", "/dataset/args/data_dir", "a stream of shards in this trainer");
  }
  virtual Losses losses(const data::Batch& batch, const LossContext& context) = 0;

  /// Loads the pretrained weights that the published models of this stage begin with. Called once by a run that goes on
  /// from no checkpoint, after `finetune_ckpt`, before replicas are made (docs/reference/training.md, 2.1): a resumed
  /// run needs these files no more. @param finetuned what `finetune_ckpt` has filled
  /// @throws InputError for a damaged file, or when a frozen parameter would stay at its random start
  virtual void warm_start(const LoadedKeys& finetuned) { static_cast<void>(finetuned); }

  /// True when set_compute_dtype() takes this type.
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

  /// Copy of the stage with models of its own, over the same data.
  virtual std::unique_ptr<Stage> replica() const = 0;
};

/// Random numbers of one micro-batch: nn::numbered_generator() by (seed, step, micro_batch) and a purpose, so that a
/// loss does not depend on replicas, threads or what was drawn before.
at::Generator loss_generator(const LossContext& context, std::string_view purpose);

/// A few threads that repeat the same job over and over, each with its own number of LibTorch threads: small models
/// gain far more from working on two micro-batches at once than from two threads inside every small operation.
class Workers {
 public:
  /// @param count jobs that run at the same time; the calling thread is the first
  /// @param threads LibTorch threads of each; also set for the calling thread
  Workers(std::size_t count, int threads);
  ~Workers();
  Workers(const Workers&) = delete;
  Workers& operator=(const Workers&) = delete;

  /// job(0) … job(count − 1) at once, job i always on the same thread; waits for all. @throws the first job's exception
  void run(const std::function<void(std::size_t)>& job);
  std::size_t count() const { return threads_.size() + 1; }

 private:
  void work(std::size_t index, int threads);

  std::mutex mutex_;
  std::condition_variable begin_, done_;
  const std::function<void(std::size_t)>* job_ = nullptr;
  std::size_t round_ = 0, running_ = 0;
  bool stop_ = false;
  std::vector<std::exception_ptr> errors_;
  std::vector<std::thread> threads_;
};

}  // namespace anigen::train
