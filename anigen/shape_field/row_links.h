#pragma once
#include <cstdint>

#include "anigen/nn/torch.h"

namespace anigen::shape_field {

using torch::Tensor;

/// Row of a table that each entry of a list belongs to, known in both directions: gathering rows and summing entries
/// are then each other's derivative, and both run in parallel with sums in one fixed order.
struct RowLinks {
  Tensor targets;  ///< [N] int64: row of the table, or −1 for none
  Tensor sources;  ///< [rows, K] int32: the entries of each row in the order they are added, −1 where there are fewer

  RowLinks to(const torch::Device& device) const { return {targets.to(device), sources.to(device)}; }
};

/// Row of each entry, zeros where there is none. Differentiable in the table, as often as one likes.
/// @param table [rows, C] fp32 or fp64 @return [N, C]
Tensor gather_rows(const Tensor& table, const RowLinks& links);

/// Sum over the entries of each row. Differentiable in the list, as often as one likes.
/// @param list [N, C], or [N/H, H, C] with any strides between rows, fp32 or fp64 @return [rows, C]
Tensor sum_rows(const Tensor& list, const RowLinks& links);

}  // namespace anigen::shape_field
