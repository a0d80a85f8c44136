#include "anigen/train/structured_latent_pictures.h"

#include "anigen/raster/mesh_renderer.h"

namespace anigen::train {
namespace {

using torch::Tensor;

constexpr double kNearPlane = 1.0, kFarPlane = 3.0;
constexpr std::int64_t kColorChannels = 3;

// Of one asset.
struct AssetCamera {
  Tensor extrinsics, intrinsics;
};

AssetCamera camera_of(const loaders::FeatureSkeletonBatch& batch, std::size_t asset, torch::Device device) {
  const auto row = static_cast<std::int64_t>(asset);
  return {batch.extrinsics[row].to(device), batch.intrinsics[row].to(device)};
}

raster::Rendering rendered(const Tensor& vertices, const Tensor& faces, const Tensor& attributes,
                           const AssetCamera& camera, std::int64_t edge) {
  raster::RenderOptions options;
  options.resolution = edge;
  options.near = kNearPlane;
  options.far = kFarPlane;
  return raster::render_mesh(vertices, faces, attributes, camera.extrinsics, camera.intrinsics, options);
}

// The pictures of several renderings, channels first.
class PictureStack {
 public:
  void add(const raster::Rendering& one) {
    masks_.push_back(one.mask.unsqueeze(0));
    depths_.push_back(one.depth.unsqueeze(0));
    normals_.push_back(one.normal.permute({2, 0, 1}));
  }
  models::SurfacePictures stacked() const {
    return {torch::stack(masks_), torch::stack(depths_), torch::stack(normals_), Tensor()};
  }

 private:
  std::vector<Tensor> masks_, depths_, normals_;
};

Tensor selected(const Tensor& rows, const std::vector<std::size_t>& assets, torch::Device device) {
  std::vector<Tensor> chosen;
  for (const std::size_t asset : assets) chosen.push_back(rows[static_cast<std::int64_t>(asset)]);
  return torch::stack(chosen).to(device);
}

}  // namespace

DecodedPictures decoded_pictures(const std::vector<fields::ExtractedMesh>& meshes,
                                 const std::vector<std::size_t>& assets, const loaders::FeatureSkeletonBatch& batch,
                                 torch::Device device) {
  const std::int64_t edge = batch.image.size(-1);
  PictureStack stack;
  std::vector<Tensor> colors;
  for (const std::size_t asset : assets) {
    const fields::ExtractedMesh& mesh = meshes[asset];
    const raster::Rendering one =
        rendered(mesh.vertices, mesh.faces, mesh.attributes, camera_of(batch, asset, device), edge);
    stack.add(one);
    if (!one.attributes.defined()) continue;
    colors.push_back(one.attributes.slice(2, 0, kColorChannels).permute({2, 0, 1}));
  }
  DecodedPictures pictures{stack.stacked(), Tensor()};
  if (colors.size() == assets.size()) pictures.color = torch::stack(colors);
  return pictures;
}

models::SurfacePictures true_pictures(const std::vector<std::size_t>& assets,
                                      const loaders::FeatureSkeletonBatch& batch, torch::Device device) {
  const torch::NoGradGuard no_grad;
  const std::int64_t edge = batch.image.size(-1);
  PictureStack stack;
  for (const std::size_t asset : assets) {
    stack.add(rendered(batch.rigs.vertices[asset].to(device), batch.rigs.faces[asset].to(device, torch::kInt64),
                       Tensor(), camera_of(batch, asset, device), edge));
  }
  models::SurfacePictures pictures = stack.stacked();
  pictures.normal = models::facing_camera(pictures.normal, selected(batch.extrinsics, assets, device),
                                          selected(batch.intrinsics, assets, device));
  return pictures;
}

Tensor mean_tsdf_loss(const std::vector<fields::ExtractedMesh>& meshes, const std::vector<std::size_t>& assets,
                      const models::SurfacePictures& truth, const loaders::FeatureSkeletonBatch& batch,
                      std::int64_t resolution) {
  Tensor sum;
  for (std::size_t i = 0; i < assets.size(); ++i) {
    const fields::CubeField& field = meshes[assets[i]].field;
    const AssetCamera camera = camera_of(batch, assets[i], field.sdf.device());
    const Tensor one =
        models::tsdf_loss(field.positions().detach(), field.sdf, truth.depth[static_cast<std::int64_t>(i)][0],
                          camera.extrinsics, camera.intrinsics, resolution);
    sum = i == 0 ? one : sum + one;
  }
  return sum / static_cast<double>(assets.size());
}

}  // namespace anigen::train
