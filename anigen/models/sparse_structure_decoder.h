#pragma once
#include <string>
#include <vector>

#include "anigen/models/sparse_structure_coder.h"
#include "anigen/models/sparse_structure_resnet.h"
#include "anigen/models/sparse_structure_tokens.h"
#include "anigen/nn/init.h"

namespace anigen::models {

/// Latents of the sparse structure → occupancy of surface and skeleton at downsampling() times their resolution
/// (paper 3.2.2; reference autoencoders.md, 2). A voxel is occupied where its logit is above 0. Freezing and precision
/// as SparseStructureEncoder.
class SparseStructureDecoderImpl : public SparseStructureCoder {
 public:
  explicit SparseStructureDecoderImpl(const SparseStructureDecoderOptions& options,
                                      nn::Init init = nn::Init::kPublished);

  struct Logits {
    torch::Tensor shape;     ///< [B, out, R, R, R]
    torch::Tensor skeleton;  ///< [B, out_skl, R, R, R]
  };
  /// @param z [B, C, r, r, r], or [B, T, C] with encode_global @param z_skl the same for the skeleton
  /// @throws InputError when a shape does not fit
  Logits forward(const torch::Tensor& z, const torch::Tensor& z_skl);
  torch::Tensor decode_shape(const torch::Tensor& z);  ///< the shape stream alone
  torch::Tensor decode_skeleton(const torch::Tensor& z_skl);

  const SparseStructureDecoderOptions& options() const { return options_; }

 private:
  struct Stream {
    nn::Conv3d input = nullptr;  // without encode_global
    GlobalTokenDecoder tokens;   // with encode_global
    VolumeTorso middle = nullptr, blocks = nullptr;
    VolumeHead out = nullptr;
  };
  torch::Tensor run(Stream& stream, const torch::Tensor& z, bool skeleton);

  SparseStructureDecoderOptions options_;
  Stream shape_, skeleton_;
};
TORCH_MODULE(SparseStructureDecoder);

}  // namespace anigen::models
