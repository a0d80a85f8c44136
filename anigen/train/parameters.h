#pragma once
#include <torch/torch.h>
#include <cstdint>
#include <functional>
#include <map>
#include <string>
#include <vector>

#include "anigen/io/arrays/ndarray.h"
#include "anigen/nn/trainable.h"

namespace anigen::train {

/// All trainable parameters of some models as one flat fp32 vector (docs/reference/training.md, 2.2), so that clipping,
/// optimiser and averages are single passes over memory. Where all of them are fp64 so is the vector: tests compare
/// ways to sum in it.
///
/// Order: models as listed, parameters as registered, those with requires_grad only. A parameter of the vector's type
/// becomes a view into it, and its gradient a view into gradient(); one of another type keeps its own storage and is
/// converted on the way in (collect_gradients) and out (publish).
class ParameterBuffer {
 public:
  struct Slot {
    std::string name;  ///< "<model>.<parameter>"
    torch::Tensor parameter;
    std::int64_t offset;
    bool view;  ///< of the vector's type: shares memory with it
  };

  /// Takes over the current values of the parameters. @throws Error when nothing is trainable
  /// @param convert called when the values are taken and before parameters become views: may change the parameters'
  ///   types, so that masters and frozen() keep the full precision of what was loaded
  explicit ParameterBuffer(const std::vector<nn::NamedModel>& models, const std::function<void()>& convert = nullptr);

  /// Copy of the layout for other models of the same architecture: their parameters share master(), their gradients
  /// are apart, for a second pair of hands in one step. @throws Error when names or shapes differ
  ParameterBuffer share(const std::vector<nn::NamedModel>& models) const;

  const torch::Tensor& master() const { return master_; }      ///< [P] fp32 (or fp64)
  const torch::Tensor& gradient() const { return gradient_; }  ///< [P] of the same type
  const std::vector<Slot>& slots() const { return slots_; }

  void zero_gradients();
  /// Brings gradients of parameters that are no views into gradient(); a missing one counts as zero. Call once
  /// after the last backward() of a step. @throws Error when someone replaced a gradient that must stay a view
  void collect_gradients();
  /// As above, for one of slots(), as soon as its gradient is there.
  void collect_gradient(const Slot& slot) const;
  /// Writes master() into the parameters that are no views.
  void publish();

  /// Part of a flat vector [P] that belongs to a slot, in the parameter's shape.
  torch::Tensor part(const torch::Tensor& flat, const Slot& slot) const;
  /// A frozen parameter as it was before `convert`, which is what checkpoints hold; it shares memory with the parameter
  /// where that was not converted. @param name "<model>.<parameter>" @return undefined for another name or in a twin
  torch::Tensor frozen(const std::string& name) const;
  /// Name of the first slot with a value that is not finite, or "" when all are.
  std::string first_not_finite(const torch::Tensor& flat) const;

 private:
  ParameterBuffer() = default;
  void attach(const std::vector<nn::NamedModel>& models);

  torch::Tensor master_, gradient_;
  std::vector<Slot> slots_;
  std::map<std::string, torch::Tensor> frozen_;
};

/// Exponential moving averages of the flat parameter vector at one or several rates: ema ← r·ema + (1 − r)·master
/// after every step, also after a skipped update (docs/reference/training.md, 2.2). Make it after warm starts: the
/// published trainer averages from the random initialisation instead, a defect.
class Ema {
 public:
  /// @param rates each in [0, 1) @param master [P] fp32; every average starts as a copy @throws InputError
  Ema(const std::vector<double>& rates, const torch::Tensor& master);

  /// @param most r is no larger in this update, so that the first ones forget where the averages start
  void update(const torch::Tensor& master, double most = 1.0);

  const std::vector<double>& rates() const { return rates_; }
  /// [P] fp32, one per rate; writable for resuming.
  std::vector<torch::Tensor>& averages() { return averages_; }
  const std::vector<torch::Tensor>& averages() const { return averages_; }

 private:
  std::vector<double> rates_;
  std::vector<torch::Tensor> averages_;
};

/// State dict of a model with its trainable parameters taken from a flat fp32 vector (the masters, or an average),
/// frozen parameters as they were loaded, whatever type they compute in (ParameterBuffer::frozen), and buffers as they
/// are: what a checkpoint file holds (docs/reference/training.md, 2.4; published: frozen parameters in fp16).
io::NamedArrays weights_of(const nn::NamedModel& model, const ParameterBuffer& buffer, const torch::Tensor& flat);

/// Inverse: frozen entries into the model and what frozen() keeps of it, trainable ones, unrounded, into the vector.
/// @param source file name for messages @throws InputError unless keys and shapes match exactly
void set_weights(const nn::NamedModel& model, const ParameterBuffer& buffer, torch::Tensor flat,
                 const io::NamedArrays& arrays, const std::string& source);

}  // namespace anigen::train
