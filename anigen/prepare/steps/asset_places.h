#pragma once
#include <filesystem>
#include <string>

namespace anigen::prepare {

/// Where the files of one asset lie in a dataset: the published names (reference training-and-data.md, 1.1) and our
/// own assets/ and records/.
struct AssetPlaces {
  std::filesystem::path out;
  std::string id;

  std::filesystem::path record() const { return out / "records" / (id + ".json"); }
  std::filesystem::path asset() const { return out / "assets" / (id + ".glb"); }
  std::filesystem::path skeleton() const { return out / "skeleton" / id / "skeleton_voxelized.npz"; }
  std::filesystem::path surface_voxels() const { return out / "voxels" / (id + ".ply"); }
  std::filesystem::path skeleton_voxels() const { return out / "voxels" / (id + "_skeleton.ply"); }
  std::filesystem::path views() const { return out / "renders" / id; }
  std::filesystem::path condition_views() const { return out / "renders_cond" / id; }
  std::filesystem::path features(const std::string& model) const { return out / "features" / model / (id + ".npz"); }
};

}  // namespace anigen::prepare
