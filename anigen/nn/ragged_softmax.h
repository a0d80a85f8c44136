#pragma once
#include "anigen/nn/attention_kernels.h"
#include "anigen/nn/small_products.h"

namespace anigen::nn {

/// kernels::softmax_block for short rows with gaps between them: on return each score holds exp(scale (score −
/// largest)), those far below the largest at least e^-87, and the state includes it; from `columns` to
/// products::padded(columns) the rows may hold anything. A row with a score that is not finite, or below -1e38, gets
/// the sum NaN.
void softmax_rows(const products::Block& scores, std::int64_t rows, std::int64_t columns, float scale,
                  const kernels::RunningSoftmax& state);

}  // namespace anigen::nn
