#pragma once
#include <Eigen/Core>
#include <vector>

#include "anigen/asset/mesh.h"
#include "anigen/loaders/anymate/anymate_mesh.h"

namespace anigen::loaders {

/// Where RigNet's models expect an object: Y up, longest side 1, the middle of its box at x = z = 0, its lowest point
/// at y = 0 (reference anymate-baselines.md, 9.3). Half of Anymate's frame, moved up.
class RignetFrame {
 public:
  /// @param vertices Z up @throws InputError when they are not finite or have no extent
  static RignetFrame of(const std::vector<Eigen::Vector3f>& vertices);

  Eigen::Vector3d into(const Eigen::Vector3d& point) const;          ///< from the Z-up frame
  Eigen::Vector3d out_of(const Eigen::Vector3d& point) const;        ///< back
  Eigen::Vector3d from_anymate(const Eigen::Vector3d& point) const;  ///< from AnymateFrame::of the same vertices
  Eigen::Vector3d to_anymate(const Eigen::Vector3d& point) const;    ///< back

 private:
  AnymateFrame anymate_;
  double floor_ = 0.0;  ///< lowest y in Anymate's frame
};

/// A surface in that frame with as many vertices as RigNet's networks can look at.
struct RignetMesh {
  RignetFrame frame;
  std::vector<Eigen::Vector3f> vertices;  ///< [V], each of some face
  std::vector<Triangle> faces;            ///< [F], F > 0
};

/// Vertices at one position become one, so that texture seams do not part the surface, and faces go by collapsing edges
/// (geometry::simplify) until about `most_vertices` are left; smaller meshes stay (the published data hold 1 to 5
/// thousand vertices). What cannot be simplified without tearing its surface, as a heap of single triangles, is snapped
/// to a grid coarse enough instead.
/// @param vertices [V] Z up @param most_vertices at least 16
/// @throws InputError as anymate_mesh, or when no face has an extent
RignetMesh rignet_mesh(const std::vector<Eigen::Vector3f>& vertices, const std::vector<Triangle>& faces,
                       std::size_t most_vertices);

}  // namespace anigen::loaders
