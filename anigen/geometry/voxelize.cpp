#include "anigen/geometry/voxelize.h"

#include <algorithm>
#include <cstdlib>
#include <string>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/core/parallel.h"
#include "anigen/geometry/bones.h"

namespace anigen::geometry {

namespace {

/// The crossings of voxel borders along one axis.
struct Walk {
  std::int64_t cell, left;       ///< where it is, and how many crossings are to come
  std::int64_t reached, length;  ///< the next crossing happens at the fraction reached / length of the segment
  int step;

  Walk(std::int64_t from, std::int64_t to)
      : cell(from >> kFractionBits), length(std::abs(to - from)), step(to < from ? -1 : 1) {
    left = std::abs((to >> kFractionBits) - cell);
    reached = step > 0 ? (cell + 1) * kVoxelUnits - from : from - cell * kVoxelUnits;
  }

  void cross() {
    cell += step;
    reached += kVoxelUnits;
    --left;
  }
};

/// < 0 when a crosses first. A point on a border belongs to the upper voxel: going up, the voxel changes on the
/// border, going down just after it.
int order(const Walk& a, const Walk& b) {
  const Int128 first = Int128{a.reached} * b.length, second = Int128{b.reached} * a.length;
  if (first != second) return first < second ? -1 : 1;
  return b.step - a.step;
}

struct Range {
  std::int64_t first, last;
  bool single() const { return first == last; }
  void cut(const Range& other) {
    first = std::max(first, other.first);
    last = std::min(last, other.last);
  }
};

/// Voxels whose closed extent along an axis meets the triangle's.
Range touched(const FixedTriangle& t, std::size_t axis, int resolution) {
  const auto [low, high] = std::minmax({t[0][axis], t[1][axis], t[2][axis]});
  return {std::max<std::int64_t>(0, (low - 1) >> kFractionBits),
          std::min<std::int64_t>(resolution - 1, high >> kFractionBits)};
}

/// Twice the signed area of the triangle seen along the third axis.
Int128 area(const FixedTriangle& t, std::size_t a, std::size_t b) {
  return Int128{t[1][a] - t[0][a]} * (t[2][b] - t[0][b]) - Int128{t[1][b] - t[0][b]} * (t[2][a] - t[0][a]);
}

/// The triangle seen along one axis, as conditions u·i + v·j + w ≥ 0 on the indices of voxels: the corner of the
/// voxel's square that lies furthest inward must not be outside an edge. Two edges of a triangle without area face
/// both ways.
class Projection {
 public:
  Projection(const FixedTriangle& t, std::size_t a, std::size_t b) {
    const Int128 twice_area = area(t, a, b);
    for (std::size_t k = 0; k < 3; ++k) {
      const FixedPoint &from = t[k], &to = t[(k + 1) % 3];
      const std::int64_t u = from[b] - to[b], v = to[a] - from[a];  // the edge's normal, inward for positive area
      if (twice_area >= 0) add(u, v, from[a], from[b]);
      if (twice_area <= 0) add(-u, -v, from[a], from[b]);
    }
  }

  /// Second indices that go with a first index.
  Range seconds(std::int64_t first, Range within) const {
    for (int k = 0; k < count_; ++k) {
      const auto& [u, v, w] = conditions_[at(k)];
      const std::int64_t rest = u * first + w;
      if (v > 0) {
        within.first = std::max(within.first, -floor_div(rest, v));
      } else if (v < 0) {
        within.last = std::min(within.last, floor_div(rest, -v));
      } else if (rest < 0) {
        return {0, -1};
      }
    }
    return within;
  }

 private:
  struct Condition {
    std::int64_t u, v, w;
  };

  void add(std::int64_t u, std::int64_t v, std::int64_t a, std::int64_t b) {
    const Int128 at_corner = -(Int128{u} * a + Int128{v} * b) +
                             Int128{std::max<std::int64_t>(u, 0) + std::max<std::int64_t>(v, 0)} * kVoxelUnits;
    // u·i + v·j is an integer number of voxels: rounding down what is added to it changes no sign.
    conditions_[at(count_++)] = {u, v, static_cast<std::int64_t>(at_corner >> kFractionBits)};
  }

  std::array<Condition, 6> conditions_;
  int count_ = 0;
};

/// floor(a / b), b > 0, correct where it lies in [low, high]; outside, any number on the same side.
std::int64_t floor_div_near(Int128 a, Int128 b, std::int64_t low, std::int64_t high) {
  const double estimate = static_cast<double>(a) / static_cast<double>(b);
  if (estimate < static_cast<double>(low) - 2.0) return low - 1;
  if (estimate > static_cast<double>(high) + 2.0) return high + 1;
  auto quotient = static_cast<std::int64_t>(estimate);
  while (b * quotient > a) --quotient;
  while (b * (quotient + 1) <= a) ++quotient;
  return quotient;
}

/// The triangle's plane n: boxes must have corners on both sides, or on it.
class Plane {
 public:
  explicit Plane(const FixedTriangle& t) : n_{area(t, 1, 2), area(t, 2, 0), area(t, 0, 1)} {
    // Seen edge-on along z, the conditions of the x, y projection say the same.
    bounds_ = n_[2] != 0;
    if (n_[2] < 0) {
      for (Int128& component : n_) component = -component;
    }
    const Int128 zero = 0;
    const Int128 offset = n_[0] * t[0][0] + n_[1] * t[0][1] + n_[2] * t[0][2];
    const Int128 positive = std::max(n_[0], zero) + std::max(n_[1], zero) + std::max(n_[2], zero);
    const Int128 negative = std::min(n_[0], zero) + std::min(n_[1], zero) + std::min(n_[2], zero);
    above_ = (positive * kVoxelUnits - offset) >> kFractionBits;  // n·(i, j, k) + above_ ≥ 0
    below_ = (offset - negative * kVoxelUnits) >> kFractionBits;  // n·(i, j, k) ≤ below_
  }

  void cut(std::int64_t x, std::int64_t y, Range& z) const {
    if (!bounds_) return;
    const Int128 at_zero = n_[0] * x + n_[1] * y;
    const Range wanted = z;
    z.first = std::max(wanted.first, -floor_div_near(at_zero + above_, n_[2], -wanted.last, -wanted.first));
    z.last = std::min(wanted.last, floor_div_near(below_ - at_zero, n_[2], wanted.first, wanted.last));
  }

 private:
  std::array<Int128, 3> n_;
  Int128 above_, below_;
  bool bounds_;
};

void insert_box(const Range& x, const Range& y, const Range& z, VoxelBits& voxels) {
  for (std::int64_t i = x.first; i <= x.last; ++i) {
    for (std::int64_t j = y.first; j <= y.last; ++j)
      voxels.insert_run(static_cast<int>(i), static_cast<int>(j), static_cast<int>(z.first), static_cast<int>(z.last));
  }
}

void require_faces(const std::vector<Triangle>& faces, std::size_t vertices) {
  if (faces.empty()) throw InputError("", "mesh.faces", "a mesh without faces has no surface to voxelise");
  for (std::size_t f = 0; f < faces.size(); ++f) {
    for (const std::int32_t v : faces[f]) {
      if (v >= 0 && static_cast<std::size_t>(v) < vertices) continue;
      throw InputError("", "mesh.faces[" + std::to_string(f) + "]", "there is no vertex " + std::to_string(v));
    }
  }
}

FixedPoint placed(const Eigen::Vector3d& vertex, std::size_t index, int resolution, OutsideCube outside) {
  const auto place = [&] { return "mesh.vertices[" + std::to_string(index) + "]"; };
  if (!vertex.allFinite()) throw InputError("", place(), "the vertex is not finite");
  if (outside == OutsideCube::kClip) return to_fixed(clip_to_cube(vertex), resolution);
  if (vertex.cwiseAbs().maxCoeff() > 0.5) throw InputError("", place(), "the vertex lies outside [-0.5, 0.5]");
  return to_fixed(vertex, resolution);
}

/// Inserts every voxel whose closed box has a point in common with the closed triangle, which may have no area. Exact:
/// by the separating-axis theorem they meet unless the boxes' face normals, the triangle's plane or one of the nine
/// edge × axis directions separates them. Each of these 13 tests allows an interval of z for a given x and y (Schwarz
/// and Seidel, "Fast parallel surface and solid voxelization on GPUs", 2010, test voxels one by one), so a column's
/// voxels are the common part of the intervals and nothing else is looked at.
/// @pre coordinates in [0, R · 2³⁰]
void insert_triangle(const FixedTriangle& triangle, VoxelBits& voxels) {
  const int resolution = voxels.resolution();
  const Range x = touched(triangle, 0, resolution), y = touched(triangle, 1, resolution),
              z = touched(triangle, 2, resolution);
  // Along one axis a connected shape meets every voxel of its extent.
  if (x.single() + y.single() + z.single() >= 2) return insert_box(x, y, z, voxels);
  const Projection xy(triangle, 0, 1), xz(triangle, 0, 2), yz(triangle, 1, 2);
  const Plane plane(triangle);
  std::array<Range, kMaxVoxelResolution> z_of_y;
  for (std::int64_t j = y.first; j <= y.last; ++j) z_of_y[at(j)] = yz.seconds(j, z);
  for (std::int64_t i = x.first; i <= x.last; ++i) {
    const Range z_of_x = xz.seconds(i, z), columns = xy.seconds(i, y);
    for (std::int64_t j = columns.first; j <= columns.last; ++j) {
      Range run = z_of_x;
      run.cut(z_of_y[at(j)]);
      if (run.first <= run.last) plane.cut(i, j, run);
      voxels.insert_run(static_cast<int>(i), static_cast<int>(j), static_cast<int>(run.first),
                        static_cast<int>(run.last));
    }
  }
}

/// Appends the voxels that the points of a closed segment lie in, in their order along it, where a point between voxels
/// belongs to the upper one as in voxel_at. A traversal from one border to the next (Amanatides and Woo, "A fast voxel
/// traversal algorithm for ray tracing", 1987) with the crossings compared as exact fractions: the same set in both
/// directions, and through an edge or a corner of the grid exactly the voxels that contain a point of the segment.
/// @pre coordinates in [0, R · 2³⁰)
void append_segment(const FixedPoint& from, const FixedPoint& to, std::vector<Voxel>& voxels) {
  std::array<Walk, 3> axes = {Walk(from[0], to[0]), Walk(from[1], to[1]), Walk(from[2], to[2])};
  for (;;) {
    voxels.push_back({static_cast<std::int32_t>(axes[0].cell), static_cast<std::int32_t>(axes[1].cell),
                      static_cast<std::int32_t>(axes[2].cell)});
    const Walk* next = nullptr;
    for (const Walk& axis : axes) {
      if (axis.left > 0 && (next == nullptr || order(axis, *next) < 0)) next = &axis;
    }
    if (next == nullptr) return;
    const Walk first = *next;
    for (Walk& axis : axes) {
      if (axis.left > 0 && order(axis, first) == 0) axis.cross();
    }
  }
}

}  // namespace

template <typename Vertex>
std::vector<Voxel> voxelize_surface(const std::vector<Vertex>& vertices, const std::vector<Triangle>& faces,
                                    int resolution, OutsideCube outside) {
  require_resolution(resolution);
  require_faces(faces, vertices.size());
  std::vector<FixedPoint> points(vertices.size());
  for (std::size_t v = 0; v < vertices.size(); ++v)
    points[v] = placed(vertices[v].template cast<double>(), v, resolution, outside);
  VoxelBits voxels(resolution);
  constexpr std::size_t kBlock = 128;  // faces at a time, so that handing out work costs nothing
  parallel_for((faces.size() + kBlock - 1) / kBlock, [&](std::size_t block) {
    const std::size_t end = std::min(faces.size(), (block + 1) * kBlock);
    for (std::size_t f = block * kBlock; f < end; ++f) {
      const auto corner = [&](std::size_t k) { return points[at(faces[f][k])]; };
      insert_triangle({corner(0), corner(1), corner(2)}, voxels);
    }
  });
  return voxels.voxels();
}

template std::vector<Voxel> voxelize_surface(const std::vector<Eigen::Vector3f>&, const std::vector<Triangle>&, int,
                                             OutsideCube);
template std::vector<Voxel> voxelize_surface(const std::vector<Eigen::Vector3d>&, const std::vector<Triangle>&, int,
                                             OutsideCube);

std::vector<Voxel> voxelize_bones(const std::vector<Eigen::Vector3d>& joints, const std::vector<int>& parents,
                                  int resolution) {
  require_resolution(resolution);
  if (joints.empty()) throw InputError("", "skeleton", "a skeleton without joints has no voxels");
  const std::vector<Bone> bones = bones_of(joints, parents);
  std::vector<Voxel> voxels;
  const auto fixed = [&](const Eigen::Vector3d& point) { return to_fixed(clip_to_cube(point), resolution); };
  for (const Bone& bone : bones) append_segment(fixed(bone.head), fixed(bone.tail), voxels);
  for (const Eigen::Vector3d& joint : joints) {  // a root without children has no bone
    const FixedPoint point = fixed(joint);
    append_segment(point, point, voxels);
  }
  sort_unique(voxels);
  return voxels;
}

}  // namespace anigen::geometry
