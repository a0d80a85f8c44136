#include "anigen/pipeline/encode_sparse_structure.h"

#include <optional>
#include <utility>
#include <vector>

#include "anigen/loaders/files/voxel_files.h"
#include "anigen/pipeline/device.h"

namespace anigen::pipeline {
namespace {

namespace fs = std::filesystem;

void add_to(models::VoxelAgreement& sum, const models::VoxelAgreement& one) {
  sum.iou += one.iou;
  sum.precision += one.precision;
  sum.recall += one.recall;
  sum.f1 += one.f1;
}

models::VoxelAgreement divided(models::VoxelAgreement sum, std::size_t count) {
  for (double* value : {&sum.iou, &sum.precision, &sum.recall, &sum.f1}) *value /= static_cast<double>(count);
  return sum;
}

class StructureLatents : public LatentSource {
 public:
  explicit StructureLatents(const EncodeRequest& request)
      : check_(request.check), coder_(request.run, request.ckpt, parse_device(request.device), request.check) {}

  fs::path checkpoint() const override { return coder_.checkpoint(); }
  std::string fingerprint() const override { return coder_.fingerprint(); }
  std::string required_flag() const override { return "voxelized"; }
  std::vector<fs::path> inputs(const loaders::AssetId& asset) const override {
    return {loaders::surface_voxel_path(asset), loaders::skeleton_voxel_path(asset)};
  }

  void encode(const loaders::AssetId& asset, const fs::path& file) override {
    voxels_ = coder_.voxels(asset);
    voxels_of_ = asset.id;
    coder_.encode(*voxels_, file);
  }

  LatentValues read(const fs::path& file) const override {
    loaders::StructureLatent latent = loaders::read_structure_latent(file);
    LatentValues values;
    values.shape_channels = static_cast<std::size_t>(latent.mean.shape[0]);
    values.skeleton_channels = static_cast<std::size_t>(latent.mean_skl.shape[0]);
    values.shape = std::move(latent.mean.values);
    values.skeleton = std::move(latent.mean_skl.values);
    return values;
  }

  void inspect(const loaders::AssetId& asset, const fs::path& file) override {
    if (!check_) return;
    if (!voxels_ || voxels_of_ != asset.id) {
      voxels_ = coder_.voxels(asset);
      voxels_of_ = asset.id;
    }
    const StructureReconstruction one = coder_.agreement(loaders::read_structure_latent(file), *voxels_);
    add_to(sum_.shape, one.shape);
    add_to(sum_.skeleton, one.skeleton);
    ++inspected_;
  }

  std::optional<StructureReconstruction> reconstruction() const {
    if (inspected_ == 0) return std::nullopt;
    return StructureReconstruction{divided(sum_.shape, inspected_), divided(sum_.skeleton, inspected_)};
  }

 private:
  bool check_;
  StructureCoder coder_;
  std::optional<loaders::SparseStructureBatch> voxels_;  // of the asset read last
  std::string voxels_of_;
  StructureReconstruction sum_;
  std::size_t inspected_ = 0;
};

}  // namespace

EncodeResult encode_sparse_structure(const EncodeRequest& request) {
  const LatentFolder folder(request.data, request.name, request.run);
  StructureLatents source(request);
  EncodeResult result;
  static_cast<EncodedLatents&>(result) = encode_latents(request, folder, source);
  result.reconstruction = source.reconstruction();
  return result;
}

}  // namespace anigen::pipeline
