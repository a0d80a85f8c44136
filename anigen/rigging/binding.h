#pragma once
#include <cstddef>
#include <string>
#include <vector>

#include "anigen/asset/mesh.h"
#include "anigen/asset/skeleton.h"
#include "anigen/asset/skin_weights.h"
#include "anigen/rigging/bone_heat.h"
#include "anigen/rigging/geodesic_voxel.h"

namespace anigen::rigging {

/// The heaviest influences of every row, collected joint by joint, so that [rows, joints] never has to be kept.
/// The choice of influences does not depend on the order in which they are offered; of equal ones the lower joints.
/// Memory: rows · min(most, joints) · 8 bytes.
class StrongestInfluences {
 public:
  /// @param most influences per row, 0 for all
  StrongestInfluences(std::size_t rows, std::size_t joints, std::size_t most);

  /// One row may be offered to by one thread at a time. @param weight > 0, or nothing happens
  void offer(std::size_t row, std::size_t joint, float weight);
  bool empty(std::size_t row) const { return counts_[row] == 0; }
  /// Every row divided by its sum. @pre no row is empty
  SkinWeights rows() const;

 private:
  std::size_t most_;
  std::vector<std::uint32_t> counts_;  ///< [rows]
  std::vector<Influence> kept_;        ///< [rows, most], heaviest first
};

/// Every vertex with weight 1 on the joint whose bones (geometry::bone_segments) are nearest by straight distance; the
/// lower index of equals. The baseline of all binding: neither smooth nor aware of the surface. Needs no faces.
/// @throws InputError naming a vertex or joint that is not finite, or without joints
SkinWeights bind_to_nearest_bone(const Mesh& mesh, const Skeleton& skeleton);

/// Ways to bind a mesh to a skeleton without having learned any.
enum class SkinBinding {
  kNearest,         ///< "nearest": bind_to_nearest_bone()
  kGeodesicVoxels,  ///< "geovoxel": bind_by_geodesic_voxels()
  kHeat             ///< "heat": bind_by_heat()
};

std::string to_string(SkinBinding binding);
/// @throws InputError for another word, naming all of them
SkinBinding parse_skin_binding(const std::string& word);

struct BindingOptions {
  GeodesicVoxelOptions geodesic;
  BoneHeatOptions heat;
};

/// Skin weights for a mesh in the bind pose of a skeleton: one row per vertex, each summing to 1. Normals, textures and
/// weights that the mesh had do not matter. @throws InputError as the function of that binding
SkinWeights bind(SkinBinding binding, const Mesh& mesh, const Skeleton& skeleton, const BindingOptions& options = {});

}  // namespace anigen::rigging
