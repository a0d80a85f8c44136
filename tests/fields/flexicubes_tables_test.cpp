#include "anigen/fields/flexicubes_tables.h"

#include <gtest/gtest.h>

#include <string>

#include "anigen/core/sha256.h"

namespace anigen::fields {
namespace {

void append_bytes(std::int16_t value, std::string& bytes) {
  bytes += static_cast<char>(value & 0xff);
  bytes += static_cast<char>(value >> 8 & 0xff);
}
template <typename T, std::size_t N>
void append_bytes(const std::array<T, N>& table, std::string& bytes) {
  for (const T& item : table) append_bytes(item, bytes);
}

// Of a table as little-endian 16-bit integers in row-major order.
template <typename Table>
std::string table_digest(const Table& table) {
  std::string bytes;
  append_bytes(table, bytes);
  return sha256(bytes);
}

// Sums of reference autoencoders.md, 4.4.
TEST(FlexicubesTables, AreThePublishedOnes) {
  const FlexicubesTables& tables = flexicubes_tables();
  EXPECT_EQ(table_digest(tables.groups), "d704bd48b4b0d7a55a1d9f7647d739bc4b934c0983b877d5a4ccf5378fc515ce");
  EXPECT_EQ(table_digest(tables.counts), "a3ce4604e8fbf815bec49308d77c46029af7fabfe5438aa56bb839c3510ac2ba");
  EXPECT_EQ(table_digest(tables.ambiguity), "2619074d39d60bb57c9d30ae29239dfd5f40b324e8f63f488d6126d4f1e24198");
}

TEST(FlexicubesTables, EveryCrossingEdgeIsInOneGroup) {
  const FlexicubesTables& tables = flexicubes_tables();
  for (std::size_t c = 0; c < FlexicubesTables::kCases; ++c) {
    int crossings = 0;
    for (std::size_t edge = 0; edge < kCubeEdges; ++edge) {
      const auto& ends = kEdgeCorners[edge];
      const bool crosses = (c >> ends[0] & 1) != (c >> ends[1] & 1);
      const int group = tables.group_of_edge[c][edge], slot = tables.slot_of_edge[c][edge];
      crossings += crosses ? 1 : 0;
      ASSERT_EQ(crosses, group >= 0) << "case " << c << " edge " << edge;
      if (!crosses) continue;
      EXPECT_EQ(tables.groups[c][static_cast<std::size_t>(group)][static_cast<std::size_t>(slot)],
                static_cast<std::int16_t>(edge));
    }
    EXPECT_EQ(tables.crossings[c], crossings) << "case " << c;
  }
}

TEST(FlexicubesTables, EdgesAreFoundFromTheirLowerCorner) {
  for (int corner = 0; corner < 8; ++corner) {
    for (int axis = 0; axis < 3; ++axis) {
      if ((corner >> axis & 1) != 0) continue;
      const auto& ends = kEdgeCorners[static_cast<std::size_t>(edge_from_corner(corner, axis))];
      EXPECT_EQ(ends[0] + ends[1], corner + (corner | 1 << axis));
      EXPECT_EQ(ends[axis == 1 ? 1 : 0], corner) << "y-edges are stored from high to low";
    }
  }
}

}  // namespace
}  // namespace anigen::fields
