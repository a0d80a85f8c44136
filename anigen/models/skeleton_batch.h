#pragma once
#include <string>
#include <vector>

#include "anigen/nn/ragged.h"
#include "anigen/nn/torch.h"

namespace anigen::models {

/// The skeletons of several assets, one below the other, as the skin models take them. Joint order within an asset is
/// the caller's; a skeleton may have several roots, and a root need not be joint 0.
struct SkeletonBatch {
  torch::Tensor joints;       ///< [ΣJ, 3] object space, float
  torch::Tensor parent_rows;  ///< [ΣJ] int64, row of the parent joint; ΣJ (one past the end) for a root
  torch::Tensor anchor_rows;  ///< [ΣJ] int64, row of the parent joint; for a root, row of its asset's joint 0
  nn::Ragged items{{}};       ///< joints per asset, each at least 1

  /// @param joints per asset [J, 3] floating @param parents per asset [J] integers, -1 for roots
  /// @param file for messages
  /// @throws InputError naming the asset: shapes, dtypes, empty skeletons, parents outside [-1, J), non-finite joints
  static SkeletonBatch from_lists(const std::vector<torch::Tensor>& joints, const std::vector<torch::Tensor>& parents,
                                  const std::string& file = "");

  SkeletonBatch to(torch::Device device) const;
};

}  // namespace anigen::models
