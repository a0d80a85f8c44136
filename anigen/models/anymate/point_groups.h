#pragma once
#include "anigen/nn/torch.h"

namespace anigen::models::anymate {

using torch::Tensor;

/// Farthest-point sampling (Eldar et al. 1997): again and again the point whose squared distance to those chosen is
/// largest, of equal ones the first. On the CPU, one thread an item.
/// @param points [B, N, 3] fp32 @param count at most N @param start [B] int64, the first choice of each item
/// @return [B, count] int64, on the device of the points
/// @throws InputError for shapes, for more points than there are, and for a start that is no point
Tensor farthest_points(const Tensor& points, std::int64_t count, const Tensor& start);

/// The `count` nearest points of each centre, in no order. Distances are formed as |a|² - 2ab + |b|², as the released
/// code does, which decides between near ties. One item at a time, so that no [B, G, N] is held.
/// @param points [B, N, 3] @param centers [B, G, 3] @return [B, G, count] int64
/// @throws InputError for shapes and for more points than there are
Tensor nearest_points(const Tensor& points, const Tensor& centers, std::int64_t count);

/// Rows of each item. @param points [B, N, C] @param rows [B, ...] int64 @return [B, ..., C]
Tensor rows_of_items(const Tensor& points, const Tensor& rows);

}  // namespace anigen::models::anymate
