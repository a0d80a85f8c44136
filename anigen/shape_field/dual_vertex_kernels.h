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

namespace anigen::shape_field::kernels {

/// Cubes that a surface passes, with what the field says at their corners. Row of a grid vertex: sdf, then `channels`
/// values that are interpolated, the position first.
template <typename T>
struct DualCubes {
  std::int64_t cubes = 0, channels = 0;
  const T* rows = nullptr;                ///< [S, 1 + channels]
  const T* alpha = nullptr;               ///< [cubes, 8]
  const T* beta = nullptr;                ///< [cubes, 12]
  const std::int32_t* corners = nullptr;  ///< [cubes, 8]
  const std::uint8_t* cases = nullptr;    ///< [cubes]
  const std::int32_t* first_dual = nullptr;
  const std::int32_t* first_crossing = nullptr;
};

/// Dual vertices and, unless `deviation` is nullptr, the deviation of every (dual vertex, edge)
/// (docs/reference/autoencoders.md, 5.2). Parallel over cubes. @param values [D, channels] @param deviation [K]
template <typename T>
void dual_vertices_forward(const DualCubes<T>& problem, T* values, T* deviation);

/// Gradients of dual_vertices_forward, cube by cube. @param d_deviation may be nullptr @param d_corners [cubes, 8,
/// 1 + channels] @param d_alpha [cubes, 8] @param d_beta [cubes, 12]; all three are overwritten
template <typename T>
void dual_vertices_backward(const DualCubes<T>& problem, const T* d_values, const T* d_deviation, T* d_corners,
                            T* d_alpha, T* d_beta);

}  // namespace anigen::shape_field::kernels
