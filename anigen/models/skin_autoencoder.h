#pragma once
#include <string>
#include <vector>

#include "anigen/models/skin_decoder.h"
#include "anigen/models/skin_encoder.h"
#include "anigen/nn/init.h"

namespace anigen::models {

/// The skin auto-encoder (paper 3.3.1, "SkinAE"; reference autoencoders.md, 1). It gives every joint a short feature
/// and every surface point a feature of the same width from which the point's skin weights can be decoded, so that
/// skinning with any number of joints becomes a field of fixed width.
///
/// A batch is treated as one: row-wise layers run once over the joints, or points, of all assets, attention stays
/// inside each asset. Results equal those of one asset at a time up to fp32 rounding.
///
/// Precision: parameters are fp32 and everything is computed in fp32. The published model keeps the joint embedder's
/// blocks, and with use_fp16 the decoder's blocks, in fp16; half_precision_modules() names them, and convert_to_fp16()
/// does the same on a GPU.
class SkinAutoEncoderImpl : public torch::nn::Module {
 public:
  explicit SkinAutoEncoderImpl(const SkinAutoEncoderOptions& options, nn::Init init = nn::Init::kPublished);

  struct Output {
    std::vector<torch::Tensor> joint_embeds;  ///< per asset [J, F]
    std::vector<torch::Tensor> vert_embeds;   ///< per asset [V, F]
    std::vector<torch::Tensor> skin;          ///< per asset [V, J], rows sum to 1
  };
  /// Encodes and decodes again.
  /// @param joints per asset [J, 3] object space @param parents per asset [J] integers, -1 for roots
  /// @param skin per asset [V, J] weights at any points, rows sum to 1
  /// @throws InputError naming the asset on wrong shapes, parents or values
  Output forward(const std::vector<torch::Tensor>& joints, const std::vector<torch::Tensor>& parents,
                 const std::vector<torch::Tensor>& skin);

  /// What a training step needs: log weights per asset [V, J] (see SkinDecoder::decode_log).
  std::vector<torch::Tensor> reconstruct_log(const SkeletonBatch& skeletons, const std::vector<torch::Tensor>& skin);

  struct JointCode {
    torch::Tensor embeddings;  ///< [ΣJ, E], for encode_vertices
    torch::Tensor features;    ///< [ΣJ, F]
  };
  JointCode encode_joints(const SkeletonBatch& skeletons);
  /// @return [ΣV, F]
  torch::Tensor encode_vertices(const JointCode& joints, const SkeletonBatch& skeletons,
                                const std::vector<torch::Tensor>& skin);
  /// @param vertex_features [ΣV, F] @param vertices points per asset @return per asset [V, J]
  std::vector<torch::Tensor> decode(const torch::Tensor& vertex_features, const nn::Ragged& vertices,
                                    const torch::Tensor& joint_features, const SkeletonBatch& skeletons);

  /// Names of the modules whose linears are fp16 in the published system, for published_dtypes().
  std::vector<std::string> half_precision_modules() const;
  /// Converts those modules in place. @throws NotSupportedError when the model is not on a GPU
  void convert_to_fp16();

  const SkinAutoEncoderOptions& options() const { return options_; }
  SkinEncoder& encoder() { return encoder_; }
  SkinDecoder& decoder() { return decoder_; }

 private:
  SkinAutoEncoderOptions options_;
  SkinEncoder encoder_ = nullptr;
  SkinDecoder decoder_ = nullptr;
};
TORCH_MODULE(SkinAutoEncoder);

/// Rows of each matrix, as items of their concatenation.
nn::Ragged rows_of(const std::vector<torch::Tensor>& matrices);

}  // namespace anigen::models
