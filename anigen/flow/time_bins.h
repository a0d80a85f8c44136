#pragma once
#include <cstdint>

#include "anigen/nn/torch.h"

namespace anigen::flow {

using torch::Tensor;

inline constexpr std::int64_t kTimeBins = 10;

/// Which of `bins` equal parts of [0, 1] each time lies in; a part holds its lower end. t = 1 gives `bins`.
/// @return [B] int64
Tensor time_bin(const Tensor& t, std::int64_t bins = kTimeBins);

/// Mean of the values whose time lies in each bin, for the training log: a loss that is low at noisy times and high
/// at clean ones shows here and not in the total. @param values, t [B] @return [bins] fp64, NaN where no time falls
Tensor mean_per_time_bin(const Tensor& values, const Tensor& t, std::int64_t bins = kTimeBins);

/// Mean squared error of each item. @param prediction, target [B, ...] @return [B] in fp32 or wider
Tensor mse_per_item(const Tensor& prediction, const Tensor& target);

/// Mean of each item over its rows and their channels, where rows of several items lie below each other.
/// @param rows [N, C] @param item [N] int64 @return [items]; 0 for an item without rows
Tensor mean_per_item(const Tensor& rows, const Tensor& item, std::int64_t items);

}  // namespace anigen::flow
