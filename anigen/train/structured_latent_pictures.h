#pragma once
#include <vector>

#include "anigen/fields/mesh_extraction.h"
#include "anigen/loaders/datasets/feature_skeleton_dataset.h"
#include "anigen/models/structured_latent_geometry_loss.h"

namespace anigen::train {

/// Pictures of the shapes of a batch from its cameras, of the size of its images: what the losses on geometry and
/// colour compare (reference training-and-data.md, 3.3, geo_loss). Differentiable in what was decoded.
struct DecodedPictures {
  models::SurfacePictures surface;
  torch::Tensor color;  ///< [N, 3, H, W]; undefined without colours
};

/// @param assets which of the batch, by index; meshes has one entry per asset of the batch, each with a surface
DecodedPictures decoded_pictures(const std::vector<fields::ExtractedMesh>& meshes,
                                 const std::vector<std::size_t>& assets, const loaders::FeatureSkeletonBatch& batch,
                                 torch::Device device);

/// The true meshes, normals turned towards the camera. No gradients.
models::SurfacePictures true_pictures(const std::vector<std::size_t>& assets,
                                      const loaders::FeatureSkeletonBatch& batch, torch::Device device);

/// Mean over the assets of tsdf_loss() on the corners of the fine grid. @param truth of true_pictures()
torch::Tensor mean_tsdf_loss(const std::vector<fields::ExtractedMesh>& meshes, const std::vector<std::size_t>& assets,
                             const models::SurfacePictures& truth, const loaders::FeatureSkeletonBatch& batch,
                             std::int64_t resolution);

}  // namespace anigen::train
