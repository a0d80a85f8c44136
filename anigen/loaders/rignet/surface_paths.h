#pragma once
#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

#include "anigen/loaders/rignet/rignet_mesh.h"

namespace anigen::loaders {

/// Geodesic distances between the vertices of a mesh, along the surface: set up once per mesh, query many times. As
/// published (reference anymate-baselines.md, 9.3), Dijkstra's algorithm on the five nearest neighbours of points
/// spread evenly over the surface, of those whose normals are no more than 120° apart, so that paths also cross from
/// part to part where parts touch. Here the mesh's own vertices are points too, and its edges are ways. Queries are
/// thread-safe.
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

  std::size_t vertices_;
  std::vector<Eigen::Vector3f> points_;  ///< vertices, then samples
  std::vector<std::size_t> first_link_;  ///< [points + 1]
  std::vector<Link> links_;
};

}  // namespace anigen::loaders
