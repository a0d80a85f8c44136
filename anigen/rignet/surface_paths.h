#pragma once
#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

#include "anigen/anymate/dataset.h"
#include "anigen/asset/mesh.h"
#include "anigen/nn/torch.h"
#include "anigen/rigging/voxels.h"

namespace anigen::rignet {

/// Frame that RigNet's models expect: Y up, longest side 1, the middle of its box at x = z = 0, its lowest point
/// at y = 0 (docs/reference/rignet.md, 1). Half of Anymate's frame, moved up.
class RignetFrame {
 public:
  /// @param vertices Z up @throws InputError when they are not finite or have no extent
  static RignetFrame of(const std::vector<Eigen::Vector3f>& vertices);

  Eigen::Vector3d into(const Eigen::Vector3d& point) const;          ///< from the Z-up frame
  Eigen::Vector3d out_of(const Eigen::Vector3d& point) const;        ///< back
  Eigen::Vector3d from_anymate(const Eigen::Vector3d& point) const;  ///< from AnymateFrame::of the same vertices
  Eigen::Vector3d to_anymate(const Eigen::Vector3d& point) const;    ///< back

 private:
  anymate::AnymateFrame anymate_;
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

/// Inside of a mesh, by solid voxels of 1/88 of its longest side (docs/reference/rignet.md, 1), walls included; the
/// mesh need not be closed (rigging/voxels.h). Questions are asked in RigNet's frame.
class SolidShape {
 public:
  /// @param vertices, faces Z up, the whole mesh @throws InputError without an extent
  SolidShape(const std::vector<Eigen::Vector3f>& vertices, const std::vector<Triangle>& faces);

  bool holds(const Eigen::Vector3d& point) const;
  /// @param points [N, 3] @return [N] bool on the CPU
  torch::Tensor holds(const torch::Tensor& points) const;

  /// The way from one point to another, looked at every 0.01, both ends included.
  struct Way {
    double inside = 0.0;  ///< share of the places
    int outside = 0;      ///< their number
  };
  Way way(const Eigen::Vector3d& from, const Eigen::Vector3d& to) const;

  /// As above, between all of some joints. @return [J, J] fp32 each, symmetric, their diagonals those of a point
  struct Ways {
    torch::Tensor inside, outside;
  };
  Ways ways(const std::vector<Eigen::Vector3d>& joints) const;

 private:
  RignetFrame frame_;
  Eigen::Vector3d center_ = Eigen::Vector3d::Zero();  ///< of the welded surface's unit frame
  double size_ = 1.0;
  rigging::VoxelBlock block_;
  std::vector<bool> is_solid_;  ///< [cells of the block]
};

/// Geodesic distances between the vertices of a mesh, along the surface: set up once per mesh, query many times. As
/// published (docs/reference/rignet.md, 5), Dijkstra's algorithm on the five nearest neighbours of points spread evenly
/// over the surface, of those whose normals are no more than 120° apart, so that paths also cross from part to part
/// where parts touch. Here the mesh's own vertices are points too, and its edges are ways. Queries are thread-safe.
class SurfacePaths {
 public:
  /// @param samples about how many points beside the vertices (published 4000) @param seed of their choice
  SurfacePaths(const RignetMesh& mesh, std::size_t samples, std::uint64_t seed);

  struct Reached {
    std::int32_t vertex;
    double distance;
  };
  /// The other vertices nearer than `radius` to a vertex, nearest first.
  std::vector<Reached> within(std::int32_t vertex, double radius) const;

  struct Nearest {
    std::int32_t source = -1;  ///< the source nearest to a vertex, -1 where none is connected
    double distance = 0.0;
  };
  /// Of every vertex. @param sources vertices @return [V]
  std::vector<Nearest> from(const std::vector<std::int32_t>& sources) const;

 private:
  struct Link {
    std::int32_t to;
    float length;
  };
  void join(const std::vector<std::pair<std::int32_t, std::int32_t>>& pairs);
  /// Dijkstra's algorithm from some vertices. @param reach called for each point nearer than `radius`, nearest first
  template <typename Reach>
  std::vector<Nearest> spread(const std::vector<std::int32_t>& sources, double radius, const Reach& reach) const;

  std::size_t vertices_;
  std::vector<Eigen::Vector3f> points_;  ///< vertices, then samples
  std::vector<std::size_t> first_link_;  ///< [points + 1]
  std::vector<Link> links_;
};

}  // namespace anigen::rignet
