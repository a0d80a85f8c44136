#pragma once
#include <cstddef>
#include <string>
#include <vector>

#include "anigen/asset/mesh.h"
#include "anigen/asset/skeleton.h"
#include "anigen/asset/skin_weights.h"
#include "anigen/rigging/bone_heat.h"

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

/// Defaults of Maya's geodesic voxel binding (docs/reference/riggers.md, 1), but for `most_influences`, which is what
/// one glTF attribute holds and Maya leaves unlimited.
struct GeodesicVoxelOptions {
  int resolution = 256;             ///< voxels along the longest side, 2 to kMaxSolidResolution (512)
  double falloff = 0.2;             ///< α in [0, 1]: from weights like 1/d² to weights like 1/d⁴
  std::size_t most_influences = 4;  ///< per vertex, 0 for all
  bool validate_solid = true;       ///< drop insides without bones and streaks; see solid_voxels()
};

/// Geodesic voxel binding (Dionne and de Lasa, "Geodesic voxel binding for production character meshes", 2013;
/// docs/reference/riggers.md, 1): weights by the distance from each joint's bones through the inside of the mesh, which
/// is voxelised so that holes, overlapping parts and inverted faces do no harm.
///
///     w_j ∝ 1 / ((1 − α) d_j + α d_j²)²,   d_j in units of the mesh's longest side
///
/// d_j is the shortest path over solid voxels (VoxelPaths), from where the bone is to where the vertex is. A bone
/// outside the solid reaches it straight, at the nearest place, and that way counts; the made-up bone of a joint
/// without children ends where it leaves the solid. What no bone reaches (a part that floats beside the body, a vertex
/// without faces, a mesh without extent) takes weights by straight distance to its three nearest joints, by the same
/// law. Vertices at one position get the same weights; the order of vertices and faces does not matter.
///
/// Runs on all threads, joints at a time; the result does not depend on them. Time: solid voxels × 26 × joints.
/// Memory: 3 bytes per voxel of the mesh's box, and 4 per voxel and thread, of which there are fewer where that would
/// take more than 1 GiB.
/// @return [V], at most `most_influences` per row
/// @throws InputError for options out of range, a vertex or joint that is not finite, a bad face, or without joints
SkinWeights bind_by_geodesic_voxels(const Mesh& mesh, const Skeleton& skeleton,
                                    const GeodesicVoxelOptions& options = {});

/// Ways to bind a mesh to a skeleton without having learned any.
enum class SkinBinding {
  kNearest,         ///< "nearest": weight 1 on the joint whose bones are nearest by straight distance
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
