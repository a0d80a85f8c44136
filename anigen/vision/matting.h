#pragma once
#include <cstdint>
#include <string>

#include "anigen/core/config_fields.h"
#include "anigen/nn/init.h"
#include "anigen/nn/torch.h"
#include "anigen/vision/unet.h"

namespace anigen::vision {

inline constexpr const char* kMattingUNetClass = "MattingUNet";

/// Arguments of the matting network, a model of ours.
struct MattingUNetOptions : UNetOptions, JsonOptions<MattingUNetOptions> {
  MattingUNetOptions();

  void fields(ConfigFields& f);
  void validate(const std::string& file = "", const std::string& pointer = "") const;
};

/// Matting: separates the object of a picture from its background. A U-Net (vision/unet.h) gives logits at half the
/// size, which are interpolated; a convolution at full size that sees the picture beside its features refines them.
/// Always fp32.
class MattingUNetImpl : public torch::nn::Module {
 public:
  explicit MattingUNetImpl(const MattingUNetOptions& options, nn::Init init = nn::Init::kPublished);

  /// @param images [B, 3, S, S] fp32 in [0, 1] @return [B, 1, S, S] logits of alpha
  /// @throws InputError on another shape
  Tensor forward(const Tensor& images);

  const MattingUNetOptions& options() const { return options_; }

 private:
  MattingUNetOptions options_;
  UNet unet_ = nullptr;
  torch::nn::Conv2d coarse_ = nullptr, detail_ = nullptr, fine_ = nullptr;
};
TORCH_MODULE(MattingUNet);

}  // namespace anigen::vision
