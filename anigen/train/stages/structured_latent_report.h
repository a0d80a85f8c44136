#pragma once
#include <cstdint>
#include <vector>

#include "anigen/data/datasets.h"
#include "anigen/shape_field/mesh_extraction.h"
#include "anigen/structured_latent/options.h"

namespace anigen::train {

/// About how many bytes of activations a training step of the structured-latent auto-encoder keeps for its backward
/// pass when no block is recomputed: fp32 intermediate results of blocks, up-sampling and heads. An estimate from the
/// sizes alone, the same for every run, so that whether blocks are recomputed does not depend on what the machine has
/// free.
std::int64_t activation_bytes(const structured_latent::StructuredLatentEncoderOptions& encoder,
                              const structured_latent::StructuredLatentDecoderOptions& decoder, std::int64_t voxels,
                              std::int64_t skeleton_voxels);

/// Pictures of the shapes of a batch from its cameras, of the size of its images: what the losses on geometry and
/// colour compare (docs/reference/training.md, 3.3). Differentiable in what was decoded.
struct DecodedPictures {
  shape_field::SurfacePictures surface;
  torch::Tensor color;  ///< [N, 3, H, W]; undefined without colours
};

/// @param assets which of the batch, by index; meshes has one entry per asset of the batch, each with a surface
DecodedPictures decoded_pictures(const std::vector<shape_field::ExtractedMesh>& meshes,
                                 const std::vector<std::size_t>& assets, const data::FeatureSkeletonBatch& batch,
                                 torch::Device device);

/// The true meshes, normals turned towards the camera. No gradients.
shape_field::SurfacePictures true_pictures(const std::vector<std::size_t>& assets,
                                           const data::FeatureSkeletonBatch& batch, torch::Device device);

/// Mean over the assets of tsdf_loss() on the corners of the fine grid. @param truth of true_pictures()
torch::Tensor mean_tsdf_loss(const std::vector<shape_field::ExtractedMesh>& meshes,
                             const std::vector<std::size_t>& assets, const shape_field::SurfacePictures& truth,
                             const data::FeatureSkeletonBatch& batch, std::int64_t resolution);

}  // namespace anigen::train
