#pragma once
#include <functional>
#include <vector>

#include "anigen/nn/torch.h"
#include "anigen/nn/volume_layers.h"

namespace anigen::models {

/// x' = skip(x) + conv2(silu(norm2(conv1(silu(norm1(x)))))): 3³ convolutions, channel layer norms, skip the identity or
/// a 1³ convolution where the width changes (reference autoencoders.md, 2.1, ResBlock). Keys `norm{1,2}.*`,
/// `conv{1,2}.*`, `skip_connection.*`. The model's initialisation must call initialize(), which makes a fresh block
/// the identity (of its skip).
class VolumeResBlockImpl : public torch::nn::Module {
 public:
  VolumeResBlockImpl(std::int64_t in_channels, std::int64_t out_channels);
  torch::Tensor forward(const torch::Tensor& x);  ///< @param x [B, C, X, Y, Z] @return [B, C', X, Y, Z]
  void initialize();                              ///< conv2 to zero

 private:
  nn::VolumeNorm norm1_ = nullptr, norm2_ = nullptr;
  nn::Conv3d conv1_ = nullptr, conv2_ = nullptr, skip_connection_ = nullptr;
};
TORCH_MODULE(VolumeResBlock);

/// 2³ convolution of stride 2 (Down). Key `conv.*`.
class VolumeDownsampleImpl : public torch::nn::Module {
 public:
  VolumeDownsampleImpl(std::int64_t in_channels, std::int64_t out_channels);
  torch::Tensor forward(const torch::Tensor& x) { return conv_->forward(x); }

 private:
  nn::Conv3d conv_ = nullptr;
};
TORCH_MODULE(VolumeDownsample);

/// 3³ convolution to eight times the width, then pixel shuffle by 2 (Up). Key `conv.*`.
class VolumeUpsampleImpl : public torch::nn::Module {
 public:
  VolumeUpsampleImpl(std::int64_t in_channels, std::int64_t out_channels);
  torch::Tensor forward(const torch::Tensor& x);

 private:
  nn::Conv3d conv_ = nullptr;
};
TORCH_MODULE(VolumeUpsample);

/// norm, SiLU, 3³ convolution: the `out_layer` of a stream, contiguous. Keys `0.*` (norm), `2.*` (convolution).
class VolumeHeadImpl : public torch::nn::Module {
 public:
  VolumeHeadImpl(std::int64_t in_channels, std::int64_t out_channels, nn::VolumeNormImpl::Kind norm);
  torch::Tensor forward(const torch::Tensor& x);

 private:
  nn::VolumeNorm norm_ = nullptr;
  nn::Conv3d conv_ = nullptr;
};
TORCH_MODULE(VolumeHead);

/// A row of VolumeResBlocks and resamplers, or of nothing; keys `0.*`, `1.*`, … One dtype for all convolutions inside,
/// which forward() casts to.
class VolumeTorsoImpl : public torch::nn::Module {
 public:
  void add_res_blocks(std::int64_t count, std::int64_t channels);
  void add_downsample(std::int64_t in_channels, std::int64_t out_channels);
  void add_upsample(std::int64_t in_channels, std::int64_t out_channels);

  /// @param x [B, C, X, Y, Z] of any floating dtype @return in the dtype of the convolutions; x itself when empty
  torch::Tensor forward(const torch::Tensor& x);

 private:
  template <typename Holder>
  void add(Holder layer);
  std::vector<std::function<torch::Tensor(const torch::Tensor&)>> layers_;
  torch::Tensor first_kernel_;  // of the first convolution, to know their dtype
};
TORCH_MODULE(VolumeTorso);

/// PyTorch's initial values for all convolutions below `module`, 1/0 for norms, then VolumeResBlock::initialize
/// (reference autoencoders.md, 2.3).
void initialize_volume_layers(torch::nn::Module& module);

}  // namespace anigen::models
