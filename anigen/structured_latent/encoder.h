#pragma once
#include <memory>
#include <string>
#include <vector>

#include "anigen/nn/blocks.h"
#include "anigen/nn/embeddings.h"
#include "anigen/nn/init.h"
#include "anigen/nn/trainable.h"
#include "anigen/skin_field/sampling.h"
#include "anigen/skin_field/skin_autoencoder.h"
#include "anigen/sparse/support.h"
#include "anigen/structured_latent/options.h"
#include "anigen/structured_latent/torso.h"

namespace anigen::geometry {
class NearestSurface;
}  // namespace anigen::geometry

namespace anigen::structured_latent {

/// The rigged meshes of a batch as the encoder reads them, one entry per asset. World frame.
struct RiggedMeshes {
  std::vector<torch::Tensor> joints;    ///< [J, 3] fp32
  std::vector<torch::Tensor> parents;   ///< [J] integers, -1 for a root
  std::vector<torch::Tensor> skin;      ///< [V, J] fp32
  std::vector<torch::Tensor> vertices;  ///< [V, 3] fp32
  std::vector<torch::Tensor> faces;     ///< [F, 3] integers
  /// One per asset: features move to voxels by the nearest surface point; empty: by the nearest vertex
  /// (docs/reference/autoencoders.md, 4.3).
  std::vector<std::shared_ptr<const geometry::NearestSurface>> surfaces;
};

/// Sources of the skin features of each asset's voxels. Depends on no parameter: may be worked out ahead.
/// @param voxels those of the surface @param upsampled at the centres of the eight parts of each voxel, eight rows per
/// voxel, z fastest; false: at its centre
/// @return per asset, [N, or 8 N] points @throws InputError when the batch sizes differ, naming the asset on bad meshes
std::vector<skin_field::VertexMix> skin_mixes(const sparse::Support& voxels, const RiggedMeshes& rigs,
                                              std::int64_t resolution, bool upsampled);

/// Input layers of the skin and the skeleton stream (docs/reference/autoencoders.md, 4.2 and 4.3). Not a module of its
/// own: registers `root_embedding`, `in_layer_skin.*`, `in_layer_jp_skl.*` and `in_layer_skin_skl.*` with the model.
class StructuredLatentInputs {
 public:
  StructuredLatentInputs() = default;
  StructuredLatentInputs(torch::nn::Module& model, const StructuredLatentEncoderOptions& options);

  /// @param mixes of skin_mixes() @param vertex_features per asset [V, F] @return [N, model_channels_skin]
  torch::Tensor skin(const sparse::Support& voxels, const std::vector<skin_field::VertexMix>& mixes,
                     const std::vector<torch::Tensor>& vertex_features);

  struct Skeleton {
    torch::Tensor features;                 ///< [M, model_channels_skl]
    std::vector<torch::Tensor> joints_pos;  ///< per asset [M_i, 3 or 4]: nearest joint, confidence
  };
  /// @param joint_features [ΣJ, F]
  Skeleton skeleton(const sparse::Support& voxels, const skin_field::SkeletonBatch& skeletons,
                    const torch::Tensor& joint_features);

  void initialize();  ///< the root embedding to zero; the linear layers are the model's to initialise

 private:
  std::int64_t resolution_ = 0;
  bool upsampled_ = true, residual_ = false, continuous_ = false;
  nn::FourierEmbedding fourier_{1};
  torch::Tensor root_embedding_;  ///< [1, width of fourier_]
  nn::FeedForward in_layer_skin_ = nullptr, in_layer_joints_ = nullptr, in_layer_joint_skin_ = nullptr;
};

/// Encoder of the structured latents: shape, skin and skeleton streams on sparse voxels (paper 3.3;
/// docs/reference/autoencoders.md, 4.1, 4.2, 4.3 and 4.4). Published keys. Gradients reach every parameter, the
/// SkinAE's encoder included, unless it is frozen.
///
/// Precision: fp32 as it is built; half_precision_modules() and convert_to_fp16() as SkinAutoEncoder.
class StructuredLatentEncoderImpl : public nn::FreezableModel {
 public:
  /// Parameters named by modules_to_freeze ask for no gradient if the options say so.
  explicit StructuredLatentEncoderImpl(const StructuredLatentEncoderOptions& options,
                                       nn::Init init = nn::Init::kPublished);

  struct Output {
    sparse::SparseTensor z;                            ///< on x: geometry L, then skin Ls channels
    sparse::SparseTensor z_skl;                        ///< on x_skl
    torch::Tensor mean, logvar, mean_skl, logvar_skl;  ///< rows as z and z_skl
    std::vector<torch::Tensor> joint_skin_embeds;      ///< per asset [J, F], of the SkinAE encoder
    std::vector<torch::Tensor> vert_skin_embeds;       ///< per asset [V, F]
    torch::Tensor x_skin, x_skl;                       ///< inputs of the two torsos, for inspection
    std::vector<torch::Tensor> joints_pos;             ///< per asset, what x_skl was made of, for inspection
    torch::Tensor z_geometry, z_skin;  ///< the two parts of z; with a frozen geometry the first carries no gradient
  };
  /// @param x surface voxels with image features @param x_skl skeleton voxels, no channels needed
  /// @param noise standard normal numbers for the sampled posteriors, in the order geometry [N, L], then, where those
  /// are posteriors, skin [N, Ls] and skeleton [M, Lk]; empty: the means
  /// @throws InputError naming what does not fit: batch sizes, channels, voxels outside the grid, values not finite,
  /// meshes and skeletons
  Output forward(const sparse::SparseTensor& x, const sparse::SparseTensor& x_skl, const RiggedMeshes& rigs,
                 const std::vector<torch::Tensor>& noise = {});

  /// Sources of the voxels' skin features: most of what forward() does outside the network. Thread-safe.
  std::vector<skin_field::VertexMix> skin_lookups(const sparse::Support& voxels, const RiggedMeshes& rigs) const;
  /// forward() with lookups worked out before; the rigs' vertices, faces and surfaces are not read.
  Output forward(const sparse::SparseTensor& x, const sparse::SparseTensor& x_skl, const RiggedMeshes& rigs,
                 const std::vector<skin_field::VertexMix>& lookups, const std::vector<torch::Tensor>& noise);

  struct SkinFeatures {
    std::vector<torch::Tensor> joints, vertices;  ///< per asset [J, F] and [V, F]
  };
  /// The SkinAE encoder alone: what the decoded features are trained towards.
  SkinFeatures encode_skin(const RiggedMeshes& rigs);

  /// Blocks keep only their inputs for the backward pass and run again in it (nn::recomputed). Default:
  /// use_checkpoint.
  void recompute_blocks(bool on) { torso_.recompute_blocks(on); }

  const StructuredLatentEncoderOptions& options() const { return options_; }
  skin_field::SkinEncoder& skin_encoder() { return skin_encoder_; }

 private:
  /// @param noise undefined: the mean
  nn::Latent latent_of(nn::Linear& head, const torch::Tensor& h, bool deterministic, const torch::Tensor& noise);

  StructuredLatentEncoderOptions options_;
  StructuredLatentTorso torso_;
  skin_field::SkinEncoder skin_encoder_ = nullptr;
  StructuredLatentInputs inputs_;
  PerStream<nn::Linear> out_{nullptr, nullptr, nullptr};
};
TORCH_MODULE(StructuredLatentEncoder);

}  // namespace anigen::structured_latent
