#pragma once
#include <vector>

#include "anigen/nn/linear.h"
#include "anigen/sparse/resampling.h"
#include "anigen/sparse/subdivide_block.h"

namespace anigen::models {

/// Sparse U-Net that smooths the skin stream, at R and coarser, always in fp32 (reference autoencoders.md, 3.9). Keys
/// `enc.{i}.*`, `mid.*`, `fuse.{i}.*`, `dec.{i}.*` with the keys of SubdivideBlock below them.
class SkinUnetImpl : public torch::nn::Module {
 public:
  /// @param levels halvings of the resolution, at least 1
  SkinUnetImpl(std::int64_t channels, std::int64_t levels);
  /// @return the support and dtype of x
  sparse::SparseTensor forward(const sparse::SparseTensor& x);

 private:
  std::vector<sparse::SubdivideBlock> down_blocks_, up_blocks_;
  sparse::SubdivideBlock middle_ = nullptr;
  std::vector<nn::Linear> fuse_;
};
TORCH_MODULE(SkinUnet);

}  // namespace anigen::models
