#include "anigen/loaders/datasets/sparse_structure_dataset.h"

#include <algorithm>

#include "anigen/loaders/files/voxel_files.h"

namespace anigen::loaders {
namespace {

using geometry::Voxel;

torch::Tensor occupancy_grids(const std::vector<const std::vector<Voxel>*>& sets, int resolution) {
  const std::int64_t r = resolution;
  torch::Tensor grids = torch::empty({static_cast<std::int64_t>(sets.size()), 1, r, r, r}, torch::kInt64);
  std::int64_t* grid = grids.data_ptr<std::int64_t>();
  std::fill_n(grid, grids.numel(), std::int64_t{0});
  for (const std::vector<Voxel>* voxels : sets) {
    for (const Voxel& v : *voxels) grid[(v[0] * r + v[1]) * r + v[2]] = 1;
    grid += r * r * r;
  }
  return grids;
}

}  // namespace

SparseStructureOptions SparseStructureOptions::read(ConfigReader& reader) {
  SparseStructureOptions options;
  options.sources.read_common(reader);
  options.sources.filter.required_flags = {"voxelized"};
  options.sources.filter.drop_bad_skeleton = false;
  options.resolution = static_cast<int>(reader.integer("resolution", 64, 1, kMostResolution));
  options.skl_dilation_iter = static_cast<int>(reader.integer("skl_dilation_iter", 0, 0, kMostResolution));
  return options;
}

struct SparseStructureDataset::Occupancy : Sample {
  std::vector<Voxel> surface, skeleton;
};

SparseStructureDataset::SparseStructureDataset(std::vector<AssetId> assets, const SparseStructureOptions& options,
                                               std::uint64_t seed)
    : AssetDataset(std::move(assets), {seed, options.sources.skip_broken, false},
                   {[](const AssetId& asset) {
                      return std::vector{surface_voxel_path(asset), skeleton_voxel_path(asset)};
                    },
                    nullptr}),
      options_(options) {}

std::unique_ptr<AssetDataset::Sample> SparseStructureDataset::read(std::size_t index, std::uint64_t) const {
  auto sample = std::make_unique<Occupancy>();
  sample->surface = read_voxel_rows(surface_voxel_path(asset(index)), options_.resolution);
  sample->skeleton = geometry::dilate(read_voxel_rows(skeleton_voxel_path(asset(index)), options_.resolution),
                                      options_.resolution, options_.skl_dilation_iter);
  return sample;
}

std::unique_ptr<Batch> SparseStructureDataset::collate(const Samples& samples, const std::vector<std::string>&) const {
  std::vector<const std::vector<Voxel>*> surfaces, skeletons;
  for (const auto& sample : samples) {
    const auto& occupancy = static_cast<const Occupancy&>(*sample);
    surfaces.push_back(&occupancy.surface);
    skeletons.push_back(&occupancy.skeleton);
  }
  auto batch = std::make_unique<SparseStructureBatch>();
  batch->ss = occupancy_grids(surfaces, options_.resolution);
  batch->ss_skl = occupancy_grids(skeletons, options_.resolution);
  return batch;
}

}  // namespace anigen::loaders
