#pragma once
#include <cstdint>

#include "anigen/nn/torch.h"

namespace anigen::models::rignet {

using torch::Tensor;

/// Directed edges sorted by the point they lead to: into target i come those from sources[offsets[i]] to
/// sources[offsets[i + 1] - 1]. Every target has at least one. Targets and sources may be points of two sets.
struct EdgeSet {
  Tensor offsets;  ///< [V + 1] int64, strictly ascending from 0
  Tensor sources;  ///< [E] int64

  std::int64_t targets() const { return offsets.size(0) - 1; }
  std::int64_t size() const { return sources.size(0); }
  EdgeSet to(torch::Device device) const { return {offsets.to(device), sources.to(device)}; }
};

/// For rows in consecutive runs, the run of each. @param offsets [S + 1] int64 ascending from 0 @return [rows] int64
Tensor run_of_rows(const Tensor& offsets);

/// at_target[target of e] + at_source[source of e], the start of a message. On the CPU by hand, since LibTorch 1.13
/// adds gradients of gathered rows one by one.
/// @param at_target [V, C] @param at_source [S, C] floating @return [E, C] @throws InputError for shapes
Tensor edge_sums(const Tensor& at_target, const Tensor& at_source, const EdgeSet& edges);

/// Largest value of each run in each channel; of equal ones the first takes the gradient, and NaN is the largest.
/// @param values [E, C] floating @param offsets [S + 1] int64, strictly ascending from 0 to E @return [S, C]
/// @throws InputError for shapes or an empty run
Tensor run_maxima(const Tensor& values, const Tensor& offsets);

/// The same two by LibTorch's own operators, which other devices use; equal values share the gradient.
Tensor indexed_edge_sums(const Tensor& at_target, const Tensor& at_source, const EdgeSet& edges);
Tensor scattered_maxima(const Tensor& values, const Tensor& offsets);

}  // namespace anigen::models::rignet
