#pragma once
#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <memory>
#include <vector>

#include "anigen/asset/mesh.h"

struct RTCSceneTy;

// Trees of boxes (BVH) over the triangles of one mesh: Embree's, and a plain one of our own, which lean builds use
// where Embree is not to be had.

namespace anigen::geometry {

/// A ray from `nearest` to `farthest`, both in lengths of the direction.
struct TreeRay {
  Eigen::Vector3f origin, direction;
  float nearest = 0.0f;
  float farthest = std::numeric_limits<float>::infinity();
};

/// The closest triangle along a ray, from either side.
struct TreeHit {
  static constexpr std::uint32_t kNone = 0xFFFFFFFFu;
  std::uint32_t face = kNone;
  float distance = std::numeric_limits<float>::infinity();  ///< in lengths of the direction
  float u = 0.0f, v = 0.0f;                                 ///< weights of the triangle's second and third corner

  bool found() const { return face != kNone; }
};

constexpr std::size_t kRayBundle = 16;  ///< rays of one origin that are traced together
using RayBundle = std::array<Eigen::Vector3f, kRayBundle>;
using BundleHits = std::array<TreeHit, kRayBundle>;

/// Called with every face whose box lies within the radius of a query, and with some that lie farther out.
/// @return the radius from now on, which only shrinks
using VisitFace = float (*)(void* data, std::uint32_t face, float radius);

/// A tree by Embree. Faces keep their indices; queries are thread-safe. A ray through a shared edge hits one of the two
/// triangles.
class EmbreeTree {
 public:
  /// Copies both arrays. @throws InputError as check_mesh() (geometry/mesh_check.h); Error when Embree fails (out of
  /// memory)
  EmbreeTree(const std::vector<Eigen::Vector3f>& vertices, const std::vector<Triangle>& faces);
  ~EmbreeTree();
  EmbreeTree(const EmbreeTree&) = delete;
  EmbreeTree& operator=(const EmbreeTree&) = delete;

  TreeHit first_hit(const TreeRay& ray) const;
  /// The closest hits of rays that point about the same way.
  BundleHits first_hits(const Eigen::Vector3f& origin, const RayBundle& directions) const;
  bool is_blocked(const TreeRay& ray) const;  ///< true when anything lies on the ray
  /// Visits the faces within the radius of a point, near ones mostly first.
  void visit_within(const Eigen::Vector3d& point, float radius, VisitFace visit, void* data) const;

  RTCSceneTy* scene() const { return scene_; }

 private:
  RTCSceneTy* scene_ = nullptr;
};

/// Answers what EmbreeTree answers by a binary tree that needs no library: split by the surface area heuristic over 16
/// bins (Wald 2007), triangles by the watertight test of Woop, Benthin and Wald (2013) in double precision.
/// benchmarks/raytrace_benchmark compares its speed with Embree's.
class PlainTree {
 public:
  /// Copies both arrays. @throws InputError as check_mesh()
  PlainTree(const std::vector<Eigen::Vector3f>& vertices, const std::vector<Triangle>& faces);
  ~PlainTree();
  PlainTree(const PlainTree&) = delete;
  PlainTree& operator=(const PlainTree&) = delete;

  TreeHit first_hit(const TreeRay& ray) const;
  BundleHits first_hits(const Eigen::Vector3f& origin, const RayBundle& directions) const;
  bool is_blocked(const TreeRay& ray) const;
  void visit_within(const Eigen::Vector3d& point, float radius, VisitFace visit, void* data) const;

 private:
  struct Nodes;
  std::unique_ptr<Nodes> nodes_;
};

#ifdef ANIGEN_LEAN
using TriangleTree = PlainTree;
#else
using TriangleTree = EmbreeTree;
#endif

}  // namespace anigen::geometry
