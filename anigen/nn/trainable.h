#pragma once
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "anigen/core/text.h"
#include "anigen/nn/torch.h"

namespace anigen::nn {

/// A model under the name it has in the config; checkpoints are called after it.
struct NamedModel {
  std::string name;
  std::shared_ptr<torch::nn::Module> module;
};

/// Turns off gradients below the named attributes of a model, as `modules_to_freeze` does
/// (docs/reference/autoencoders.md, 1.5): a name stands for exactly the child module or parameter of that name —
/// `blocks` is not `blocks_skl` — and names the model lacks are ignored. Parameters whose own path contains "lora" stay
/// trainable: low-rank additions are what a frozen stream learns.
void freeze_modules(torch::nn::Module& module, const std::vector<std::string>& names);

/// State-dict keys of the parameters that ask for no gradient, in registration order.
std::vector<std::string> frozen_parameters(const torch::nn::Module& module);

/// Base of the published models: freezing and precision. Parameters are fp32 until one of the conversions below.
class FreezableModel : public torch::nn::Module {
 public:
  /// Names of modules below this one; dots lead to modules further down.
  struct Parts {
    std::vector<std::string> torso;             ///< fp16 with use_fp16
    std::vector<std::string> torso_parameters;  ///< bare parameters of this module, likewise
    std::vector<std::string> other_fp16;        ///< fp16 with use_fp16, but no part of the torso
    std::vector<std::string> always_fp16;
    bool use_fp16 = false;
    std::vector<std::string> to_freeze;  ///< modules_to_freeze
    bool all_is_a_word = false;          ///< "all" among them stands for everything
  };

  /// Turns off gradients as modules_to_freeze says, whatever the two flags say (see freeze_modules).
  void apply_freezing();
  /// Names of the modules whose linears and convolutions, and of the parameters that are fp16 in the published system
  /// (docs/reference/autoencoders.md, 1.4), for published_dtypes().
  std::vector<std::string> half_precision_modules() const;
  /// Converts those modules in place. @throws NotSupportedError when the model is not on a GPU
  void convert_to_fp16();
  /// Converts the torso to any type, whatever use_fp16 says.
  void set_torso_dtype(torch::Dtype dtype);

 protected:
  explicit FreezableModel(Parts parts);

  Parts parts_;

 private:
  void cast(const std::vector<std::string>& names, torch::Dtype dtype);
};

/// Precisions of a flow on a CPU, by their words on command lines.
inline const Words<torch::Dtype> kFlowPrecisions = {
    {torch::kFloat32, "fp32"}, {torch::kBFloat16, "bf16"}, {torch::kInt8, "int8"}};

/// Base of the two flow models: fp32 unless set_compute_dtype() chose another type for the torso; norms, embeddings,
/// the first and the last layer stay in fp32.
class FlowModel : public FreezableModel {
 public:
  /// Converts the linears and convolutions of the torso in place (docs/reference/autoencoders.md, 1.4); forward() casts
  /// its inputs where they enter it. Call it before an optimiser takes over the parameters. With int8 the linears alone
  /// get 8-bit weights, for good (nn/int8_linear.h); all else computes in bf16 where kernels multiply such numbers
  /// (has_bf16_products()), elsewhere in fp32.
  /// @throws NotSupportedError for fp16 on a CPU, where bf16 is the choice, and for int8 on a GPU
  void set_compute_dtype(torch::Dtype dtype);
  /// Does by the key of one parameter what set_compute_dtype() does to all: a model that is converted while it is read
  /// (load_state_file()) never is in memory in fp32. Valid while the model lives and stays on its
  /// device. @throws as set_compute_dtype()
  std::function<void(const std::string& key)> conversion(torch::Dtype dtype);
  torch::Dtype compute_dtype() const { return dtype_of(torso_weight_); }

 protected:
  using FreezableModel::FreezableModel;

  /// @throws InputError unless t is [batch] and cond [batch or 1, M, channels]
  static void check_conditions(const torch::Tensor& t, const torch::Tensor& cond, std::int64_t batch,
                               std::int64_t channels);

  torch::Tensor torso_weight_;  ///< any linear weight of the torso: its dtype is the compute dtype
};

/// Latent of an encoder, with the posterior that it was drawn from.
struct Latent {
  torch::Tensor z, mean, logvar;
};
/// z as it is, its detached copy as mean, zeros as logvar.
Latent deterministic_latent(const torch::Tensor& z);
/// Gaussian posterior: z = mean + exp(logvar/2) · noise. @param raw mean, then logvar, along `axis`
/// @param noise undefined: z = mean @throws InputError when its shape does not fit
Latent sampled_latent(const torch::Tensor& raw, std::int64_t axis, const torch::Tensor& noise);

/// part(inputs), which in training keeps nothing but its inputs for the backward pass, and runs forward a second time
/// in it: less memory for a third more work ("gradient checkpointing"). The part must give the same result both times,
/// so it must draw no random numbers. Gradients reach its inputs and any parameters it uses; those of parameters are
/// added to `.grad` directly, so use backward(), not torch::autograd::grad() for them. Can be differentiated once.
/// @param part a function of the inputs; kept alive until the backward pass @param on false: just part(inputs)
torch::Tensor recomputed(const std::vector<torch::Tensor>& inputs,
                         const std::function<torch::Tensor(const std::vector<torch::Tensor>&)>& part, bool on = true);

}  // namespace anigen::nn
