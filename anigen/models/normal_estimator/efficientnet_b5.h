#pragma once
#include <memory>
#include <vector>

#include "anigen/models/normal_estimator/efficientnet_block.h"

namespace anigen::models {

/// What the decoder reads of the encoder.
struct EncoderMaps {
  Tensor eighth;         ///< [B, 64, H/8, W/8]
  Tensor sixteenth;      ///< [B, 176, H/16, W/16]
  Tensor thirty_second;  ///< [B, 2048, H/32, W/32], before the norm and swish that would follow
};

/// EfficientNet-B5 with the padding and norms of the TensorFlow release (reference normal-estimator.md, 5), without
/// pooling and classifier; in evaluation. Keys `conv_stem.weight`, `bn1.*`, `blocks.<stage>.<block>.*`,
/// `conv_head.weight`, `bn2.*` (loaded, without influence).
class EfficientNetB5Impl : public torch::nn::Module {
 public:
  EfficientNetB5Impl();

  /// @param images [B, 3, H, W], normalised
  EncoderMaps forward(const Tensor& images);

 private:
  Conv2d conv_stem_ = nullptr, conv_head_ = nullptr;
  BatchNormState bn1_ = nullptr, bn2_ = nullptr;
  std::vector<std::vector<std::shared_ptr<EfficientNetBlockImpl>>> stages_;
};
TORCH_MODULE(EfficientNetB5);

}  // namespace anigen::models
