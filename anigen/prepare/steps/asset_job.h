#pragma once
#include <functional>
#include <optional>
#include <vector>

#include "anigen/asset/asset.h"
#include "anigen/asset/normalize.h"
#include "anigen/geometry/voxel_grid.h"
#include "anigen/prepare/steps/asset_places.h"

namespace anigen::prepare {

/// One asset on its way through the steps. The asset is read or posed only when the first step asks for it, so that
/// finding everything up to date costs no import; steps after that share it.
class AssetJob {
 public:
  /// @param load gives the normalised asset; called at most once
  AssetJob(AssetPlaces places, std::function<Asset()> load);

  const AssetPlaces& places() const { return places_; }
  const std::string& id() const { return places_.id; }
  /// @throws what load throws
  const Asset& asset();
  /// What put the source into [-0.5, 0.5]³; known once the first step is done.
  const Similarity& normalisation() const { return normalisation_; }
  void set_normalisation(const Similarity& similarity) { normalisation_ = similarity; }
  /// The surface voxels as the voxel step wrote them. @throws InputError when the file is damaged
  const std::vector<geometry::Voxel>& surface_voxels(int resolution);
  /// After the voxel step wrote them anew.
  void forget_voxels() { voxels_.reset(); }

 private:
  AssetPlaces places_;
  std::function<Asset()> load_;
  std::optional<Asset> asset_;
  Similarity normalisation_;
  std::optional<std::vector<geometry::Voxel>> voxels_;
};

}  // namespace anigen::prepare
