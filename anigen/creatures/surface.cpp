#include "anigen/creatures/surface.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>

#include "anigen/core/disjoint_sets.h"
#include "anigen/core/numeric.h"

namespace anigen::creatures {

namespace {

using Eigen::Vector3d;
using Index = std::array<int, 3>;

constexpr int kBlock = 4;  ///< nodes along the side of a block
// Blocks are classified in groups first, which saves most distance evaluations.
constexpr int kGroup = 5 * kBlock;
constexpr int kNodes = kBlock * kBlock * kBlock;

Index corner_of(const Index& cell, int corner) {
  return {cell[0] + (corner & 1), cell[1] + ((corner >> 1) & 1), cell[2] + (corner >> 2)};
}

/// A regular grid of field samples that stores only the blocks of 4³ nodes near the surface; everywhere else the sign
/// is known. Cell (i, j, k) has the nodes (i … i+1, j … j+1, k … k+1).
class BlockGrid {
 public:
  BlockGrid(const Field& field, double spacing) : spacing_(spacing) {
    Vector3d low = Vector3d::Constant(1e300), high = -low;
    for (const Primitive& p : field.primitives()) {
      if (p.carve) continue;
      Vector3d a, b;
      bounds(p, a, b);
      low = low.cwiseMin(a - Vector3d::Constant(p.blend));
      high = high.cwiseMax(b + Vector3d::Constant(p.blend));
    }
    // Two spare cells on each side keep the surface off the boundary; the odd fraction keeps symmetric bodies from
    // placing nodes exactly on flat faces.
    origin_ = low.array() - 2.37 * spacing;
    for (int axis = 0; axis < 3; ++axis)
      blocks_[axis] = static_cast<int>(std::ceil((high[axis] - low[axis]) / spacing + 5.0)) / kBlock + 1;
    slots_.resize(static_cast<std::size_t>(blocks_[0]) * blocks_[1] * blocks_[2]);
    PrimitiveList all(field.primitives().size()), list;
    std::iota(all.begin(), all.end(), 0);
    const auto end = [&](int axis, int from) { return std::min(from + kGroup, blocks_[axis] * kBlock); };
    for (int z = 0; z < blocks_[2] * kBlock; z += kGroup) {
      for (int y = 0; y < blocks_[1] * kBlock; y += kGroup) {
        for (int x = 0; x < blocks_[0] * kBlock; x += kGroup) {
          const Vector3d center = node({x, y, z}) + Vector3d::Constant(0.5 * (kGroup - 1) * spacing);
          const Field::Content content = field.classify(center, radius_of(kGroup), all, list);
          for (int k = z; k < end(2, z); k += kBlock) {
            for (int j = y; j < end(1, y); j += kBlock) {
              for (int i = x; i < end(0, x); i += kBlock) {
                slots_[block_of({i, j, k})] = content == Field::Content::kInside ? -2 : -1;
                if (content == Field::Content::kMixed) add_block(field, {i, j, k}, list);
              }
            }
          }
        }
      }
    }
  }

  double spacing() const { return spacing_; }
  Eigen::Vector3d node(const Index& i) const { return origin_ + spacing_ * Eigen::Vector3d(i[0], i[1], i[2]); }
  float value(const Index& i) const {
    const int at = slot(i);
    if (at < 0) return at == -2 ? -1.0f : 1.0f;
    return values_[storage_index(i)];
  }

  bool inside(const Index& i) const { return value(i) < 0.0f; }
  /// Bit c (x = bit 0, y = bit 1, z = bit 2 of c) is set where corner c of the cell is inside.
  int corners(const Index& cell) const {
    int mask = 0;
    for (int c = 0; c < 8; ++c) mask |= inside(corner_of(cell, c)) << c;
    return mask;
  }

  /// Index into lists() for the block of a node; -1 where the block is uniform.
  int slot(const Index& i) const { return slots_[block_of(i)]; }
  const std::vector<PrimitiveList>& lists() const { return lists_; }
  std::vector<PrimitiveList> take_lists() { return std::move(lists_); }

  /// Makes the samples well-composed: no two inside (or outside) corners of a cell touch only diagonally.
  /// @return false when that would reach out of the stored blocks (has not been seen): use another spacing
  bool repair() {
    // Every step turns one more node inside, so this ends.
    std::vector<Index> work = mixed_cells();
    while (!work.empty()) {
      const Index cell = work.back();
      work.pop_back();
      const int corner = ambiguous_corner(cell);
      if (corner < 0) continue;
      const Index node = corner_of(cell, corner);
      if (!make_inside(node)) return false;
      for (int c = 0; c < 8; ++c) work.push_back({node[0] - (c & 1), node[1] - ((c >> 1) & 1), node[2] - (c >> 2)});
    }
    return true;
  }

  /// All cells whose corners differ in sign.
  std::vector<Index> mixed_cells() const {
    std::vector<Index> cells;
    for (const Index& first : firsts_) {
      for (int n = 0; n < kNodes; ++n) {
        const Index cell{first[0] + n % kBlock, first[1] + n / kBlock % kBlock, first[2] + n / kBlock / kBlock};
        // The last layer of the grid has no cells; nothing is inside there.
        if (cell[0] + 1 >= blocks_[0] * kBlock || cell[1] + 1 >= blocks_[1] * kBlock ||
            cell[2] + 1 >= blocks_[2] * kBlock) {
          continue;
        }
        const int mask = corners(cell);
        if (mask != 0 && mask != 255) cells.push_back(cell);
      }
    }
    return cells;
  }

  /// One number per node of the stored blocks, in memory order of value(); for tables keyed by cell.
  std::size_t storage_index(const Index& i) const {
    const auto in_block = ((i[2] % kBlock) * kBlock + i[1] % kBlock) * kBlock + i[0] % kBlock;
    return static_cast<std::size_t>(slot(i)) * kNodes + static_cast<std::size_t>(in_block);
  }

  std::size_t storage_size() const { return values_.size(); }

 private:
  std::size_t block_of(const Index& i) const {
    return (static_cast<std::size_t>(i[2] / kBlock) * blocks_[1] + i[1] / kBlock) * blocks_[0] + i[0] / kBlock;
  }
  /// Of a ball that covers `nodes`³ nodes, the cells that reach over to the next block, and repairs there.
  double radius_of(int nodes) const { return spacing_ * (0.8661 * (nodes - 1) + 2.1); }
  void add_block(const Field& field, const Index& first, const PrimitiveList& candidates) {
    PrimitiveList list;
    const Vector3d center = node(first) + Vector3d::Constant(0.5 * (kBlock - 1) * spacing_);
    const Field::Content content = field.classify(center, radius_of(kBlock), candidates, list);
    int& slot = slots_[block_of(first)];
    slot = content == Field::Content::kInside ? -2 : -1;
    if (content != Field::Content::kMixed) return;
    slot = static_cast<int>(lists_.size());
    for (int n = 0; n < kNodes; ++n) {
      const Index at{first[0] + n % kBlock, first[1] + n / kBlock % kBlock, first[2] + n / kBlock / kBlock};
      values_.push_back(static_cast<float>(field.value(node(at), list)));
    }
    lists_.push_back(std::move(list));
    firsts_.push_back(first);
  }

  bool make_inside(const Index& i) {
    // The eight cells at the node must be stored, too.
    for (int c = 0; c < 8; ++c) {
      if (slot({i[0] - (c & 1), i[1] - ((c >> 1) & 1), i[2] - (c >> 2)}) < 0) return false;
    }
    values_[storage_index(i)] = static_cast<float>(-1e-3 * spacing_);
    return true;
  }

  /// The corner to turn inside where a cell is ambiguous, -1 where it is not.
  int ambiguous_corner(const Index& cell) const {
    const int mask = corners(cell);
    if (mask == 0 || mask == 255) return -1;
    std::array<int, 8> candidates{};
    int count = 0;
    for (int axis = 0; axis < 3 && count == 0; ++axis) {
      const int u = 1 << (axis + 1) % 3, v = 1 << (axis + 2) % 3;
      for (int side = 0; side < 2 && count == 0; ++side) {
        const int c = side << axis;
        const bool a = mask >> c & 1, b = mask >> (c | u) & 1, d = mask >> (c | v) & 1, e = mask >> (c | u | v) & 1;
        if (a == e && b == d && a != b) {
          candidates[0] = a ? (c | u) : c;
          candidates[1] = a ? (c | v) : (c | u | v);
          count = 2;
        }
      }
    }
    if (count == 0) {
      for (int c = 0; c < 4; ++c) {
        const int pair = (1 << c) | (1 << (7 - c));
        if (mask == pair || (mask ^ 255) == pair) {
          for (int k = 0; k < 8; ++k) {
            if (!(mask >> k & 1)) candidates[count++] = k;
          }
        }
      }
    }
    if (count == 0) return -1;
    int best = candidates[0];
    for (int n = 1; n < count; ++n) {
      if (value(corner_of(cell, candidates[n])) < value(corner_of(cell, best))) best = candidates[n];
    }
    return best;
  }

  double spacing_;
  Eigen::Vector3d origin_;
  Index blocks_{};
  std::vector<int> slots_;  ///< per block: ≥ 0 stored, -1 outside, -2 inside
  std::vector<Index> firsts_;
  std::vector<float> values_;
  std::vector<PrimitiveList> lists_;
};

/// The mean of the points where the field changes sign along the cell's edges.
Vector3d first_guess(const BlockGrid& grid, const Index& cell) {
  Vector3d sum = Vector3d::Zero();
  int count = 0;
  for (int c = 0; c < 8; ++c) {
    for (int axis = 0; axis < 3; ++axis) {
      if (c >> axis & 1) continue;
      const Index a{cell[0] + (c & 1), cell[1] + ((c >> 1) & 1), cell[2] + (c >> 2)};
      Index b = a;
      ++b[axis];
      const double fa = grid.value(a), fb = grid.value(b);
      if ((fa < 0.0) == (fb < 0.0)) continue;
      sum += grid.node(a) + fa / (fa - fb) * (grid.node(b) - grid.node(a));
      ++count;
    }
  }
  return sum / count;
}

class Net {
 public:
  Net(const Field& field, double spacing) : field_(field), grid_(field, spacing) {
    if (!grid_.repair()) return;
    cells_ = grid_.mixed_cells();
    std::vector<int> vertex_of(grid_.storage_size(), -1);
    for (std::size_t v = 0; v < cells_.size(); ++v) {
      vertex_of[grid_.storage_index(cells_[v])] = static_cast<int>(v);
      surface_.vertices.push_back(first_guess(grid_, cells_[v]));
      surface_.vertex_lists.push_back(grid_.slot(cells_[v]));
    }
    for (const Index& cell : cells_) add_quads(cell, vertex_of);
    keep_largest_piece();
  }

  void project(int steps) {
    const double h = grid_.spacing();
    PrimitiveList list;
    for (std::size_t v = 0; v < cells_.size(); ++v) {
      Vector3d x = surface_.vertices[v];
      field_.narrow(x, grid_.lists()[surface_.vertex_lists[v]], h, list);
      for (int step = 0; step < steps; ++step) {
        const double f = field_.value(x, list);
        if (std::abs(f) < 1e-3 * h) break;
        const Vector3d g = field_.gradient(x, list, 0.03 * h);
        const double squared = g.squaredNorm();
        if (squared < 1e-4) break;
        Vector3d move = -f / squared * g;
        if (move.norm() > 0.5 * h) move *= 0.5 * h / move.norm();
        x += move;
      }
      surface_.vertices[v] = clamp(v, x);
    }
  }

  void relax() {
    std::vector<Vector3d> sums(cells_.size(), Vector3d::Zero());
    std::vector<int> counts(cells_.size(), 0);
    for (const auto& quad : quads_) {
      for (int k = 0; k < 4; ++k) {
        sums[quad[k]] += surface_.vertices[quad[(k + 1) % 4]];
        ++counts[quad[k]];
      }
    }
    for (std::size_t v = 0; v < cells_.size(); ++v) {
      if (counts[v] > 0) surface_.vertices[v] = clamp(v, 0.5 * (surface_.vertices[v] + sums[v] / counts[v]));
    }
  }

  Surface finish() {
    for (const auto& q : quads_) {
      // The diagonal that folds less sharply.
      const auto& x = surface_.vertices;
      const auto alignment = [&](int a, int b, int c, int d) {
        const Vector3d first = (x[b] - x[a]).cross(x[c] - x[a]), second = (x[c] - x[a]).cross(x[d] - x[a]);
        return first.dot(second) / std::max(first.norm() * second.norm(), 1e-30);
      };
      const int s = alignment(q[0], q[1], q[2], q[3]) >= alignment(q[1], q[2], q[3], q[0]) ? 0 : 1;
      surface_.faces.push_back({q[s], q[s + 1], q[s + 2]});
      surface_.faces.push_back({q[s], q[s + 2], q[(s + 3) % 4]});
    }
    set_normals();
    surface_.lists = grid_.take_lists();
    return std::move(surface_);
  }

 private:
  // A vertex that stays near its own cell cannot fold the mesh over.
  Vector3d clamp(std::size_t v, const Vector3d& x) const {
    const double h = grid_.spacing();
    const Vector3d low = grid_.node(cells_[v]).array() - 0.25 * h;
    return x.cwiseMax(low).cwiseMin((low.array() + 1.5 * h).matrix());
  }

  void add_quads(const Index& cell, const std::vector<int>& vertex_of) {
    const bool start = grid_.inside(cell);
    for (int axis = 0; axis < 3; ++axis) {
      Index end = cell;
      ++end[axis];
      if (grid_.inside(end) == start) continue;
      const int u = (axis + 1) % 3, v = (axis + 2) % 3;
      std::array<int, 4> quad{};
      for (int k = 0; k < 4; ++k) {
        Index around = cell;
        around[u] -= k == 1 || k == 2;
        around[v] -= k >= 2;
        quad[k] = vertex_of[grid_.storage_index(around)];
      }
      if (!start) std::swap(quad[1], quad[3]);
      quads_.push_back(quad);
    }
  }

  void keep_largest_piece() {
    DisjointSets pieces(cells_.size());
    for (const auto& quad : quads_) {
      for (int k = 1; k < 4; ++k) pieces.join(at(quad[0]), at(quad[k]));
    }
    const std::size_t none = cells_.size();
    std::size_t largest = none;
    for (std::size_t v = 0; v < cells_.size(); ++v) {
      if (pieces.find(v) == v && (largest == none || pieces.size_of(v) > pieces.size_of(largest))) largest = v;
    }
    if (largest == none || pieces.size_of(largest) == cells_.size()) return;
    std::vector<int> kept(cells_.size(), -1);
    int count = 0;
    for (std::size_t v = 0; v < cells_.size(); ++v) {
      if (pieces.find(v) != largest) continue;
      kept[v] = count;
      cells_[count] = cells_[v];
      surface_.vertices[count] = surface_.vertices[v];
      surface_.vertex_lists[count++] = surface_.vertex_lists[v];
    }
    cells_.resize(count);
    surface_.vertices.resize(count);
    surface_.vertex_lists.resize(count);
    std::vector<std::array<int, 4>> quads;
    for (auto quad : quads_) {
      if (kept[quad[0]] < 0) continue;
      for (int& v : quad) v = kept[v];
      quads.push_back(quad);
    }
    quads_ = std::move(quads);
  }

  void set_normals() {
    surface_.normals.assign(cells_.size(), Vector3d::Zero());
    for (const Triangle& t : surface_.faces) {
      const auto& x = surface_.vertices;
      const Vector3d n = (x[t[1]] - x[t[0]]).cross(x[t[2]] - x[t[0]]);
      for (int v : t) surface_.normals[v] += n;
    }
    PrimitiveList list;
    for (std::size_t v = 0; v < cells_.size(); ++v) {
      Vector3d& normal = surface_.normals[v];
      normal = normal.norm() > 1e-30 ? normal.normalized() : Vector3d::UnitZ();
      field_.narrow(surface_.vertices[v], grid_.lists()[surface_.vertex_lists[v]], 0.1 * grid_.spacing(), list);
      const Vector3d exact = field_.gradient(surface_.vertices[v], list, 0.03 * grid_.spacing());
      // When the mesh cannot follow the field (thin gaps, repaired cells) its own normal is the right one.
      if (exact.norm() > 0.1 && exact.normalized().dot(normal) > 0.6) normal = exact.normalized();
    }
  }

  const Field& field_;
  BlockGrid grid_;
  std::vector<Index> cells_;
  std::vector<std::array<int, 4>> quads_;
  Surface surface_;
};

std::vector<Primitive> prepared(std::vector<Primitive> primitives, double spacing) {
  for (Primitive& p : primitives) {
    ensure_thickness(p, spacing);
    p.blend = std::max(p.blend, 0.7 * spacing);
  }
  return primitives;
}

}  // namespace

double estimate_vertices(const std::vector<Primitive>& primitives, double spacing) {
  const double coarse = 2.5 * spacing;
  const Field field(prepared(primitives, spacing));
  return static_cast<double>(BlockGrid(field, coarse).mixed_cells().size()) * 6.25;
}

Surface extract_surface(const std::vector<Primitive>& primitives, double spacing, int relaxations) {
  const Field field(prepared(primitives, spacing));
  Net net(field, spacing);
  for (int n = 0; n < relaxations; ++n) {
    net.project(1);
    net.relax();
  }
  net.project(3);
  return net.finish();
}

}  // namespace anigen::creatures
