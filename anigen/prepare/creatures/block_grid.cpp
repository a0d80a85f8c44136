#include "anigen/prepare/creatures/block_grid.h"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace anigen::prepare {
namespace {

using Eigen::Vector3d;
// Blocks are classified in groups first, which saves most distance evaluations.
constexpr int kGroup = 5 * BlockGrid::kBlock;
constexpr int kNodes = BlockGrid::kBlock * BlockGrid::kBlock * BlockGrid::kBlock;

BlockGrid::Index corner_of(const BlockGrid::Index& cell, int corner) {
  return {cell[0] + (corner & 1), cell[1] + ((corner >> 1) & 1), cell[2] + (corner >> 2)};
}

}  // namespace

BlockGrid::BlockGrid(const Field& field, double spacing) : spacing_(spacing) {
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
  for (int axis = 0; axis < 3; ++axis) {
    blocks_[axis] = static_cast<int>(std::ceil((high[axis] - low[axis]) / spacing + 5.0)) / kBlock + 1;
  }
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

void BlockGrid::add_block(const Field& field, const Index& first, const PrimitiveList& candidates) {
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

std::size_t BlockGrid::storage_index(const Index& i) const {
  return static_cast<std::size_t>(slot(i)) * kNodes + ((i[2] % kBlock) * kBlock + i[1] % kBlock) * kBlock +
         i[0] % kBlock;
}

float BlockGrid::value(const Index& i) const {
  const int at = slot(i);
  if (at < 0) return at == -2 ? -1.0f : 1.0f;
  return values_[storage_index(i)];
}

int BlockGrid::corners(const Index& cell) const {
  int mask = 0;
  for (int c = 0; c < 8; ++c) mask |= inside(corner_of(cell, c)) << c;
  return mask;
}

bool BlockGrid::make_inside(const Index& i) {
  // The eight cells at the node must be stored, too.
  for (int c = 0; c < 8; ++c) {
    if (slot({i[0] - (c & 1), i[1] - ((c >> 1) & 1), i[2] - (c >> 2)}) < 0) return false;
  }
  values_[storage_index(i)] = static_cast<float>(-1e-3 * spacing_);
  return true;
}

std::vector<BlockGrid::Index> BlockGrid::mixed_cells() const {
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

int BlockGrid::ambiguous_corner(const Index& cell) const {
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

bool BlockGrid::repair() {
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

}  // namespace anigen::prepare
