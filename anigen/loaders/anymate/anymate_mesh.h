#pragma once
#include <Eigen/Core>
#include <vector>

#include "anigen/asset/mesh.h"
#include "anigen/geometry/surface_point.h"
#include "anigen/nn/torch.h"

namespace anigen::loaders {

/// Where Anymate's models expect an object: Y up, the middle of its box at the origin, its longest side from -1 to 1
/// (reference anymate-baselines.md, 1.3, the demo's normalisation). The released data put the middle of the *sampled
/// points* there instead, which is the same but for chance.
class AnymateFrame {
 public:
  /// @param vertices Z up @throws InputError when they are not finite or have no extent
  static AnymateFrame of(const std::vector<Eigen::Vector3f>& vertices);

  Eigen::Vector3d into(const Eigen::Vector3d& point) const;    ///< from the Z-up frame
  Eigen::Vector3d out_of(const Eigen::Vector3d& point) const;  ///< back

 private:
  Eigen::Vector3d center_ = Eigen::Vector3d::Zero();
  double scale_ = 1.0;
};

/// A surface in that frame.
struct AnymateMesh {
  AnymateFrame frame;
  std::vector<Eigen::Vector3f> vertices;  ///< [V]
  std::vector<Triangle> faces;            ///< [F], F > 0
};

/// @param vertices [V] Z up @throws InputError as AnymateFrame::of, without faces, or for a face without its vertices
AnymateMesh anymate_mesh(const std::vector<Eigen::Vector3f>& vertices, const std::vector<Triangle>& faces);

/// Positions and normals of the faces, [N, 6] fp32: what encoders look at. A face without area has normal (0, 1, 0).
torch::Tensor surface_features(const AnymateMesh& mesh, const std::vector<geometry::SurfacePoint>& points);

/// Positions and area-weighted normals of all vertices, [V, 6] fp32: where skin weights are wanted.
torch::Tensor vertex_features(const AnymateMesh& mesh);

/// The cells of the 64³ grid over [-1, 1]³ whose middle is inside the mesh or on its wall, [Nv, 3] int8 (reference
/// anymate-baselines.md, 1.4): the grid that fields of joints are asked about. Closed surfaces are not needed
/// (rig/binding/solid_voxels.h).
torch::Tensor solid_cells(const AnymateMesh& mesh);

}  // namespace anigen::loaders
