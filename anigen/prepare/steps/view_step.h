#pragma once
#include <cstddef>
#include <cstdint>

#include "anigen/prepare/steps/step.h"

namespace anigen::prepare {

struct ViewSettings {
  std::size_t count = 0;
  int size = 512;            ///< pixels, square
  int samples_per_axis = 2;  ///< anti-aliasing
  bool geometry = false;     ///< also normals and depth
  bool front = false;        ///< conditions only: cameras in front (raytrace::front_views) instead of all around
  std::uint64_t seed = 0;    ///< of camera positions, together with the asset's id
};

/// renders/<id>: NNN.png, transforms.json and mesh.ply, from cameras all around (reference training-and-data.md,
/// 1.1). mesh.ply is the normalised mesh that surface voxels are made of. With ViewSettings::geometry also
/// NNN_normal.png (world normals, alpha is the mask) and NNN_depth.png (16 bits, raytrace::kDepthUnits).
class ViewStep : public Step {
 public:
  explicit ViewStep(const ViewSettings& settings) : settings_(settings) {}

  std::string name() const override { return "views"; }
  int version() const override { return 1; }
  Json options() const override;
  std::vector<std::filesystem::path> outputs(const AssetPlaces& places, const Json& options) const override;
  void clear(const AssetPlaces& places) const override;
  /// @return views
  Json run(AssetJob& job) const override;

 private:
  ViewSettings settings_;
};

/// renders_cond/<id>: NNN.png and transforms.json, from cameras of many focal lengths, for image conditions. With
/// ViewSettings::geometry also NNN_normal.png: the true normals in the form of the published normal estimator, which
/// condition its first stage (raytrace::encode_condition_normals).
class ConditionViewStep : public Step {
 public:
  explicit ConditionViewStep(const ViewSettings& settings) : settings_(settings) {}

  std::string name() const override { return "cond_views"; }
  int version() const override { return 1; }
  Json options() const override;
  std::vector<std::filesystem::path> outputs(const AssetPlaces& places, const Json& options) const override;
  void clear(const AssetPlaces& places) const override;
  /// @return cond_views
  Json run(AssetJob& job) const override;

 private:
  ViewSettings settings_;
};

}  // namespace anigen::prepare
