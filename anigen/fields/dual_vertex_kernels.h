#pragma once
#include <cstdint>

namespace anigen::fields::kernels {

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

/// Dual vertices and, unless `deviation` is nullptr, the deviation of every (dual vertex, edge) (reference
/// autoencoders.md, 4.3, steps 5, 6 and 9). Parallel over cubes. @param values [D, channels] @param deviation [K]
template <typename T>
void dual_vertices_forward(const DualCubes<T>& problem, T* values, T* deviation);

/// Gradients of dual_vertices_forward, cube by cube. @param d_deviation may be nullptr @param d_corners [cubes, 8,
/// 1 + channels] @param d_alpha [cubes, 8] @param d_beta [cubes, 12]; all three are overwritten
template <typename T>
void dual_vertices_backward(const DualCubes<T>& problem, const T* d_values, const T* d_deviation, T* d_corners,
                            T* d_alpha, T* d_beta);

}  // namespace anigen::fields::kernels
