#pragma once
#include "anigen/nn/torch.h"

namespace anigen::nn {

/// Sinusoidal embedding of integer coordinates: per axis the sines then the cosines of c · 10000^(−i/F), F =
/// ⌊⌊C/axes⌋/2⌋; axes in order, zero-padded to C (reference flows-and-pipeline.md, 1.4).
/// @param coordinates [N, axes], integer or floating point @return [N, channels] fp32
Tensor absolute_position_embedding(const Tensor& coordinates, std::int64_t channels);

/// Cells (x, y, z) of a cubic grid as rows in row-major order, z fastest. [R³, 3] int64
Tensor grid_coordinates(std::int64_t resolution);

}  // namespace anigen::nn
