#pragma once
#include "anigen/nn/torch.h"

namespace anigen::models {

using torch::Tensor;

/// Pictures to tokens by halving: 3 × 3 convolutions of stride 2, each but the last followed by a group norm without
/// parameters and GELU. Knows edges before anything is learned, which a transformer over raw patches has to find out
/// (Xiao et al. 2021, "Early Convolutions Help Transformers See Better"). Keys `layers.<i>.weight` and `.bias`.
class ConvolutionStemImpl : public torch::nn::Module {
 public:
  /// @param width channels of the tokens @param patch_size pixels that become one token, a power of two above 1
  ConvolutionStemImpl(std::int64_t width, std::int64_t patch_size);

  /// @param images [B, 3, S, S], S a multiple of patch_size @return [B, (S / patch_size)², width], row by row
  Tensor forward(const Tensor& images);

 private:
  std::vector<torch::nn::Conv2d> layers_;
};
TORCH_MODULE(ConvolutionStem);

}  // namespace anigen::models
