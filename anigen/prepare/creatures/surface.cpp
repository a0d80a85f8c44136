#include "anigen/prepare/creatures/surface.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>

#include "anigen/prepare/creatures/block_grid.h"

namespace anigen::prepare {
namespace {

using Eigen::Vector3d;
using Index = BlockGrid::Index;

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
      if (counts[v] > 0) {
        surface_.vertices[v] = clamp(v, 0.5 * (surface_.vertices[v] + sums[v] / counts[v]));
      }
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
    std::vector<int> root(cells_.size());
    std::iota(root.begin(), root.end(), 0);
    const auto find = [&](int v) {
      while (root[v] != v) v = root[v] = root[root[v]];
      return v;
    };
    for (const auto& quad : quads_) {
      for (int k = 1; k < 4; ++k) root[find(quad[k])] = find(quad[0]);
    }
    std::vector<int> sizes(cells_.size(), 0);
    for (std::size_t v = 0; v < cells_.size(); ++v) ++sizes[find(static_cast<int>(v))];
    const int largest = static_cast<int>(std::max_element(sizes.begin(), sizes.end()) - sizes.begin());
    if (sizes.empty() || sizes[largest] == static_cast<int>(cells_.size())) return;
    std::vector<int> kept(cells_.size(), -1);
    int count = 0;
    for (std::size_t v = 0; v < cells_.size(); ++v) {
      if (find(static_cast<int>(v)) != largest) continue;
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
      // Where the mesh cannot follow the field (thin gaps, repaired cells) its own normal is the right one.
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

}  // namespace anigen::prepare
