#pragma once
#include "anigen/nn/torch.h"

namespace anigen::models {

using torch::Tensor;

/// DINOv2's position embedding for a picture of rows × columns patches. At its own (square) size the parameter is
/// returned untouched. Otherwise the M × M grid of patch embeddings is resampled bicubically (align_corners false), and
/// the class token's entry kept. The two published families differ (README of the parity fixtures, "DINOv2"):
/// - models with registers: antialiased, offset 0, and the kernel scales by M / rows and M / columns;
/// - models without: not antialiased, offset 0.1, and the kernel scales by exactly M / (rows + 0.1), so that it samples
///   slightly other places than a call by size would.
/// @param pos_embed [1, 1 + M·M, C], class token first @param rows,columns at least 1
/// @return [1, 1 + rows·columns, C], patches row by row, dtype of pos_embed
Tensor interpolate_positions(const Tensor& pos_embed, std::int64_t rows, std::int64_t columns, bool antialias,
                             double offset);

}  // namespace anigen::models
