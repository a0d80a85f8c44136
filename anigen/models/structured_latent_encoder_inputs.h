#pragma once
#include <memory>
#include <vector>

#include "anigen/models/skeleton_batch.h"
#include "anigen/models/structured_latent_options.h"
#include "anigen/models/vertex_mix.h"
#include "anigen/nn/feed_forward.h"
#include "anigen/nn/fourier_embedding.h"
#include "anigen/sparse/support.h"

namespace anigen::geometry {
class NearestSurface;
}

namespace anigen::models {

/// The rigged meshes of a batch as the encoder reads them, one entry per asset. World frame.
struct RiggedMeshes {
  std::vector<torch::Tensor> joints;    ///< [J, 3] fp32
  std::vector<torch::Tensor> parents;   ///< [J] integers, -1 for a root
  std::vector<torch::Tensor> skin;      ///< [V, J] fp32
  std::vector<torch::Tensor> vertices;  ///< [V, 3] fp32
  std::vector<torch::Tensor> faces;     ///< [F, 3] integers
  /// One per asset: features move to voxels by the nearest surface point; empty: by the nearest vertex (reference
  /// autoencoders.md, 3.3).
  std::vector<std::shared_ptr<const geometry::NearestSurface>> surfaces;
};

/// Where the voxels of each asset take their skin features from. Depends on no parameter: may be worked out ahead.
/// @param voxels those of the surface @param upsampled at the centres of the eight parts of each voxel, eight rows per
/// voxel, z fastest; false: at its centre
/// @return per asset, [N, or 8 N] points @throws InputError when the batch sizes differ, naming the asset on bad meshes
std::vector<VertexMix> skin_mixes(const sparse::Support& voxels, const RiggedMeshes& rigs, std::int64_t resolution,
                                  bool upsampled);

/// Input layers of the skin and the skeleton stream (reference autoencoders.md, 3.2 and 3.3). Not a module of its own:
/// registers `root_embedding`, `in_layer_skin.*`, `in_layer_jp_skl.*` and `in_layer_skin_skl.*` with the model.
class StructuredLatentInputs {
 public:
  StructuredLatentInputs() = default;
  StructuredLatentInputs(torch::nn::Module& model, const StructuredLatentEncoderOptions& options);

  /// @param mixes of skin_mixes() @param vertex_features per asset [V, F] @return [N, model_channels_skin]
  torch::Tensor skin(const sparse::Support& voxels, const std::vector<VertexMix>& mixes,
                     const std::vector<torch::Tensor>& vertex_features);

  struct Skeleton {
    torch::Tensor features;                 ///< [M, model_channels_skl]
    std::vector<torch::Tensor> joints_pos;  ///< per asset [M_i, 3 or 4]: nearest joint, confidence
  };
  /// @param joint_features [ΣJ, F]
  Skeleton skeleton(const sparse::Support& voxels, const SkeletonBatch& skeletons, const torch::Tensor& joint_features);

  void initialize();  ///< the root embedding to zero; the linear layers are the model's to initialise

 private:
  std::int64_t resolution_ = 0;
  bool upsampled_ = true, residual_ = false, continuous_ = false;
  nn::FourierEmbedding fourier_{1};
  torch::Tensor root_embedding_;  ///< [1, width of fourier_]
  nn::FeedForward in_layer_skin_ = nullptr, in_layer_joints_ = nullptr, in_layer_joint_skin_ = nullptr;
};

}  // namespace anigen::models
