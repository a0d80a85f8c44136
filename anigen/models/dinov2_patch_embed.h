#pragma once
#include "anigen/nn/torch.h"

namespace anigen::models {

using torch::Tensor;

/// Cuts a picture into square patches and maps each to C channels: a convolution whose stride is its width. Keys
/// `proj.weight` [C, 3, patch, patch] and `proj.bias` [C], not initialised.
class PatchEmbedImpl : public torch::nn::Module {
 public:
  PatchEmbedImpl(std::int64_t channels, std::int64_t patch_size);

  /// @param images [B, 3, H, W] @return [B, P, C], patches row by row
  Tensor forward(const Tensor& images);

 private:
  struct Projection : torch::nn::Module {
    Tensor weight, bias;
  };

  std::int64_t patch_size_;
  std::shared_ptr<Projection> projection_;
};
TORCH_MODULE(PatchEmbed);

}  // namespace anigen::models
