#pragma once
#include <string>
#include <vector>

#include "anigen/nn/torch.h"

namespace anigen::models {

/// What the encoders and decoders of the sparse structure and of the structured latents do alike: freezing and
/// precision. Parameters are fp32 until one of the conversions below.
class StreamCoder : public torch::nn::Module {
 public:
  /// Names of modules below this one; dots lead to modules further down.
  struct Parts {
    std::vector<std::string> torso;   ///< fp16 with use_fp16
    std::vector<std::string> beside;  ///< the same, but no part of the torso
    std::vector<std::string> always;  ///< fp16 whatever use_fp16 says
    bool use_fp16 = false;
    std::vector<std::string> to_freeze;  ///< modules_to_freeze
    bool all_is_a_word = false;          ///< "all" among them stands for everything
  };

  /// Turns off gradients as modules_to_freeze says, whatever the two flags say (see freezing.h).
  void apply_freezing();
  /// Names of the modules whose linears and convolutions are fp16 in the published system (reference autoencoders.md,
  /// 0.4 and appendix A), for published_dtypes().
  std::vector<std::string> half_precision_modules() const;
  /// Converts those modules in place. @throws NotSupportedError when the model is not on a GPU
  void convert_to_fp16();
  /// Converts the torso to any type, whatever use_fp16 says.
  void set_torso_dtype(torch::Dtype dtype);

 protected:
  explicit StreamCoder(Parts parts);

 private:
  void cast(const std::vector<std::string>& names, torch::Dtype dtype);

  Parts parts_;
};

}  // namespace anigen::models
