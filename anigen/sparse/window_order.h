#pragma once
#include "anigen/sparse/support.h"

namespace anigen::sparse {

/// Support::windows. @param coords [N, 4] int32, CPU, contiguous @param items number of items @throws InputError for a
/// window below 1, a shift below 0, or numbers of windows beyond 2^62
WindowOrder window_order(const Tensor& coords, std::int64_t items, std::int64_t size, std::int64_t shift);

}  // namespace anigen::sparse
