#pragma once
#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <utility>
#include <vector>

#include "anigen/asset/mesh.h"
#include "anigen/geometry/voxel_grid.h"
#include "anigen/geometry/voxelize.h"
#include "anigen/rigging/surface.h"

namespace anigen::rigging {

/// Part of a grid of R³ cubic cells (geometry/voxel_grid.h), with its own numbering: cell (i, j, k) of the block is
/// voxel low + (i, j, k), and cells lie z fastest. Points are measured in cells from the block's corner, so that cell
/// (i, j, k) is the box [i, i + 1] × [j, j + 1] × [k, k + 1].
struct VoxelBlock {
  int resolution = 0;           ///< R of the grid
  geometry::Voxel low{};        ///< voxel of the grid at cell (0, 0, 0); −1 along an axis is one before the grid
  std::array<int, 3> size{};    ///< cells along each axis
  double cells_per_unit = 0.0;  ///< of the frame that points are given in

  std::size_t cells() const { return extent(0) * extent(1) * extent(2); }
  std::size_t index(int i, int j, int k) const {
    return (static_cast<std::size_t>(i) * extent(1) + static_cast<std::size_t>(j)) * extent(2) +
           static_cast<std::size_t>(k);
  }
  /// Stride between neighbours along an axis.
  std::size_t stride(std::size_t axis) const { return axis == 2 ? 1 : axis == 1 ? extent(2) : extent(1) * extent(2); }
  bool holds(int i, int j, int k) const {
    return i >= 0 && j >= 0 && k >= 0 && i < size[0] && j < size[1] && k < size[2];
  }
  std::array<int, 3> cell(std::size_t index) const {
    return {static_cast<int>(index / stride(0)), static_cast<int>(index / extent(2) % extent(1)),
            static_cast<int>(index % extent(2))};
  }
  Eigen::Vector3d center(std::size_t index) const {
    const std::array<int, 3> c = cell(index);
    return {c[0] + 0.5, c[1] + 0.5, c[2] + 0.5};
  }
  /// A point of the unit frame, measured in cells.
  Eigen::Vector3d measured(const Eigen::Vector3d& point) const {
    return cells_per_unit * point +
           Eigen::Vector3d(0.5 * resolution - low[0], 0.5 * resolution - low[1], 0.5 * resolution - low[2]);
  }

 private:
  std::size_t extent(std::size_t axis) const { return static_cast<std::size_t>(size[axis]); }
};

/// The inside of a mesh as cells, whatever the mesh is like. The block is the mesh's box and one cell more all around,
/// which is always outside.
struct SolidVoxels {
  enum State : std::uint8_t { kOutside, kInside, kWall };

  VoxelBlock block;
  std::vector<std::uint8_t> states;  ///< [cells]
  std::vector<std::uint32_t> walls;  ///< cells that the surface passes through, ascending

  bool is_solid(std::size_t cell) const { return states[cell] != kOutside; }
};

/// Largest resolution: at 512 the states of a mesh that fills the grid take 136 MB, and as much as that three times
/// over while they are made.
constexpr int kMaxSolidResolution = 512;

/// Solid voxelisation (docs/reference/riggers.md, 1, step 1).
///  - Walls are the cells whose closed box meets a face.
///  - Inside is what a flood from outside does not reach past the walls: that needs no winding, no single surface and
///    no care about what overlaps what.
///  - Where the flood gets in through a hole, rays decide: inside is also where at least four of the six rays along the
///    axes cross the surface an odd number of times.
///  - Unless `validate` is off, what the rays found is dropped where most neighbours are outside (streaks behind an
///    open sheet), and insides that no bone comes near are dropped (the space below a skirt, a cup, a mouth): they
///    would join what they lie between.
/// The cells do not depend on the order of vertices or faces, nor on the number of threads.
/// @param bones [J] in the surface's frame
/// @throws InputError unless 2 ≤ resolution ≤ kMaxSolidResolution @pre surface.has_extent
SolidVoxels solid_voxels(const WeldedSurface& surface, const std::vector<MovingBones>& bones, int resolution,
                         bool validate = true);

/// Upper bound, at each cell of a solid, of the distance of the nearest few joints. What is farther needs no
/// paths there, nor through there: each of those few is nearer also at the end of every path that goes on. So with
/// bounds each joint's paths stay around the joint, and the nearest few are the same, bit for bit, in whichever order
/// joints come. Kept per block of 4³ cells, for the farthest cell of each.
class PathBounds {
 public:
  /// @param most how many nearest joints are wanted, 0 for all: nothing is bounded then
  PathBounds(const SolidVoxels& solid, std::size_t most);

  /// Longest path to a cell that may matter, in cells; infinite while fewer than `most` joints reach its whole block.
  float at_cell(std::size_t cell) const {
    return most_ == 0 ? kUnbounded : nearest_[block_of(cell) * most_ + most_ - 1];
  }
  /// Takes note of finished paths. Runs on all threads.
  /// @param joints [cells] distances as VoxelPaths gives them, and how much longer each path is
  void add(const std::vector<std::pair<const std::vector<float>*, double>>& joints);

 private:
  static constexpr float kUnbounded = 3.4e38F;
  std::size_t block_of(std::size_t cell) const { return block_of_row_[cell / row_] + (cell % row_) / kSide; }
  static constexpr std::size_t kSide = 4;

  const SolidVoxels* solid_;
  std::size_t most_, row_;                 ///< cells along z
  std::vector<std::size_t> block_of_row_;  ///< [cells / row_] first block of each row along z
  std::size_t blocks_along_[3];
  std::vector<float> nearest_;  ///< [blocks, most] ascending
};

/// Sources of paths, with their initial cost.
struct PathSource {
  std::uint32_t cell;
  float distance;  ///< in cells, in [0, 2)
};

/// Length of the shortest path from the sources to every cell, over solid cells and their 26 neighbours with steps of
/// 1, √2 and √3 cells (docs/reference/riggers.md, 1, step 3); infinite where there is none, −infinite outside.
/// Dijkstra's algorithm with buckets one cell wide: no step is shorter than that, so a bucket is final before it is
/// opened and its order does not matter (Dial, "Algorithm 360: shortest-path forest with topological ordering", 1969;
/// Denardo and Fox, "Shortest-route methods: reaching, pruning and buckets", 1979). The result is exact but for the
/// rounding of sums to single precision. One thread: use as many objects as threads.
class VoxelPaths {
 public:
  explicit VoxelPaths(const SolidVoxels& solid);

  /// Paths that are longer than `bounds` in a cell end there: distances are exact where they are within them, and
  /// elsewhere the length of some path or infinite.
  /// @param before what every path costs besides, in cells, where it is compared with bounds
  /// @return [cells], without `before`, valid until the next run @pre sources are solid cells
  const std::vector<float>& run(const std::vector<PathSource>& sources, const PathBounds& bounds, double before);

 private:
  struct Step {
    std::ptrdiff_t offset;
    float length;
  };
  struct Entry {
    std::uint32_t cell;
    float distance;
  };
  void offer(std::size_t cell, float distance);

  const SolidVoxels* solid_;
  std::vector<Step> steps_;  ///< 26
  std::vector<float> distances_;
  std::vector<Entry> buckets_[3];
};

/// Visits the cells of the block that a line touches, slab by slab along its longest axis from its start to its end;
/// a line on the border of cells touches those on both sides, so that a symmetric rig stays symmetric. In a slab also
/// cells are visited that the line misses by less than a cell. Cells that lie outside the block are left out.
/// @param line in the unit frame
/// @param visit gets the cells of one slab, none twice; false ends the walk
void walk_line(const VoxelBlock& block, const BoneLine& line,
               const std::function<bool(const std::vector<std::uint32_t>&)>& visit);

}  // namespace anigen::rigging
