#pragma once
#include <functional>
#include <string>
#include <vector>

#include "anigen/fields/mesh_extraction.h"
#include "anigen/fields/skeleton_field.h"
#include "anigen/models/skin_decoder.h"
#include "anigen/models/stream_coder.h"
#include "anigen/models/structured_latent_grouped_cross.h"
#include "anigen/models/structured_latent_options.h"
#include "anigen/models/structured_latent_skeleton.h"
#include "anigen/models/structured_latent_skin_unet.h"
#include "anigen/models/structured_latent_torso.h"
#include "anigen/models/structured_latent_upsampler.h"
#include "anigen/nn/init.h"

namespace anigen::models {

/// Decoder of the structured latents into the S³ fields: a mesh field on fine voxels, a skeleton field with confidence,
/// skin features on both (paper 3.3; reference autoencoders.md, 3.5–3.9). Keys as its Appendix A.4.
///
/// Precision: fp32 as it is built; half_precision_modules() and convert_to_fp16() as SkinAutoEncoder. Of the
/// off-by-default grouped cross attention the published system also halves two bare parameters and a norm, which stay
/// fp32 here.
class StructuredLatentDecoderImpl : public StreamCoder {
 public:
  /// Parameters named by modules_to_freeze ask for no gradient if the options say so.
  explicit StructuredLatentDecoderImpl(const StructuredLatentDecoderOptions& options,
                                       nn::Init init = nn::Init::kPublished);

  struct Fields {
    sparse::SparseTensor mesh;                              ///< fine voxels, mesh_options().channels() channels, fp32
    sparse::SparseTensor skeleton;                          ///< raw channels of the skeleton heads
    std::vector<fields::SkeletonField> skeletons;           ///< per asset, activated
    std::vector<fields::SkeletonTensors> joints;            ///< per asset: grouped, or what the caller gave
    std::vector<fields::JointSkinFeatures> joint_features;  ///< per asset
    torch::Tensor skin_coarse;  ///< what the up-sampling of the skin starts from, for inspection
  };
  /// @param z geometry and skin channels on the surface voxels @param z_skl on the skeleton voxels
  /// @param given skeletons instead of the grouped ones, one per asset; empty: group the votes
  /// @throws InputError naming what does not fit: batch sizes, channels, voxels outside the grid, values not finite
  Fields forward(const sparse::SparseTensor& z, const sparse::SparseTensor& z_skl,
                 const std::vector<fields::SkeletonTensors>& given = {});
  /// The same with geometry and skin apart, on one support: a frozen geometry whose latents carry no gradient then
  /// keeps nothing for the backward pass.
  Fields forward(const PerStream<sparse::SparseTensor>& z, const std::vector<fields::SkeletonTensors>& given = {});

  /// Another way to turn votes into a skeleton than grouping_strategy; an empty function: grouping_strategy again.
  void group_with(std::function<fields::SkeletonTensors(const fields::SkeletonField&)> grouping);

  /// Layout of Fields::mesh, for fields::extract_mesh.
  const fields::MeshFieldOptions& mesh_options() const { return mesh_options_; }
  /// Meshes of each asset. @param training see fields::extract_mesh
  std::vector<fields::ExtractedMesh> extract_meshes(const Fields& decoded, bool training);
  /// Skin weights of any points of one asset from their skin features, in chunks of points that take at most
  /// `max_bytes` beside the result, at least one point (reference autoencoders.md, 1.2 and 4.6). Exact: a point's
  /// weights depend on its own feature and the joints only. With gradients the graph of all chunks is kept.
  /// @param vertex_features [V, F] @param joint_features [J, F] @return [V, J]
  /// @throws InputError for shapes that do not fit, a skeleton without joints, a parent out of range
  torch::Tensor skin_weights(const torch::Tensor& vertex_features, const fields::SkeletonTensors& skeleton,
                             const torch::Tensor& joint_features, std::int64_t max_bytes = 256 << 20);

  /// Blocks of the torso and of the up-sampling keep only their inputs for the backward pass and run again in it (see
  /// recompute.h). Default: use_checkpoint.
  void recompute_blocks(bool on);

  const StructuredLatentDecoderOptions& options() const { return options_; }
  SkinDecoder& skin_decoder() { return skin_decoder_; }

 private:
  /// Fills the skeleton part of `decoded` from the torso's skeleton stream.
  void decode_joints(const sparse::SparseTensor& h, const std::vector<fields::SkeletonTensors>& given, Fields& decoded);
  sparse::SparseTensor decode_surface(const sparse::SparseTensor& geometry, const sparse::SparseTensor& skin);

  StructuredLatentDecoderOptions options_;
  fields::MeshFieldOptions mesh_options_;
  SkeletonHeadLayout layout_;
  bool recompute_ = false;
  std::function<fields::SkeletonTensors(const fields::SkeletonField&)> grouping_;
  StructuredLatentTorso torso_;
  SkinDecoder skin_decoder_ = nullptr;
  SkinUnet skin_unet_ = nullptr;
  GroupedCross grouped_cross_;
  StructuredLatentUpsampler upsample_, upsample_skin_, upsample_skeleton_;
  nn::Linear out_layer_ = nullptr, out_layer_skin_ = nullptr, out_layer_skl_skin_ = nullptr, out_layer_skl_ = nullptr;
};
TORCH_MODULE(StructuredLatentDecoder);

}  // namespace anigen::models
