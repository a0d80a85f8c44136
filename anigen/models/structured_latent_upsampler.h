#pragma once
#include <vector>

#include "anigen/sparse/subdivide_block.h"

namespace anigen::models {

/// Two up-sampling blocks that take a stream from R to 4 R (reference autoencoders.md, 3.7). Registered with the model
/// under one name, keys `<name>.0.*` and `<name>.1.*`.
class StructuredLatentUpsampler {
 public:
  StructuredLatentUpsampler() = default;
  /// @param channels widths before, between and behind
  StructuredLatentUpsampler(torch::nn::Module& model, const char* name, std::int64_t channels, std::int64_t between,
                            std::int64_t behind);
  bool present() const { return !blocks_.empty(); }

  /// @return in the dtype of the blocks @param recompute whether blocks keep only their inputs for the backward pass
  sparse::SparseTensor forward(const sparse::SparseTensor& x, bool recompute);

 private:
  std::vector<sparse::SubdivideBlock> blocks_;
};

}  // namespace anigen::models
