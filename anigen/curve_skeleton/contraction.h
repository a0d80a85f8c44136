#pragma once
#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <memory>
#include <new>
#include <vector>

#include "anigen/asset/mesh.h"

namespace anigen::curve_skeleton {

/// Memory whose addresses ascend in the order of allocation, for code that sorts by address: what it does then no
/// longer depends on where the heap had room. Nothing is given back before the end of the scope. One thread's own.
class OrderedMemory {
 public:
  /// From here to the end of the scope the calling thread's OrderedAllocator takes its memory here.
  /// @param bytes in one block; only what is touched takes memory. Blocks after the first may lie anywhere.
  explicit OrderedMemory(std::size_t bytes) : block_bytes_(bytes), before_(current()) { current() = this; }
  ~OrderedMemory() { current() = before_; }
  OrderedMemory(const OrderedMemory&) = delete;
  OrderedMemory& operator=(const OrderedMemory&) = delete;

  static OrderedMemory*& current() {
    thread_local OrderedMemory* memory = nullptr;
    return memory;
  }

  void* allocate(std::size_t bytes) {
    bytes = (bytes + kAlignment - 1) / kAlignment * kAlignment;
    if (blocks_.empty() || block_size_ - used_ < bytes) {
      block_size_ = bytes > block_bytes_ ? bytes : block_bytes_;
      // Not make_unique, which would touch every page.
      blocks_.emplace_back(new unsigned char[block_size_]);
      used_ = 0;
    }
    void* const result = blocks_.back().get() + used_;
    used_ += bytes;
    return result;
  }

 private:
  static constexpr std::size_t kAlignment = 16;
  std::size_t block_bytes_, block_size_ = 0, used_ = 0;
  std::vector<std::unique_ptr<unsigned char[]>> blocks_;
  OrderedMemory* before_;
};

/// Whatever it allocates must be gone before the OrderedMemory around it. @pre there is one
template <typename T>
struct OrderedAllocator {
  using value_type = T;
  OrderedAllocator() = default;
  template <typename U>
  OrderedAllocator(const OrderedAllocator<U>&) {}
  T* allocate(std::size_t n) { return static_cast<T*>(OrderedMemory::current()->allocate(n * sizeof(T))); }
  void deallocate(T*, std::size_t) {}
  template <typename U>
  bool operator==(const OrderedAllocator<U>&) const {
    return true;
  }
  template <typename U>
  bool operator!=(const OrderedAllocator<U>&) const {
    return false;
  }
};

/// @throws InputError naming what keeps the mesh from being one closed, oriented two-manifold: an index out of range, a
/// position that is not finite, a face with a vertex twice, an edge without exactly two faces of opposite direction, a
/// vertex without a face or with several fans of them, several pieces
void require_closed_surface(const std::vector<Eigen::Vector3d>& vertices, const std::vector<Triangle>& faces);

/// Result of contracting a surface.
struct CurveGraph {
  std::vector<Eigen::Vector3d> points;    ///< the mesh's frame
  std::vector<std::array<int, 2>> edges;  ///< without direction; a surface with handles gives cycles
  std::vector<int> point_of_vertex;       ///< [V], the point that a vertex of the surface went to
};

struct ContractionOptions {
  std::size_t most_iterations = 300;  ///< of the flow; it ends by itself when the area hardly shrinks any more
  double speed = 0.1;                 ///< CGAL's quality_speed_tradeoff: lower is smoother and slower
  double centering = 0.2;             ///< CGAL's medially_centered_speed_tradeoff: higher is nearer to the medial axis
};

/// True when contract_curve() is available: built with CMake option ANIGEN_WITH_CGAL, which makes a program GPL-3.
bool can_contract();

/// Contracts a surface to a curve by mean curvature flow (Tagliasacchi et al. 2012, "Mean curvature skeletons", as
/// CGAL's package Surface_mesh_skeletonization has it). The same input gives the same result.
/// @throws NotSupportedError naming the option, where can_contract() is false
/// @throws InputError unless every edge has two faces that run along it in opposite directions, every vertex one fan
/// of faces, and all faces hang together; for positions that are not finite; for fewer than 4 faces
/// @throws Error when CGAL gives up, Interrupted between steps of the flow
CurveGraph contract_curve(const std::vector<Eigen::Vector3d>& vertices, const std::vector<Triangle>& faces,
                          const ContractionOptions& options = {});

}  // namespace anigen::curve_skeleton
