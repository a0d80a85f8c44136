#pragma once
#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "anigen/asset/mesh.h"
#include "anigen/asset/mesh_shells.h"

namespace anigen::metrics {

/// Shells count as touching up to this distance at rest, in diagonals of the mesh's box.
inline constexpr double kTouching = 0.01;

/// Two shells that touch at rest.
struct TouchingShells {
  std::int32_t first = 0, second = 0;            ///< first < second
  double distance = 0.0;                         ///< least distance of their surfaces, in the unit of the mesh
  std::int32_t face_first = 0, face_second = 0;  ///< where: faces of the mesh
};

struct ShellTree;

/// Gaps between the parts of a mesh in motion: of shells that touch at rest, growth of the least distance of their
/// surfaces. Parts of a machine that turn in each other keep it; parts that a rig tears apart do not. Distances are
/// those of triangles, exact in double precision, 0 where they cross.
///
/// Set up once per mesh: a tree of boxes for each shell, whose boxes are fitted again to each pose. Const: poses may be
/// measured at the same time.
class ShellGaps {
 public:
  /// @param touching limit in diagonals @param most_pairs nearest ones that are kept, of equal ones the first
  /// @throws InputError for a face of a missing vertex, or a vertex that is not finite
  ShellGaps(const std::vector<Eigen::Vector3f>& vertices, const std::vector<Triangle>& faces,
            double touching = kTouching, std::size_t most_pairs = kMostPairs);

  const std::vector<TouchingShells>& pairs() const { return pairs_; }
  const MeshShells& shells() const { return shells_; }

  /// Growth of the distance of every pair in a pose, at least 0, in diagonals of the mesh's box at rest; what is below
  /// 1e-6 counts as 0, being the rounding of places. @param posed [V] @return [pairs]
  std::vector<double> growth(const std::vector<Eigen::Vector3f>& posed) const;

  static constexpr std::size_t kMostPairs = 2000;

 private:
  std::vector<Eigen::Vector3f> rest_;
  std::vector<Triangle> faces_;
  MeshShells shells_;
  std::shared_ptr<const std::vector<ShellTree>> trees_;  ///< [shells]; copies share them
  std::vector<TouchingShells> pairs_;
  double diagonal_ = 0.0;
};

/// Corners of a triangle.
using TriangleCorners = std::array<Eigen::Vector3d, 3>;

/// Least distance of two triangles, 0 where they cross; one without area counts as its edges.
double triangle_distance(const TriangleCorners& first, const TriangleCorners& second);

}  // namespace anigen::metrics
