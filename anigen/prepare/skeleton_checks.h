#pragma once
#include <Eigen/Core>
#include <cstddef>
#include <vector>

#include "anigen/asset/mesh.h"

namespace anigen::prepare {

/// How far apart the two most similar bones are: the smallest, over pairs of joints other than the root, of the
/// largest coordinate difference between their vectors from the parent. The skin auto-encoder tells joints apart by
/// these vectors (reference autoencoders.md, 1.1), so equal ones give equal tokens.
/// @param joints [J] normalised positions @param parents [J], -1 for the root
/// @return kNoPair with fewer than two bones
inline constexpr double kNoPair = 1e9;
double closest_bones(const std::vector<Eigen::Vector3f>& joints, const std::vector<int>& parents);

/// The share of joints outside the box, which is first grown by 1e-4 of its diagonal: joints on the surface are inside.
/// @return 0 without joints
double outside_share(const std::vector<Eigen::Vector3d>& joints, const Box& box);

/// What decides `is_bad_skeleton` and `is_bad_skin`.
struct QualityLimits {
  std::size_t min_joints = 3;
  std::size_t max_joints = 100;
  /// Bones no farther apart than this count as equal. The default is far above the rounding of float32 joints, which
  /// hides equal bones of symmetric rigs from an exact comparison, and far below any difference that shows.
  double same_bone = 1e-6;
  double max_outside_share = 0.7;   ///< of joints outside the mesh's bounding box (Anymate's limit)
  double max_invented_rows = 0.01;  ///< share of vertices whose weights the importer had to make up
  double least_weight_sum = 0.9;    ///< of any vertex, in the file (what Articulation-XL 2.0 was cleaned by)
};

}  // namespace anigen::prepare
