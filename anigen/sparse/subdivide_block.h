#pragma once
#include "anigen/sparse/convolution.h"
#include "anigen/sparse/group_norm.h"

namespace anigen::sparse {

struct SubdivideBlockOptions {
  std::int64_t channels = 0, out_channels = 0;
  bool subdivide = true;          ///< false: the residual block of the skin U-Net
  bool skip_convolution = false;  ///< a 1³ convolution on the skip even when the width stays
  std::int64_t groups = 32;
};

/// Up-sampling block of the decoder (reference autoencoders.md, 3.7): norm and SiLU, subdivision of both branches, two
/// convolutions with a norm between, plus the skip. Keys `act_layers.0.*`, `out_layers.0.conv.*`, `out_layers.1.*`,
/// `out_layers.3.conv.*`, `skip_connection.conv.*`.
class SubdivideBlockImpl : public torch::nn::Module {
 public:
  explicit SubdivideBlockImpl(const SubdivideBlockOptions& options);
  SparseTensor forward(const SparseTensor& x);
  void initialize();           ///< the last convolution to zero; call after default_submanifold_kernels
  torch::Dtype dtype() const;  ///< of the convolutions

 private:
  SubdivideBlockOptions options_;
  SparseGroupNorm norm1_ = nullptr, norm2_ = nullptr;
  SubmanifoldConv3d conv1_ = nullptr, conv2_ = nullptr, skip_ = nullptr;
};
TORCH_MODULE(SubdivideBlock);

}  // namespace anigen::sparse
