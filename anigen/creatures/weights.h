#pragma once
#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <utility>
#include <vector>

#include "anigen/asset/skin_weights.h"
#include "anigen/creatures/body.h"
#include "anigen/creatures/surface.h"

namespace anigen::creatures {

/// Skin weights as an artist would paint them, for a posed body and its surface.
///
/// A vertex belongs to the joint of the primitive it lies on. Around every joint there is a band, across the bisector
/// of the two bones, in which weight passes from the parent to the child by a smooth step; its half width is
/// Body::softness times the limb radius. Bands act only along the tree: a vertex can hear its own joint, ancestors and
/// descendants up to three hops away, never another limb, however close that is in space. Joint::twist_of helpers take
/// over linearly along their bone. A few diffusion steps over the mesh, under the same restriction, even out what is
/// left; small weights are dropped.
/// @return one row per vertex, at most 8 influences each
SkinWeights paint_weights(const Body& body, const Surface& surface);

/// A regular grid of field samples that stores only the blocks of 4³ nodes near the surface; everywhere else the sign
/// is known. Cell (i, j, k) has the nodes (i … i+1, j … j+1, k … k+1).
class BlockGrid {
 public:
  using Index = std::array<int, 3>;
  static constexpr int kBlock = 4;

  BlockGrid(const Field& field, double spacing);

  double spacing() const { return spacing_; }
  Eigen::Vector3d node(const Index& i) const { return origin_ + spacing_ * Eigen::Vector3d(i[0], i[1], i[2]); }
  float value(const Index& i) const;
  bool inside(const Index& i) const { return value(i) < 0.0f; }
  /// Bit c (x = bit 0, y = bit 1, z = bit 2 of c) is set where corner c of the cell is inside.
  int corners(const Index& cell) const;
  /// Index into lists() for the block of a node; -1 where the block is uniform.
  int slot(const Index& i) const { return slots_[block_of(i)]; }
  const std::vector<PrimitiveList>& lists() const { return lists_; }
  std::vector<PrimitiveList> take_lists() { return std::move(lists_); }

  /// Makes the samples well-composed: no two inside (or outside) corners of a cell touch only diagonally.
  /// @return false when that would reach out of the stored blocks (has not been seen): use another spacing
  bool repair();
  /// All cells whose corners differ in sign.
  std::vector<Index> mixed_cells() const;
  /// One number per node of the stored blocks, in memory order of value(); for tables keyed by cell.
  std::size_t storage_index(const Index& i) const;
  std::size_t storage_size() const { return values_.size(); }

 private:
  std::size_t block_of(const Index& i) const {
    return (static_cast<std::size_t>(i[2] / kBlock) * blocks_[1] + i[1] / kBlock) * blocks_[0] + i[0] / kBlock;
  }
  /// Of a ball that covers `nodes`³ nodes, the cells that reach over to the next block, and repairs there.
  double radius_of(int nodes) const { return spacing_ * (0.8661 * (nodes - 1) + 2.1); }
  void add_block(const Field& field, const Index& first, const PrimitiveList& candidates);
  bool make_inside(const Index& i);
  /// The corner to turn inside where a cell is ambiguous, -1 where it is not.
  int ambiguous_corner(const Index& cell) const;

  double spacing_;
  Eigen::Vector3d origin_;
  Index blocks_{};
  std::vector<int> slots_;  ///< per block: ≥ 0 stored, -1 outside, -2 inside
  std::vector<Index> firsts_;
  std::vector<float> values_;
  std::vector<PrimitiveList> lists_;
};

}  // namespace anigen::creatures
