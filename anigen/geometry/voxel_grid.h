#pragma once
#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <vector>

namespace anigen::geometry {

/// Index of a voxel of the R³ grid over the cube [-0.5, 0.5]³ of the world frame, each entry in [0, R). Voxel (i, j, k)
/// is the box [i, i+1] × [j, j+1] × [k, k+1] of edge 1/R, counted from the corner (-0.5, -0.5, -0.5). Sets of voxels
/// are vectors in lexicographic (x, y, z) order without repetition, unless a function says otherwise.
using Voxel = std::array<std::int32_t, 3>;

/// Largest resolution: a set of voxels is worked on as one bit each, 128 MiB at this resolution.
constexpr int kMaxVoxelResolution = 1024;

/// @throws InputError unless 1 ≤ resolution ≤ kMaxVoxelResolution
void require_resolution(int resolution);
/// @throws InputError naming the first voxel outside the grid, or a bad resolution
void require_inside(const std::vector<Voxel>& voxels, int resolution);

/// (i + 0.5) / R − 0.5, what the published voxel files hold (docs/reference/training.md, 1.1).
Eigen::Vector3d voxel_center(const Voxel& voxel, int resolution);

/// The voxel that a reader of voxel files makes of a point: (p + 0.5) · R truncated toward zero, so that points less
/// than one voxel below -0.5 count as 0 (docs/reference/training.md, 1.1).
/// @throws InputError when the point is not finite or its voxel lies outside the grid
Voxel voxel_at(const Eigen::Vector3d& point, int resolution);

/// The points p + (±1, ±1, ±1) · 0.25/R around a voxel's centre, z changing fastest and − first: where the encoder
/// looks up skin features (docs/reference/autoencoders.md, 4.3).
std::array<Eigen::Vector3d, 8> sub_voxel_points(const Voxel& voxel, int resolution);

/// Puts a list into the order of a set and removes repetitions.
void sort_unique(std::vector<Voxel>& voxels);

/// Every voxel within Chebyshev distance `radius` of the set: one pass of a cube of side 2·radius + 1, clipped by the
/// grid (docs/reference/training.md, 1.3). Radius 0 returns the set. @param voxels in any order
/// @throws InputError on a negative radius, a bad resolution, or a voxel outside the grid
std::vector<Voxel> dilate(const std::vector<Voxel>& voxels, int resolution, int radius);

/// The random dilation of docs/reference/training.md, 1.3: each voxel takes its state from the set dilated by radius −
/// 1 (nothing at all when radius ≤ 1) or from the set dilated by radius + 1, with probability ½ each.
/// @param draw uniform in [0, 1); called once for every voxel in which the two differ, in lexicographic order; below ½
///        the smaller dilation decides @throws InputError as dilate
std::vector<Voxel> dilate_randomly(const std::vector<Voxel>& voxels, int resolution, int radius,
                                   const std::function<double()>& draw);

/// A set of voxels as one bit each: R² rows along z of whole 64-bit words. Inserting may happen from many threads at
/// once, and the set does not depend on their order; everything else may not run at the same time as inserting.
class VoxelBits {
 public:
  /// The empty set. @pre 1 ≤ resolution ≤ kMaxVoxelResolution
  explicit VoxelBits(int resolution);

  int resolution() const { return resolution_; }
  std::size_t words() const { return words_; }  ///< per row
  std::uint64_t* row(int x, int y) { return bits_.data() + row_start(x, y); }
  const std::uint64_t* row(int x, int y) const { return bits_.data() + row_start(x, y); }

  /// @pre inside the grid, as everywhere in this class
  void insert(const Voxel& voxel) { insert_run(voxel[0], voxel[1], voxel[2], voxel[2]); }
  /// (x, y, first) … (x, y, last), nothing when last < first
  void insert_run(int x, int y, int first, int last);
  bool contains(const Voxel& voxel) const {
    return (row(voxel[0], voxel[1])[voxel[2] / 64] >> (voxel[2] % 64) & 1) != 0;
  }

  std::vector<Voxel> voxels() const;  ///< in lexicographic order

 private:
  std::size_t row_start(int x, int y) const {
    return (static_cast<std::size_t>(x) * static_cast<std::size_t>(resolution_) + static_cast<std::size_t>(y)) * words_;
  }

  int resolution_;
  std::size_t words_;
  std::vector<std::uint64_t> bits_;
};

struct PooledVoxels {
  std::vector<Voxel> voxels;    ///< at resolution R / factor, lexicographic
  std::vector<float> features;  ///< row-major [voxels, channels]
};

/// The coarser voxels that contain the given ones.
/// @param voxels in any order @throws InputError unless factor ≥ 1
std::vector<Voxel> pool_voxels(const std::vector<Voxel>& voxels, int factor);

/// Merges the voxels of each factor³ block. A block of n voxels gets Σ features / (n + 1): the published pooling
/// averages the zero it starts from as well, which shrinks a lone voxel's features by half (docs/reference/training.md,
/// 1.3).
/// @param features row-major [voxels, channels] @throws InputError when lengths differ or factor < 1
PooledVoxels pool_features(const std::vector<Voxel>& voxels, const std::vector<float>& features, std::size_t channels,
                           int factor);

}  // namespace anigen::geometry
