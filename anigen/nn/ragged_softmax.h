#pragma once
#include "anigen/nn/attention_kernels.h"
#include "anigen/nn/small_products.h"

namespace anigen::nn {

/// kernels::softmax_block for short rows with gaps between them: on return each score holds exp(scale (score −
/// largest)) and the state includes it; from `columns` to products::padded(columns) there are zeros. A row with a score
/// that is not finite gets the sum NaN.
void softmax_rows(const products::Block& scores, std::int64_t rows, std::int64_t columns, float scale,
                  const kernels::RunningSoftmax& state);

}  // namespace anigen::nn
